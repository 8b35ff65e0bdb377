//! Simulated LMS scans of random road sections with known truth, in double precision: the oracle of the accuracy tests.
//!
//! A section is a polyline seen from the sensor at the origin. Every beam is cast at its own instant's roll
//! (interlaced turns included) and gets normal range noise, vegetation, strays, dropouts and the scanner's rounding.
#![allow(dead_code)]

mod random;
pub mod tally;

use crossfall_core::protocol::message::ScanMode;
use crossfall_core::protocol::{Angle, DeviceTime};
use crossfall_core::scan::{KNOTS, MAX_BEAMS, MAX_TURNS, RawScan, RollTrack};
pub use random::Random;

/// What makes one set of scenes differ from another. Lengths in metres, angles in degrees.
#[derive(Clone, Debug)]
pub struct Family {
    pub name: &'static str,
    /// One sigma of a range.
    pub noise_m: f64,
    /// One sigma of the surface about its line.
    pub roughness_m: f64,
    /// Part of the off-road returns that vegetation raises (exponential, mean 50 mm, at most 200 mm).
    pub grass: f64,
    /// Part of the off-road returns that come from somewhere else along their beam.
    pub strays: f64,
    /// Part of the beams without an echo.
    pub dropouts: f64,
    /// Roll is drawn within this, its rate within four times this a second.
    pub roll_deg: f64,
    pub slopes_deg: (f64, f64),
    pub adjacent_m: (f64, f64),
    pub ditch_m: (f64, f64),
    pub opposing_m: (f64, f64),
    pub has_opposing: bool,
    /// The road edge is a parabola over this length instead of a corner.
    pub rounded_m: f64,
    /// A rail 0.45 to 0.75 m above the ground, 0.3 m beyond the edge.
    pub guardrail: bool,
    /// Micrometres in a unit of range: 1,000 or 10,000.
    pub unit_um: i32,
    /// One sigma of the height of undulations beyond the road's edge, and their shortest and longest wave.
    pub undulation_m: f64,
    pub waves_m: (f64, f64),
    /// The road lies in a cut: the adjacent slope rises, level ground follows.
    pub cut: bool,
}

impl Family {
    /// The sets of the comparison with other methods.
    pub fn plain(name: &'static str, noise_m: f64) -> Self {
        Self {
            name,
            noise_m,
            roughness_m: 0.0,
            grass: 0.0,
            strays: 0.0,
            dropouts: 0.0,
            roll_deg: 1.5,
            slopes_deg: (6.0, 10.0),
            adjacent_m: (2.5, 6.0),
            ditch_m: (0.0, 1.5),
            opposing_m: (3.0, 8.0),
            has_opposing: true,
            rounded_m: 0.0,
            guardrail: false,
            unit_um: 1_000,
            undulation_m: 0.0,
            waves_m: (2.0, 12.0),
            cut: false,
        }
    }

    pub fn grass(name: &'static str, noise_m: f64) -> Self {
        Self { grass: 0.3, strays: 0.01, ..Self::plain(name, noise_m) }
    }
}

/// The true section on one side, going outward: signed like the results (positive rises outward), distances outward.
#[derive(Clone, Copy, Debug)]
pub struct Truth {
    pub road_deg: f64,
    pub edge_m: f64,
    pub adjacent_deg: f64,
    pub foot_m: f64,
    pub opposing_start_m: f64,
    pub opposing_deg: Option<f64>,
    pub top_m: f64,
}

/// One simulated scan.
pub struct Scene {
    pub scan: RawScan,
    pub track: RollTrack,
    pub left: Truth,
    pub right: Truth,
}

type Vertex = (f64, f64);

fn tan(degrees: f64) -> f64 {
    libm::tan(degrees.to_radians())
}

