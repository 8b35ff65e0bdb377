//! The sensors' byte streams: bytes with their arrival times in, scans, poses and replies out.
//!
//! All decoders are pure push parsers over one engine, `framing`: they hold no clock and no time-out, take one byte
//! at a time and account for every one of them. What comes out, and when each frame is said to have begun, depends on
//! the bytes and their arrivals alone, never on how they were chunked.

pub mod cola;
mod framing;
pub mod lms2xx;
pub mod novatel;

use crossfall_protocol::DeviceTime;
use crossfall_protocol::message::LineCounters;

use crate::scan::RawScan;

/// A decoder of a laser scanner's stream: what the instrument needs of it. docs/scanners.md tells how one is added.
pub trait Scanner {
    /// What the scanner says: scans and everything else.
    type Event<'a>;

    /// Takes the next byte, which arrived at `at`, and tells what it completes: nothing, or one or several events.
    fn push(&mut self, byte: u8, at: DeviceTime, out: &mut impl FnMut(Self::Event<'_>));

    /// Declares that nothing that is under way can be completed.
    fn finish(&mut self, out: &mut impl FnMut(Self::Event<'_>));

    /// The scan that an event is, if it is one.
    fn scan<'e>(event: &'e Self::Event<'_>) -> Option<&'e RawScan>;

    /// Assumes this measuring mode from now on, until the scanner reports its own.
    fn assume_measuring_mode(&mut self, mode: u8);

    /// Counters of the line, without overruns.
    fn counters(&self) -> LineCounters;

    /// Scans decoded.
    fn scans(&self) -> u32;

    /// Scans that the scanner's own numbers prove missing.
    fn scans_missing(&self) -> u32;

    /// Whole scan telegrams of a layout that is not known.
    fn scans_unreadable(&self) -> u32;
}
