//! Random roadsides, each drawn from its seed: scanned medians, and points that are unkind to a search.

#![allow(dead_code, reason = "shared by tests, bench and example, none of which draws every kind")]

use crossfall_core::scan::{Point, resample};

/// A small generator with a full period of 2^64 (Weyl sequence through a mixing function).
pub struct Draw(u64);

impl Draw {
    pub fn new(seed: u64) -> Self {
        Self(seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) ^ 0x5851_f42d_4c95_7f2d)
    }

    pub fn bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mixed = (self.0 ^ self.0 >> 32).wrapping_mul(0xd6e8_feb8_6659_fd93);
        let mixed = (mixed ^ mixed >> 32).wrapping_mul(0xd6e8_feb8_6659_fd93);
        mixed ^ mixed >> 32
    }

    /// In 0 to 1.
    pub fn unit(&mut self) -> f64 {
        (self.bits() >> 11) as f64 / (1_u64 << 53) as f64
    }

    pub fn within(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.unit()
    }

    /// A whole number, both ends included.
    pub fn whole(&mut self, low: i32, high: i32) -> i32 {
        low + (self.bits() % (i64::from(high) - i64::from(low) + 1) as u64) as i32
    }

    pub fn chance(&mut self, probability: f64) -> bool {
        self.unit() < probability
    }

    /// Standard normal, from twelve uniforms.
    pub fn normal(&mut self) -> f64 {
        (0..12).map(|_| self.unit()).sum::<f64>() - 6.0
    }
}

/// How a median is scanned.
#[derive(Clone, Copy)]
pub struct Scanning {
    /// Beams a degree.
    pub beams: f64,
    /// Standard deviation of a range.
    pub range_sigma_m: f64,
    /// Whether vegetation grows: 30 % of off-road points raised, 1 % strays.
    pub grass: bool,
}

/// One side of a random median: its points and the true slopes.
pub struct Median {
    pub points: Vec<Point>,
    pub adjacent_deg: f64,
    pub opposing_deg: f64,
}

/// A random median: sensor 2-3 m high, road edge at 2.5-4.5 m, cross slope up to 1.8 degrees, adjacent slope of 6-10 degrees over
/// 2.5-6 m, ditch of 0-1.5 m, opposing slope of 6-10 degrees over 3-8 m, flat beyond; ranges in whole millimetres to 30 m.
pub fn median(seed: u64, scanning: Scanning) -> Median {
    let mut draw = Draw::new(seed);
    let cross = draw.within(-1.8, 1.8).to_radians().tan();
    let adjacent_deg = -draw.within(6.0, 10.0);
    let opposing_deg = draw.within(6.0, 10.0);
    let height = draw.within(2.0, 3.0);
    let edge = draw.within(2.5, 4.5);
    let foot = edge + draw.within(2.5, 6.0);
    let ditch = foot + draw.within(0.0, 1.5);
    let top = ditch + draw.within(3.0, 8.0);
    let stretches = [
        (-8.0, edge, cross),
        (edge, foot, adjacent_deg.to_radians().tan()),
        (foot, ditch, 0.0),
        (ditch, top, opposing_deg.to_radians().tan()),
        (top, 40.0, 0.0),
    ];
    let mut corners = vec![(-8.0, -height - 8.0 * cross)];
    for (from, to, slope) in stretches {
        let (_, z) = corners[corners.len() - 1];
        corners.push((to, z + (to - from) * slope));
    }
    let mut points = Vec::new();
    let beams = (100.0 * scanning.beams) as i32;
    for beam in (-(10.0 * scanning.beams) as i32)..beams {
        // Down is 0; the side's beams turn outward.
        let (sin, cos) = (f64::from(beam) / scanning.beams).to_radians().sin_cos();
        let hit = corners.windows(2).find_map(|ends| {
            let ((y0, z0), (y1, z1)) = (ends[0], ends[1]);
            let (dy, dz) = (y1 - y0, z1 - z0);
            let turned = sin * dz + cos * dy;
            let along = -(sin * z0 + cos * y0) / turned;
            let range = (y0 * dz - z0 * dy) / turned;
            ((0.0..1.0).contains(&along) && range > 0.0).then_some(range)
        });
        let Some(mut range) = hit else { continue };
        if scanning.grass && range * sin > edge {
            // What stands up by h shortens the range by h over the sine of the grazing angle.
            if draw.chance(0.3) {
                let blade = (-0.05 * (1.0 - draw.unit()).ln()).min(0.2);
                range -= (blade / cos.max(0.15)).min(0.5 * range);
            }
            if draw.chance(0.01) {
                range *= draw.within(0.3, 1.0);
            }
        }
        range += scanning.range_sigma_m * draw.normal();
        let range_um = (range * 1e3).round() * 1e3;
        if (0.0..30e6).contains(&range_um) {
            points.push(Point { y_um: (range_um * sin).round() as i32, z_um: (-range_um * cos).round() as i32 });
        }
    }
    Median { points, adjacent_deg, opposing_deg }
}

