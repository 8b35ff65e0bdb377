//! The instrument: everything between the pins and the link.
//!
//! ```text
//! lidar bytes ─┐
//! ins bytes ───┤                    ┌─> link and log
//! pulses ──────┼─> Decode ─ events ─┤
//! commands ────┘                    └─> Survey ─ profiles ─> link and log
//! ```
//!
//! The seam between [`Decode`] and [`Survey`] is what makes a log provable: all that crosses it is streamed. On a board the two run at
//! different priorities with a queue between them; on a desk [`Instrument`] runs them in one go. Both give the same events.

mod decode;
mod event;
mod line;
mod survey;
mod waiting;

pub use decode::{ClockReplay, Decode, Identity, Losses, RESTART_TEXT};
pub use event::Event;
pub use line::Line;
pub use survey::{Survey, WAITING};

use crossfall_protocol::message::{Command, Message, Profile};
use crossfall_protocol::{Config, DeviceTime};

use crate::sensors::{Scanner, lms2xx};

/// What makes profiles, for the hello: program, version and the number of the survey's answers. Profiles of two numbers may differ in their bits; a test
/// holds those of this one (`tests/survey_number.rs`).
pub const FIRMWARE: &str = concat!("crossfall ", env!("CARGO_PKG_VERSION"), " survey 2");

/// Both layers in one, for a desk: every event goes out first and then to the survey, whose profiles follow it.
///
/// Times must not go back by more than the sensors' stamps overlap: feed bytes and pulses in the order of their arrivals.
pub struct Instrument<S = lms2xx::Decoder> {
    decode: Decode<S>,
    survey: Survey,
    lidar: Line,
    ins: Line,
}

impl Instrument {
    /// An instrument at boot.
    #[must_use]
    pub fn new(config: Config, identity: Identity) -> Self {
        Self::with_scanner(lms2xx::Decoder::new(config.scanner.measuring_mode), config, identity)
    }
}

impl<S: Scanner> Instrument<S> {
    /// The same with a scanner of another kind.
    #[must_use]
    pub fn with_scanner(scanner: S, config: Config, identity: Identity) -> Self {
        Self {
            lidar: Line::new(config.scanner.baud),
            ins: Line::new(config.ins.baud),
            decode: Decode::with_scanner(scanner, config, identity),
            survey: Survey::new(),
        }
    }

    /// Says hello and starts the survey.
    pub fn start(&mut self, now: DeviceTime, out: &mut impl FnMut(Event<'_>)) {
        let survey = &mut self.survey;
        self.decode.start(now, &mut |event| through(survey, event, out));
    }

    /// Bytes from the scanner. The first arrived at `at`, the others follow at the configured baud rate.
    pub fn lidar_bytes(&mut self, at: DeviceTime, bytes: &[u8], out: &mut impl FnMut(Event<'_>)) {
        for &byte in bytes {
            let arrival = micros(self.lidar.take(at.0.saturating_mul(1_000)));
            self.lidar_byte(byte, arrival, out);
        }
    }

    /// Bytes from the inertial unit, likewise.
    pub fn ins_bytes(&mut self, at: DeviceTime, bytes: &[u8], out: &mut impl FnMut(Event<'_>)) {
        for &byte in bytes {
            let arrival = micros(self.ins.take(at.0.saturating_mul(1_000)));
            self.ins_byte(byte, arrival, out);
        }
    }

    /// One byte from the scanner and its own arrival.
    pub fn lidar_byte(&mut self, byte: u8, at: DeviceTime, out: &mut impl FnMut(Event<'_>)) {
        let survey = &mut self.survey;
        self.decode.lidar_byte(byte, at, &mut |event| through(survey, event, out));
    }

    /// One byte from the inertial unit and its own arrival.
    pub fn ins_byte(&mut self, byte: u8, at: DeviceTime, out: &mut impl FnMut(Event<'_>)) {
        let survey = &mut self.survey;
        self.decode.ins_byte(byte, at, &mut |event| through(survey, event, out));
    }

    /// One edge of the pulse per second.
    pub fn pps(&mut self, at: DeviceTime, out: &mut impl FnMut(Event<'_>)) {
        let survey = &mut self.survey;
        self.decode.pulse(at, &mut |event| through(survey, event, out));
    }

    /// One command; `sequence` is that of its frame.
    pub fn command(&mut self, sequence: u16, command: &Command, now: DeviceTime, out: &mut impl FnMut(Event<'_>)) {
        let survey = &mut self.survey;
        self.decode.command(sequence, command, now, &mut |event| through(survey, event, out));
    }

    /// Declares that no more bytes come: all that waits is worked off and all counters are reported.
    pub fn finish(&mut self, now: DeviceTime, out: &mut impl FnMut(Event<'_>)) {
        let survey = &mut self.survey;
        self.decode.finish(now, &mut |event| through(survey, event, out));
    }

    /// Lets time pass: sends the status when its second has come.
    pub fn tick(&mut self, now: DeviceTime, out: &mut impl FnMut(Event<'_>)) {
        self.decode.tick(now, out);
    }

    /// The decode layer, for its counters.
    #[must_use]
    pub fn decode(&self) -> &Decode<S> {
        &self.decode
    }
}

/// Sends an event out, then through the survey.
fn through(survey: &mut Survey, event: Event<'_>, out: &mut impl FnMut(Event<'_>)) {
    out(event);
    survey.take(&event, &mut |profile: Profile| out(Event::Message(Message::Profile(profile))));
}

fn micros(nanoseconds: u64) -> DeviceTime {
    DeviceTime(nanoseconds / 1_000)
}
