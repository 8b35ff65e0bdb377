use super::*;

use std::io::{self, Write};
use std::sync::mpsc::{self, Sender};

use crossfall_core::protocol::DeviceTime;
use crossfall_core::protocol::frame::{BoardDecoder, Event};
use crossfall_core::protocol::message::{Hello, Status};
use tokio::sync::oneshot;

use crate::record::Summary;

/// A tape, and what gives it orders.
fn tape(folder: &Path, min_free: u64) -> (LiveTape, Sender<Order>, Arc<Mutex<Shared>>) {
    let (orders, obeyed) = mpsc::channel();
    // Nobody hears what is shown.
    let (heard, _) = mpsc::sync_channel(1);
    let shared = Arc::new(Mutex::new(Shared::default()));
    let logs = Logs { min_free, ..Logs::from(folder) };
    let commands = Arc::new(Commands::default());
    let tape = LiveTape::new(logs, obeyed, heard, Arc::default(), Arc::clone(&shared), commands);
    (tape, orders, shared)
}

fn record(orders: &Sender<Order>) -> oneshot::Receiver<Result<String, String>> {
    let (tell, told) = oneshot::channel();
    orders.send(Order::Record { name: DriveName::new("x").unwrap(), tell }).unwrap();
    told
}

fn settle_until(tape: &mut LiveTape, is: impl Fn(&Step) -> bool) {
    let began = Instant::now();
    while !is(&tape.step) {
        assert!(began.elapsed() < Duration::from_secs(20));
        tape.settle(0).unwrap();
        std::thread::sleep(Duration::from_millis(5));
    }
}

/// Brings a tape to where it records, as an answering board does.
fn roll(tape: &mut LiveTape, orders: &Sender<Order>) -> PathBuf {
    let mut told = record(orders);
    settle_until(tape, |step| matches!(step, Step::Clearing { .. }));
    tape.frame(0, &[0], Some(&Message::Session(Session::Stopped(DeviceTime(0))))).unwrap();
    settle_until(tape, |step| matches!(step, Step::Greeting { .. }));
    let hello = Hello { schema: 0, firmware: "f", board: "b", boot: 0, restart: "" };
    tape.frame(0, &[0], Some(&Message::Hello(hello))).unwrap();
    assert!(matches!(tape.step, Step::Recording { .. }));
    told.try_recv().unwrap().unwrap().into()
}

fn entries(key: &str, value: &str) -> BTreeMap<String, String> {
    [(key.to_owned(), value.to_owned())].into()
}

#[test]
fn a_recording_ends_whole_while_the_disk_has_room_for_its_end() {
    let folder = tempfile::tempdir().unwrap();
    let (mut tape, orders, shared) = tape(folder.path(), u64::MAX);
    let mut told = record(&orders);
    tape.settle(0).unwrap();
    let refused = told.try_recv().unwrap().unwrap_err();
    assert!(refused.starts_with("the disk is full"), "{refused}");
    assert!(std::fs::read_dir(folder.path()).unwrap().next().is_none(), "no log is begun");

    tape.logs.min_free = 0;
    let path = roll(&mut tape, &orders);
    assert_eq!(shared.lock().unwrap().disk_error, None);
    tape.frame(0, &[1, 0], None).unwrap();
    tape.watch = Watch::of(Box::new(|| Ok(5_000_000)), 6_000_000);
    settle_until(&mut tape, |step| matches!(step, Step::Ending { .. }));
    tape.frame(1, &[2, 0], None).unwrap();
    settle_until(&mut tape, |step| matches!(step, Step::Idle));
    let shared = shared.lock().unwrap();
    let last = shared.last.as_ref().unwrap();
    assert!(!last.is_whole() && last.error == shared.disk_error, "{last:?}");
    assert_eq!(shared.disk_error.as_deref(), Some("the disk is full: 5.0 MB are left free"));
    let frames: Vec<_> = log::Reader::open(&path).unwrap().map(|frame| frame.unwrap().bytes).collect();
    assert_eq!(frames, [vec![0], vec![1, 0], vec![2, 0]], "whole, with what came while it ended");
}

/// Takes so many bytes.
struct Small(usize);

