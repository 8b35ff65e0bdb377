//! Drives that have been: a capture or a log, played as if it came from a board now.
//!
//! A capture runs through the instrument in process. Of a log the scans, poses and pulses are taken and surveyed anew, so that commands work on
//! it as on a board: another configuration gives other profiles. Both are played up to an instant of their own time and can be
//! wound to any other; winding goes through the file from its start, which takes a second or so for an hour of driving.

use std::path::{Path, PathBuf};

use crossfall_core::instrument::{Event, Instrument, Survey};
use crossfall_core::protocol::frame::{Event as Received, Gap, HostDecoder, Sequence};
use crossfall_core::protocol::message::{ClockState, Command, Hello, Marker, Message, Outcome, Reply, Session};
use crossfall_core::protocol::{Config, DeviceTime, schema};
use crossfall_core::scan::RawScan;
use crossfall_core::sensors::{Scanner, cola, lms2xx};

use crate::capture::{self, Chunk};
use crate::container::Error;
use crate::log;
use crate::recorded::Recorded;
use crate::run::{Wires, identity};
use crate::scanner::{self, Family};

/// How much is played before the instant wound to, so that clock and attitude have settled: in nanoseconds.
const LEAD_NS: u64 = 4_000_000_000;

/// What a film shows.
#[expect(clippy::large_enum_variant, reason = "one at a time, on its way to a callback")]
pub enum Shown<'a> {
    /// What a board would have sent.
    Event(Event<'a>),
    /// The board has booted here: its frames count from 0 again, its hello follows.
    Boot,
}

/// A capture or a log.
pub enum Film {
    /// Sensor bytes with an LMS 2xx.
    Capture(Box<CaptureFilm<lms2xx::Decoder>>),
    /// Sensor bytes with a scanner that speaks CoLa B.
    ColaCapture(Box<CaptureFilm<cola::Decoder>>),
    /// Frames of a board.
    Log(Box<LogFilm>),
}

impl Film {
    /// Opens whichever it is.
    ///
    /// # Errors
    /// When the file cannot be read or is neither.
    pub fn open(path: &Path, config: Option<Config>) -> Result<Self, Error> {
        let reader = match Recorded::open(path)? {
            Recorded::Capture(reader) => reader,
            Recorded::Log(_) => return Ok(Self::Log(Box::new(LogFilm::open(path, config)?))),
        };
        let config = config.unwrap_or_default();
        Ok(match scanner::of_chunks(reader).0 {
            Family::Lms2xx => {
                let scanner = |config: &Config| lms2xx::Decoder::new(config.scanner.measuring_mode);
                Self::Capture(Box::new(CaptureFilm::open(path, config, Family::Lms2xx, scanner)?))
            }
            Family::Cola => {
                let scanner = |_: &Config| cola::Decoder::default();
                Self::ColaCapture(Box::new(CaptureFilm::open(path, config, Family::Cola, scanner)?))
            }
        })
    }

