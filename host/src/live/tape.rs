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
use std::time::{Duration, Instant};

use crossfall_core::protocol::message::{Command, Message, Session};

use super::account::{Losses, Shared};
use super::commands::Commands;
use super::drive_name::DriveName;
use super::session::{Heard, Order};
use super::state::{Phase, Recording};
use crate::record::space::{RESERVE, Space, Watch};
use crate::record::{ANSWER, Lost, Tape};
use crate::{log, output};

/// How long after a session's end its last profiles come: a scan waits 213 ms at most.
const LAST_PROFILES: Duration = Duration::from_millis(350);

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
    /// What the connection had lost when the recording began.
    before: Losses,
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
            before: Losses::default(),
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

    fn begin(&mut self, name: &DriveName) -> Result<String, String> {
        if !matches!(self.step, Step::Idle) {
            return Err("a recording is under way".into());
        }
        self.watch = Watch::over_folder(self.logs.folder.clone(), self.logs.min_free);
        if let Some(Space::Full { free }) = self.watch.look(0, 0.0) {
            let words = full(free);
            self.share(|shared| shared.disk_error = Some(words.clone()));
            return Err(words);
        }
        let (path, log) = self.create(name)?;
        let file = path.display().to_string();
        self.before = self.share(|shared| {
            shared.disk_error = None;
            let name = name.to_string();
            shared.recording = Recording { phase: Phase::Starting, name, file: file.clone(), ..Recording::default() };
            Losses::of(&shared.summary)
        });
        self.began = Instant::now();
        self.commands.send(&Command::Stop);
        self.step = Step::Clearing { log, until: Instant::now() + ANSWER };
        Ok(file)
    }

    /// A new log; a name that is taken gets a number.
    fn create(&self, name: &DriveName) -> Result<(PathBuf, log::Writer), String> {
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
    fn roll(&mut self, mut log: log::Writer) {
        let described = self.described.iter().try_for_each(|(name, entries)| log.metadata(name, entries.clone()));
        if let Err(error) = described {
            self.failed(log, &error);
        } else {
            self.began = Instant::now();
            self.before = self.share(|shared| {
                shared.recording.phase = Phase::Recording;
                Losses::of(&shared.summary)
            });
            self.step = Step::Recording { log };
        }
        self.commands.send(&Command::Start);
    }

    fn close(&mut self, log: log::Writer) {
        let (finished, before) = (log.finish(), self.before);
        self.share(|shared| shared.end(finished, before));
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
        let Err(error) = write(log) else { return };
        match std::mem::replace(&mut self.step, Step::Idle) {
            Step::Recording { log } => self.failed(log, &error),
            Step::Ending { log, .. } => {
                self.failed(log, &error);
                // The viewers' session, as behind every recording: this one's is stopped already.
                self.commands.send(&Command::Start);
            }
            Step::Idle | Step::Clearing { .. } | Step::Greeting { .. } => {}
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
            Step::Greeting { log, until } if now >= until => self.roll(log),
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

    /// What a message changes.
    fn notice(&mut self, message: &Message<'_>) {
        let soon = Instant::now() + LAST_PROFILES;
        match (&mut self.step, message) {
            (Step::Clearing { until, .. } | Step::Ending { until, .. }, Message::Session(Session::Stopped(_))) => {
                *until = soon;
            }
            (Step::Greeting { .. }, Message::Hello(_)) => {
                if let Step::Greeting { log, .. } = std::mem::replace(&mut self.step, Step::Idle) {
                    self.roll(log);
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

impl Tape for LiveTape {
    fn frame(&mut self, receive_ns: u64, raw: &[u8], message: Option<&Message<'_>>) -> Result<(), output::Error> {
        if let Some(message) = message {
            self.notice(message);
        }
        self.write(|log| log.frame(receive_ns, raw));
        if matches!(self.step, Step::Recording { .. } | Step::Ending { .. }) {
            let seconds = self.began.elapsed().as_secs_f64();
            let before = self.before.on_the_way;
            self.share(|shared| {
                let lost = Lost::of(&shared.summary).since(before);
                let recording = &mut shared.recording;
                recording.seconds = seconds;
                recording.frames += 1;
                recording.bytes += raw.len() as u64;
                recording.profiles += u64::from(matches!(message, Some(Message::Profile(_))));
                recording.markers += u64::from(matches!(message, Some(Message::Marker(_))));
                recording.lost = lost;
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

    fn grows_on(&self) -> Option<log::GrowsOn> {
        match &self.step {
            Step::Recording { log } | Step::Ending { log, .. } => log.grows_on(),
            _ => None,
        }
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

#[cfg(test)]
mod tests;
