//! Frames on their way to the link: encoded at once, kept in a bounded queue of bytes, dropped whole when there is no room.
//!
//! A dropped frame uses up its sequence number, so that the host sees the gap, and is counted, so that the next status says how
//! many there were. Only tasks of the acquisition executor touch it: no lock.

use crossfall_core::instrument::Event;
use crossfall_core::scan::RawScan;
use crossfall_protocol::Message;
use crossfall_protocol::frame::{MAX_MESSAGE_FRAME, Sequencer};
use crossfall_protocol::message::Scan;
use crossfall_protocol::ranges::{self, MAX_CODE};
use embassy_sync::blocking_mutex::raw::NoopRawMutex;
use embassy_sync::pipe::Pipe;

/// Bytes that may wait for the link: 170 ms of a survey in full flow, and never less than four of the longest frames.
pub const CAPACITY: usize = 4096;

const _: () = assert!(CAPACITY >= 4 * MAX_MESSAGE_FRAME);

/// Encodes messages and keeps their frames until the link takes them.
pub struct Outbox<'q> {
    queue: &'q Queue,
    sequencer: Sequencer,
    dropped: u32,
    code: [u8; MAX_CODE],
    frame: [u8; MAX_MESSAGE_FRAME],
}

/// The bytes themselves, shared with the task that writes them to the link.
pub type Queue = Pipe<NoopRawMutex, CAPACITY>;

impl<'q> Outbox<'q> {
    /// An outbox that fills `queue`.
    #[must_use]
    pub const fn new(queue: &'q Queue) -> Self {
        Self { queue, sequencer: Sequencer::new(), dropped: 0, code: [0; MAX_CODE], frame: [0; MAX_MESSAGE_FRAME] }
    }

    /// Frames that found no room.
    #[must_use]
    pub const fn dropped(&self) -> u32 {
        self.dropped
    }

    /// Sends an event of the instrument.
    pub fn event(&mut self, event: &Event<'_>) {
        match event {
            Event::Scan(scan) => self.scan(scan),
            Event::Message(message) => self.message(message),
        }
    }

    /// Sends a message.
    pub fn message(&mut self, message: &Message<'_>) {
        let encoded = self.sequencer.message(message, &mut self.frame);
        let frame = encoded.ok().and_then(|length| self.frame.get(..length));
        enqueue(self.queue, frame, &mut self.dropped);
    }

    fn scan(&mut self, scan: &RawScan) {
        let RawScan { index, stx, layout, mode, status, counters, ref values } = *scan;
        let code = ranges::encode(layout, mode, values, &mut self.code);
        let message = Message::Scan(Scan { index, stx, layout, mode, status, counters, code });
        let encoded = self.sequencer.message(&message, &mut self.frame);
        let frame = encoded.ok().and_then(|length| self.frame.get(..length));
        enqueue(self.queue, frame, &mut self.dropped);
    }

    /// Drops what would have been a frame, so that the host sees a gap in its place.
    pub fn drop_one(&mut self) {
        let _gap = self.sequencer.take();
        self.dropped = self.dropped.wrapping_add(1);
    }
}

/// Queues a whole frame or counts it as dropped.
fn enqueue(queue: &Queue, frame: Option<&[u8]>, dropped: &mut u32) {
    match frame {
        Some(frame) if queue.free_capacity() >= frame.len() => {
            let mut rest = frame;
            // The pipe takes a piece up to the end of its ring at a time; two pieces at most, as there is room.
            while let Ok(taken) = queue.try_write(rest) {
                rest = rest.get(taken..).unwrap_or_default();
                if rest.is_empty() {
                    break;
                }
            }
        }
        _ => *dropped = dropped.wrapping_add(1),
    }
}