/// Resampled to a spacing as the instrument does it.
pub fn resampled(points: &[Point], spacing_um: i32) -> Vec<Point> {
    let mut samples = resample::Samples::new();
    resample(points.iter().copied(), spacing_um, &mut samples);
    samples.to_vec()
}

/// Kinds of points that are unkind to a search.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Unkind {
    /// Straight stretches of random inclination with noise and spikes, at a regular spacing.
    Stretches,
    /// Few heights on a coarse grid: ties everywhere.
    Grid,
    /// Points at exact thresholds from lines of rational inclination and length, or one micrometre off.
    Thresholds,
    /// A random walk that turns back, runs vertically and repeats points.
    Walk,
    /// A bow on which many lines score alike.
    Bow,
    /// A walk in reversed or shuffled order.
    Disorder,
    /// Points out to the limits of the integers among others.
    Huge,
    /// None to four points.
    Few,
}

pub const UNKIND: [Unkind; 8] = [
    Unkind::Stretches,
    Unkind::Grid,
    Unkind::Thresholds,
    Unkind::Walk,
    Unkind::Bow,
    Unkind::Disorder,
    Unkind::Huge,
    Unkind::Few,
];

/// Points of a kind, at most about `most` of them.
pub fn unkind(kind: Unkind, seed: u64, most: i32) -> Vec<Point> {
    let mut draw = Draw::new(seed ^ (kind as u64) << 56);
    let count = draw.whole(most / 3, most);
    match kind {
        Unkind::Stretches => stretches(&mut draw, count),
        Unkind::Grid => grid(&mut draw, count),
        Unkind::Thresholds => thresholds(&mut draw, count),
        Unkind::Walk => walk(&mut draw, count),
        Unkind::Bow => bow(&mut draw, count),
        Unkind::Disorder => {
            let mut points = if draw.chance(0.5) { stretches(&mut draw, count) } else { walk(&mut draw, count) };
            if draw.chance(0.5) {
                points.reverse();
            } else {
                for k in 0..points.len() {
                    let near = (k as i32 + draw.whole(-3, 3)).clamp(0, points.len() as i32 - 1);
                    points.swap(k, near as usize);
                }
            }
            points
        }
        Unkind::Huge => {
            let mut points = if draw.chance(0.5) { stretches(&mut draw, count) } else { walk(&mut draw, count) };
            for p in &mut points {
                if draw.chance(0.1) {
                    // A draw of bits shifted by a draw: every magnitude, both signs.
                    let shift = draw.whole(0, 31);
                    p.z_um = draw.bits() as i32 >> shift;
                    if draw.chance(0.3) {
                        p.y_um = draw.bits() as i32 >> draw.whole(0, 31);
                    }
                }
            }
            points
        }
        Unkind::Few => walk(&mut draw, seed as i32 % 5),
    }
}

