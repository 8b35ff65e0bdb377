//! What the tasks of the acquisition executor share: the decode layer, the way to the link and the way to the survey.
//!
//! Every event goes to the survey's queue and to the link in one step that nothing interrupts at this priority, so that both see
//! the same order: a log then holds the survey's input exactly, which is what makes it provable.
//!
//! The survey runs at a lower priority and may be behind. A scan is only queued while [`RESERVE`] places remain for poses
//! and borders; else it is streamed, counted as skipped and not measured. A pose without room is withheld from the link too,
//! as a counted gap: the log must not show the survey an input that it did not have.

use core::cell::RefCell;

use crossfall_core::instrument::{Decode, Event};
use crossfall_core::scan::RawScan;
use crossfall_protocol::message::{Command, Level, LogLine, Message, Outcome, Pose, Profile, Reply, Session, Status};
use crossfall_protocol::{Config, DeviceTime};
use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;
use embassy_sync::zerocopy_channel::{Channel, Sender};

use crate::outbox::Outbox;

/// Places in the survey's queue.
pub const QUEUE: usize = 10;

/// Places that scans leave free: at 100 poses a second, 50 ms of computing.
pub const RESERVE: usize = 5;

/// One input of the survey.
// A scan is much larger than the rest. The queue's places are allotted once, so boxing would gain nothing.
#[allow(clippy::large_enum_variant)]
#[derive(Clone, Debug, Default)]
pub enum Work {
    /// An empty place.
    #[default]
    None,
    /// A scan to measure.
    Scan(RawScan),
    /// A pose for the attitude's history.
    Pose(Pose),
    /// A configuration that holds from here on.
    Config(Config),
    /// A border of the survey.
    Session(Session),
}

/// The queue to the survey.
pub type WorkQueue<'q> = Channel<'q, CriticalSectionRawMutex, Work>;

/// The shared state. Borrowed for one synchronous step at a time, never across a wait.
pub type Shared<'q> = RefCell<Acquisition<'q>>;

/// See the module.
pub struct Acquisition<'q> {
    decode: Decode,
    outlets: Outlets<'q>,
    lost: Lost,
}

/// Where events go.
struct Outlets<'q> {
    link: Outbox<'q>,
    survey: Sender<'q, CriticalSectionRawMutex, Work>,
    scans_skipped: u32,
}

/// What the lines and the command decoder have lost, as they tell it.
#[derive(Clone, Copy, Debug, Default)]
struct Lost {
    lidar: u32,
    ins: u32,
    pulses: u32,
    commands: u32,
}

impl<'q> Acquisition<'q> {
    /// Ties a decode layer to its outlets.
    #[must_use]
    pub fn new(decode: Decode, link: Outbox<'q>, survey: Sender<'q, CriticalSectionRawMutex, Work>) -> Self {
        Self { decode, outlets: Outlets { link, survey, scans_skipped: 0 }, lost: Lost::default() }
    }

    /// Says hello and starts the survey.
    pub fn start(&mut self, now: DeviceTime) {
        let Self { decode, outlets, .. } = self;
        decode.start(now, &mut |event| outlets.put(&event));
    }

    /// One byte from the scanner; `lost` is what its line has lost so far.
    pub fn lidar_byte(&mut self, byte: u8, at: DeviceTime, lost: u32) {
        self.lost.lidar = lost;
        let Self { decode, outlets, .. } = self;
        decode.lidar_byte(byte, at, &mut |event| outlets.put(&event));
    }

    /// One byte from the inertial unit, likewise.
    pub fn ins_byte(&mut self, byte: u8, at: DeviceTime, lost: u32) {
        self.lost.ins = lost;
        let Self { decode, outlets, .. } = self;
        decode.ins_byte(byte, at, &mut |event| outlets.put(&event));
    }

    /// One edge of the pulse per second; `lost` counts edges that were overrun.
    pub fn pulse(&mut self, at: DeviceTime, lost: u32) {
        self.lost.pulses = lost;
        let Self { decode, outlets, .. } = self;
        decode.pulse(at, &mut |event| outlets.put(&event));
    }

    /// One command. The caller makes sure of room for its consequence, see [`Acquisition::has_room`].
    pub fn command(&mut self, sequence: u16, command: &Command, now: DeviceTime) {
        let Self { decode, outlets, .. } = self;
        decode.command(sequence, command, now, &mut |event| outlets.put(&event));
    }

    /// Bytes on the command line that are no command, and its sequence number when that much could be read.
    pub fn rejected_command(&mut self, sequence: Option<u16>) {
        self.lost.commands = self.lost.commands.wrapping_add(1);
        if let Some(to) = sequence {
            self.outlets.link.message(&Message::Reply(Reply { to, outcome: Outcome::Unknown }));
        }
    }

    /// Whether a configuration or a border of the survey would find room in its queue.
    #[must_use]
    pub fn has_room(&self) -> bool {
        !self.outlets.survey.is_full()
    }

    /// Lets time pass: the status goes out when its second has come.
    pub fn tick(&mut self, now: DeviceTime) {
        self.count_losses();
        let Self { decode, outlets, .. } = self;
        decode.tick(now, &mut |event| outlets.put(&event));
    }

    /// A result of the survey.
    pub fn profile(&mut self, profile: Profile) {
        self.outlets.link.message(&Message::Profile(profile));
    }

    /// A line of text, or a piece of a defmt stream.
    pub fn log(&mut self, time: DeviceTime, level: Level, text: &[u8]) {
        self.outlets.link.message(&Message::Log(LogLine { time, level, text }));
    }

    /// The configuration in force.
    #[must_use]
    pub fn config(&self) -> Config {
        *self.decode.config()
    }

    /// All counters.
    #[must_use]
    pub fn status(&mut self, now: DeviceTime) -> Status {
        self.count_losses();
        self.decode.status(now)
    }

    fn count_losses(&mut self) {
        let losses = self.decode.losses();
        losses.lidar_overruns = self.lost.lidar;
        losses.ins_overruns = self.lost.ins;
        losses.pulses_overrun = self.lost.pulses;
        losses.commands_rejected = self.lost.commands;
        losses.scans_skipped = self.outlets.scans_skipped;
        losses.frames_dropped = self.outlets.link.dropped();
    }
}

impl Outlets<'_> {
    fn put(&mut self, event: &Event<'_>) {
        match event {
            Event::Scan(scan) => {
                if self.survey.len() + RESERVE < QUEUE {
                    let _room = self.queue(|| Work::Scan((*scan).clone()));
                } else {
                    self.scans_skipped = self.scans_skipped.wrapping_add(1);
                }
            }
            Event::Message(message) => {
                let queued = match *message {
                    Message::Pose(pose) => self.queue(|| Work::Pose(pose)),
                    Message::Config(config) => self.queue(|| Work::Config(config)),
                    Message::Session(session) => self.queue(|| Work::Session(session)),
                    _ => true,
                };
                if !queued {
                    self.link.drop_one();
                    return;
                }
            }
        }
        self.link.event(event);
    }

    /// Queues one input; false when there is no room.
    fn queue(&mut self, work: impl FnOnce() -> Work) -> bool {
        let Some(place) = self.survey.try_send() else { return false };
        *place = work();
        self.survey.send_done();
        true
    }
}
