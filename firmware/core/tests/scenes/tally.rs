//! Errors of many sections, summed up.

use core::fmt;
use std::time::Instant;

use crossfall_core::profile::{Workspace, measure};
use crossfall_core::protocol::config::Config;
use crossfall_core::protocol::message::{Side, Slope, flags};

use super::{Family, Random, Truth, scene};

/// Errors of one quantity.
#[derive(Clone, Debug, Default)]
pub struct Errors {
    pub values: Vec<f64>,
    pub covered: usize,
    pub expected: usize,
    /// Slopes where there is none, and of these the ones without a flag.
    pub invented: usize,
    pub invented_unflagged: usize,
    /// Off by more than a degree, and of these the ones without any flag on their side.
    pub far: usize,
    pub far_unflagged: usize,
}

impl Errors {
    fn add(&mut self, error: f64, half: f64) {
        self.values.push(error);
        self.covered += usize::from(error.abs() <= half);
    }

    pub fn rms(&self) -> f64 {
        libm::sqrt(self.values.iter().map(|e| e * e).sum::<f64>() / self.values.len().max(1) as f64)
    }

    pub fn median(&self) -> f64 {
        let mut sizes: Vec<f64> = self.values.iter().map(|e| e.abs()).collect();
        sizes.sort_by(f64::total_cmp);
        sizes.get(sizes.len() / 2).copied().unwrap_or(0.0)
    }

    pub fn found(&self) -> f64 {
        100.0 * self.values.len() as f64 / self.expected.max(1) as f64
    }

    pub fn coverage(&self) -> f64 {
        100.0 * self.covered as f64 / self.values.len().max(1) as f64
    }
}

/// The errors of one family of scenes.
pub struct Tally {
    pub name: &'static str,
    pub adjacent: Errors,
    pub opposing: Errors,
    pub edge: Errors,
    pub foot: Errors,
    pub start: Errors,
    pub top: Errors,
    pub us: f64,
    pub flagged: [usize; 16],
    pub sides: usize,
}

pub const HEADER: &str = "set                   | found adj/opp %   | RMS deg       | median        | >1 deg (unflagged) | coverage %    | edge foot start top RMS mm (cover %)            | false | us";

fn degrees(slope: &Slope) -> (f64, f64) {
    let unit = 360.0 / 4_294_967_296.0;
    (f64::from(slope.angle.0) * unit, f64::from(slope.ci95.0) * unit)
}

impl Tally {
    fn side(&mut self, side: &Side, truth: &Truth) {
        self.sides += 1;
        for (bit, count) in self.flagged.iter_mut().enumerate() {
            *count += usize::from(side.flags >> bit & 1 == 1);
        }
        let slope = |errors: &mut Errors, found: &Option<Slope>, expected: Option<f64>| {
            errors.expected += usize::from(expected.is_some());
            match (found, expected) {
                (Some(found), Some(expected)) => {
                    let (angle, half) = degrees(found);
                    errors.add(angle - expected, half);
                    if (angle - expected).abs() > 1.0 {
                        errors.far += 1;
                        errors.far_unflagged += usize::from(side.flags & (flags::DOUBTFUL | flags::OBSTRUCTED) == 0);
                    }
                }
                (Some(_), None) => {
                    errors.invented += 1;
                    errors.invented_unflagged += usize::from(side.flags & (flags::DOUBTFUL | flags::OBSTRUCTED) == 0);
                }
                _ => {}
            }
        };
        slope(&mut self.adjacent, &side.adjacent, Some(truth.adjacent_deg));
        slope(&mut self.opposing, &side.opposing, truth.opposing_deg);
        let place = |errors: &mut Errors, hinge: crossfall_core::protocol::message::Hinge, expected: f64| {
            errors.expected += 1;
            errors.add(f64::from(hinge.y_um.abs()) / 1e3 - expected * 1e3, f64::from(hinge.ci95_um) / 1e3);
        };
        if let Some(adjacent) = &side.adjacent {
            place(&mut self.edge, adjacent.start, truth.edge_m);
            place(&mut self.foot, adjacent.end, truth.foot_m);
        }
        if let (Some(opposing), Some(_)) = (&side.opposing, truth.opposing_deg) {
            place(&mut self.start, opposing.start, truth.opposing_start_m);
            place(&mut self.top, opposing.end, truth.top_m);
        }
    }
}

/// Measures `sections` scenes of a family.
pub fn run(family: &Family, sections: u32, seed: u64) -> Tally {
    let mut random = Random::new(seed);
    let mut tally = Tally {
        name: family.name,
        adjacent: Errors::default(),
        opposing: Errors::default(),
        edge: Errors::default(),
        foot: Errors::default(),
        start: Errors::default(),
        top: Errors::default(),
        us: 0.0,
        flagged: [0; 16],
        sides: 0,
    };
    let config = Config::default();
    let mut work = Workspace::new();
    for index in 0..sections {
        let scene = scene(family, &mut random, index);
        let begin = Instant::now();
        let (left, right, _) = measure(&scene.scan, &scene.track, &config, &mut work);
        tally.us += begin.elapsed().as_secs_f64() * 1e6 / f64::from(sections);
        tally.side(&left, &scene.left);
        tally.side(&right, &scene.right);
    }
    tally
}

impl fmt::Display for Tally {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (a, o) = (&self.adjacent, &self.opposing);
        let place = |e: &Errors| format!("{:.0} ({:.0})", e.rms(), e.coverage());
        writeln!(
            f,
            "{:21} | {:7.2} {:7.2}   | {:.4} {:.4} | {:.4} {:.4} | {:3} ({}) {:3} ({})    | {:5.1} {:5.1}   | {:9} {:9} {:9} {:9} | {} {} | {:.1}",
            self.name,
            a.found(),
            o.found(),
            a.rms(),
            o.rms(),
            a.median(),
            o.median(),
            a.far,
            a.far_unflagged,
            o.far,
            o.far_unflagged,
            a.coverage(),
            o.coverage(),
            place(&self.edge),
            place(&self.foot),
            place(&self.start),
            place(&self.top),
            a.invented,
            o.invented,
            self.us,
        )?;
        let named = flags::NAMES.iter().zip(self.flagged).filter(|(_, n)| *n > 0);
        for (name, count) in named {
            write!(f, "    {name} {:.1} %", 100.0 * count as f64 / self.sides as f64)?;
        }
        writeln!(f)
    }
}
