//! Finding checked frames in a damaged byte stream, in bounded time and memory, without losing a good one.
//!
//! A parser that commits to a header must go back when the frame's check fails: a corrupted length may have swallowed
//! the next good frame. Going back naively costs the square of the frame length, which adversarial bytes can provoke.
//! Here nothing is read twice. Every place that looks like a header becomes an *open* candidate the moment its header
//! is complete, also inside another candidate. Candidates are decided in the order of their starts, each once its
//! last byte is there: a good one closes all that begin inside it, a bad one closes alone. The check of any stretch of
//! the stream follows in constant time from the running checks at its two ends, because both sensors' checks are
//! linear: `check(frame) = running(end) - running(start) * x^length`.
//!
//! Cost: about 50 instructions a byte on a Cortex-M4; one multiplication in GF(2) a candidate. One push decides at most
//! `OPEN` candidates, and every candidate is decided once. Memory: one longest frame and a quarter, its running checks,
//! and the most candidates that it can hold; 8.5 KB for the scanner, 3.7 KB for the receiver.
//!
//! Guarantee: every valid frame is found unless it begins inside another valid frame that begins earlier (bytes that
//! pass header and check *are* a frame to any receiver). It comes out no later than [`Protocol::LONGEST`] bytes after its start.

use core::marker::PhantomData;

use crossfall_protocol::DeviceTime;
use crossfall_protocol::message::LineCounters;
use heapless::Deque;

/// What the first bytes of a possible frame tell.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Verdict {
    /// No frame begins here.
    No,
    /// One may, as far as there are bytes.
    More,
    /// One may, of so many bytes in all.
    Frame(u16),
}

/// The frame format of a sensor.
pub(super) trait Protocol {
    /// State of the running check; its default is the state before the first byte.
    type Check: Copy + Default;
    /// The byte that every frame begins with.
    const SYNC: u8;
    /// Bytes after which [`Protocol::judge`] decides; shorter than the shortest frame, at most [`RECENT`].
    const HEADER: usize;
    /// The longest frame, check included.
    const LONGEST: usize;
    /// Bytes of the check at the end of a frame.
    const TRAILER: usize;
    /// The least distance of two places that [`Protocol::judge`] both takes for headers.
    const SPACING: usize;

    /// Judges the beginning of a frame from its first bytes, at most [`Protocol::HEADER`].
    fn judge(beginning: &[u8]) -> Verdict;

    /// Takes one byte, and the one before it, into the running check.
    fn step(check: Self::Check, previous: u8, byte: u8) -> Self::Check;

    /// Whether the frame's check holds, from the running checks before its first byte and after the last one covered.
    fn holds(before: Self::Check, previous: u8, after: Self::Check, frame: &[u8]) -> bool;
}

/// Arrivals kept: a header's first byte is this close when the header is complete. A power of two.
const RECENT: usize = 16;

/// A whole frame whose check holds.
#[derive(Clone, Copy, Debug)]
pub(super) struct Frame<'a> {
    /// All its bytes.
    pub bytes: &'a [u8],
    /// Arrival of the first.
    pub at: DeviceTime,
}

/// A place that looks like a header and is not yet decided.
#[derive(Clone, Copy, Debug)]
struct Open {
    at: DeviceTime,
    start: Position,
    total: u16,
}

/// Number of a byte in the stream, modulo 2^32. Positions that are compared are less than 2^31 apart: whatever is
/// further back than the buffer is brought forward when the buffer moves.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Position(u32);

impl Position {
    fn plus(self, bytes: usize) -> Self {
        Self(self.0.wrapping_add(bytes as u32))
    }

    fn minus(self, bytes: usize) -> Self {
        Self(self.0.wrapping_sub(bytes as u32))
    }

    /// Bytes from `earlier` to here; the caller knows that it is not later.
    fn since(self, earlier: Self) -> usize {
        self.0.wrapping_sub(earlier.0) as usize
    }

    fn is_before(self, other: Self) -> bool {
        (self.0.wrapping_sub(other.0) as i32) < 0
    }

