//! A drive with a scanner of the other family, from its bytes to slopes: simulated, imported, run, verified, held against the truth.

use std::path::Path;

use crossfall::capture::{Channel, Reader, Writer};
use crossfall::import::import;
use crossfall::live::film::{Film, Shown};
use crossfall::live::{Live, Source};
use crossfall::profiles::{Row, Rows, sides};
use crossfall::scanner::Family;
use crossfall::side::Side;
use crossfall::simulate::scene::{Kind, Scene};
use crossfall::simulate::{self, truth};
use crossfall::track::Position;
use crossfall::{info, log, run, verify};
use crossfall_core::instrument::Event;
use crossfall_core::protocol::Config;
use crossfall_core::protocol::message::Message;

fn scene() -> Scene {
    let mut scene = Scene::default();
    scene.drive.seconds = 6.0;
    scene.scanner.kind = Kind::Lms111;
    scene
}

fn capture(scene: &Scene, path: &Path) -> Vec<truth::Row> {
    let mut capture = Writer::create(path).unwrap();
    let truth = simulate::simulate(scene, &mut capture, |_| ()).unwrap().truth;
    capture.finish().unwrap();
    truth
}

fn rows(capture: &Path, to: &Path) -> (run::Summary, Vec<Row>) {
    let mut writer = log::Writer::create(to).unwrap();
    let ran = run::run(&mut Reader::open(capture).unwrap(), &Config::default(), &mut writer, |_| ()).unwrap();
    writer.finish().unwrap();
    (ran, Rows::open(to).unwrap().collect())
}

/// Bytes of one line of a capture.
fn line(capture: &Path, channel: Channel) -> Vec<u8> {
    let chunks = Reader::open(capture).unwrap().map(Result::unwrap);
    chunks.filter(|chunk| chunk.channel == channel).flat_map(|chunk| chunk.data).collect()
}

#[test]
fn a_drive_with_an_lms_111_is_measured_as_well_as_one_with_an_lms_291() {
    let folder = tempfile::tempdir().unwrap();
    let (drive, to) = (folder.path().join("drive.mcap"), folder.path().join("drive.log.mcap"));
    let truth = capture(&scene(), &drive);
    let (ran, rows) = rows(&drive, &to);
    assert_eq!(ran.family, Family::Cola);
    assert_eq!((truth.len(), ran.status.scans, ran.profiles), (300, 300, 300));
    assert_eq!((ran.status.scans_missing, ran.status.scans_unreadable, ran.status.lidar.bad_frames), (0, 0, 0));

    let report = verify::verify(&to, |_| ()).unwrap();
    assert!(report.ok && report.profiles_reproduced == 300, "{:?}", report.problems);

    let mut squares = Vec::new();
    for row in &rows {
        assert_eq!(row.flags & crossfall_core::protocol::message::flags::PARTIAL_SCAN, 0);
        let section = truth[row.scan as usize].section;
        let side = if row.side == Side::Left { section.left } else { section.right };
        for (found, slope) in [(row.adjacent, side.adjacent_slope_deg), (row.opposing, side.opposing_slope_deg)] {
            squares.extend(found.map(|found| (found.slope_deg - slope).powi(2)));
        }
    }
    // Four slopes a scan. The vehicle rolls by 6 degrees a second at most: had the scan's time been wrong by 10 ms, so had its slopes by 0.06 degrees.
    assert!(squares.len() > 1_100, "{} found", squares.len());
    let rms = (squares.iter().sum::<f64>() / squares.len() as f64).sqrt();
    assert!(rms < 0.06, "{rms}");
    let mean: f64 = rows.iter().filter(|row| row.side == Side::Left).map(|row| row.roll_deg).sum::<f64>() / 300.0;
    let true_mean = truth.iter().map(|row| row.roll_deg).sum::<f64>() / 300.0;
    assert!((mean - true_mean).abs() < 0.01, "{mean} {true_mean}");
}

