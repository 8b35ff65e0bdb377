//! The rock test (the paper's figures 5 and 6): the vehicle is rocked by two degrees once a second for a minute while it stands on level ground.

use super::pipeline::Bench;
use super::{Error, Line, Picture, RANGE_NOISE_MM, Report, limit};
use crate::calibrate::{self, DRAWN_SCANS, Drive, Estimate, Sample, Surface};
use crate::plot;
use crate::simulate::scene::Scene;
use crossfall_core::protocol::Config;

/// What the simulated scanner is mounted and delayed by.
const OFFSET_DEG: f64 = 0.8;
const DELAY_US: f64 = 1_500.0;

/// The scanner's height, and how far to both sides the ground is even, in metres: so far it is looked at.
const HEIGHT_M: f64 = 2.5;
const REACH_M: f64 = 4.0;

/// The scene of a rock test.
fn scene(bench: &Bench, range_noise_mm: f64) -> Scene {
    let mut scene = Scene::rock_test(OFFSET_DEG, DELAY_US);
    scene.drive.seed = bench.seed;
    scene.drive.seconds = bench.seconds(60.0);
    scene.scanner.range_noise_mm = range_noise_mm;
    scene.sections.random.height_m = [HEIGHT_M; 2];
    scene
}

fn estimated(bench: &Bench, name: &str, scene: &Scene) -> Result<(Drive, Estimate, Vec<Sample>), Error> {
    let captured = bench.drive(name, scene)?;
    let log = bench.log(name, &captured, &Config::default())?;
    let drive = calibrate::read(&log)?;
    let (found, samples) = calibrate::estimate(&drive, Surface::Assumed)?;
    Ok((drive, found, samples))
}

pub fn run(bench: &Bench, report: &mut Report) -> Result<(), Error> {
    for range_noise_mm in RANGE_NOISE_MM {
        let scene = scene(bench, range_noise_mm);
        let (drive, found, samples) = estimated(bench, "rock", &scene)?;
        let ranges = limit::ground_deg(HEIGHT_M, REACH_M, range_noise_mm * 1e-3);
        let roll = limit::roll_within_deg(&scene.ins, scene.drive.seconds);
        let residual = ranges.hypot(roll);
        // The delay's bound: noise of a scan over the roll rate, by the square root of the scans.
        let fast = ranges.hypot(scene.ins.attitude_white_deg);
        let delay_us = fast / found.roll_rate_rms_deg_s / (found.scans as f64).sqrt() * 1e6;
        let mut line = |quantity: &str, paper, crossfall, limit, unit| {
            report.lines.push(Line {
                experiment: "rock test",
                quantity: quantity.to_owned(),
                range_noise_mm: Some(range_noise_mm),
                paper,
                crossfall,
                seed_search: None,
                limit,
                unit,
            });
        };
        let most = samples.iter().map(|s| s.after_deg.abs()).fold(0.0, f64::max);
        line("residual after correction, sd", Some(0.03), found.residual_after_deg, Some(residual), "deg");
        line("residual before correction, sd", None, found.residual_before_deg, None, "deg");
        line("greatest error of one scan", Some(0.2), most, Some(EXPECTED_MOST * residual), "deg");
        line("delay: error; limit one sigma", None, (found.lidar_delay_us - DELAY_US).abs(), Some(delay_us), "us");
        line("delay: stated standard error", None, found.lidar_delay_se_us, Some(delay_us), "us");
        let unit = limit::roll_mean_deg(&scene.ins, scene.drive.seconds);
        let error = (found.roll_offset_deg - OFFSET_DEG).abs();
        line("offset: error; limit one sigma", None, error, Some(unit), "deg");
        line("offset: stated standard error", None, found.roll_offset_se_deg, Some(unit), "deg");
        if range_noise_mm == RANGE_NOISE_MM[0] {
            pictures(&drive, &found, &samples, report)?;
        }
    }
    let mut scene = scene(bench, 0.0);
    scene.scanner.dropout_share = 0.0;
    (scene.ins.attitude_drift_deg, scene.ins.attitude_white_deg) = (0.0, 0.0);
    let (_, found, _) = estimated(bench, "rock", &scene)?;
    let mut line = |quantity: &str, crossfall, limit, unit| {
        report.lines.push(Line {
            experiment: "rock test",
            quantity: quantity.to_owned(),
            range_noise_mm: Some(0.0),
            paper: None,
            crossfall,
            seed_search: None,
            limit: Some(limit),
            unit,
        });
    };
    // Ranges are whole millimetres even of a perfect scanner.
    let rounding = limit::ground_deg(HEIGHT_M, REACH_M, 1e-3 / 12_f64.sqrt());
    line("perfect sensors: residual, sd", found.residual_after_deg, rounding, "deg");
    line("perfect sensors: error of the delay", (found.lidar_delay_us - DELAY_US).abs(), 0.0, "us");
    line("perfect sensors: error of the offset", (found.roll_offset_deg - OFFSET_DEG).abs(), 0.0, "deg");
    Ok(())
}

/// The greatest of 2252 normal errors, in standard deviations: its expectation.
const EXPECTED_MOST: f64 = 3.54;

fn pictures(drive: &Drive, found: &Estimate, samples: &[Sample], report: &mut Report) -> Result<(), Error> {
    let note = format!(
        "3.5 mm range noise; residual {:.4}\u{b0} sd before, {:.4}\u{b0} after taking out {:.0} us of delay",
        found.residual_before_deg, found.residual_after_deg, found.lidar_delay_us
    );
    let title = "Rock test: roll by the inertial unit, slope by the scanner";
    report.pictures.push(Picture::new(
        "validation-rock",
        "Rock test: roll by the inertial unit and slope of the ground by the scanner, and the residual before and after the correction",
        |theme| calibrate::picture(samples, title, &note, theme),
    )?);
    let layers = calibrate::layers(drive, found)?;
    let note = format!("{DRAWN_SCANS} scans spread over the test, 3.5 mm range noise, seen from behind");
    report.pictures.push(Picture::new(
        "validation-ground",
        "Points of the ground under the rocked vehicle: as measured, with roll taken out, with roll and delay taken out",
        |theme| plot::layers(&layers, "The ground under the rocked vehicle", &note, theme),
    )?);
    Ok(())
}