    fn max(self, other: Self) -> Self {
        if self.is_before(other) { other } else { self }
    }
}

/// Bytes of the buffer for frames of at most `longest`: live bytes plus a quarter, so that the buffer seldom moves.
pub(super) const fn room(longest: usize) -> usize {
    longest + longest / 4 + 2 * RECENT
}

/// Candidates that can be open at once.
pub(super) const fn most_open(longest: usize, spacing: usize) -> usize {
    longest.div_ceil(spacing)
}

/// The engine. `ROOM` is [`room`] and `OPEN` is [`most_open`] of the protocol's constants.
pub(super) struct Framer<P: Protocol, const ROOM: usize, const OPEN: usize> {
    bytes: [u8; ROOM],
    checks: [P::Check; ROOM],
    filled: usize,
    origin: Position,
    /// Bytes that the buffer has let go of.
    dropped: u64,
    /// Everything before is decided.
    floor: Position,
    /// End of the frame that failed last.
    bad_until: Position,
    /// Where the first open candidate ends; anywhere when none is open.
    due: Position,
    arrivals: [DeviceTime; RECENT],
    previous: u8,
    check: P::Check,
    open: Deque<Open, OPEN>,
    framed: u64,
    frames: u32,
    bad_frames: u32,
    protocol: PhantomData<P>,
}

impl<P: Protocol, const ROOM: usize, const OPEN: usize> Framer<P, ROOM, OPEN> {
    const SIZES_HOLD: () = {
        assert!(P::HEADER <= RECENT && P::HEADER > P::TRAILER);
        assert!(ROOM == room(P::LONGEST) && OPEN == most_open(P::LONGEST, P::SPACING));
    };

    pub(super) fn new() -> Self {
        let () = Self::SIZES_HOLD;
        // The zero in front stands for the stream before its first byte: running check 0 and no previous byte.
        Self {
            bytes: [0; ROOM],
            checks: [P::Check::default(); ROOM],
            filled: 1,
            origin: Position(0),
            floor: Position(1),
            bad_until: Position(1),
            dropped: 0,
            due: Position(0),
            arrivals: [DeviceTime(0); RECENT],
            previous: 0,
            check: P::Check::default(),
            open: Deque::new(),
            framed: 0,
            frames: 0,
            bad_frames: 0,
            protocol: PhantomData,
        }
    }

