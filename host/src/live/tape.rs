//! Recordings that start and end while the connection lasts.
//!
//! A recording is one session of the survey. At its start the old session is stopped and its last profiles let go by, the board is
//! asked who it is, and with its hello the log begins; then a new session is started. At its end the session is stopped, and when
//! its last profiles are in, the log is closed and another session started for the viewers. So every log holds identity, configuration and
//! clock before its first scan, and every profile in it can be recomputed. A board that does not answer is recorded as it is.

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
use crate::record::{Summary, Tape};
use crate::{log, output};

/// How long after a session's end its last profiles come: a scan waits 213 ms at most.
const LAST_PROFILES: Duration = Duration::from_millis(350);

/// How long a board may take to answer.
const ANSWER: Duration = Duration::from_secs(2);

/// Longest name of a drive, in bytes.
const LONGEST_NAME: usize = 80;

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
    folder: PathBuf,
    orders: Receiver<Order>,
    heard: SyncSender<Heard>,
    unheard: Arc<AtomicU64>,
    shared: Arc<Mutex<Shared>>,
    commands: Arc<Commands>,
    metadata: BTreeMap<String, BTreeMap<String, String>>,
    began: Instant,
    /// Losses of the connection when the recording began.
    lost_before: u64,
}

impl LiveTape {
    pub fn new(
        folder: PathBuf,
        orders: Receiver<Order>,
        heard: SyncSender<Heard>,
        unheard: Arc<AtomicU64>,
        shared: Arc<Mutex<Shared>>,
        commands: Arc<Commands>,
    ) -> Self {
        Self {
            step: Step::Idle,
            folder,
            orders,
            heard,
            unheard,
            shared,
            commands,
            metadata: BTreeMap::new(),
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
            let path = self.folder.join(file);
            match log::Writer::create_live(&path) {
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
        for (name, entries) in &self.metadata {
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
                ended.error.get_or_insert(error.to_string());
                shared.disk_error = Some(error.to_string());
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

    fn metadata(&mut self, name: &str, entries: BTreeMap<String, String>) -> Result<(), output::Error> {
        self.write(|log| log.metadata(name, entries.clone()));
        self.metadata.insert(name.to_owned(), entries);
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

    fn settle(&mut self, now_ns: u64) -> Result<(), output::Error> {
        while let Ok(order) = self.orders.try_recv() {
            self.obey(order);
        }
        self.due();
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
}
