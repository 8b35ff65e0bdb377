//! One board, or one film, and everybody who looks at it.

use std::io;
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, SyncSender, channel, sync_channel};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant};

use crossfall_core::protocol::Config;
use crossfall_core::protocol::message::{Command, Label};
use serde::Deserialize;
use tokio::sync::oneshot;

use super::account::Shared;
use super::commands::Commands;
use super::drive_name::DriveName;
use super::film::Film;
use super::hub::Hub;
use super::model::Model;
use super::player::{Controls, Player};
use super::state::{Recording, SourceState};
use super::tape::{LiveTape, Logs};
use crate::container;
use crate::record::{self, Device, Notice, Port};

/// Frames that may wait for the model: more than ten seconds of a board's stream.
const WAITING: usize = 4_096;

/// How often the state is told.
const TOLD: Duration = Duration::from_millis(200);

/// Where frames come from.
#[derive(Clone, Debug)]
pub enum Source {
    /// A board.
    Device(Device),
    /// A capture or a log.
    File(PathBuf),
}

/// What the recorder's thread is to do.
#[derive(Debug)]
pub enum Order {
    /// Begin a recording.
    Record {
        /// The drive's name.
        name: DriveName,
        /// The log's path, or why there is none.
        tell: oneshot::Sender<Result<String, String>>,
    },
    /// End it.
    Stop {
        /// Whether there was one to end.
        tell: Option<oneshot::Sender<Result<(), String>>>,
    },
}

/// What is to become of a rock test.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum RockOrder {
    /// Begin one.
    Begin,
    /// Enough: make an estimate.
    End,
    /// Give it up, or forget its result.
    Cancel,
}

/// What the model hears.
#[derive(Debug)]
pub enum Heard {
    /// A frame as received.
    Frame(Box<[u8]>),
    /// Something about the connection.
    Notice(Notice),
    /// What is to become of a rock test.
    Rock(RockOrder),
}

/// See the module. Dropping it ends the recording, if there is one, with a whole log.
pub struct Live {
    common: Common,
    controls: Option<Controls>,
    orders: Sender<Order>,
    heard: SyncSender<Heard>,
    threads: Mutex<Vec<JoinHandle<()>>>,
}

/// What the threads and those who look have in common.
#[derive(Clone, Default)]
struct Common {
    hub: Arc<Hub>,
    commands: Arc<Commands>,
    shared: Arc<Mutex<Shared>>,
    /// Frames that the model had no time for.
    unheard: Arc<AtomicU64>,
    /// Whether the recorder is to end.
    stop: Arc<AtomicBool>,
    /// Whether it has.
    recorded: Arc<AtomicBool>,
}

