use std::path::Path;

use crossfall_core::protocol::DeviceTime;
use crossfall_core::sensors::{lms2xx, novatel};

use super::scene::{Mode, Scene};
use super::*;
use crate::capture::Reader;

fn drive(scene: &Scene, folder: &Path) -> (Summary, Vec<crate::capture::Chunk>) {
    let path = folder.join("drive.mcap");
    let mut writer = Writer::create(&path).unwrap();
    let summary = simulate(scene, &mut writer, |_| {}).unwrap();
    writer.finish().unwrap();
    (summary, Reader::open(&path).unwrap().map(Result::unwrap).collect())
}

fn short() -> Scene {
    let mut scene = Scene::default();
    scene.drive.seconds = 3.0;
    scene
}

/// Ranges of every telegram, in millimetres.
fn ranges(chunks: &[crate::capture::Chunk]) -> Vec<Vec<u16>> {
    let mut decoder = lms2xx::Decoder::new(6);
    let mut scans = Vec::new();
    for chunk in chunks.iter().filter(|chunk| chunk.channel == Channel::Lidar) {
        for &byte in &chunk.data {
            decoder.push(byte, DeviceTime(chunk.device_time_ns / 1_000), &mut |event| {
                if let lms2xx::Event::Scan { scan, .. } = event {
                    scans.push(scan.ranges().to_vec());
                }
            });
        }
    }
    assert_eq!((decoder.counters().bad_frames, decoder.counters().skipped, decoder.scans_missing()), (0, 0, 0));
    scans
}

#[test]
fn every_byte_decodes() {
    let folder = tempfile::tempdir().unwrap();
    let (summary, chunks) = drive(&short(), folder.path());
    assert_eq!(summary.truth.len(), 112, "3 s of scans of 26.64 ms");
    assert_eq!(ranges(&chunks).len(), 112);
    let mut decoder = novatel::Decoder::new();
    let (mut solutions, mut times) = (0, 0);
    for chunk in chunks.iter().filter(|chunk| chunk.channel == Channel::Ins) {
        for &byte in &chunk.data {
            decoder.push(byte, DeviceTime(chunk.device_time_ns / 1_000), &mut |event| match event.log {
                novatel::Log::Solution(..) => solutions += 1,
                novatel::Log::Time(_) => times += 1,
                _ => {}
            });
        }
    }
    assert_eq!((decoder.counters().bad_frames, decoder.counters().skipped), (0, 0));
    assert_eq!((solutions, times), (summary.poses, 4));
    assert!(chunks.is_sorted_by_key(|chunk| chunk.device_time_ns));
}

#[test]
fn a_drive_across_the_date_line_goes_on_at_the_other_end_of_longitudes() {
    let folder = tempfile::tempdir().unwrap();
    for (from_deg, azimuth_deg) in [(179.999_6, 90.0), (-179.999_6, 270.0)] {
        let mut scene = short();
        (scene.drive.longitude_deg, scene.drive.azimuth_deg) = (from_deg, azimuth_deg);
        (scene.drive.track, scene.ins.position_drift_m) = (Vec::new(), 1.0);
        let (summary, chunks) = drive(&scene, folder.path());
        let mut decoder = novatel::Decoder::new();
        let mut longitudes = Vec::new();
        for chunk in chunks.iter().filter(|chunk| chunk.channel == Channel::Ins) {
            for &byte in &chunk.data {
                decoder.push(byte, DeviceTime(chunk.device_time_ns / 1_000), &mut |event| {
                    if let novatel::Log::Solution(solution, ..) = event.log {
                        longitudes.extend(solution.fix.map(|fix| fix.longitude_ndeg as f64 * 1e-9));
                    }
                });
            }
        }
        assert_eq!((decoder.counters().bad_frames, longitudes.len() as u64), (0, summary.poses));
        let step = longitudes.windows(2).map(|pair| (pair[1] - pair[0] + 180.0).rem_euclid(360.0) - 180.0);
        assert!(step.map(f64::abs).fold(0.0, f64::max) < 1e-5, "a pose is less than a metre on");
        assert!(longitudes.first().unwrap() * longitudes.last().unwrap() < 0.0, "{from_deg}: on the other side");
    }
}