    /// Takes the next byte, received at `at`, and gives every frame that it decides, in stream order.
    ///
    /// Kept to what every byte needs; a candidate that begins or ends here is dealt with out of line.
    #[inline]
    pub(super) fn push(&mut self, byte: u8, at: DeviceTime, frames: &mut impl FnMut(Frame<'_>)) {
        if self.filled >= ROOM {
            self.compact();
        }
        self.check = P::step(self.check, self.previous, byte);
        self.previous = byte;
        if let (Some(place), Some(check)) = (self.bytes.get_mut(self.filled), self.checks.get_mut(self.filled)) {
            (*place, *check) = (byte, self.check);
        }
        self.arrivals[self.next().0 as usize & (RECENT - 1)] = at;
        self.filled += 1;
        if self.filled.checked_sub(P::HEADER).and_then(|first| self.bytes.get(first)) == Some(&P::SYNC) {
            self.consider();
        }
        if self.next() == self.due {
            self.settle(frames);
        }
    }

    /// Opens a candidate if the last bytes are a plausible header.
    #[cold]
    fn consider(&mut self) {
        let start = self.next().minus(P::HEADER);
        if let Some(first) = self.filled.checked_sub(P::HEADER)
            && let Some(beginning) = self.bytes.get(first..self.filled)
            && let Verdict::Frame(total) = P::judge(beginning)
            && !start.is_before(self.floor)
        {
            let at = self.arrivals[start.0 as usize & (RECENT - 1)];
            if self.open.is_empty() {
                self.due = start.plus(usize::from(total));
            }
            // Never full: candidates lie at least SPACING apart within the longest frame.
            let _never_full = self.open.push_back(Open { at, start, total });
        }
    }

    /// Decides every candidate that is complete, in the order of their starts, up to one that is not.
    #[cold]
    fn settle(&mut self, frames: &mut impl FnMut(Frame<'_>)) {
        while let Some(&front) = self.open.front() {
            self.due = front.start.plus(usize::from(front.total));
            if self.next().is_before(self.due) {
                return;
            }
            self.open.pop_front();
            self.decide(front, frames);
        }
    }

    /// Ends the stream here: what is incomplete can never be completed and is skipped, whole frames behind it come out.
    pub(super) fn finish(&mut self, frames: &mut impl FnMut(Frame<'_>)) {
        let next = self.next();
        while let Some(front) = self.open.pop_front() {
            if !next.is_before(front.start.plus(usize::from(front.total))) {
                self.decide(front, frames);
            }
        }
        (self.floor, self.bad_until) = (next, next);
    }

    /// Whether a candidate stands open, so that the next byte belongs to it.
    pub(super) fn is_inside(&self) -> bool {
        !self.open.is_empty()
    }

    /// The counters of this line; overruns are the driver's to count.
    pub(super) fn counters(&self) -> LineCounters {
        let pending = self.pending() as u64;
        // Without the zero in front of the first byte.
        let received = self.dropped + self.filled as u64 - 1;
        LineCounters {
            bytes: received,
            frames: self.frames,
            bad_frames: self.bad_frames,
            skipped: received - self.framed - pending,
            overruns: 0,
        }
    }

    /// Bytes that may still become a frame.
    pub(super) fn pending(&self) -> usize {
        self.next().since(self.undecided())
    }

    fn next(&self) -> Position {
        self.origin.plus(self.filled)
    }

    /// The first byte that may still become part of a frame.
    fn undecided(&self) -> Position {
        let next = self.next();
        if let Some(front) = self.open.front() {
            return front.start;
        }
        for back in (1..P::HEADER).rev() {
            if let Some(first) = self.filled.checked_sub(back)
                && let Some(beginning) = self.bytes.get(first..self.filled)
                && !next.minus(back).is_before(self.floor)
                && P::judge(beginning) == Verdict::More
            {
                return next.minus(back);
            }
        }
        next
    }

    fn decide(&mut self, candidate: Open, frames: &mut impl FnMut(Frame<'_>)) {
        let total = usize::from(candidate.total);
        let (start, end) = (candidate.start, candidate.start.plus(total));
        let first = start.since(self.origin);
        let good = match (
            self.bytes.get(first..first + total),
            first.checked_sub(1).and_then(|i| self.bytes.get(i)),
            first.checked_sub(1).and_then(|i| self.checks.get(i)),
            self.checks.get((first + total).saturating_sub(P::TRAILER + 1)),
        ) {
            (Some(frame), Some(&previous), Some(&before), Some(&after)) => {
                P::holds(before, previous, after, frame).then_some(frame)
            }
            _ => None,
        };
        if let Some(bytes) = good {
            self.frames = self.frames.wrapping_add(1);
            self.framed += total as u64;
            (self.floor, self.bad_until) = (end, end);
            while self.open.front().is_some_and(|inner| inner.start.is_before(end)) {
                self.open.pop_front();
            }
            frames(Frame { bytes, at: candidate.at });
        } else if !start.is_before(self.bad_until) {
            // Header-shaped bytes inside a frame that has failed already are not another lost frame.
            self.bad_frames = self.bad_frames.wrapping_add(1);
            self.bad_until = end;
        }
    }

    /// Moves what may still be needed to the front: from the byte before the first open candidate, or before the
    /// header that may be under way.
    #[cold]
    fn compact(&mut self) {
        let header = self.next().minus(P::HEADER - 1);
        let first = self.open.front().map_or(header, |front| front.start);
        let drop = first.since(self.origin).saturating_sub(1).min(ROOM);
        self.bytes.copy_within(drop.., 0);
        self.checks.copy_within(drop.., 0);
        self.filled = self.filled.saturating_sub(drop);
        self.origin = self.origin.plus(drop);
        self.dropped += drop as u64;
        self.floor = self.floor.max(self.origin);
        self.bad_until = self.bad_until.max(self.origin);
    }
}
