//! One inertial unit in the vehicle and one on the scanner (the paper's figure 2).
//!
//! The paper moved one unit and drove the path twice, so that its RMS difference holds the difference of two drives. Here both units are on one drive,
//! the second mounted with the paper's mean difference, the scanner's frame flexing by a hundredth of a degree.

use super::pipeline::Bench;
use super::{Error, Line, Picture, Report, limit};
use crate::compare::attitude;
use crate::simulate::scene::{Ins, Oscillation, Scene};

/// How differently the second unit is mounted: the paper's mean difference.
const MOUNTED_DEG: f64 = 0.22;

/// How far the scanner's frame flexes.
const FLEX: Oscillation = Oscillation { amplitude_deg: 0.01, frequency_hz: 7.0 };

pub fn run(bench: &Bench, report: &mut Report) -> Result<(), Error> {
    let mut scene = Scene::default();
    scene.drive.seed = bench.seed;
    scene.drive.seconds = bench.seconds(60.0);
    scene.vehicle.flex = vec![FLEX];
    scene.ins2 = Some(Ins { roll_bias_deg: MOUNTED_DEG, ..Ins::default() });
    let captured = bench.drive("two-units", &scene)?;
    let found = attitude::compare(&captured.path)?;
    let seconds = scene.drive.seconds;
    let both = core::f64::consts::SQRT_2;
    let flex_rms = FLEX.amplitude_deg / core::f64::consts::SQRT_2;
    let line = |quantity: &str, paper, crossfall, limit| Line {
        experiment: "two units",
        quantity: quantity.to_owned(),
        range_noise_mm: None,
        paper,
        crossfall,
        seed_search: None,
        limit: Some(limit),
        unit: "deg",
    };
    let mean_limit = both * limit::roll_mean_deg(&scene.ins, seconds);
    let rms_limit = (both * limit::roll_within_deg(&scene.ins, seconds)).hypot(flex_rms);
    report.lines.extend([
        line("mean difference of roll (0.22 was simulated)", Some(0.22), found.roll.mean_deg, MOUNTED_DEG),
        line("its error; limit one sigma", None, (found.roll.mean_deg - MOUNTED_DEG).abs(), mean_limit),
        line("RMS difference about the mean", Some(0.13), found.roll.rms_deg, rms_limit),
    ]);
    let title = "Roll by a unit in the vehicle and one on the scanner";
    report.pictures.push(Picture::new(
        "validation-two-units",
        "Roll by two inertial units on one drive, and their difference",
        |theme| found.picture(title, &found.said(), theme),
    )?);
    Ok(())
}
