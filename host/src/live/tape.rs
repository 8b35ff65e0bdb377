//! Recordings that start and end while the connection lasts.
//!
//! A recording is one session of the survey. At its start the old session is stopped and its last profiles let go by, the board is
//! asked who it is, and with its hello the log begins; then a new session is started. At its end the session is stopped, and when
//! its last profiles are in, the log is closed and another session started for the viewers. So every log holds identity, configuration and
//! clock before its first scan, and every profile in it can be recomputed. A board that does not answer is recorded as it is.
//!
//! The disk is watched meanwhile: while there is room to end a recording well, it is ended ([`space`](crate::record::space)).

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, SyncSender};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

use crossfall_core::protocol::message::{Command, Message, Session};

use super::commands::Commands;
use super::session::{Heard, Order};
use super::state::{Phase, Recording};
use crate::calendar::Date;
use crate::record::space::{RESERVE, Space, Watch};
use crate::record::{ANSWER, Summary, Tape};
use crate::{log, output};

/// How long after a session's end its last profiles come: a scan waits 213 ms at most.
const LAST_PROFILES: Duration = Duration::from_millis(350);

/// Longest name of a drive, in bytes.
const LONGEST_NAME: usize = 80;

/// Where recordings go, and how they are written.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Logs {
    /// The folder.
    pub folder: PathBuf,
    /// How files follow each other, and whether they are packed.
    pub options: log::Options,
    /// A recording ends when less than this is free on the folder's disk, in bytes.
    pub min_free: u64,
}

impl From<&Path> for Logs {
    fn from(folder: &Path) -> Self {
        Self { folder: folder.to_path_buf(), options: log::Options::default(), min_free: RESERVE }
    }
}

/// What the recorder's thread and the viewers share.
#[derive(Debug, Default)]
pub struct Shared {
    /// The recording.
    pub recording: Recording,
    /// The one before.
    pub last: Option<Recording>,
    /// Why a log could not be written.
    pub disk_error: Option<String>,
    /// What the connection has come to.
    pub summary: Summary,
}

/// What the recording does, and until when.
enum Step {
    Idle,
    /// The old session's last profiles go by.
    Clearing {
        log: log::Writer,
        until: Instant,
    },
    /// The hello is awaited.
    Greeting {
        log: log::Writer,
        until: Instant,
    },
    Recording {
        log: log::Writer,
    },
    /// The session's last profiles are awaited.
    Ending {
        log: log::Writer,
        until: Instant,
    },
}

/// See the module.
pub struct LiveTape {
    step: Step,
    logs: Logs,
    watch: Watch,
    orders: Receiver<Order>,
    heard: SyncSender<Heard>,
    unheard: Arc<AtomicU64>,
    shared: Arc<Mutex<Shared>>,
    commands: Arc<Commands>,
    /// Who the board is and how it is configured: what every log begins with.
    described: BTreeMap<String, BTreeMap<String, String>>,
    began: Instant,
    /// Losses of the connection when the recording began.
    lost_before: u64,
}

impl LiveTape {
    pub fn new(
        logs: Logs,
        orders: Receiver<Order>,
        heard: SyncSender<Heard>,
        unheard: Arc<AtomicU64>,
        shared: Arc<Mutex<Shared>>,
        commands: Arc<Commands>,
    ) -> Self {
        Self {
            step: Step::Idle,
            watch: Watch::over_folder(logs.folder.clone(), logs.min_free),
            logs,
            orders,
            heard,
            unheard,
            shared,
            commands,
            described: BTreeMap::new(),
            began: Instant::now(),
            lost_before: 0,
        }
    }

    /// Ends what is being recorded at once.
    pub fn finish(mut self) {
        match std::mem::replace(&mut self.step, Step::Idle) {
            Step::Recording { log }
            | Step::Ending { log, .. }
            | Step::Clearing { log, .. }
            | Step::Greeting { log, .. } => {
                self.close(log);
            }
            Step::Idle => {}
        }
    }

