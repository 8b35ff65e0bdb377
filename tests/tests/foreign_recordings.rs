//! Recordings that differ from what `run` makes. One begins while the board has been surveying for a while, as most do: nothing was lost, so it
//! verifies; only profiles whose inputs came before it are beyond proof. One comes of another build's survey: `verify` says that.

use std::path::Path;

use crossfall::simulate::scene::Scene;
use crossfall::{log, verify};
use crossfall_core::attitude::HISTORY;
use crossfall_core::instrument::WAITING;
use crossfall_core::protocol::Angle;
use crossfall_core::protocol::frame::{Event, HostDecoder, MAX_MESSAGE_FRAME};
use crossfall_core::protocol::message::{Hello, Message, Profile};
use crossfall_tests::drives;

/// A log of a 40 s drive.
fn whole(folder: &Path) -> Vec<log::Frame> {
    let (drive, result) = (folder.join("drive.mcap"), folder.join("drive.log.mcap"));
    let mut scene = Scene::default();
    scene.drive.seconds = 40.0;
    drives::capture(&scene, &drive);
    drives::log(&drive, &result);
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

#[test]
fn a_log_of_another_survey_says_why_it_does_not_recompute() {
    let scratch = tempfile::tempdir().expect("a scratch folder");
    let path = scratch.path().join("other.log.mcap");
    let mut writer = log::Writer::create(&path).expect("a log");
    for frame in whole(scratch.path()) {
        // The firmware of another build, and profiles that differ.
        let mut bytes = frame.bytes.clone();
        let mut rest = &*frame.bytes;
        if let Some(Event::Frame(heard)) = HostDecoder::new().next(&mut rest) {
            let changed = match heard.body {
                Message::Hello(hello) => Message::Hello(Hello { firmware: "crossfall 0.1.0 survey 0", ..hello }),
                Message::Profile(profile) => Message::Profile(Profile { roll: Angle(profile.roll.0 ^ 1), ..profile }),
                other => other,
            };
            bytes = vec![0; MAX_MESSAGE_FRAME];
            let length = changed.encode(heard.sequence, &mut bytes).expect("room");
            bytes.truncate(length);
        }
        writer.frame(frame.receive_ns, &bytes).expect("room on the disk");
    }
    writer.finish().expect("a log");
    let report = verify::verify(&path, |_| ()).expect("a readable log");
    assert!(!report.ok && report.profiles_reproduced == 0);
    assert!(
        report.problems[0].what.starts_with("made by \"crossfall 0.1.0 survey 0\", this is \""),
        "{:?}",
        report.problems[0]
    );
}
