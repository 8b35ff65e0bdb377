//! What the tasks of the acquisition executor share: the decode layer, the way to the link and the way to the survey.
//!
//! Every event goes to the survey's queue and to the link in one step that nothing interrupts at this priority, so that both see
//! the same order: a log then holds the survey's input exactly, which is what makes it provable.
//!
//! The survey runs at a lower priority and may be behind. A scan without room in its queue is streamed, counted as skipped and
//! not measured; a pose is streamed. Before either goes a `Skip`, so that who repeats the survey from the log leaves it out too.

use core::cell::RefCell;

use crossfall_core::instrument::{Decode, Event};
use crossfall_core::sensors::{lms2xx, novatel};
use crossfall_protocol::message::{Command, Level, LogLine, Message, Outcome, Profile, Reply, Sensor, Skip, Status};
use crossfall_protocol::{Config, DeviceTime};

use crate::outbox::Outbox;
use crate::work::{Work, WorkSender};

/// The shared state. Borrowed for one synchronous step at a time, never across a wait.
pub type Shared<'q> = RefCell<Acquisition<'q>>;

/// See the module.
pub struct Acquisition<'q> {
    decode: &'q mut Decode,
    outlets: Outlets<'q>,
    lost: Lost,
}

/// Where events go.
struct Outlets<'q> {
    link: &'q mut Outbox<'q>,
    survey: WorkSender<'q>,
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
    /// Ties a decode layer to its outlets. Both are large and stay where they are: a board's stack is no place for them.
    #[must_use]
    pub fn new(decode: &'q mut Decode, link: &'q mut Outbox<'q>, survey: WorkSender<'q>) -> Self {
        Self { decode, outlets: Outlets { link, survey, scans_skipped: 0 }, lost: Lost::default() }
    }

    /// Says hello and starts the survey.
    pub fn start(&mut self, now: DeviceTime) {
        let Self { decode, outlets, .. } = self;
        decode.start(now, &mut |event| outlets.put(&event));
    }

    /// One byte from the scanner; `lost` is what its line has lost so far. What the scanner says goes to `heard`.
    pub fn lidar_byte(&mut self, byte: u8, at: DeviceTime, lost: u32, heard: &mut impl FnMut(&lms2xx::Event<'_>)) {
        self.lost.lidar = lost;
        let Self { decode, outlets, .. } = self;
        decode.hear_lidar(byte, at, heard, &mut |event| outlets.put(&event));
    }

    /// Gives up what the scanner was saying.
    pub fn cut_lidar(&mut self) {
        let Self { decode, outlets, .. } = self;
        decode.cut_lidar(&mut |event| outlets.put(&event));
    }

    /// One byte from the inertial unit, likewise.
    pub fn ins_byte(&mut self, byte: u8, at: DeviceTime, lost: u32, heard: &mut impl FnMut(&novatel::Event)) {
        self.lost.ins = lost;
        let Self { decode, outlets, .. } = self;
        decode.hear_ins(byte, at, heard, &mut |event| outlets.put(&event));
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

    /// Whether a command has asked for this sensor to be brought up again; told once.
    pub fn take_restart(&mut self, sensor: Sensor) -> bool {
        self.decode.take_restart(sensor)
    }

    /// Bytes on the command line that are no command, and its sequence number when that much could be read.
    pub fn rejected_command(&mut self, sequence: Option<u16>) {
        self.lost.commands = self.lost.commands.wrapping_add(1);
        if let Some(to) = sequence {
            self.outlets.link.message(&Message::Reply(Reply { to, outcome: Outcome::Unknown }));
        }
    }

    /// Whether what a command brings about, a configuration or two borders of the survey, would find room in its queue.
    #[must_use]
    pub fn has_room(&self) -> bool {
        self.outlets.survey.has_room()
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
        let queued = match *event {
            Event::Scan(scan) => {
                if !self.survey.scan(scan) {
                    self.scans_skipped = self.scans_skipped.wrapping_add(1);
                    self.link.message(&Message::Skip(Skip::Scan(scan.index)));
                }
                true
            }
            Event::Message(Message::Pose(pose)) => {
                if !self.survey.input(Work::Pose(pose)) {
                    self.link.message(&Message::Skip(Skip::Pose(pose.time)));
                }
                true
            }
            Event::Message(Message::Config(config)) => self.survey.input(Work::Config(config)),
            Event::Message(Message::Session(session)) => self.survey.input(Work::Session(session)),
            Event::Message(_) => true,
        };
        if queued {
            self.link.event(event);
        } else {
            self.link.drop_one();
        }
    }
}
