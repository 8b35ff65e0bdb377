//! Medians with grass, held against measurements by hand (the paper's figure 7a, actual medians).
//!
//! V-shaped medians whose centre is 10 to 15 m from the vehicle, on undulating ground, 30 % of the returns from grass (exponential heights of mean 50 mm, at
//! most 200) and 1 % strays. Every 10 m an inclinometer of 1.22 m is laid on the middle of either slope; it presses the grass down and shows
//! the ground it covers to 0.1 degrees. What it shows is not the slope of the whole, which is what the scanner measures: most of the paper's
//! 0.62 degrees is that, and crossfall's error against the whole slope stands beside it.

use std::fmt::Write as _;

use super::pipeline::{BOTH_METHODS, Bench};
use super::surface_truth::{self, TrueSlope};
use super::{Error, Line, Picture, RANGE_NOISE_MM, Report, limit, mean_magnitude};
use crate::compare::{Drive, Kind, Options, Sides, manual};
use crate::output;
use crate::plot::{self, Words};
use crate::side::Side;
use crate::simulate::scene::{Random, Scene, Surface, Vegetation};
use crate::simulate::{surface, truth};
use crate::statistics::rms;

/// From one measurement by hand to the next.
const APART_M: f64 = 10.0;

/// Height of the undulations, one sigma: what a three-metre straightedge on a graded slope shows is about twice that.
const UNDULATION_MM: f64 = 8.0;

/// Share of off-road returns from the ground itself.
const GROUND_SHARE: f64 = 0.69;

/// The road of this experiment and of the repeat drives.
pub fn scene(bench: &Bench, seconds: f64, range_noise_mm: f64) -> Scene {
    let mut scene = Scene::default();
    scene.drive.seed = bench.seed;
    scene.drive.seconds = bench.seconds(seconds);
    scene.scanner.range_noise_mm = range_noise_mm;
    scene.sections.seed = Some(bench.seed);
    scene.sections.surface = Surface { undulation_mm: UNDULATION_MM, wavelength_m: [3.0, 15.0], ..Surface::default() };
    scene.sections.random = Random {
        left_edge_m: [4.0, 5.0],
        road_width_m: [8.5, 9.5],
        adjacent_length_m: [5.0, 8.0],
        ditch_m: [0.0, 0.0],
        opposing_length_m: [5.0, 8.0],
        ..Random::default()
    };
    scene.vegetation = Vegetation { share: 0.3, stray_share: 0.01, ..Vegetation::default() };
    scene
}

