//! `verify` finds what is wrong with a log, names it and its place, and calls nothing else wrong.

use std::path::{Path, PathBuf};

use crossfall::verify::{Report, verify};
use crossfall::{capture, log};
use crossfall_core::protocol::frame::{Event, HostDecoder, MAX_MESSAGE_FRAME};
use crossfall_core::protocol::message::Message;
use crossfall_tests::drives;
use crossfall_tests::recordings;

/// One frame of a log: receive time and bytes.
type Frame = (u64, Vec<u8>);

/// The frames of the first six seconds of the example.
fn good_log(folder: &Path) -> Option<Vec<Frame>> {
    let recordings = recordings("capture")?;
    let reader = capture::Reader::open(&recordings.join("example.mcap")).expect("the capture");
    let short = folder.join("short.mcap");
    let mut writer = capture::Writer::create(&short).expect("a capture");
    for chunk in reader.map(|chunk| chunk.expect("a chunk")).take_while(|chunk| chunk.device_time_ns < 6_000_000_000) {
        writer.write(chunk.channel, chunk.device_time_ns, &chunk.data).expect("room on the disk");
    }
    writer.finish().expect("a whole capture");
    let path = folder.join("good.mcap");
    drives::log(&short, &path);
    let frames = log::Reader::open(&path).expect("the log").map(|frame| frame.expect("a frame"));
    Some(frames.map(|frame| (frame.receive_ns, frame.bytes)).collect())
}

fn verified(frames: &[Frame], folder: &Path) -> Report {
    let path: PathBuf = folder.join("changed.mcap");
    let mut log = log::Writer::create(&path).expect("a log");
    for (receive_ns, bytes) in frames {
        log.frame(*receive_ns, bytes).expect("room on the disk");
    }
    log.finish().expect("a whole log");
    verify(&path, |_| ()).expect("a readable log")
}