/// One side's vertices going outward, after the road edge at (`edge`, `z`).
fn side(family: &Family, random: &mut Random, edge: f64, road_deg: f64, height: f64) -> (Vec<Vertex>, Truth) {
    let draw = |random: &mut Random, (from, to)| random.uniform(from, to);
    let inclination_deg = draw(random, family.slopes_deg);
    let adjacent_deg = if family.cut { inclination_deg } else { -inclination_deg };
    let opposing_deg = draw(random, family.slopes_deg);
    let along = |degrees: f64, length: f64| {
        (length * libm::cos(degrees.to_radians()), length * libm::sin(degrees.to_radians()))
    };
    let z = -height + edge * tan(road_deg);
    let (run, rise) = along(adjacent_deg, draw(random, family.adjacent_m));
    let foot = (edge + run, z + rise);
    let ditch = (foot.0 + draw(random, family.ditch_m), foot.1);
    let (run, rise) = along(opposing_deg, draw(random, family.opposing_m));
    let has_opposing = family.has_opposing && !family.cut;
    let top = if has_opposing { (ditch.0 + run, ditch.1 + rise) } else { ditch };
    let mut vertices = Vec::new();
    if family.rounded_m > 0.0 {
        // The parabola that touches both lines half the length from where they meet.
        let (half, road, slope) = (family.rounded_m / 2.0, tan(road_deg), tan(adjacent_deg));
        for k in 0..=20 {
            let along = -half + family.rounded_m * f64::from(k) / 20.0;
            let bend = (along + half) * (along + half) * (slope - road) / (2.0 * family.rounded_m);
            vertices.push((edge + along, z + along * road + bend));
        }
    } else {
        vertices.push((edge, z));
    }
    vertices.extend([foot, ditch, top, (top.0 + 80.0, top.1)]);
    let truth = Truth {
        road_deg,
        edge_m: edge,
        adjacent_deg,
        foot_m: foot.0,
        opposing_start_m: ditch.0,
        opposing_deg: has_opposing.then_some(opposing_deg),
        top_m: top.0,
    };
    if family.undulation_m > 0.0 {
        return undulating(family, random, &vertices, truth);
    }
    (vertices, truth)
}

/// The side with undulations on it: 24 plane waves in random directions, wavelengths evenly spread in their logarithm, fading in over half a
/// metre from the edge. The true slope is then that of the best line over the whole of it.
fn undulating(family: &Family, random: &mut Random, vertices: &[Vertex], truth: Truth) -> (Vec<Vertex>, Truth) {
    const WAVES: u32 = 24;
    const STEP_M: f64 = 0.05;
    let (shortest, longest) = family.waves_m;
    let waves: Vec<(f64, f64)> = (0..WAVES)
        .map(|i| {
            let length = shortest * libm::pow(longest / shortest, (f64::from(i) + 0.5) / f64::from(WAVES));
            let turn = core::f64::consts::TAU;
            (turn / length * libm::cos(turn * random.uniform(0.0, 1.0)), turn * random.uniform(0.0, 1.0))
        })
        .collect();
    let amplitude = family.undulation_m * libm::sqrt(2.0 / f64::from(WAVES));
    let height = |u: f64| {
        let fade = ((u - truth.edge_m) / 0.5).clamp(0.0, 1.0);
        fade * fade
            * (3.0 - 2.0 * fade)
            * amplitude
            * waves.iter().map(|(k, phase)| libm::sin(k * u + phase)).sum::<f64>()
    };
    let ground = |u: f64| {
        let pair = vertices.windows(2).find(|pair| u <= pair[1].0).unwrap_or(&vertices[vertices.len() - 2..]);
        let (a, b) = (pair[0], pair[1]);
        let part = if b.0 > a.0 { (u - a.0) / (b.0 - a.0) } else { 0.0 };
        a.1 + part * (b.1 - a.1) + height(u)
    };
    let slope_deg = |from: f64, to: f64| {
        let places: Vec<f64> = (0..=80).map(|i| from + (to - from) * f64::from(i) / 80.0).collect();
        let mean = (from + to) / 2.0;
        let product: f64 = places.iter().map(|u| (u - mean) * ground(*u)).sum();
        let spread: f64 = places.iter().map(|u| (u - mean) * (u - mean)).sum();
        libm::atan(product / spread).to_degrees()
    };
    let truth = Truth {
        adjacent_deg: slope_deg(truth.edge_m, truth.foot_m),
        opposing_deg: truth.opposing_deg.map(|_| slope_deg(truth.opposing_start_m, truth.top_m)),
        ..truth
    };
    let steps = ((truth.top_m + 12.0 - truth.edge_m) / STEP_M) as u32;
    let mut ground: Vec<Vertex> =
        (0..=steps).map(|i| truth.edge_m + f64::from(i) * STEP_M).map(|u| (u, ground(u))).collect();
    ground.extend(vertices.last().copied());
    (ground, truth)
}

