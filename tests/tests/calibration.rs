//! Calibration finds what the simulator put in, says honestly how sure it is, and refuses where the data cannot tell.

use std::path::Path;

use crossfall::calibrate::{self, Drive, Estimate, Surface};
use crossfall::simulate::scene::Scene;
use crossfall::{capture, config, log, run, simulate};
use crossfall_core::protocol::Config;
use crossfall_core::protocol::frame::{Event, HostDecoder, MAX_MESSAGE_FRAME};

const OFFSET_DEG: f64 = 0.8;
const DELAY_US: f64 = 1_500.0;

/// Shorter than the minute of a real test, to keep the tests short.
const SECONDS: f64 = 20.0;

fn rock_test(seed: u64) -> Scene {
    let mut scene = Scene::rock_test(OFFSET_DEG, DELAY_US);
    scene.drive.seed = seed;
    scene.drive.seconds = SECONDS;
    scene.scanner.range_noise_mm = 10.0;
    scene
}

/// The drive of a scene as its log has it, made with a configuration.
fn logged(scene: &Scene, config: &Config, folder: &Path) -> Drive {
    let (capture_path, log_path) = (folder.join("rock.mcap"), folder.join("rock.log.mcap"));
    let mut writer = capture::Writer::create(&capture_path).expect("a capture");
    simulate::simulate(scene, &mut writer, |_| ()).expect("a simulation");
    writer.finish().expect("a whole capture");
    let mut reader = capture::Reader::open(&capture_path).expect("the capture");
    let mut log = log::Writer::create(&log_path).expect("a log");
    run::run(&mut reader, config, &mut log, |_| ()).expect("a run");
    log.finish().expect("a whole log");
    calibrate::read(&log_path).expect("the log")
}

fn calibrated(scene: &Scene, folder: &Path) -> Estimate {
    let drive = logged(scene, &Config::default(), folder);
    calibrate::estimate(&drive, Surface::Assumed).expect("an estimate").0
}