    fn share<T>(&self, change: impl FnOnce(&mut Shared) -> T) -> T {
        change(&mut self.shared.lock().unwrap_or_else(PoisonError::into_inner))
    }

    fn obey(&mut self, order: Order) {
        match order {
            Order::Record { name, tell } => {
                let answer = self.begin(&name);
                // Who asked may have gone meanwhile.
                let _gone = tell.send(answer);
            }
            Order::Stop { tell } => {
                let answer = self.end();
                if let Some(tell) = tell {
                    let _gone = tell.send(answer);
                }
            }
        }
    }

    fn begin(&mut self, name: &str) -> Result<String, String> {
        if !matches!(self.step, Step::Idle) {
            return Err("a recording is under way".into());
        }
        let name = drive_name(name)?;
        self.watch = Watch::over_folder(self.logs.folder.clone(), self.logs.min_free);
        if let Some(Space::Full { free }) = self.watch.look(0, 0.0) {
            let words = full(free);
            self.share(|shared| shared.disk_error = Some(words.clone()));
            return Err(words);
        }
        let (path, log) = self.create(&name)?;
        let file = path.display().to_string();
        self.share(|shared| {
            shared.disk_error = None;
            shared.recording = Recording { phase: Phase::Starting, name, file: file.clone(), ..Recording::default() };
        });
        self.began = Instant::now();
        self.commands.send(&Command::Stop);
        self.step = Step::Clearing { log, until: Instant::now() + ANSWER };
        Ok(file)
    }

    /// A new log; a name that is taken gets a number.
    fn create(&self, name: &str) -> Result<(PathBuf, log::Writer), String> {
        for number in 1..10_000 {
            let file = if number == 1 { format!("{name}.log.mcap") } else { format!("{name}-{number}.log.mcap") };
            let path = self.logs.folder.join(file);
            match log::Writer::create_with(&path, self.logs.options) {
                Ok(log) => return Ok((path, log)),
                Err(error) if error.source.kind() == std::io::ErrorKind::AlreadyExists => {}
                Err(error) => {
                    self.share(|shared| shared.disk_error = Some(error.to_string()));
                    return Err(error.to_string());
                }
            }
        }
        Err(format!("there are 10,000 drives called {name} already"))
    }

    fn end(&mut self) -> Result<(), String> {
        match std::mem::replace(&mut self.step, Step::Idle) {
            Step::Recording { log } => {
                self.commands.send(&Command::Stop);
                self.phase(Phase::Ending);
                self.step = Step::Ending { log, until: Instant::now() + ANSWER };
                Ok(())
            }
            Step::Idle => Err("nothing is being recorded".into()),
            other @ Step::Ending { .. } => {
                self.step = other;
                Ok(())
            }
            // It has not begun: nothing is lost by ending it at once.
            Step::Clearing { log, .. } | Step::Greeting { log, .. } => {
                self.close(log);
                self.commands.send(&Command::Start);
                Ok(())
            }
        }
    }

    fn phase(&self, phase: Phase) {
        self.share(|shared| shared.recording.phase = phase);
    }

    /// The board's hello has come, or will not come: from here on everything is logged.
    fn roll(&mut self, mut log: log::Writer) -> Result<(), output::Error> {
        for (name, entries) in &self.described {
            log.metadata(name, entries.clone())?;
        }
        self.began = Instant::now();
        self.lost_before = self.share(|shared| {
            shared.recording.phase = Phase::Recording;
            lost(&shared.summary)
        });
        self.commands.send(&Command::Start);
        self.step = Step::Recording { log };
        Ok(())
    }

    fn close(&mut self, log: log::Writer) {
        let finished = log.finish();
        self.share(|shared| {
            let mut ended = std::mem::take(&mut shared.recording);
            ended.phase = Phase::Idle;
            if let Err(error) = finished {
                // What went wrong first is the cause, and what follows from it says nothing.
                shared.disk_error.get_or_insert(error.to_string());
                ended.error.get_or_insert(error.to_string());
            }
            shared.last = Some(ended);
        });
    }