#[test]
fn the_same_seed_gives_the_same_bytes_and_another_does_not() {
    let folder = tempfile::tempdir().unwrap();
    let (_, first) = drive(&short(), folder.path());
    let (_, again) = drive(&short(), folder.path());
    assert!(first == again);
    let mut other = short();
    other.drive.seed = 2;
    assert!(drive(&other, folder.path()).1 != first);
}

#[test]
fn range_noise_has_the_deviation_asked_for() {
    let folder = tempfile::tempdir().unwrap();
    let mut scene = short();
    scene.drive.speed_m_s = 0.0;
    scene.vehicle.roll.clear();
    scene.scanner.dropout_share = 0.0;
    scene.scanner.range_noise_mm = 10.0;
    let scans = ranges(&drive(&scene, folder.path()).1);
    // Nothing moves: each beam's spread over the scans is the noise, with the rounding to millimetres (1/12 mm^2).
    let mut squares = 0.0;
    let mut count = 0.0;
    for beam in (60..300).filter(|&beam| scans.iter().all(|scan| scan[beam] < 32_000)) {
        let values: Vec<f64> = scans.iter().map(|scan| f64::from(scan[beam])).collect();
        let mean = values.iter().sum::<f64>() / values.len() as f64;
        squares += values.iter().map(|value| (value - mean).powi(2)).sum::<f64>();
        count += values.len() as f64 - 1.0;
    }
    assert!(count > 20_000.0);
    let sd = f64::sqrt(squares / count);
    assert!((sd - 10.004).abs() < 0.15, "{sd}");
}

#[test]
fn dropouts_have_the_share_asked_for() {
    let folder = tempfile::tempdir().unwrap();
    let mut scene = short();
    scene.scanner.dropout_share = 0.1;
    let scans = ranges(&drive(&scene, folder.path()).1);
    let dropped = scans.iter().flatten().filter(|&&value| value == lms::WEAK_ECHO).count();
    let hit = scans.iter().flatten().filter(|&&value| value < 32_000).count();
    let share = dropped as f64 / (dropped + hit) as f64;
    assert!((share - 0.1).abs() < 0.01, "{share}");
}

#[test]
fn pulses_follow_the_drifting_clock() {
    let folder = tempfile::tempdir().unwrap();
    let mut scene = short();
    scene.clock.drift_ppm = 40.0;
    scene.clock.start_s = 4_294.0;
    let (_, chunks) = drive(&scene, folder.path());
    let pulses: Vec<_> =
        chunks.iter().filter(|chunk| chunk.channel == Channel::Pps).map(|chunk| chunk.device_time_ns).collect();
    assert_eq!(pulses, [4_294_000_000_000, 4_295_000_040_000, 4_296_000_080_000, 4_297_000_120_000]);
}

#[test]
fn beams_of_a_rolling_scan_lie_on_the_ground_at_their_own_instant() {
    let folder = tempfile::tempdir().unwrap();
    let mut scene = short();
    scene.scanner.range_noise_mm = 0.0;
    scene.scanner.dropout_share = 0.0;
    scene.scanner.mounting_offset_deg = 1.25;
    scene.sections.mode = Mode::RandomPerScan;
    let (summary, chunks) = drive(&scene, folder.path());
    let attitude = Attitude::new(&scene.vehicle, &mut Noise::new(scene.drive.seed, Purpose::Motion));
    for (row, values) in summary.truth.iter().zip(ranges(&chunks)) {
        let start_s = (row.start_device_s - scene.clock.start_s) / (1.0 + scene.clock.drift_ppm * 1e-6);
        for (i, value) in values.iter().enumerate().filter(|(_, value)| **value < 32_000) {
            // The convention of the design, written out once more.
            let t = start_s + i as f64 / 2.0 / 360.0 * 0.013_32 + (i % 2) as f64 * 0.013_32;
            let phi = (i as f64 / 2.0 + attitude.roll_deg(t) + 1.25).to_radians();
            let r = f64::from(*value) / 1_000.0;
            let (y, z) = (-r * phi.cos(), -r * phi.sin());
            let ground = row.section.ground(y >= 0.0);
            let pair = ground.windows(2).find(|pair| y.abs() <= pair[1].0).unwrap();
            let on = pair[0].1 + (y.abs() - pair[0].0) * (pair[1].1 - pair[0].1) / (pair[1].0 - pair[0].0);
            assert!((z - on).abs() < 0.001, "scan {} beam {i}: {z} at {y}, expected {on}", row.scan);
        }
    }
}