#[test]
fn a_rock_test_tells_offset_and_delay() {
    let scratch = tempfile::tempdir().expect("a scratch folder");
    let found = calibrated(&rock_test(1), scratch.path());
    println!("{found:#?}");
    assert!(found.parked && found.delay_determined && found.offset_determined);
    assert!((found.lidar_delay_us - DELAY_US).abs() < 200.0, "{}", found.lidar_delay_us);
    // The unit's own slow error (0.017 degrees) is the limit of the offset.
    assert!((found.roll_offset_deg - OFFSET_DEG).abs() < 0.05, "{}", found.roll_offset_deg);
    assert!(found.residual_after_deg < found.residual_before_deg);
    // Most of what is left is the ranges' noise: 10 mm over as much even ground as there is, seen from 2.5 m.
    assert!((0.010..0.030).contains(&found.residual_ranges_deg), "{}", found.residual_ranges_deg);
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
fn the_offset_is_as_good_as_the_unit_is_steady() {
    let scratch = tempfile::tempdir().expect("a scratch folder");
    let mut scene = rock_test(4);
    // What is left when the unit does not drift: the ranges and its white noise.
    scene.ins.attitude_drift_deg = 0.0;
    let found = calibrated(&scene, scratch.path());
    assert!((found.roll_offset_deg - OFFSET_DEG).abs() < 0.005, "{}", found.roll_offset_deg);
}

#[test]
fn a_scanner_that_looks_the_other_way_round_is_told_apart_from_data_that_say_nothing() {
    let scratch = tempfile::tempdir().expect("a scratch folder");
    let mut scene = rock_test(6);
    scene.scanner.mirrored = true;
    let wrong = calibrated(&scene, scratch.path());
    assert!(!wrong.delay_determined && !wrong.offset_determined, "{wrong:#?}");
    assert!(wrong.remarks.iter().any(|remark| remark.contains("twice the vehicle's roll")), "{:?}", wrong.remarks);
    assert!(!wrong.remarks.iter().any(|remark| remark.contains("park")), "{:?}", wrong.remarks);
    let mut told = Config::default();
    told.scanner.mirrored = true;
    let drive = logged(&scene, &told, scratch.path());
    let right = calibrate::estimate(&drive, Surface::Assumed).expect("an estimate").0;
    assert!(right.delay_determined && (right.roll_offset_deg - OFFSET_DEG).abs() < 0.05, "{right:#?}");
}

#[test]
fn a_second_calibration_finds_nothing_more() {
    let scratch = tempfile::tempdir().expect("a scratch folder");
    let scene = rock_test(5);
    let first = calibrated(&scene, scratch.path());
    let mut better = Config::default();
    better.scanner = first.scanner(&better.scanner).expect("an offset");
    let text = config::to_toml(&better);
    let read_back = config::parse(Path::new("my.toml"), &text).expect("a configuration that run takes");
    assert_eq!(read_back, better);
    let drive = logged(&scene, &better, scratch.path());
    let second = calibrate::estimate(&drive, Surface::Assumed).expect("an estimate").0;
    // Levelled with the other offset, a few points at three metres are others.
    let change_us = second.lidar_delay_us - first.lidar_delay_us;
    assert!(change_us.abs() < 0.25 * first.lidar_delay_se_us, "{change_us}");
    assert!((second.roll_offset_deg - first.roll_offset_deg).abs() < 2e-3, "{}", second.roll_offset_deg);
    assert!((second.residual_before_deg - second.residual_after_deg).abs() < 1e-4);
}

/// Sums of squared errors in standard errors, of delay and offset, over seeds.
fn honesty(seeds: u64, change: impl Fn(&mut Scene)) -> (f64, f64) {
    let scratch = tempfile::tempdir().expect("a scratch folder");
    let (mut delay, mut offset) = (0.0, 0.0);
    let (mut worst_delay, mut worst_offset) = (0.0_f64, 0.0_f64);
    for seed in 0..seeds {
        let mut scene = rock_test(100 + seed);
        change(&mut scene);
        let found = calibrated(&scene, scratch.path());
        let (delay_error, offset_error) = (found.lidar_delay_us - DELAY_US, found.roll_offset_deg - OFFSET_DEG);
        delay += (delay_error / found.lidar_delay_se_us).powi(2);
        offset += (offset_error / found.roll_offset_se_deg).powi(2);
        worst_delay = worst_delay.max(delay_error.abs());
        worst_offset = worst_offset.max(offset_error.abs());
    }
    println!(
        "{seeds} seeds: squared errors in standard errors sum up to {delay:.1} (delay), {offset:.1} (offset); \
         greatest errors {worst_delay:.0} us, {worst_offset:.4} degrees"
    );
    (delay, offset)
}

#[test]
fn standard_errors_are_honest() {
    let (delay, offset) = honesty(10, |_| ());
    // Ten squared normal deviates lie between 2.2 and 25 in 99 of 100 draws; the seeds are fixed.
    assert!((2.2..25.2).contains(&delay), "{delay}");
    assert!((2.2..25.2).contains(&offset), "{offset}");
}

#[test]
fn standard_errors_are_honest_over_many_seeds() {
    if std::env::var_os("CROSSFALL_LONG").is_none() {
        println!("skipped: fifty rock tests of a minute are done under CROSSFALL_LONG only");
        return;
    }
    // A drift of the published kind, one that is faster, and an error that stays: the offset's standard error must hold for each.
    for (name, drift_s) in [("30 s", 30.0), ("5 s", 5.0), ("constant", 1e5)] {
        let (delay, offset) = honesty(50, |scene| {
            scene.drive.seconds = 60.0;
            scene.ins.attitude_drift_s = drift_s;
        });
        // Fifty squared normal deviates lie between 28 and 79.5 in 99 of 100 draws. A fast drift is averaged out better than the
        // published accuracy lets one claim: there the standard error may be too large, never too small.
        assert!((28.0..79.5).contains(&delay), "{name}: {delay}");
        assert!(offset < 79.5, "{name}: {offset}");
        assert!(drift_s < 30.0 || offset > 28.0, "{name}: {offset}");
    }
}

#[test]
fn a_drive_tells_the_delay_but_hardly_the_offset() {
    let scratch = tempfile::tempdir().expect("a scratch folder");
    let mut scene = Scene::default();
    scene.drive.seed = 7;
    scene.drive.seconds = 30.0;
    // A motorway: its cross slope changes slowly.
    scene.sections.spacing_m = 200.0;
    scene.sections.random.cross_slope_deg = [0.5, 1.5];
    scene.scanner.delay_us = DELAY_US;
    scene.scanner.mounting_offset_deg = OFFSET_DEG;
    let found = calibrated(&scene, scratch.path());
    println!("{found:#?}");
    assert!(!found.parked && found.delay_determined);
    let (delay_error, offset_error) = (found.lidar_delay_us - DELAY_US, found.roll_offset_deg - OFFSET_DEG);
    assert!(delay_error.abs() < 4.0 * found.lidar_delay_se_us, "{delay_error}");
    assert!(offset_error.abs() < 2.0 * found.roll_offset_se_deg, "{offset_error}");
    assert!(!found.offset_determined, "a road's cross slope is not known");
    let old = Config::default().scanner;
    let new = found.scanner(&old).expect("an offset");
    assert_eq!(new.mounting_offset, old.mounting_offset, "what is not known is not put in");
    assert_ne!(new.delay_us, old.delay_us);
    // As an angle these would be others: 80.8 degrees is what 1e9 wraps to.
    for roll_offset_deg in [f64::NAN, f64::INFINITY, 1e9, -90.5] {
        let wrong = Estimate { offset_determined: true, roll_offset_deg, ..found.clone() };
        assert!(wrong.scanner(&old).is_err(), "{roll_offset_deg}");
    }
}

#[test]
fn turning_the_vehicle_round_needs_no_level_ground() {
    let scratch = tempfile::tempdir().expect("a scratch folder");
    let estimates = [(30.0, 1.4), (210.0, -1.4)].map(|(azimuth_deg, to_the_left_deg)| {
        let mut scene = rock_test(8);
        scene.drive.azimuth_deg = azimuth_deg;
        scene.drive.track = Vec::new();
        scene.sections.random.cross_slope_deg = [to_the_left_deg; 2];
        calibrated(&scene, scratch.path())
    });
    assert!(estimates.iter().all(|found| (found.roll_offset_deg - OFFSET_DEG).abs() > 1.0), "each alone is misled");
    let joined = calibrate::join(estimates.into(), 0.0).expect("two rock tests");
    assert!((joined.roll_offset_deg - OFFSET_DEG).abs() < 0.05, "{}", joined.roll_offset_deg);
    assert!(joined.remarks[0].contains("tilt by 1.40"), "{:?}", joined.remarks);
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

#[test]
fn poses_that_no_pulse_has_timed_are_refused_their_delay() {
    let scratch = tempfile::tempdir().expect("a scratch folder");
    let mut drive = logged(&rock_test(6), &Config::default(), scratch.path());
    for pose in &mut drive.poses {
        pose.timed_by_pulse = false;
    }
    let (found, _) = calibrate::estimate(&drive, Surface::Assumed).expect("an estimate");
    assert!(!found.delay_determined);
    assert!(found.remarks.iter().any(|remark| remark.contains("no pulses")), "{:?}", found.remarks);
}

/// Appends the frames of a log to another, as long as it has lasted less than `seconds`, numbered from `first`.
fn append(from: &Path, seconds: f64, first: u16, to: &mut log::Writer) {
    let frames: Vec<_> = log::Reader::open(from).expect("a log").map(|frame| frame.expect("a frame")).collect();
    let end_ns = frames[0].receive_ns.saturating_add((seconds * 1e9) as u64);
    let mut sequence = first;
    for frame in frames.iter().take_while(|frame| frame.receive_ns < end_ns) {
        let (mut decoder, mut bytes, mut room) = (HostDecoder::new(), frame.bytes.as_slice(), [0; MAX_MESSAGE_FRAME]);
        let Some(Event::Frame(received)) = decoder.next(&mut bytes) else { panic!("a good frame") };
        let length = received.body.encode(sequence, &mut room).expect("room for the longest frame");
        to.frame(frame.receive_ns, &room[..length]).expect("a frame");
        sequence = sequence.wrapping_add(1);
    }
}

#[test]
fn boots_within_a_log_do_not_mix() {
    let scratch = tempfile::tempdir().expect("a scratch folder");
    let whole = logged(&rock_test(1), &Config::default(), scratch.path());
    let alone = calibrate::estimate(&whole, Surface::Assumed).expect("an estimate").0;
    let (log, joined) = (scratch.path().join("rock.log.mcap"), scratch.path().join("joined.log.mcap"));
    // A board that is reset after four seconds, and again at the end; then one that was away and comes back with numbers that pass for frames lost.
    for (first, damage) in [(0, 0), (20_000, 1)] {
        let mut writer = log::Writer::create(&joined).expect("a log");
        append(&log, 4.0, 0, &mut writer);
        append(&log, f64::INFINITY, first, &mut writer);
        append(&log, 3.0, 0, &mut writer);
        writer.finish().expect("a whole log");
        let drive = calibrate::read(&joined).expect("the log");
        assert_eq!((drive.scans.len(), drive.damage), (whole.scans.len(), damage));
        assert!(drive.poses.is_sorted_by_key(|pose| pose.time));
        let found = calibrate::estimate(&drive, Surface::Assumed).expect("an estimate").0;
        assert!(found.remarks.iter().any(|remark| remark.contains("of 3 stretches only the longest")), "{found:?}");
        assert_eq!(
            (found.roll_offset_deg, found.lidar_delay_us, found.residual_after_deg),
            (alone.roll_offset_deg, alone.lidar_delay_us, alone.residual_after_deg)
        );
    }
}

#[test]
fn a_unit_that_logs_its_attitude_alone_does_not_tell_that_the_vehicle_stood() {
    let scratch = tempfile::tempdir().expect("a scratch folder");
    let mut drive = logged(&rock_test(1), &Config::default(), scratch.path());
    drive.poses.iter_mut().for_each(|pose| pose.fix = None);
    let found = calibrate::estimate(&drive, Surface::Assumed).expect("an estimate").0;
    assert!(!found.parked && !found.offset_determined && found.delay_determined, "{found:#?}");
    assert!(found.remarks[0].contains("no pose has a velocity"), "{:?}", found.remarks);
    // Who knows the surface has the offset.
    assert!(calibrate::estimate(&drive, Surface::Known(0.0)).expect("an estimate").0.offset_determined);
}
