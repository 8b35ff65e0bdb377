//! From bytes to typed logs.

use crossfall_protocol::DeviceTime;
use crossfall_protocol::message::LineCounters;

use super::frame::{Frames, Header, LONGEST};
use super::logs::{Event, Log};
use crate::sensors::framing::{Frame, Framer, Protocol, most_open, room};

/// Decodes a receiver's stream, one byte at a time.
///
/// Accounting: every byte received is part of a good frame, skipped, or pending. ASCII between frames (prompts, answers
/// to commands) counts as skipped.
pub struct Decoder {
    framer: Framer<Frames, { room(LONGEST) }, { most_open(LONGEST, Frames::SPACING) }>,
    logs: Logs,
}

/// What turns frames into events.
struct Logs {
    solutions: u32,
    bad_fields: u32,
}

impl Default for Decoder {
    fn default() -> Self {
        Self::new()
    }
}

impl Decoder {
    /// A decoder at the start of a stream.
    #[must_use]
    pub fn new() -> Self {
        Self { framer: Framer::new(), logs: Logs { solutions: 0, bad_fields: 0 } }
    }

    /// Takes the next byte, which arrived at `at`, and tells what it completes: nothing, or one or several events.
    #[inline]
    pub fn push(&mut self, byte: u8, at: DeviceTime, out: &mut impl FnMut(Event<'_>)) {
        let logs = &mut self.logs;
        self.framer.push(byte, at, &mut |frame| logs.decode(frame, out));
    }

    /// Declares that nothing that is under way can be completed: at the end of a stream or when the line's speed
    /// changes. Its bytes count as skipped, unless whole frames stand behind a false beginning.
    pub fn finish(&mut self, out: &mut impl FnMut(Event<'_>)) {
        let logs = &mut self.logs;
        self.framer.finish(&mut |frame| logs.decode(frame, out));
    }

    /// Counters of the line, without overruns.
    #[must_use]
    pub fn counters(&self) -> LineCounters {
        self.framer.counters()
    }

    /// Bytes of a frame that may be under way.
    #[must_use]
    pub fn pending(&self) -> usize {
        self.framer.pending()
    }

    /// Poses decoded, usable or not.
    #[must_use]
    pub fn solutions(&self) -> u32 {
        self.logs.solutions
    }

    /// Fields that cannot be true: not a number, infinite, out of range, or missing.
    #[must_use]
    pub fn bad_fields(&self) -> u32 {
        self.logs.bad_fields
    }
}

impl Logs {
    fn decode(&mut self, frame: Frame<'_>, out: &mut impl FnMut(Event<'_>)) {
        // The framer gives whole frames only, so that there is a header to split off.
        let Some((header, body)) = Header::split(frame) else { return };
        let (log, bad) = Log::read(&header, body);
        self.bad_fields = self.bad_fields.wrapping_add(bad);
        if matches!(log, Log::Solution(..)) {
            self.solutions = self.solutions.wrapping_add(1);
        }
        out(Event { header, log });
    }
}