    /// The log cannot be written any more: what there is of it is kept, and viewing goes on.
    fn failed(&mut self, log: log::Writer, error: &output::Error) {
        self.share(|shared| {
            shared.disk_error = Some(error.to_string());
            shared.recording.error = Some(error.to_string());
        });
        self.close(log);
    }

    /// Writes to the log, if there is one.
    fn write(&mut self, write: impl FnOnce(&mut log::Writer) -> Result<(), output::Error>) {
        let (Step::Recording { log } | Step::Ending { log, .. }) = &mut self.step else { return };
        if let Err(error) = write(log)
            && let Step::Recording { log } | Step::Ending { log, .. } = std::mem::replace(&mut self.step, Step::Idle)
        {
            self.failed(log, &error);
        }
    }

    /// What is due by time.
    fn due(&mut self) {
        let now = Instant::now();
        match std::mem::replace(&mut self.step, Step::Idle) {
            Step::Clearing { log, until } if now >= until => {
                self.commands.send(&Command::Identify);
                self.step = Step::Greeting { log, until: now + ANSWER };
            }
            Step::Greeting { log, until } if now >= until => self.roll_or_fail(log),
            Step::Ending { log, until } if now >= until => {
                self.close(log);
                self.commands.send(&Command::Start);
            }
            other => self.step = other,
        }
    }

    /// Ends the recording, whole, while the disk has room for it.
    fn watch(&mut self) {
        let Step::Recording { log } = &self.step else { return };
        // That the room gets little the disk's lamp shows, hours before.
        let Some(Space::Full { free }) = self.watch.look(log.bytes(), self.began.elapsed().as_secs_f64()) else {
            return;
        };
        self.share(|shared| {
            shared.disk_error = Some(full(free));
            shared.recording.error = Some(full(free));
        });
        // There is one to end.
        let _ended = self.end();
    }

    fn roll_or_fail(&mut self, log: log::Writer) {
        if let Err(error) = self.roll(log) {
            self.share(|shared| {
                shared.disk_error = Some(error.to_string());
                shared.recording = Recording::default();
            });
            self.step = Step::Idle;
        }
    }

    /// What a message changes.
    fn notice(&mut self, message: &Message<'_>) {
        let soon = Instant::now() + LAST_PROFILES;
        match (&mut self.step, message) {
            (Step::Clearing { until, .. } | Step::Ending { until, .. }, Message::Session(Session::Stopped(_))) => {
                *until = soon;
            }
            (Step::Greeting { .. }, Message::Hello(_)) => {
                if let Step::Greeting { log, .. } = std::mem::replace(&mut self.step, Step::Idle) {
                    self.roll_or_fail(log);
                }
            }
            _ => {}
        }
    }
}

/// Why nothing more is recorded.
fn full(free: u64) -> String {
    format!("the disk is full: {:.1} MB are left free", free as f64 / 1e6)
}

/// What the connection has lost.
fn lost(summary: &Summary) -> u64 {
    summary.bad_frames + summary.missing_frames + summary.bytes_lost
}

impl Tape for LiveTape {
    fn frame(&mut self, receive_ns: u64, raw: &[u8], message: Option<&Message<'_>>) -> Result<(), output::Error> {
        if let Some(message) = message {
            self.notice(message);
        }
        self.write(|log| log.frame(receive_ns, raw));
        if matches!(self.step, Step::Recording { .. } | Step::Ending { .. }) {
            let seconds = self.began.elapsed().as_secs_f64();
            let before = self.lost_before;
            self.share(|shared| {
                let lost_now = lost(&shared.summary);
                let recording = &mut shared.recording;
                recording.seconds = seconds;
                recording.frames += 1;
                recording.bytes += raw.len() as u64;
                recording.profiles += u64::from(matches!(message, Some(Message::Profile(_))));
                recording.markers += u64::from(matches!(message, Some(Message::Marker(_))));
                recording.lost = lost_now.saturating_sub(before);
            });
        }
        // The viewers' model may be behind: the recording does not wait for it.
        if self.heard.try_send(Heard::Frame(raw.into())).is_err() {
            self.unheard.fetch_add(1, Ordering::Relaxed);
        }
        Ok(())
    }