    /// What viewers are told that it is.
    #[must_use]
    pub fn kind(&self) -> &'static str {
        match self {
            Self::Capture(_) | Self::ColaCapture(_) => "capture",
            Self::Log(_) => "log",
        }
    }

    /// Its first and last instant, in nanoseconds of its own time.
    #[must_use]
    pub fn span_ns(&self) -> (u64, u64) {
        match self {
            Self::Capture(film) => film.span_ns,
            Self::ColaCapture(film) => film.span_ns,
            Self::Log(film) => film.span_ns,
        }
    }

    /// Plays on up to an instant; false when the end has come. Damage in the file is passed over here: `verify` and `info` tell it.
    pub fn play(&mut self, until_ns: u64, out: &mut impl FnMut(Shown<'_>)) -> bool {
        match self {
            Self::Capture(film) => film.play(until_ns, out),
            Self::ColaCapture(film) => film.play(until_ns, out),
            Self::Log(film) => film.play(until_ns, out),
        }
    }

    /// Winds to an instant.
    ///
    /// # Errors
    /// When the file cannot be read any more.
    pub fn wind(&mut self, to_ns: u64, out: &mut impl FnMut(Shown<'_>)) -> Result<(), Error> {
        match self {
            Self::Capture(film) => film.wind(to_ns, out),
            Self::ColaCapture(film) => film.wind(to_ns, out),
            Self::Log(film) => film.wind(to_ns, out),
        }
    }

    /// Does what a board would do, but for restarts of sensors: there are none.
    pub fn command(&mut self, sequence: u16, command: &Command, out: &mut impl FnMut(Shown<'_>)) {
        match self {
            Self::Capture(film) => film.command(sequence, command, out),
            Self::ColaCapture(film) => film.command(sequence, command, out),
            Self::Log(film) => film.command(sequence, command, out),
        }
    }
}

/// Sensor bytes through the instrument.
pub struct CaptureFilm<S> {
    path: PathBuf,
    family: Family,
    scanner: fn(&Config) -> S,
    span_ns: (u64, u64),
    reader: capture::Reader,
    next: Option<Chunk>,
    instrument: Box<Instrument<S>>,
    wires: Wires,
    now_ns: u64,
    begun: bool,
    ended: bool,
}

impl<S: Scanner> CaptureFilm<S> {
    fn open(path: &Path, config: Config, family: Family, scanner: fn(&Config) -> S) -> Result<Self, Error> {
        let reader = capture::Reader::open(path)?;
        let span_ns = reader.span_ns().unwrap_or_default();
        Ok(Self {
            path: path.to_path_buf(),
            family,
            scanner,
            span_ns,
            reader,
            next: None,
            instrument: Box::new(Instrument::with_scanner(scanner(&config), config, identity())),
            wires: Wires::new(&config, family),
            now_ns: span_ns.0,
            begun: false,
            ended: false,
        })
    }

    fn play(&mut self, until_ns: u64, out: &mut impl FnMut(Shown<'_>)) -> bool {
        let Self { instrument, wires, now_ns, .. } = self;
        if !self.begun {
            self.begun = true;
            instrument.start(DeviceTime(*now_ns / 1_000), &mut |event| out(Shown::Event(event)));
        }
        loop {
            if self.next.is_none() {
                self.next = self.reader.by_ref().flatten().next();
            }
            let until = self.next.as_ref().map(|chunk| chunk.device_time_ns);
            wires.deliver(Some(until.unwrap_or(u64::MAX).min(until_ns)), instrument, now_ns, &mut |_, event| {
                out(Shown::Event(event))
            });
            match self.next.take_if(|chunk| chunk.device_time_ns <= until_ns) {
                Some(chunk) => wires.push(chunk),
                None if self.next.is_some() => {
                    *now_ns = until_ns.max(*now_ns);
                    return true;
                }
                None => break,
            }
        }
        if !self.ended {
            self.ended = true;
            wires.deliver(None, instrument, now_ns, &mut |_, event| out(Shown::Event(event)));
            instrument.finish(DeviceTime(*now_ns / 1_000), &mut |event| out(Shown::Event(event)));
        }
        false
    }

    fn wind(&mut self, to_ns: u64, out: &mut impl FnMut(Shown<'_>)) -> Result<(), Error> {
        let config = *self.instrument.decode().config();
        let wound = Self::open(&self.path, config, self.family, self.scanner)?;
        *self = wound;
        let from_ns = to_ns.saturating_sub(LEAD_NS).max(self.span_ns.0);
        self.next = self.reader.by_ref().flatten().find(|chunk| chunk.device_time_ns >= from_ns);
        self.now_ns = from_ns;
        self.play(to_ns, out);
        Ok(())
    }

    fn command(&mut self, sequence: u16, command: &Command, out: &mut impl FnMut(Shown<'_>)) {
        if matches!(command, Command::Restart(_)) {
            let reply = Reply { to: sequence, outcome: Outcome::Unknown };
            return out(Shown::Event(Event::Message(Message::Reply(reply))));
        }
        let now = DeviceTime(self.now_ns / 1_000);
        self.instrument.command(sequence, command, now, &mut |event| out(Shown::Event(event)));
    }
}

/// A board's frames, surveyed anew.
pub struct LogFilm {
    path: PathBuf,
    span_ns: (u64, u64),
    reader: log::Recording,
    /// Absent only while it is at work.
    decoder: Option<Box<HostDecoder>>,
    sequence: Sequence,
    next: Option<log::Frame>,
    survey: Box<Survey>,
    /// Likewise.
    room: Option<Box<RawScan>>,
    firmware: String,
    board: String,
    boot: u32,
    config: Config,
    /// Whether `config` is the user's and not the log's.
    configured: bool,
    running: bool,
    clock: Option<ClockState>,
    latest: DeviceTime,
    markers: u32,
    begun: bool,
    ended: bool,
}

impl LogFilm {
    fn open(path: &Path, config: Option<Config>) -> Result<Self, Error> {
        // Once through for its end: logs have no index.
        let mut span_ns: Option<(u64, u64)> = None;
        for frame in log::Recording::open(path)?.flatten() {
            span_ns = Some((span_ns.map_or(frame.receive_ns, |(first, _)| first), frame.receive_ns));
        }
        let mut film = Self::at_start(path, span_ns.unwrap_or_default())?;
        film.configured = config.is_some();
        film.config = config.unwrap_or_default();
        Ok(film)
    }

    fn at_start(path: &Path, span_ns: (u64, u64)) -> Result<Self, Error> {
        Ok(Self {
            path: path.to_path_buf(),
            span_ns,
            reader: log::Recording::open(path)?,
            decoder: None,
            sequence: Sequence::new(),
            next: None,
            survey: Box::new(Survey::new()),
            room: None,
            firmware: String::new(),
            board: String::new(),
            boot: 0,
            config: Config::default(),
            configured: false,
            running: true,
            clock: None,
            latest: DeviceTime(0),
            markers: 0,
            begun: false,
            ended: false,
        })
    }

    fn play(&mut self, until_ns: u64, out: &mut impl FnMut(Shown<'_>)) -> bool {
        self.go(until_ns, true, out)
    }

    /// Plays on; or, unseen, only takes note of who the board is, its configuration and its clock.
    fn go(&mut self, until_ns: u64, seen: bool, out: &mut impl FnMut(Shown<'_>)) -> bool {
        loop {
            if self.next.is_none() {
                self.next = self.reader.by_ref().flatten().next();
            }
            let Some(frame) = self.next.take_if(|frame| frame.receive_ns <= until_ns) else {
                if self.next.is_none() && seen && !self.ended {
                    self.ended = true;
                    let stopped = Message::Session(Session::Stopped(self.latest));
                    self.show(&Event::Message(stopped), out);
                }
                return self.next.is_some();
            };
            let mut decoder = self.decoder.take().unwrap_or_else(|| Box::new(HostDecoder::new()));
            let mut bytes = frame.bytes.as_slice();
            while let Some(received) = decoder.next(&mut bytes) {
                if let Received::Frame(frame) = received {
                    let gap = self.sequence.observe_message(frame.sequence, &frame.body);
                    self.take(&frame.body, gap, seen, out);
                }
            }
            decoder.finish();
            self.decoder = Some(decoder);
        }
    }

    fn take(&mut self, message: &Message<'_>, gap: Gap, seen: bool, out: &mut impl FnMut(Shown<'_>)) {
        if gap == Gap::Restarted {
            self.clock = None;
            self.markers = 0;
            self.begun = false;
            if seen {
                out(Shown::Boot);
            }
        }
        match message {
            Message::Hello(hello) => {
                (self.firmware, self.board, self.boot) = (hello.firmware.into(), hello.board.into(), hello.boot);
            }
            Message::Config(config) if !self.configured => self.config = *config,
            Message::Clock(clock) => self.clock = Some(*clock),
            Message::Marker(marker) => self.markers = self.markers.max(marker.number.wrapping_add(1)),
            _ => {}
        }
        if !seen || matches!(message, Message::Hello(_)) {
            return;
        }
        if !self.begun {
            self.begun = true;
            self.introduce(out);
            if self.running {
                self.show(&Event::Message(Message::Session(Session::Started(self.latest))), out);
            }
        }
        match message {
            // What is made here anew.
            Message::Hello(_) | Message::Profile(_) | Message::Skip(_) | Message::Session(_) | Message::Reply(_) => {}
            Message::Config(_) => self.show(&Event::Message(Message::Config(self.config)), out),
            Message::Scan(scan) => {
                self.latest = scan.stx;
                if self.running {
                    let mut room = self.room.take().unwrap_or_else(|| Box::new(RawScan::EMPTY));
                    if let Ok(event) = Event::of(message, &mut room) {
                        self.show(&event, out);
                    }
                    self.room = Some(room);
                }
            }
            _ => {
                match message {
                    Message::Pose(pose) => self.latest = self.latest.max(pose.time),
                    Message::Status(status) => self.latest = status.time,
                    _ => {}
                }
                self.show(&Event::Message(*message), out);
            }
        }
    }

    /// Sends an event out, then through the survey, as the instrument does.
    fn show(&mut self, event: &Event<'_>, out: &mut impl FnMut(Shown<'_>)) {
        out(Shown::Event(*event));
        self.survey.take(event, &mut |profile| out(Shown::Event(Event::Message(Message::Profile(profile)))));
    }

    fn introduce(&mut self, out: &mut impl FnMut(Shown<'_>)) {
        let hello =
            Hello { schema: schema::HASH, firmware: &self.firmware, board: &self.board, boot: self.boot, restart: "" };
        out(Shown::Event(Event::Message(Message::Hello(hello))));
        self.show(&Event::Message(Message::Config(self.config)), out);
        if let Some(clock) = self.clock {
            out(Shown::Event(Event::Message(Message::Clock(clock))));
        }
    }

    fn wind(&mut self, to_ns: u64, out: &mut impl FnMut(Shown<'_>)) -> Result<(), Error> {
        let wound = Self::at_start(&self.path, self.span_ns)?;
        let (config, configured, running) = (self.config, self.configured, self.running);
        *self = Self { configured, running, config: if configured { config } else { wound.config }, ..wound };
        self.go(to_ns.saturating_sub(LEAD_NS), false, out);
        self.go(to_ns, true, out);
        Ok(())
    }

    /// What `instrument::Decode::command` does on a board: here nothing is decoded any more.
    fn command(&mut self, sequence: u16, command: &Command, out: &mut impl FnMut(Shown<'_>)) {
        let outcome = match command {
            Command::Identify => {
                self.introduce(out);
                Outcome::Done
            }
            Command::Ping(number) => Outcome::Pong(*number),
            Command::Configure(config) => match config.check() {
                Ok(()) => {
                    (self.config, self.configured) = (*config, true);
                    self.show(&Event::Message(Message::Config(*config)), out);
                    Outcome::Done
                }
                Err(_) => Outcome::BadConfig,
            },
            Command::Start => {
                // The scans that wait in a survey that runs are measured, not lost.
                if self.running {
                    self.show(&Event::Message(Message::Session(Session::Stopped(self.latest))), out);
                }
                self.running = true;
                self.show(&Event::Message(Message::Session(Session::Started(self.latest))), out);
                Outcome::Done
            }
            Command::Stop => {
                self.running = false;
                self.show(&Event::Message(Message::Session(Session::Stopped(self.latest))), out);
                Outcome::Done
            }
            Command::Mark(label) => {
                let marker = Marker { time: self.latest, number: self.markers, label: *label };
                self.markers = self.markers.wrapping_add(1);
                out(Shown::Event(Event::Message(Message::Marker(marker))));
                Outcome::Done
            }
            Command::Restart(_) => Outcome::Unknown,
        };
        out(Shown::Event(Event::Message(Message::Reply(Reply { to: sequence, outcome }))));
    }
}

#[cfg(test)]
mod tests {
    use crossfall_core::protocol::message::Sensor;

    use super::*;
    use crate::simulate::scene::Scene;
    use crate::{run, simulate};

    /// A drive of so many seconds, as a capture and as a log.
    fn drive(folder: &Path, seconds: f64) -> (PathBuf, PathBuf) {
        let (drive, log_path) = (folder.join("drive.mcap"), folder.join("drive.log.mcap"));
        let mut scene = Scene::default();
        scene.drive.seconds = seconds;
        let mut writer = capture::Writer::create(&drive).unwrap();
        simulate::simulate(&scene, &mut writer, |_| ()).unwrap();
        writer.finish().unwrap();
        let mut log = log::Writer::create(&log_path).unwrap();
        run::run(&mut capture::Reader::open(&drive).unwrap(), &Config::default(), &mut log, |_| ()).unwrap();
        log.finish().unwrap();
        (drive, log_path)
    }

    #[test]
    fn another_start_loses_no_scan_that_waits_in_the_survey() {
        let folder = tempfile::tempdir().unwrap();
        let (drive, log) = drive(folder.path(), 2.0);
        for (path, kind) in [(drive, "capture"), (log, "log")] {
            let mut film = Film::open(&path, None).unwrap();
            assert_eq!(film.kind(), kind);
            let (mut scans, mut profiles, mut sessions) = (0, 0, Vec::new());
            let mut see = |shown: Shown<'_>| match shown {
                Shown::Event(Event::Scan(_)) => scans += 1,
                Shown::Event(Event::Message(Message::Profile(_))) => profiles += 1,
                Shown::Event(Event::Message(Message::Session(session))) => {
                    sessions.push(matches!(session, Session::Started(_)));
                }
                _ => {}
            };
            let (first, last) = film.span_ns();
            film.play(first.midpoint(last), &mut see);
            film.command(0, &Command::Start, &mut see);
            film.play(u64::MAX, &mut see);
            assert_eq!(sessions, [true, false, true, false], "{kind}");
            assert!(scans > 60 && profiles == scans, "{kind}: {profiles} profiles of {scans} scans");
        }
    }

    #[test]
    fn no_film_restarts_a_sensor() {
        let folder = tempfile::tempdir().unwrap();
        let (drive, log) = drive(folder.path(), 0.5);
        for path in [drive, log] {
            let mut outcomes = Vec::new();
            let restart = Command::Restart(Sensor::Lidar);
            Film::open(&path, None).unwrap().command(7, &restart, &mut |shown| {
                if let Shown::Event(Event::Message(Message::Reply(reply))) = shown {
                    outcomes.push((reply.to, reply.outcome));
                }
            });
            assert_eq!(outcomes, [(7, Outcome::Unknown)]);
        }
    }
}
