//! Scans of random road sections under roll, as an LMS 291 in half degrees and millimetres would send them.
//!
//! A road 7-8 m wide with its cross slope, on each side an adjacent slope of 6-10 degrees over 2.5-6 m, a ditch and an
//! opposing slope, flat beyond; the sensor 2-3 m above; roll of 1.5 degrees at 0.8 Hz; the second turn of the mirror
//! 13.32 ms after the first. Beyond 30 m there is no echo. `Grass` raises three in ten points off the road.

#![allow(dead_code, reason = "every test binary uses a part")]

use crossfall_protocol::message::ScanMode;

/// The count word and the mode of these scans.
pub const LAYOUT: u16 = 1 << 14 | 361;
/// See [`LAYOUT`].
pub const MODE: ScanMode = ScanMode { span_deg: 180, step_cdeg: 50, measuring: 6 };

/// What grows beside the road.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Cover {
    /// Nothing.
    Bare,
    /// Grass, and one stray point in a hundred.
    Grass,
}

/// Xorshift (Marsaglia, 2003).
struct Random(u64);

impl Random {
    fn unit(&mut self) -> f64 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        (self.0 >> 11) as f64 / (1_u64 << 53) as f64
    }

    fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.unit()
    }

    fn normal(&mut self) -> f64 {
        (-2.0 * self.unit().max(1e-300).ln()).sqrt() * (std::f64::consts::TAU * self.unit()).cos()
    }
}

/// A section as two polylines from under the sensor outward, (lateral, vertical) in metres from the sensor.
struct Section {
    sides: [Vec<(f64, f64)>; 2],
    edges: [f64; 2],
}

impl Section {
    fn random(random: &mut Random) -> Self {
        let height = random.between(2.0, 3.0);
        let left = random.between(2.5, 4.5);
        let edges = [left, random.between(7.0, 8.0) - left];
        let cross_slope = random.between(-1.8, 1.8).to_radians().tan();
        let mut side = |outward: f64, edge: f64| {
            let mut line = vec![(0.0, -height), (outward * edge, -height + cross_slope * outward * edge)];
            let adjacent = random.between(6.0, 10.0).to_radians();
            let fall = random.between(2.5, 6.0);
            let ditch = random.between(0.001, 1.5);
            let opposing = random.between(6.0, 10.0).to_radians();
            let rise = random.between(3.0, 8.0);
            for (along, up) in [
                (fall * adjacent.cos(), -fall * adjacent.sin()),
                (ditch, 0.0),
                (rise * opposing.cos(), rise * opposing.sin()),
                (60.0, 0.0),
            ] {
                let (y, z) = line[line.len() - 1];
                line.push((y + outward * along, z + up));
            }
            line
        };
        Self { sides: [side(1.0, edges[0]), side(-1.0, edges[1])], edges }
    }

    /// Range along a direction; infinite where nothing is met.
    fn range(&self, (dy, dz): (f64, f64)) -> f64 {
        let mut nearest = f64::INFINITY;
        for ends in self.sides.iter().flat_map(|side| side.windows(2)) {
            let ((y, z), (ey, ez)) = (ends[0], (ends[1].0 - ends[0].0, ends[1].1 - ends[0].1));
            let across = dy * ez - dz * ey;
            let (range, place) = ((y * ez - z * ey) / across, (y * dz - z * dy) / across);
            if range > 0.0 && (0.0..=1.0).contains(&place) {
                nearest = nearest.min(range);
            }
        }
        nearest
    }
}

/// `count` scans, each of its own section, with normal range noise of `sigma_mm`.
pub fn scans(count: usize, sigma_mm: f64, cover: Cover, seed: u64) -> Vec<Vec<u16>> {
    let mut random = Random(seed);
    (0..count).map(|i| scan(&mut random, sigma_mm, cover, i as f64 * 0.194)).collect()
}

fn scan(random: &mut Random, sigma_mm: f64, cover: Cover, start_s: f64) -> Vec<u16> {
    let section = Section::random(random);
    let roll = |time_s: f64| 1.5_f64.to_radians() * (std::f64::consts::TAU * 0.8 * time_s).sin();
    (0..361)
        .map(|beam| {
            let theta_deg = f64::from(beam) * 0.5;
            let turn = if beam % 2 == 1 { 0.01332 } else { 0.0 };
            let angle = theta_deg.to_radians() + roll(start_s + turn + theta_deg / 360.0 * 0.01332);
            let (dy, dz) = (-angle.cos(), -angle.sin());
            let mut range = section.range((dy, dz));
            let y = dy * range;
            if cover == Cover::Grass && range < 30.0 && (y > section.edges[0] || y < -section.edges[1]) {
                if random.unit() < 0.3 {
                    let height = (-0.05 * random.unit().max(1e-300).ln()).min(0.2);
                    range += height / dz.min(-0.01);
                }
                if random.unit() < 0.01 {
                    range *= random.between(0.3, 1.0);
                }
            }
            let value = (range * 1000.0 + sigma_mm * random.normal()).round();
            if range > 30.0 { 32_767 } else { value.max(0.0) as u16 }
        })
        .collect()
}