/// The first crossing of a ray from the origin with the polyline: range, and range gained for a metre of raised ground.
fn cast(direction: Vertex, lines: &[Vec<Vertex>]) -> Option<(f64, f64)> {
    let mut first: Option<(f64, f64)> = None;
    for line in lines {
        for pair in line.windows(2) {
            let (a, b) = (pair[0], pair[1]);
            let edge = (b.0 - a.0, b.1 - a.1);
            let denominator = direction.0 * edge.1 - direction.1 * edge.0;
            if denominator.abs() < 1e-12 {
                continue;
            }
            let range = (a.0 * edge.1 - a.1 * edge.0) / denominator;
            let place = (a.0 * direction.1 - a.1 * direction.0) / denominator;
            if range > 0.0 && (0.0..1.0).contains(&place) && first.is_none_or(|(best, _)| range < best) {
                // A line raised by h is met where (a + (0, h)) x edge = range (direction x edge).
                first = Some((range, -edge.0 / denominator));
            }
        }
    }
    first
}

/// Draws a scene of a family.
pub fn scene(family: &Family, random: &mut Random, index: u32) -> Scene {
    let height = random.uniform(2.0, 3.0);
    let left_edge = random.uniform(2.5, 4.5);
    let right_edge = random.uniform(7.0, 8.0) - left_edge;
    let cross_deg = random.uniform(-1.8, 1.8);
    let (left_line, left) = side(family, random, left_edge, cross_deg, height);
    let (right_line, right) = side(family, random, right_edge, -cross_deg, height);
    let mut ground: Vec<Vertex> = right_line.iter().rev().map(|&(y, z)| (-y, z)).collect();
    ground.extend(left_line.iter().copied());
    let mut lines = vec![ground];
    if family.guardrail {
        for (truth, mirror) in [(&left, 1.0), (&right, -1.0)] {
            let y = truth.edge_m + 0.3;
            let z = -height + truth.edge_m * tan(truth.road_deg) + 0.3 * tan(truth.adjacent_deg);
            lines.push(vec![(mirror * y, z + 0.45), (mirror * (y + 0.05), z + 0.6), (mirror * y, z + 0.75)]);
        }
    }
    let roll_deg = random.uniform(-family.roll_deg, family.roll_deg);
    let rate_deg = random.uniform(-4.0 * family.roll_deg, 4.0 * family.roll_deg);
    let roll_at = |ns: i32| (roll_deg + rate_deg * f64::from(ns) * 1e-9).to_radians();

    let mut scan = RawScan {
        index,
        stx: DeviceTime(1_000_000 + 26_640 * u64::from(index)),
        layout: 361 | if family.unit_um == 1_000 { 1 << 14 } else { 0 },
        mode: ScanMode { span_deg: 180, step_cdeg: 50, measuring: 6 },
        status: 0x10,
        counters: None,
        values: [0; MAX_BEAMS],
    };
    for beam in 0..scan.beams() {
        let angle = f64::from(scan.beam_cdeg(beam)).to_radians() / 100.0 + roll_at(scan.beam_ns(beam));
        let direction = (-libm::cos(angle), -libm::sin(angle));
        let mut value = 32_767;
        if let Some((mut range, per_raise)) = cast(direction, &lines) {
            let place = range * direction.0;
            let off_road = place > left_edge || place < -right_edge;
            range += per_raise * family.roughness_m * random.normal();
            if off_road && random.chance(family.grass) {
                range += per_raise * random.exponential(0.05).min(0.2);
            }
            if off_road && random.chance(family.strays) {
                range *= random.uniform(0.4, 1.05);
            }
            range += family.noise_m * random.normal();
            let dropped = random.chance(family.dropouts);
            if range < 30.0 && range > 0.0 && !dropped {
                value = libm::round(range * 1e6 / f64::from(family.unit_um)) as u16;
            }
        }
        scan.values[beam] = value;
    }
    let mut track = RollTrack::constant(Angle::ZERO);
    for turn in 0..scan.turns().min(MAX_TURNS) {
        for knot in 0..KNOTS {
            let roll = roll_at(RollTrack::knot_ns(&scan, turn, knot));
            track.knots[turn][knot] = Angle((roll / core::f64::consts::TAU * 4_294_967_296.0).round() as i32);
        }
    }
    Scene { scan, track, left, right }
}
