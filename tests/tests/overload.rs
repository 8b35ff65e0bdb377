//! A survey that falls behind, as on a board whose processor is busy: what found no room in its queue is streamed, counted and announced, and the log
//! proves right without it.

use std::path::Path;

use crossfall::simulate::scene::Scene;
use crossfall::{capture, log, verify};
use crossfall_core::instrument::{Decode, Event, Identity, Survey};
use crossfall_core::protocol::frame::{Event as Heard, HostDecoder};
use crossfall_core::protocol::message::{Message, Skip, Status};
use crossfall_core::protocol::{Config, DeviceTime};
use crossfall_firmware::acquisition::Acquisition;
use crossfall_firmware::outbox::{Outbox, Queue};
use crossfall_firmware::work::{Places, WorkQueue, WorkReceiver};
use crossfall_tests::{arrivals, drives};
use embassy_futures::poll_once;

/// The survey's side: works off everything that is queued.
fn work_off(survey: &mut Survey, work: &mut WorkReceiver<'_>, board: &mut Acquisition<'_>) {
    while let std::task::Poll::Ready(profile) = poll_once(work.next(|event: &Event<'_>| survey.accept(event))) {
        profile.into_iter().for_each(|profile| board.profile(profile));
        while let Some(profile) = survey.next_profile() {
            board.profile(profile);
        }
    }
}

/// A drive through a board whose survey stands still in some of its seconds; what it sends, and its last status.
fn drive(capture: &Path, stands_still: impl Fn(f64) -> bool) -> (Vec<u8>, Status) {
    let (mut places, queue, config) = (Places::new(), Queue::new(), Config::default());
    let mut work_queue = WorkQueue::new(&mut places);
    let (sender, mut work) = work_queue.split();
    let mut decode = Decode::new(config, Identity::default());
    let mut outbox = Outbox::new(&queue);
    let mut board = Acquisition::new(&mut decode, &mut outbox, sender);
    let mut survey = Survey::new();
    let mut wire = Vec::new();
    let mut now = DeviceTime(0);
    board.start(now);
    for arrival in arrivals::of(capture, &config) {
        now = DeviceTime(arrival.at_ns / 1_000);
        match arrival.channel {
            capture::Channel::Lidar => board.lidar_byte(arrival.byte, now, 0, &mut |_| ()),
            capture::Channel::Ins => board.ins_byte(arrival.byte, now, 0, &mut |_| ()),
            _ => board.pulse(now, 0),
        }
        if !stands_still(arrival.at_ns as f64 * 1e-9) {
            work_off(&mut survey, &mut work, &mut board);
        }
        let mut chunk = [0; 1024];
        while let Ok(count) = queue.try_read(&mut chunk) {
            wire.extend_from_slice(&chunk[..count]);
        }
    }
    (wire, board.status(now))
}

#[test]
fn what_a_late_survey_has_left_out_is_announced_and_the_log_still_proves_right() {
    let scratch = tempfile::tempdir().expect("a scratch folder");
    let (capture, result) = (scratch.path().join("drive.mcap"), scratch.path().join("drive.log.mcap"));
    let mut scene = Scene::default();
    scene.drive.seconds = 12.0;
    drives::capture(&scene, &capture);

    let begin_s = scene.clock.start_s;
    let (wire, status) = drive(&capture, |at_s| matches!(at_s - begin_s, 3.0..3.1 | 5.0..6.0 | 8.0..8.4));
    // 1.5 s of scans, less those that found room.
    assert!((30..=60).contains(&status.scans_skipped), "{status:?}");
    assert_eq!((status.scans_missing, status.frames_dropped), (0, 0));

    let mut writer = log::Writer::create(&result).expect("a log");
    let (mut decoder, mut rest, mut skipped) = (HostDecoder::new(), &*wire, [0, 0]);
    while let Some(heard) = decoder.next(&mut rest) {
        let Heard::Frame(frame) = heard else { panic!("a damaged frame: {heard:?}") };
        match frame.body {
            Message::Skip(Skip::Scan(_)) => skipped[0] += 1,
            Message::Skip(Skip::Pose(_)) => skipped[1] += 1,
            _ => {}
        }
    }
    for frame in wire.split_inclusive(|&byte| byte == 0) {
        writer.frame(0, frame).expect("room on the disk");
    }
    writer.finish().expect("a log");
    assert_eq!(skipped[0], status.scans_skipped);
    assert!(skipped[1] > 100, "{} poses", skipped[1]);

    let report = verify::verify(&result, |_| ()).expect("a readable log");
    assert_eq!((&report.problems[..], report.missing_frames, report.profiles_unverifiable), (&[][..], 0, 0));
    assert!(report.ok && report.profiles > 300, "{report:?}");
    assert!(report.scans - report.profiles >= u64::from(status.scans_skipped));
}
