//! One line of the pins: the chunks that wait on it, and when each of their bytes arrives.
//!
//! Where a capture stamps a chunk, the bytes after its first follow at the line's baud rate ([`Line`]). Nothing here bounds what waits: who pushes
//! looks at [`Wire::waiting`].

use std::collections::VecDeque;

use crossfall_core::instrument::Line;

use crate::capture::Chunk;

/// A line and what waits on it.
pub(crate) struct Wire {
    line: Line,
    chunks: VecDeque<Chunk>,
    taken: usize,
    waiting: usize,
}

impl Wire {
    /// Nothing waits on a line of a speed.
    pub(crate) fn new(baud: u32) -> Self {
        Self { line: Line::new(baud), chunks: VecDeque::new(), taken: 0, waiting: 0 }
    }

    /// Bytes that wait.
    pub(crate) fn waiting(&self) -> usize {
        self.waiting
    }

    /// What comes next on it.
    pub(crate) fn push(&mut self, chunk: Chunk) {
        if !chunk.data.is_empty() {
            self.waiting += chunk.data.len();
            self.chunks.push_back(chunk);
        }
    }

    /// When the next byte arrives, in nanoseconds; `u64::MAX` when none waits.
    pub(crate) fn next_arrival(&self) -> u64 {
        self.chunks.front().map_or(u64::MAX, |chunk| self.line.next_arrival(chunk.device_time_ns))
    }

    /// The next byte and its arrival; only called when there is one.
    pub(crate) fn take(&mut self) -> (u8, u64) {
        let Some(chunk) = self.chunks.front() else { return (0, u64::MAX) };
        let (byte, at_ns) = (chunk.data[self.taken], self.line.take(chunk.device_time_ns));
        self.taken += 1;
        self.waiting -= 1;
        if self.taken == chunk.data.len() {
            self.chunks.pop_front();
            self.taken = 0;
        }
        (byte, at_ns)
    }

    /// Appends the bytes that arrive before an instant.
    pub(crate) fn take_until(&mut self, end_ns: u64, into: &mut Vec<u8>) {
        while self.next_arrival() < end_ns {
            into.push(self.take().0);
        }
    }
}