#[test]
fn grass_is_off_the_road_and_above_the_ground() {
    let folder = tempfile::tempdir().unwrap();
    let mut scene = short();
    scene.vehicle.roll.clear();
    scene.scanner.range_noise_mm = 0.0;
    scene.scanner.dropout_share = 0.0;
    scene.sections.mode = Mode::RandomPerScan;
    scene.vegetation.share = 0.3;
    let (summary, chunks) = drive(&scene, folder.path());
    let (mut raised, mut all) = (0.0, 0.0);
    for (row, values) in summary.truth.iter().zip(ranges(&chunks)) {
        for (i, value) in values.iter().enumerate().filter(|(_, value)| **value < 32_000) {
            let phi = (i as f64 / 2.0).to_radians();
            let r = f64::from(*value) / 1_000.0;
            let (y, z) = (-r * phi.cos(), -r * phi.sin());
            let (side, ground) =
                (if y >= 0.0 { row.section.left } else { row.section.right }, row.section.ground(y >= 0.0));
            let pair = ground.windows(2).find(|pair| y.abs() <= pair[1].0).unwrap();
            let above = z - pair[0].1 - (y.abs() - pair[0].0) * (pair[1].1 - pair[0].1) / (pair[1].0 - pair[0].0);
            assert!(above > -0.001);
            if y.abs() < side.edge_m - 1.5 {
                assert!(above < 0.001, "nothing grows on the road");
            } else if y.abs() > side.edge_m {
                all += 1.0;
                raised += if above > 0.002 { 1.0 } else { 0.0 };
            }
        }
    }
    // An exponential height of mean 50 mm is below 2 mm in 4 % of cases.
    assert!((raised / all - 0.29_f64).abs() < 0.02, "{}", raised / all);
}

#[test]
fn the_example_scenes_are_accepted_and_the_default_one_is_the_default() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes");
    let mut count = 0;
    for entry in std::fs::read_dir(&folder).unwrap() {
        let path = entry.unwrap().path();
        // The one for 3-D frames is of another kind.
        if path.file_name().is_some_and(|name| name != "terrain.toml") {
            Scene::read(&path).unwrap();
            count += 1;
        }
    }
    assert!(count >= 3);
    assert_eq!(Scene::read(&folder.join("default.toml")).unwrap(), Scene::default());
}

#[test]
fn a_scene_that_cannot_be_is_refused_with_its_key() {
    let refuse = |text: &str| {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.toml");
        std::fs::write(&path, text).unwrap();
        let error = Scene::read(&path).unwrap_err().to_string();
        assert!(!error.contains('\n'), "{error}");
        error.split_once("a.toml").unwrap().1.to_owned()
    };
    assert!(refuse("[scanner]\nrange_noise = 3").starts_with(":2: unknown field `range_noise`, expected one of"));
    assert_eq!(refuse("[scanner]\nmax_range_m = 80.0"), ": scanner.max_range_m = 80, expected a number from 1 to 32");
    assert_eq!(
        refuse("[sections.random]\nditch_m = [2.0, 1.0]"),
        ": sections.random.ditch_m = [2, 1], expected two numbers from 0 to 50, the lower first"
    );
    assert!(refuse("[ins]\nbaud = 115200\nrate_hz = 200").contains("ins.baud = 115200, expected at least"));
    assert!(refuse("[drive]\nseconds = \"long\"").starts_with(":2: invalid type: string"));
    assert!(refuse("[drive").starts_with(":1: "));
}
