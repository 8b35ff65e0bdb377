//! Calibration finds what the simulator put in, says honestly how sure it is, and refuses where the data cannot tell.

use std::path::Path;

use crossfall::calibrate::{self, Estimate, Surface};
use crossfall::simulate::scene::{Oscillation, Scene};
use crossfall::{capture, log, run, simulate};
use crossfall_core::protocol::Config;

const OFFSET_DEG: f64 = 0.8;
const DELAY_US: f64 = 1_500.0;

/// Shorter than the minute of a real test, to keep the tests short.
const SECONDS: f64 = 20.0;

/// The vehicle is rocked by two degrees once a second while it stands on level ground.
fn rock_test(seed: u64) -> Scene {
    let mut scene = Scene::default();
    scene.drive.seed = seed;
    scene.drive.seconds = SECONDS;
    scene.drive.speed_m_s = 0.0;
    scene.vehicle.roll = vec![Oscillation { amplitude_deg: 2.0, frequency_hz: 1.0 }];
    scene.vehicle.pitch = Vec::new();
    scene.scanner.mounting_offset_deg = OFFSET_DEG;
    scene.scanner.delay_us = DELAY_US;
    scene.scanner.range_noise_mm = 10.0;
    scene.sections.random.cross_slope_deg = [0.0, 0.0];
    scene
}

fn calibrated(scene: &Scene, folder: &Path) -> Estimate {
    let (capture_path, log_path) = (folder.join("rock.mcap"), folder.join("rock.log.mcap"));
    let mut writer = capture::Writer::create(&capture_path).expect("a capture");
    simulate::simulate(scene, &mut writer, |_| ()).expect("a simulation");
    writer.finish().expect("a whole capture");
    let mut reader = capture::Reader::open(&capture_path).expect("the capture");
    let mut log = log::Writer::create(&log_path).expect("a log");
    run::run(&mut reader, &Config::default(), &mut log, |_| ()).expect("a run");
    log.finish().expect("a whole log");
    let drive = calibrate::read(&log_path).expect("the log");
    calibrate::estimate(&drive, Surface::Assumed).expect("an estimate").0
}

#[test]
fn a_rock_test_tells_offset_and_delay() {
    let scratch = tempfile::tempdir().expect("a scratch folder");
    let found = calibrated(&rock_test(1), scratch.path());
    println!("{found:#?}");
    assert!(found.parked && found.delay_determined);
    assert!((found.lidar_delay_us - DELAY_US).abs() < 200.0, "{}", found.lidar_delay_us);
    // The unit's own slow error (0.017 degrees) is the limit of the offset.
    assert!((found.roll_offset_deg - OFFSET_DEG).abs() < 0.05, "{}", found.roll_offset_deg);
    assert!(found.residual_after_deg < found.residual_before_deg);
}

#[test]
fn with_perfect_sensors_the_processing_leaves_nothing() {
    let scratch = tempfile::tempdir().expect("a scratch folder");
    let mut scene = rock_test(2);
    scene.scanner.range_noise_mm = 0.0;
    scene.ins.attitude_drift_deg = 0.0;
    scene.ins.attitude_white_deg = 0.0;
    let found = calibrated(&scene, scratch.path());
    println!("{found:#?}");
    assert!((found.lidar_delay_us - DELAY_US).abs() < 5.0, "{}", found.lidar_delay_us);
    assert!((found.roll_offset_deg - OFFSET_DEG).abs() < 0.001, "{}", found.roll_offset_deg);
    assert!(found.residual_after_deg < 0.003, "{}", found.residual_after_deg);
}

#[test]
fn standard_errors_are_honest() {
    let scratch = tempfile::tempdir().expect("a scratch folder");
    let seeds = 10;
    let (mut delay, mut offset) = (0.0, 0.0);
    for seed in 0..seeds {
        let found = calibrated(&rock_test(100 + seed), scratch.path());
        delay += ((found.lidar_delay_us - DELAY_US) / found.lidar_delay_se_us).powi(2);
        offset += ((found.roll_offset_deg - OFFSET_DEG) / found.roll_offset_se_deg).powi(2);
    }
    // Ten squared normal deviates lie between 2.2 and 25 in 99 of 100 draws; the seeds are fixed.
    println!("sum of squared errors in standard errors: delay {delay:.1}, offset {offset:.1}");
    assert!((2.2..25.2).contains(&delay), "{delay}");
    assert!((1.0..25.2).contains(&offset), "{offset}");
}

#[test]
fn a_vehicle_at_rest_is_refused_its_delay() {
    let scratch = tempfile::tempdir().expect("a scratch folder");
    let mut scene = rock_test(3);
    scene.vehicle.roll = Vec::new();
    let found = calibrated(&scene, scratch.path());
    assert!(!found.delay_determined);
    assert!(found.remarks.iter().any(|remark| remark.contains("cannot be told")), "{:?}", found.remarks);
    assert!((found.roll_offset_deg - OFFSET_DEG).abs() < 0.1);
}