impl Common {
    fn shared(&self) -> MutexGuard<'_, Shared> {
        self.shared.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Why nothing can be looked at.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// The file cannot be played.
    #[error(transparent)]
    File(#[from] container::Error),
    /// The folder for recordings is not there and cannot be made.
    #[error("{}: no folder for recordings: {error}", folder.display())]
    Folder {
        /// It.
        folder: PathBuf,
        /// Why.
        error: io::Error,
    },
    /// A thread cannot be started.
    #[error("cannot start a thread: {0}")]
    Thread(#[from] io::Error),
}

impl Live {
    /// Connects, or begins to play. A board that is not there yet is waited for. `config` is kept in force on a board; a film is
    /// surveyed with it. Of `logs` a folder is enough, which is made if need be.
    ///
    /// # Errors
    /// When the file can be read as neither capture nor log, the folder cannot be made, or a thread not be started.
    pub fn start(source: &Source, logs: impl Into<Logs>, speed: f64, config: Option<Config>) -> Result<Self, Error> {
        let logs = logs.into();
        let opened = Opened::open(source, speed, config)?;
        std::fs::create_dir_all(&logs.folder).map_err(|error| Error::Folder { folder: logs.folder.clone(), error })?;
        let (kind, name, folder) = (opened.kind, opened.name.clone(), logs.folder.display().to_string());
        let controls = opened.controls.clone();
        let common = Common::default();
        let (orders, obeyed) = channel();
        let (heard, hears) = sync_channel(WAITING);
        let tape = LiveTape::new(
            logs,
            obeyed,
            heard.clone(),
            Arc::clone(&common.unheard),
            Arc::clone(&common.shared),
            Arc::clone(&common.commands),
        );
        let mut model = Model::new(
            Arc::clone(&common.hub),
            Arc::clone(&common.commands),
            Arc::clone(&common.shared),
            controls.clone(),
            SourceState { kind, name, folder },
            Arc::clone(&common.unheard),
        );
        // Whoever looks from now on finds a state.
        model.tell();
        let recorder = {
            let (heard, common) = (heard.clone(), common.clone());
            move || record(opened, tape, &heard, &common)
        };
        let recorded = Arc::clone(&common.recorded);
        let threads = vec![
            thread::Builder::new().name("recorder".to_owned()).spawn(recorder)?,
            thread::Builder::new().name("model".to_owned()).spawn(move || show(model, &hears, &recorded))?,
        ];
        Ok(Self { common, controls, orders, heard, threads: Mutex::new(threads) })
    }

    /// What there is to see.
    #[must_use]
    pub fn hub(&self) -> &Arc<Hub> {
        &self.common.hub
    }

    /// The replay's transport, if it is one.
    #[must_use]
    pub fn controls(&self) -> Option<&Controls> {
        self.controls.as_ref()
    }

    /// Begins a recording, or ends the one there is; what comes of it shows in the state.
    pub fn toggle_recording(&self) {
        let order = match self.hub().state().recording.phase {
            super::Phase::Idle => Order::Record { name: DriveName::of_now(), tell: oneshot::channel().0 },
            _ => Order::Stop { tell: None },
        };
        self.order(order);
    }

    /// Halts a replay, or lets it go on; what comes of it shows in the state.
    pub fn toggle_pause(&self) {
        let Some(controls) = &self.controls else { return };
        let transport = *controls.lock();
        let _refused = self.pause(!(transport.paused || transport.ended));
    }

    /// The recordings that have ended and are not whole.
    #[must_use]
    pub fn broken(&self) -> Vec<Recording> {
        self.common.shared().broken.clone()
    }

    /// Drops a marker; what comes of it shows in the state.
    pub fn mark(&self, label: &str) {
        self.common.commands.send(&Command::Mark(Label::new(label)));
    }

    pub(super) fn commands(&self) -> &Commands {
        &self.common.commands
    }

    pub(super) fn order(&self, order: Order) {
        // Gone only when this is being dropped: then who asked gets no answer.
        let _gone = self.orders.send(order);
    }

    pub(super) fn rock(&self, order: RockOrder) {
        let _gone = self.heard.try_send(Heard::Rock(order));
    }

    /// Ends the recording, if there is one, and every thread.
    pub fn finish(&self) {
        self.common.stop.store(true, Ordering::Relaxed);
        let threads = std::mem::take(&mut *self.threads.lock().unwrap_or_else(PoisonError::into_inner));
        for thread in threads {
            // A thread that panicked has told so.
            let _told = thread.join();
        }
    }
}

impl Drop for Live {
    fn drop(&mut self) {
        self.finish();
    }
}

/// A board, or a film on a port of its own.
struct Opened {
    device: Device,
    port: Box<dyn Port>,
    controls: Option<Controls>,
    /// What viewers are told that it is, and its name.
    kind: &'static str,
    name: String,
    /// What is kept in force on it; a film is surveyed with it from the start.
    kept: Option<Config>,
}

impl Opened {
    fn open(source: &Source, speed: f64, config: Option<Config>) -> Result<Self, Error> {
        Ok(match source {
            Source::Device(device) => Self {
                device: device.clone(),
                port: device.connect().unwrap_or_else(|error| Box::new(Absent(Some(error)))),
                controls: None,
                kind: "device",
                name: device.to_string(),
                kept: config,
            },
            Source::File(path) => {
                let film = Film::open(path, config)?;
                let kind = film.kind();
                let (player, controls) = Player::new(film, speed);
                Self {
                    // A film's end is no lost connection; one whose file fails is looked for at a port that nobody has.
                    device: Device::Tcp { address: "127.0.0.1:0".to_owned() },
                    port: Box::new(player),
                    controls: Some(controls),
                    kind,
                    name: path.display().to_string(),
                    kept: None,
                }
            }
        })
    }
}

/// The recorder's thread.
fn record(opened: Opened, mut tape: LiveTape, heard: &SyncSender<Heard>, common: &Common) {
    let Opened { device, port, kept, .. } = opened;
    // The tape keeps its own errors: only the reader's thread can fail here, and the link's lamp shows that nothing comes.
    let conversed = record::converse(
        &device,
        port,
        &mut tape,
        common.commands.outbox(),
        kept,
        |notice| {
            let _full = heard.try_send(Heard::Notice(notice));
        },
        |summary| {
            common.shared().summary = summary.clone();
            !common.stop.load(Ordering::Relaxed)
        },
    );
    if let Ok(summary) = conversed {
        common.shared().summary = summary;
    }
    tape.finish();
    common.recorded.store(true, Ordering::Relaxed);
}

/// The model's thread.
fn show(mut model: Model, hears: &Receiver<Heard>, recorded: &AtomicBool) {
    let mut told = Instant::now();
    loop {
        match hears.recv_timeout(TOLD / 4) {
            Ok(heard) => model.hear(heard),
            Err(RecvTimeoutError::Timeout) if !recorded.load(Ordering::Relaxed) => {}
            // The recorder has ended and everything is heard: the last word.
            Err(_) => return model.tell(),
        }
        if told.elapsed() >= TOLD {
            told = Instant::now();
            model.tell();
        }
    }
}

/// A port that is not there: its first read says why, and the reader looks for it from then on.
struct Absent(Option<io::Error>);

impl io::Read for Absent {
    fn read(&mut self, _: &mut [u8]) -> io::Result<usize> {
        Err(self.0.take().unwrap_or_else(|| io::ErrorKind::NotConnected.into()))
    }
}

impl io::Write for Absent {
    fn write(&mut self, _: &[u8]) -> io::Result<usize> {
        Err(io::ErrorKind::NotConnected.into())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}
