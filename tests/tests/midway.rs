//! Logs that begin while the board is at work, or are pieces of a longer one: nothing that is right is called wrong, and what can be proved is.

use std::path::{Path, PathBuf};

use crossfall::log::{self, Options};
use crossfall::recover::recover;
use crossfall::simulate::scene::Scene;
use crossfall::verify::{Report, verify, verify_all};
use crossfall::{capture, run};
use crossfall_core::instrument::{Event, Instrument};
use crossfall_core::protocol::frame::{MAX_MESSAGE_FRAME, Sequencer};
use crossfall_core::protocol::message::Command;
use crossfall_core::protocol::ranges::MAX_CODE;
use crossfall_core::protocol::{Config, DeviceTime};
use crossfall_tests::drives;

type Frame = (u64, Vec<u8>);

const SECONDS: f64 = 20.0;

fn drive(folder: &Path) -> PathBuf {
    let path = folder.join("drive.mcap");
    let mut scene = Scene::default();
    scene.drive.seconds = SECONDS;
    drives::capture(&scene, &path);
    path
}

/// What the board streams; at `asked_s` a host asks who it is.
fn streamed(capture_path: &Path, config: Config, asked_s: f64) -> Vec<Frame> {
    let mut instrument = Instrument::new(config, run::identity());
    let (mut sequencer, mut frames) = (Sequencer::new(), Vec::new());
    let mut now = 0;
    let mut send = |event: Event<'_>, now: u64| {
        let (mut code, mut frame) = ([0; MAX_CODE], [0; MAX_MESSAGE_FRAME]);
        let length = sequencer.message(&event.message(&mut code), &mut frame).expect("room");
        frames.push((now, frame[..length].to_vec()));
    };
    instrument.start(DeviceTime(0), &mut |event| send(event, 0));
    let mut asked = false;
    for chunk in capture::Reader::open(capture_path).expect("the capture") {
        let chunk = chunk.expect("a chunk");
        now = chunk.device_time_ns;
        let at = DeviceTime(now / 1_000);
        if !asked && now as f64 >= asked_s * 1e9 {
            asked = true;
            instrument.command(0, &Command::Identify, at, &mut |event| send(event, now));
        }
        match chunk.channel {
            capture::Channel::Lidar => instrument.lidar_bytes(at, &chunk.data, &mut |event| send(event, now)),
            capture::Channel::Ins => instrument.ins_bytes(at, &chunk.data, &mut |event| send(event, now)),
            _ => instrument.pps(at, &mut |event| send(event, now)),
        }
    }
    instrument.finish(DeviceTime(now / 1_000), &mut |event| send(event, now));
    frames
}

fn verified(frames: &[Frame], folder: &Path) -> Report {
    let path = folder.join("part.mcap");
    let mut log = log::Writer::create(&path).expect("a log");
    for (time, bytes) in frames {
        log.frame(*time, bytes).expect("room on the disk");
    }
    log.finish().expect("a whole log");
    verify(&path, |_| ()).expect("a log")
}

/// A recorder connects while the survey runs: its first frames are the answer to its question.
#[test]
fn a_recording_that_begins_midway_is_not_called_wrong() {
    let folder = tempfile::tempdir().expect("a scratch folder");
    let capture_path = drive(folder.path());
    let mut config = Config::default();
    config.scanner.delay_us += 700;
    let frames = streamed(&capture_path, config, 7.003);
    let hello = frames.iter().position(|(time, _)| *time >= 7_003_000_000).expect("the answer");
    for begin in [hello, hello - 1, hello - 40, hello - 333] {
        let report = verified(&frames[begin..], folder.path());
        assert_eq!(
            report.problem_count,
            0,
            "from frame {begin}: {:?}",
            &report.problems[..report.problems.len().min(5)]
        );
        // Histories of two seconds and a clock of some: the rest is proved.
        assert!(report.profiles_reproduced > 200, "{report:?}");
        assert_eq!(report.profiles_reproduced + report.profiles_unverifiable, report.profiles);
    }
    let whole = verified(&frames, folder.path());
    assert!(whole.ok, "{:?}", whole.problems);
}

/// One recording in several files: as one stream everything is proved; each alone is not called wrong.
#[test]
fn the_files_of_a_recording_are_one_stream() {
    let folder = tempfile::tempdir().expect("a scratch folder");
    let capture_path = drive(folder.path());
    let mut config = Config::default();
    config.scanner.delay_us += 700;
    let frames = streamed(&capture_path, config, 1e9);
    let first = folder.path().join("a.log.mcap");
    let options = Options { max_ns: 6_000_000_000, ..Options::default() };
    let mut log = log::Writer::create_with(&first, options).expect("a log");
    // What `record` writes when the configuration's frame comes.
    let toml = [("toml".to_owned(), crossfall::config::to_toml(&config))].into();
    log.metadata(log::metadata::CONFIG, toml).expect("room");
    for (time, bytes) in &frames {
        log.frame(*time, bytes).expect("room");
    }
    let parts = log.parts();
    log.finish().expect("a whole log");
    let others: Vec<_> = (2..=parts).map(|part| folder.path().join(format!("a.log.part{part:04}.mcap"))).collect();
    assert!(others.len() >= 3);
    let report = verify_all(&first, &others, |_, _| ()).expect("a log");
    assert!(report.ok, "{:?}", report.problems);
    for alone in &others {
        let report = verify(alone, |_| ()).expect("a log");
        assert_eq!(report.problem_count, 0, "{}: {:?}", alone.display(), report.problems);
        assert!(report.profiles_reproduced > 0, "{report:?}");
    }
    // In the wrong order, or with one missing, it is told.
    assert!(!verify_all(&first, &others[1..], |_, _| ()).expect("a log").ok);
    let mut swapped = others.clone();
    swapped.swap(0, 1);
    assert!(!verify_all(&first, &swapped, |_, _| ()).expect("a log").ok);
    let all: Vec<_> = std::iter::once(first).chain(others).collect();
    let joined = folder.path().join("joined.mcap");
    let report = recover(&all, &joined, |_, _| ()).expect("a log");
    assert!(!report.lost, "{report:?}");
    assert!(verify(&joined, |_| ()).expect("a log").ok);
}