impl Write for Small {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.0 = self.0.checked_sub(bytes.len()).ok_or(io::ErrorKind::StorageFull)?;
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

impl log::Storage for Small {
    fn sync(&mut self) -> io::Result<()> {
        Ok(())
    }
}

#[test]
fn what_went_wrong_first_is_told() {
    let folder = tempfile::tempdir().unwrap();
    let (mut tape, _orders, shared) = tape(folder.path(), 0);
    tape.step = Step::Recording { log: small_log(folder.path(), "x") };
    for second in 0..4 {
        tape.frame(second * 1_000_000_000, &[7; 1_000], None).unwrap();
    }
    assert!(matches!(tape.step, Step::Idle));
    let shared = shared.lock().unwrap();
    let words = shared.disk_error.as_deref().unwrap();
    assert!(words.contains(&io::Error::from(io::ErrorKind::StorageFull).to_string()), "{words}");
    assert_eq!(shared.last.as_ref().unwrap().error.as_deref(), Some(words));
}

#[test]
fn a_log_begins_with_who_and_how_and_counts_its_own_boots() {
    let folder = tempfile::tempdir().unwrap();
    let (mut tape, orders, shared) = tape(folder.path(), 0);
    for (name, key, value) in
        [("segment", "number", "2"), ("identity", "board", "b"), ("config", "toml", "x"), ("segment", "number", "3")]
    {
        tape.metadata(name, entries(key, value)).unwrap();
    }
    let path = roll(&mut tape, &orders);
    let read = |path: &Path| {
        let mut reader = log::Reader::open(path).unwrap();
        assert!(reader.by_ref().all(|frame| frame.is_ok()));
        reader.metadata().clone()
    };
    tape.metadata("segment", entries("number", "4")).unwrap();
    tape.finish();
    let found = read(&path);
    assert_eq!(found["segment"]["number"], "2", "the first boot within this log");
    assert_eq!((&*found["identity"]["board"], &*found["config"]["toml"]), ("b", "x"));
    let last = shared.lock().unwrap().last.clone().unwrap();
    assert!(last.restarts == 1 && !last.is_whole());

    let (mut tape, orders, _) = self::tape(folder.path(), 0);
    tape.metadata("segment", entries("number", "2")).unwrap();
    let path = roll(&mut tape, &orders);
    tape.finish();
    assert!(!read(&path).contains_key("segment"), "nothing has booted within this one");
}

/// What was said to the board since this was asked last.
fn said(tape: &LiveTape) -> Vec<Command> {
    let mut said = Vec::new();
    while let Some(frame) = tape.commands.outbox().take() {
        let (mut decoder, mut rest) = (BoardDecoder::new(), frame.as_slice());
        while let Some(Event::Frame(frame)) = decoder.next(&mut rest) {
            said.push(frame.body);
        }
    }
    said
}

fn small_log(folder: &Path, name: &str) -> log::Writer {
    let small = Box::new(|_: &Path| Ok(Box::new(Small(2_000)) as Box<dyn log::Storage>));
    log::Writer::create_over(&folder.join(name), log::Options::default(), small).unwrap()
}

#[test]
fn a_log_that_fails_leaves_the_viewers_a_session() {
    let folder = tempfile::tempdir().unwrap();
    let (mut tape, _orders, shared) = tape(folder.path(), 0);
    let far = Instant::now() + Duration::from_secs(60);
    tape.step = Step::Ending { log: small_log(folder.path(), "end"), until: far };
    for second in 0..4 {
        tape.frame(second * 1_000_000_000, &[7; 1_000], None).unwrap();
    }
    assert!(matches!(tape.step, Step::Idle));
    assert_eq!(said(&tape), [Command::Start], "the session was stopped for the end");

    tape.metadata("identity", entries("board", &"b".repeat(4_000))).unwrap();
    tape.step = Step::Greeting { log: small_log(folder.path(), "begin"), until: Instant::now() };
    settle_until(&mut tape, |step| !matches!(step, Step::Greeting { .. }));
    for second in 0..4 {
        tape.frame(second * 1_000_000_000, &[7; 1_000], None).unwrap();
    }
    assert!(matches!(tape.step, Step::Idle));
    assert_eq!(said(&tape), [Command::Start], "the session was stopped for the beginning");
    let shared = shared.lock().unwrap();
    assert_eq!((shared.broken.len(), shared.recording.phase), (2, Phase::Idle));
    assert!(shared.broken.iter().all(|recording| recording.error.is_some()), "{:?}", shared.broken);
}

#[test]
fn a_recording_that_is_not_whole_is_not_forgotten_behind_one_that_is() {
    let folder = tempfile::tempdir().unwrap();
    let (mut tape, orders, shared) = tape(folder.path(), 0);
    let status = |seconds: u64| Status { time: DeviceTime(seconds * 1_000_000), ..Status::default() };
    shared.lock().unwrap().summary.totals.status(&status(100));
    let mut recorded = |change: &dyn Fn(&mut Summary)| {
        roll(&mut tape, &orders);
        change(&mut shared.lock().unwrap().summary);
        orders.send(Order::Stop { tell: None }).unwrap();
        settle_until(&mut tape, |step| matches!(step, Step::Ending { .. }));
        tape.frame(0, &[0], Some(&Message::Session(Session::Stopped(DeviceTime(0))))).unwrap();
        settle_until(&mut tape, |step| matches!(step, Step::Idle));
        shared.lock().unwrap().last.as_ref().unwrap().amiss().join("; ")
    };
    assert_eq!(recorded(&|_| ()), "");
    assert_eq!(recorded(&|summary| summary.missing_frames = 3), "3 frames lost");
    let kinds = |summary: &mut Summary| {
        (summary.bad_frames, summary.bytes_lost, summary.unknown_gaps) = (1, 70_000, 1);
    };
    assert_eq!(recorded(&kinds), "1 frame lost; 70000 bytes lost; 1 gap of unknown length");
    let scans = |summary: &mut Summary| summary.totals.status(&Status { scans_missing: 2, ..status(101) });
    assert_eq!(recorded(&scans), "2 lost on the board");
    let restarted = recorded(&|summary| summary.totals.status(&status(1)));
    assert!(restarted.starts_with("restarts of the board: 1"), "{restarted}");
    assert!(recorded(&|summary| summary.disconnected = true).starts_with("not connected at the end"));
    assert_eq!(recorded(&|summary| summary.disconnected = false), "");
    assert!(recorded(&|summary| summary.unconfigured = true).starts_with("the configuration is not in force"));
    assert_eq!(recorded(&|summary| summary.unconfigured = false), "");

    // Ended before it has begun.
    let _told = record(&orders);
    settle_until(&mut tape, |step| matches!(step, Step::Clearing { .. }));
    tape.finish();
    let shared = shared.lock().unwrap();
    let [said] = &shared.last.as_ref().unwrap().amiss()[..] else { panic!("one thing is amiss") };
    assert!(said.starts_with("no frame came"), "{said}");
    assert_eq!(shared.broken.len(), 7);
}
