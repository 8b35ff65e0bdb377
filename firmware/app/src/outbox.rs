//! Frames on their way to the link: encoded at once, kept in a bounded queue of bytes, dropped whole when there is no room.
//!
//! A dropped frame uses up its sequence number, so that the host sees the gap, and is counted, so that the next status says how
//! many there were. Only tasks of the acquisition executor touch it: no lock.

use crossfall_core::instrument::Event;
use crossfall_protocol::Message;
use crossfall_protocol::frame::{MAX_MESSAGE_FRAME, Sequencer};
use crossfall_protocol::ranges::MAX_CODE;
use embassy_sync::blocking_mutex::raw::NoopRawMutex;
use embassy_sync::pipe::Pipe;

/// Bytes that may wait for the link: 130 ms of a survey in full flow, and never less than three of the longest frames.
pub const CAPACITY: usize = 3072;

const _: () = assert!(CAPACITY >= 3 * MAX_MESSAGE_FRAME);

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
        let message = event.message(&mut self.code);
        send(&mut self.sequencer, &message, &mut self.frame, self.queue, &mut self.dropped);
    }

    /// Sends a message.
    pub fn message(&mut self, message: &Message<'_>) {
        send(&mut self.sequencer, message, &mut self.frame, self.queue, &mut self.dropped);
    }

    /// Drops what would have been a frame, so that the host sees a gap in its place.
    pub fn drop_one(&mut self) {
        let _gap = self.sequencer.take();
        self.dropped = self.dropped.wrapping_add(1);
    }
}

/// Queues a message's whole frame or counts it as dropped.
fn send(sequencer: &mut Sequencer, message: &Message<'_>, frame: &mut [u8], queue: &Queue, dropped: &mut u32) {
    let encoded = sequencer.message(message, frame);
    let frame = encoded.ok().and_then(|length| frame.get(..length));
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