pub fn run(bench: &Bench, report: &mut Report) -> Result<(), Error> {
    for range_noise_mm in RANGE_NOISE_MM {
        let scene = scene(bench, 60.0, range_noise_mm);
        let surface = surface_truth::surface(&scene);
        let captured = bench.drive("medians", &scene)?;
        let truth = &captured.made.truth;
        let (mut table, mut by_position) = (String::from("side,slope,slope_deg,station_m\n"), Vec::new());
        let mut next_m = truth.first().map_or(0.0, |row| row.station_m) + APART_M;
        for row in truth.iter() {
            if row.station_m < next_m {
                continue;
            }
            next_m += APART_M;
            for kind in Kind::BOTH {
                let slope = TrueSlope::of(row, &surface, kind);
                let (from, to) = slope.ends();
                let read = slope.by_hand_deg((from + to) / 2.0);
                by_position.push(read - slope.whole_deg());
                let _ = writeln!(table, "left,{},{read:.1},{:.3}", kind.name(), row.station_m);
            }
        }
        let path = bench.file("medians.csv");
        output::write(&path, table.as_bytes())?;
        let list = manual::read(&path)?;
        let options = Options { sides: Sides::One(Side::Left), within_m: 0.5, over_m: None };
        let (mut held, mut judged) = (Vec::new(), Vec::new());
        for method in BOTH_METHODS {
            let drive = bench.profiles("medians", &captured, method)?;
            held.push(manual::hold(&drive, drive.way().as_ref(), &list, &options, false));
            judged.push(Judged::of(&drive, truth, &surface));
        }
        let sigma_m = range_noise_mm * 1e-3;
        let bounds: Vec<f64> = truth
            .iter()
            .step_by(20)
            .flat_map(|row| Kind::BOTH.map(|k| limit::slope_deg(&row.section, Side::Left, k, sigma_m, GROUND_SHARE)))
            .collect();
        let one = rms(bounds.iter().copied()).hypot(scene.ins.attitude_drift_deg);
        let by_hand = by_position.iter().map(|d| d.abs()).sum::<f64>() / by_position.len().max(1) as f64;
        let mut line = |quantity: &str, paper, values: [f64; 2], limit| {
            report.lines.push(Line {
                experiment: "medians with grass",
                quantity: quantity.to_owned(),
                range_noise_mm: Some(range_noise_mm),
                paper,
                crossfall: values[0],
                seed_search: Some(values[1]),
                limit: Some(limit),
                unit: "deg",
            });
        };
        let of = |part: fn(&manual::Manual) -> f64| [part(&held[0]), part(&held[1])];
        line("mean difference from the inclinometer", Some(0.62), of(|h| h.all.mean_absolute_deg), by_hand);
        let both = |part: fn(&Judged) -> f64| [part(&judged[0]), part(&judged[1])];
        line("mean error against the whole slope, one scan", None, both(Judged::of_whole), mean_magnitude(one));
        line("mean error over the stretch that is reported", None, both(Judged::of_stretch), mean_magnitude(one));
        let mut share = |quantity: &str, values: [f64; 2], limit| {
            report.lines.push(Line {
                experiment: "medians with grass",
                quantity: quantity.to_owned(),
                range_noise_mm: Some(range_noise_mm),
                paper: None,
                crossfall: values[0],
                seed_search: Some(values[1]),
                limit,
                unit: "share",
            });
        };
        let of_all = (2 * truth.len()) as f64;
        share("slopes found and not flagged doubtful", both(|j| j.whole.len() as f64).map(|n| n / of_all), Some(1.0));
        share("slopes found and flagged doubtful", both(|j| j.doubtful as f64).map(|n| n / of_all), None);
        if range_noise_mm == RANGE_NOISE_MM[1] {
            picture(&held[0], report)?;
        }
    }
    Ok(())
}

/// A drive's slopes on the left held against the truth.
#[derive(Clone, Debug, Default)]
pub struct Judged {
    /// Errors against the best line over the whole slope, in degrees.
    pub whole: Vec<f64>,
    /// Errors against the best line over the stretch that the drive reports as the slope.
    pub stretch: Vec<f64>,
    /// Slopes that are left out because they say themselves unreliable.
    pub doubtful: usize,
}

impl Judged {
    pub fn of(drive: &Drive, truth: &[truth::Row], surface: &surface::Surface) -> Self {
        let mut judged = Self::default();
        for row in drive.rows.iter().filter(|row| row.side == Side::Left) {
            let Some(truth) = truth.get(row.scan as usize) else { continue };
            for kind in Kind::BOTH {
                let Some(found) = kind.of(row) else { continue };
                if !row.is_reliable() {
                    judged.doubtful += 1;
                    continue;
                }
                let slope = TrueSlope::of(truth, surface, kind);
                let to = found.end_y_m.abs();
                let from = to - found.length_m * found.slope_deg.to_radians().cos();
                judged.whole.push(found.slope_deg - slope.whole_deg());
                judged.stretch.push(found.slope_deg - slope.between_deg(from, to));
            }
        }
        judged
    }

    fn of_whole(&self) -> f64 {
        mean_size(&self.whole)
    }

    fn of_stretch(&self) -> f64 {
        mean_size(&self.stretch)
    }
}

fn mean_size(values: &[f64]) -> f64 {
    values.iter().map(|value| value.abs()).sum::<f64>() / values.len().max(1) as f64
}

fn picture(held: &manual::Manual, report: &mut Report) -> Result<(), Error> {
    let note = format!(
        "10 mm range noise, 30 % grass; mean difference {:.2}\u{b0}, the paper\u{2019}s 0.62\u{b0}",
        held.all.mean_absolute_deg
    );
    let words = Words {
        title: "Medians with grass",
        note: &note,
        first: "by the inclinometer on 1.22 m, \u{b0}",
        other: "by the scanner on the whole slope, \u{b0}",
    };
    report.pictures.push(Picture::new(
        "validation-medians",
        "Slopes of medians by the scanner against those by an inclinometer on part of the slope",
        |theme| plot::agreement(&held.held, &words, theme),
    )?);
    Ok(())
}