fn stretches(draw: &mut Draw, count: i32) -> Vec<Point> {
    let spacing_um = f64::from(draw.whole(50, 400)) * 1e3;
    let noise_um = draw.within(0.0, 30e3);
    let (mut z, mut slope) = (-2e6, 0.0);
    (0..count)
        .map(|k| {
            if draw.chance(0.08) {
                slope = draw.within(-20.0, 20.0).to_radians().tan();
            }
            z += slope * spacing_um;
            let spike = if draw.chance(0.02) { draw.within(-4e5, 4e5) } else { 0.0 };
            let noise = noise_um * draw.normal();
            Point { y_um: (f64::from(k) * spacing_um) as i32, z_um: (z + spike + noise) as i32 }
        })
        .collect()
}

fn grid(draw: &mut Draw, count: i32) -> Vec<Point> {
    let (spacing_um, step_um) = (draw.whole(1, 4) * 100_000, draw.whole(1, 5) * 5_000);
    let mut level = 0;
    let trend = draw.whole(-2, 2);
    (0..count)
        .map(|k| {
            level += trend + draw.whole(-1, 1);
            Point { y_um: k * spacing_um, z_um: level * step_um }
        })
        .collect()
}

/// Directions with whole hypotenuse, 5 to 17 degrees: offsets of 25, 50 and 250 mm along their normals are whole micrometres.
const RATIONAL: [(i32, i32, i32); 4] = [(24, 7, 25), (40, 9, 41), (60, 11, 61), (180, 19, 181)];

fn thresholds(draw: &mut Draw, count: i32) -> Vec<Point> {
    let (run, rise, hypotenuse) = RATIONAL[draw.whole(0, 3) as usize];
    let sign = if draw.chance(0.5) { 1 } else { -1 };
    // 1.5 m in `division` steps: lengths come out at the exact limits.
    let division = draw.whole(3, 12);
    (0..count)
        .map(|k| {
            let (along, across) = (1_500_000 * i64::from(k) / i64::from(division), {
                let size = [0, 0, 0, 25_000, 25_000, 50_000, 250_000][draw.whole(0, 6) as usize];
                i64::from(if draw.chance(0.5) { size } else { -size })
            });
            let off = if draw.chance(0.2) { draw.whole(-1, 1) } else { 0 };
            let (run, rise, hypotenuse) = (i64::from(run), i64::from(rise * sign), i64::from(hypotenuse));
            Point {
                y_um: ((along * run - across * rise) / hypotenuse) as i32,
                z_um: ((along * rise + across * run) / hypotenuse) as i32 + off,
            }
        })
        .collect()
}

fn walk(draw: &mut Draw, count: i32) -> Vec<Point> {
    let stride_um = draw.whole(1, 5) * 80_000;
    let mut p = Point { y_um: draw.whole(-300_000, 300_000), z_um: -2_000_000 };
    let mut slope = draw.within(-0.3, 0.3);
    (0..count)
        .map(|_| {
            match draw.whole(0, 19) {
                0 => p.z_um += draw.whole(-500_000, 500_000),
                1 => p.y_um -= draw.whole(0, 300_000),
                2 | 3 => {}
                4 => p.y_um += draw.whole(0, 3),
                5 => slope = draw.within(-0.4, 0.4),
                _ => {
                    let stride = draw.whole(0, stride_um);
                    p.y_um += stride;
                    p.z_um += (f64::from(stride) * slope) as i32 + draw.whole(-15_000, 15_000);
                }
            }
            p
        })
        .collect()
}

fn bow(draw: &mut Draw, count: i32) -> Vec<Point> {
    let spacing = 10e6 / f64::from(count.max(1)) * draw.within(0.5, 2.0);
    let radius = 10_f64.powf(draw.within(6.5, 8.5)) * if draw.chance(0.5) { 1.0 } else { -1.0 };
    let slope = draw.within(-0.3, 0.3);
    let noise = if draw.chance(0.5) { 0.0 } else { draw.within(0.0, 20e3) };
    (0..count)
        .map(|k| {
            let y = f64::from(k) * spacing;
            Point { y_um: y as i32, z_um: (slope * y + y * y / (2.0 * radius) + noise * draw.normal()) as i32 }
        })
        .collect()
}
