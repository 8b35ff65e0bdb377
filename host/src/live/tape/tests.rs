use super::*;

use std::io::{self, Write};
use std::sync::mpsc::{self, Sender};

use crossfall_core::protocol::DeviceTime;
use crossfall_core::protocol::message::Hello;
use tokio::sync::oneshot;

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
    orders.send(Order::Record { name: "x".into(), tell }).unwrap();
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
    let small = Box::new(|_: &Path| Ok(Box::new(Small(2_000)) as Box<dyn log::Storage>));
    let log = log::Writer::create_over(&folder.path().join("x"), log::Options::default(), small).unwrap();
    tape.step = Step::Recording { log };
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