/// Decodes a frame, lets `change` alter its message, and encodes it again under its own number: a fault that no check sum sees.
fn altered(bytes: &[u8], change: impl FnOnce(&mut Message<'_>)) -> Vec<u8> {
    let mut decoder = HostDecoder::new();
    let Some(Event::Frame(frame)) = decoder.next(&mut &bytes[..]) else { panic!("a good frame") };
    let mut message = frame.body;
    change(&mut message);
    let mut out = [0; MAX_MESSAGE_FRAME];
    let length = message.encode(frame.sequence, &mut out).expect("room");
    out[..length].to_vec()
}

fn is(bytes: &[u8], wanted: impl Fn(&Message<'_>) -> bool) -> bool {
    let mut decoder = HostDecoder::new();
    matches!(decoder.next(&mut &bytes[..]), Some(Event::Frame(frame)) if wanted(&frame.body))
}

/// Number of the `n`-th frame that is wanted.
fn find(frames: &[Frame], n: usize, wanted: impl Fn(&Message<'_>) -> bool) -> usize {
    let places = frames.iter().enumerate().filter(|(_, (_, bytes))| is(bytes, &wanted));
    places.map(|(place, _)| place).nth(n).expect("such a frame")
}

#[test]
fn a_good_log_is_good() {
    let scratch = tempfile::tempdir().expect("a scratch folder");
    let Some(frames) = good_log(scratch.path()) else { return };
    let report = verified(&frames, scratch.path());
    assert!(report.ok, "{:?}", report.problems);
    assert_eq!(report.frames, frames.len() as u64);
    assert!(report.profiles > 150 && report.profiles_reproduced == report.profiles);
}

#[test]
fn a_flipped_bit_is_one_broken_frame_at_its_place() {
    let scratch = tempfile::tempdir().expect("a scratch folder");
    let Some(mut frames) = good_log(scratch.path()) else { return };
    let hit = find(&frames, 40, |message| matches!(message, Message::Scan(_)));
    frames[hit].1[20] ^= 0x10;
    let report = verified(&frames, scratch.path());
    assert!(!report.ok);
    assert_eq!((report.bad_frames, report.missing_frames), (1, 1));
    assert_eq!(report.problems[0].frame, hit as u64);
    assert!(report.problems[0].what.contains("broken frame"), "{:?}", report.problems);
    // Nothing that can still be proved is called wrong: the scan's own profile is the only one that lost its input.
    let wrong = report.problems.iter().filter(|problem| problem.what.contains("does not recompute")).count();
    assert_eq!(wrong, 0, "{:?}", report.problems);
    assert!(report.profiles_unverifiable <= 1, "{}", report.profiles_unverifiable);
}

#[test]
fn a_missing_frame_is_told_where_the_sequence_jumps() {
    let scratch = tempfile::tempdir().expect("a scratch folder");
    let Some(mut frames) = good_log(scratch.path()) else { return };
    let hit = find(&frames, 100, |message| matches!(message, Message::Pose(_)));
    frames.drain(hit..hit + 3);
    let report = verified(&frames, scratch.path());
    assert!(!report.ok);
    assert_eq!((report.bad_frames, report.missing_frames), (0, 3));
    let problem = &report.problems[0];
    assert_eq!((problem.frame, problem.what.as_str()), (hit as u64, "3 frames missing before this one"));
    assert!(problem.offset > 0);
    assert!(
        report.problems.iter().all(|problem| !problem.what.contains("does not recompute")),
        "{:?}",
        report.problems
    );
}

#[test]
fn a_forged_profile_is_found_out() {
    let scratch = tempfile::tempdir().expect("a scratch folder");
    let Some(mut frames) = good_log(scratch.path()) else { return };
    let hit = find(&frames, 60, |message| matches!(message, Message::Profile(_)));
    frames[hit].1 = altered(&frames[hit].1, |message| {
        let Message::Profile(profile) = message else { panic!("a profile") };
        let slope = profile.left.adjacent.as_mut().expect("an adjacent slope");
        slope.angle.0 += 1;
    });
    let report = verified(&frames, scratch.path());
    assert_eq!(report.profiles_reproduced + 1, report.profiles);
    assert_eq!(report.problems.len(), 1, "{:?}", report.problems);
    assert_eq!(report.problems[0].frame, hit as u64);
    assert!(report.problems[0].what.contains("left side differs"), "{:?}", report.problems);
}

#[test]
fn a_range_changed_by_one_unit_breaks_its_profile_alone() {
    let scratch = tempfile::tempdir().expect("a scratch folder");
    let Some(mut frames) = good_log(scratch.path()) else { return };
    let hit = find(&frames, 60, |message| matches!(message, Message::Scan(_)));
    let mut decoder = HostDecoder::new();
    let (_, bytes) = &frames[hit];
    let Some(Event::Frame(frame)) = decoder.next(&mut &bytes[..]) else { panic!("a good frame") };
    let Message::Scan(mut scan) = frame.body else { panic!("a scan") };
    let mut values = [0; crossfall_core::protocol::ranges::MAX_VALUES];
    let count = scan.values(&mut values).expect("a good code").len();
    for value in &mut values[170..190] {
        *value += 40;
    }
    let mut room = [0; crossfall_core::protocol::ranges::MAX_CODE];
    scan.code = crossfall_core::protocol::ranges::encode(scan.layout, scan.mode, &values[..count], &mut room);
    let mut out = [0; MAX_MESSAGE_FRAME];
    let length = Message::Scan(scan).encode(frame.sequence, &mut out).expect("room");
    frames[hit].1 = out[..length].to_vec();
    let report = verified(&frames, scratch.path());
    assert_eq!(report.profiles_reproduced + 1, report.profiles, "{:?}", report.problems);
    assert_eq!(report.problems.len(), 1, "{:?}", report.problems);
}

#[test]
fn time_that_goes_back_is_told() {
    let scratch = tempfile::tempdir().expect("a scratch folder");
    let Some(mut frames) = good_log(scratch.path()) else { return };
    let hit = find(&frames, 3, |message| matches!(message, Message::Status(_)));
    frames[hit].1 = altered(&frames[hit].1, |message| {
        let Message::Status(status) = message else { panic!("a status") };
        status.time.0 -= 2_000_000;
    });
    frames[hit + 5].0 -= 1_000_000_000;
    let report = verified(&frames, scratch.path());
    let said: Vec<_> = report.problems.iter().map(|problem| (problem.frame, problem.what.as_str())).collect();
    assert_eq!(said.len(), 2, "{said:?}");
    assert!(
        said[0].0 == hit as u64 && said[0].1.contains("time goes back") && said[0].1.contains("status"),
        "{said:?}"
    );
    assert!(said[1].0 == hit as u64 + 5 && said[1].1.contains("receive time goes back"), "{said:?}");
}

#[test]
fn an_implausible_or_forged_clock_is_told() {
    let scratch = tempfile::tempdir().expect("a scratch folder");
    let Some(mut frames) = good_log(scratch.path()) else { return };
    let hit = find(&frames, 3, |message| matches!(message, Message::Clock(_)));
    frames[hit].1 = altered(&frames[hit].1, |message| {
        let Message::Clock(clock) = message else { panic!("a clock") };
        clock.drift = 4_294_967;
    });
    let report = verified(&frames, scratch.path());
    let said: Vec<_> = report.problems.iter().map(|problem| (problem.frame, problem.what.as_str())).collect();
    assert_eq!(said.len(), 2, "{said:?}");
    assert!(said.iter().all(|(frame, _)| *frame == hit as u64));
    assert!(said[0].1.contains("implausible clock: 1000 ppm"), "{said:?}");
    assert!(said[1].1.contains("does not recompute"), "{said:?}");
}