    fn metadata(&mut self, name: &str, mut entries: BTreeMap<String, String>) -> Result<(), output::Error> {
        match name {
            log::metadata::IDENTITY | log::metadata::CONFIG => {
                self.described.insert(name.to_owned(), entries.clone());
            }
            // The connection counts its boots, a log those within it.
            log::metadata::SEGMENT if matches!(self.step, Step::Recording { .. } | Step::Ending { .. }) => {
                let restarts = self.share(|shared| {
                    shared.recording.restarts += 1;
                    shared.recording.restarts
                });
                entries.insert("number".to_owned(), (restarts + 1).to_string());
            }
            _ => {}
        }
        self.write(|log| log.metadata(name, entries));
        Ok(())
    }

    fn extent(&self) -> (u64, u32) {
        match &self.step {
            Step::Idle => (0, 0),
            Step::Clearing { log, .. }
            | Step::Greeting { log, .. }
            | Step::Recording { log }
            | Step::Ending { log, .. } => (log.bytes(), log.parts()),
        }
    }

    fn is_last(&self) -> bool {
        matches!(&self.step, Step::Recording { log } | Step::Ending { log, .. } if log.is_last())
    }

    fn settle(&mut self, now_ns: u64) -> Result<(), output::Error> {
        while let Ok(order) = self.orders.try_recv() {
            self.obey(order);
        }
        self.due();
        self.watch();
        self.write(|log| log.settle(now_ns));
        if matches!(self.step, Step::Recording { .. }) {
            let seconds = self.began.elapsed().as_secs_f64();
            self.share(|shared| shared.recording.seconds = seconds);
        }
        Ok(())
    }
}

/// The name of a drive as a file's name: nothing that could leave the folder, hide or mislead.
///
/// # Errors
/// Why it cannot be one, in words.
pub fn drive_name(text: &str) -> Result<String, String> {
    let name = text.trim();
    if name.is_empty() {
        let since = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
        return Ok(format!("drive-{}", utc(since.as_secs())));
    }
    if name.len() > LONGEST_NAME {
        return Err(format!("a drive's name has at most {LONGEST_NAME} bytes"));
    }
    let wrong = name.chars().find(|&c| !(c.is_alphanumeric() || matches!(c, ' ' | '-' | '_' | '.' | '+')));
    if let Some(wrong) = wrong {
        return Err(format!("a drive's name has letters, digits, spaces and - _ . +, not {wrong:?}"));
    }
    if name.starts_with('.') || Path::new(name).file_name().is_none_or(|file| file != name) {
        return Err("a drive's name does not begin with a dot".into());
    }
    Ok(name.to_owned())
}

/// Date and time as they sort: 20260131-235959.
fn utc(seconds: u64) -> String {
    let Date { year, month, day } = Date::of_unix(seconds);
    let time = seconds % 86_400;
    format!("{year:04}{month:02}{day:02}-{:02}{:02}{:02}", time / 3_600, time / 60 % 60, time % 60)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_cannot_leave_the_folder() {
        for good in ["A1 north", "drive-7_b.2", "Überholspur 3+"] {
            assert_eq!(drive_name(good).unwrap(), good);
        }
        assert!(drive_name("").unwrap().starts_with("drive-20"));
        for bad in
            ["../x", "a/b", "a\\b", "..", ".hidden", "a\0b", "a\nb", "C:x", "~", &"x".repeat(81), "$(x)", "a%2fb"]
        {
            assert!(drive_name(bad).is_err(), "{bad:?}");
        }
    }

    #[test]
    fn dates_sort_as_they_follow() {
        assert_eq!(utc(0), "19700101-000000");
        assert_eq!(utc(951_782_400), "20000229-000000");
        assert_eq!(utc(1_767_225_599), "20251231-235959");
    }

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
        for (name, key, value) in [
            ("segment", "number", "2"),
            ("identity", "board", "b"),
            ("config", "toml", "x"),
            ("segment", "number", "3"),
        ] {
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
}