#[test]
fn a_look_at_its_capture_counts_its_scans() {
    let folder = tempfile::tempdir().unwrap();
    let drive = folder.path().join("drive.mcap");
    capture(&scene(), &drive);
    let found = info::look(&drive).unwrap();
    assert_eq!((found.scans, found.counters["lidar.bad_frames"], found.counters["lidar.skipped"]), (300, 0, 0));
    assert_eq!(found.about["scanner"], Family::Cola.name());
}

#[test]
fn a_capture_of_it_plays_on_the_live_page_as_run_measures_it() {
    let folder = tempfile::tempdir().unwrap();
    let (drive, to) = (folder.path().join("drive.mcap"), folder.path().join("drive.log.mcap"));
    capture(&scene(), &drive);
    let expected: Vec<_> =
        rows(&drive, &to).1.into_iter().filter(|row| row.side == Side::Left).map(|row| row.adjacent).collect();
    let mut film = Film::open(&drive, None).unwrap();
    let mut found = Vec::new();
    film.play(u64::MAX, &mut |shown| {
        if let Shown::Event(Event::Message(Message::Profile(profile))) = shown {
            found.push(sides(&profile, Position::default())[0].adjacent);
        }
    });
    assert!(found == expected && found.len() == 300, "{} profiles", found.len());
    let live = Live::start(&Source::File(drive), folder.path(), 1.0, None).unwrap();
    assert_eq!(live.hub().state().source.kind, "capture");
    live.finish();
    // Wound back to the middle it shows what it had shown there.
    let (first, last) = film.span_ns();
    let mut after = 0;
    film.wind(first.midpoint(last), &mut |_| ()).unwrap();
    film.play(u64::MAX, &mut |shown| {
        after += u32::from(matches!(shown, Shown::Event(Event::Message(Message::Profile(_)))));
    });
    assert!((140..160).contains(&after), "{after}");
}

#[test]
fn roll_is_that_of_the_instant_at_which_the_scanner_looks_down() {
    let folder = tempfile::tempdir().unwrap();
    let (drive, to) = (folder.path().join("drive.mcap"), folder.path().join("drive.log.mcap"));
    let truth = capture(&scene(), &drive);
    for row in rows(&drive, &to).1.iter().filter(|row| row.side == Side::Left) {
        let truth = &truth[row.scan as usize];
        assert!((row.roll_deg - truth.roll_deg).abs() < 0.04, "scan {}: {} {}", row.scan, row.roll_deg, truth.roll_deg);
        assert!((row.time.0 as f64 * 1e-6 - truth.start_device_s).abs() < 20e-6, "scan {}", row.scan);
    }
}

#[test]
fn a_dump_of_its_connection_is_imported_by_its_own_clock() {
    let folder = tempfile::tempdir().unwrap();
    let (drive, imported) = (folder.path().join("drive.mcap"), folder.path().join("imported.mcap"));
    capture(&scene(), &drive);
    let (lidar, ins) = (line(&drive, Channel::Lidar), line(&drive, Channel::Ins));
    assert_eq!((Family::of(&lidar), Family::of(&ins)), (Family::Cola, Family::Lms2xx));
    let mut writer = Writer::create(&imported).unwrap();
    let (found, _) = import(Some(&lidar), Some(&ins), 6, &mut writer).unwrap();
    writer.finish().unwrap();
    let found = found.unwrap();
    assert_eq!((found.family, found.scans, found.missing, found.line.bad_frames), (Family::Cola, 300, 0, 0));
    assert!((found.seconds - 299.0 * 0.02).abs() < 1e-3, "{}", found.seconds);
    assert!(line(&imported, Channel::Lidar) == lidar && line(&imported, Channel::Ins) == ins);
    let (ran, rows) = rows(&imported, &folder.path().join("imported.log.mcap"));
    assert_eq!((ran.family, ran.profiles), (Family::Cola, 300));
    assert!(rows.iter().filter(|row| row.adjacent.is_some()).count() > 500);
}
