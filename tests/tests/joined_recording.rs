//! A recording that begins while the board has been surveying for a while, as most do: nothing was lost, so it verifies; only profiles whose
//! inputs came before it are beyond proof.

use std::path::Path;

use crossfall::simulate::scene::Scene;
use crossfall::{capture, log, run, simulate, verify};
use crossfall_core::attitude::HISTORY;
use crossfall_core::instrument::WAITING;
use crossfall_core::protocol::Config;

/// A log of a 40 s drive.
fn whole(folder: &Path) -> Vec<log::Frame> {
    let (drive, result) = (folder.join("drive.mcap"), folder.join("drive.log.mcap"));
    let mut scene = Scene::default();
    scene.drive.seconds = 40.0;
    let mut writer = capture::Writer::create(&drive).expect("a capture");
    simulate::simulate(&scene, &mut writer, |_| ()).expect("a drive");
    writer.finish().expect("a capture");
    let mut reader = capture::Reader::open(&drive).expect("a capture");
    let mut writer = log::Writer::create(&result).expect("a log");
    run::run(&mut reader, &Config::default(), &mut writer, |_| ()).expect("a run");
    writer.finish().expect("a log");
    log::Reader::open(&result).expect("a log").map(|frame| frame.expect("whole")).collect()
}

/// The log as one who came after so many frames would have it: the board says who it is and how it is configured, and goes on.
fn joined(folder: &Path, frames: &[log::Frame], after: usize) -> verify::Report {
    let path = folder.join(format!("joined-{after}.mcap"));
    let mut writer = log::Writer::create(&path).expect("a log");
    for frame in &frames[after..] {
        writer.frame(frame.receive_ns, &frame.bytes).expect("room on the disk");
    }
    writer.finish().expect("a log");
    verify::verify(&path, |_| ()).expect("a readable log")
}

#[test]
fn a_recording_that_begins_in_the_middle_verifies() {
    let scratch = tempfile::tempdir().expect("a scratch folder");
    let frames = whole(scratch.path());
    assert_eq!(joined(scratch.path(), &frames, 0).profiles_unverifiable, 0);
    for after in [3, 10, 200, 777, 2_000, 3_001] {
        let report = joined(scratch.path(), &frames, after);
        assert_eq!(report.problems, [], "after {after} frames");
        assert!(report.ok && report.profiles_reproduced > 0, "{report:?}");
        assert_eq!(report.profiles_reproduced + report.profiles_unverifiable, report.profiles);
        // What the histories hold, in scans, and those that had been waiting.
        let most = HISTORY.div_ceil(2) + 2 * WAITING;
        assert!(report.profiles_unverifiable as usize <= most, "{} unverifiable", report.profiles_unverifiable);
    }
}
