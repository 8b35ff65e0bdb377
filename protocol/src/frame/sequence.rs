//! Sequence numbers: dealt out by the sender, turned into a count of missing frames by the receiver.
//!
//! Sixteen bits wrap every 65,536 frames. A step forward of less than half a turn is read as frames lost, anything
//! else as a sender that began again; a loss of 32,768 frames or more (three minutes of a survey) is therefore seen but
//! not counted right.

use super::NoRoom;
use crate::message::{Command, Message};

/// The sender's side: every frame takes the next number, sent or not.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Sequencer {
    next: u16,
}

impl Sequencer {
    /// A sender that has sent nothing; its first frame is number 0.
    #[must_use]
    pub const fn new() -> Self {
        Self { next: 0 }
    }

    /// The number of the next frame. Also for a frame that will be dropped: the gap is how the receiver knows.
    pub fn take(&mut self) -> u16 {
        let sequence = self.next;
        self.next = sequence.wrapping_add(1);
        sequence
    }

    /// Encode a message under the next number, which is used up whether it fits or not.
    ///
    /// # Errors
    /// [`NoRoom`] as of [`Message::encode`].
    pub fn message(&mut self, message: &Message<'_>, out: &mut [u8]) -> Result<usize, NoRoom> {
        message.encode(self.take(), out)
    }

    /// Encode a command under the next number, which is used up whether it fits or not.
    ///
    /// # Errors
    /// [`NoRoom`] as of [`Command::encode`].
    pub fn command(&mut self, command: &Command, out: &mut [u8]) -> Result<usize, NoRoom> {
        command.encode(self.take(), out)
    }
}

/// What lies between a frame and the one before it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Gap {
    /// Nothing: the first frame of all, or the next one in order.
    None,
    /// So many frames were sent and not received.
    Missing(u16),
    /// The sender began again: what was lost in between cannot be known.
    Restarted,
}

/// The receiver's side.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Sequence {
    expected: Option<u16>,
    missing: u64,
    restarts: u64,
}

impl Sequence {
    /// A receiver that has seen nothing. Frames before the first one that it sees do not count as missing.
    #[must_use]
    pub const fn new() -> Self {
        Self { expected: None, missing: 0, restarts: 0 }
    }

    /// Take note of a frame that carries a command, or nothing known.
    pub fn observe(&mut self, sequence: u16) -> Gap {
        let gap = match self.expected.map(|expected| sequence.wrapping_sub(expected)) {
            None | Some(0) => Gap::None,
            Some(ahead) if ahead < 1 << 15 => Gap::Missing(ahead),
            Some(_) => Gap::Restarted,
        };
        self.note(sequence, gap)
    }

    /// Take note of a message's frame. A hello numbered 0 out of turn is the first word of a board that has rebooted:
    /// its count starts again and nothing is missing. (A hello that answers a command goes on with the count.)
    pub fn observe_message(&mut self, sequence: u16, message: &Message<'_>) -> Gap {
        let out_of_turn = self.expected.is_some_and(|expected| expected != sequence);
        if sequence == 0 && out_of_turn && matches!(message, Message::Hello(_)) {
            return self.note(sequence, Gap::Restarted);
        }
        self.observe(sequence)
    }

    /// Frames known to be missing so far.
    #[must_use]
    pub const fn missing(&self) -> u64 {
        self.missing
    }

    /// How often the sender began again.
    #[must_use]
    pub const fn restarts(&self) -> u64 {
        self.restarts
    }

    fn note(&mut self, sequence: u16, gap: Gap) -> Gap {
        self.expected = Some(sequence.wrapping_add(1));
        match gap {
            Gap::None => {}
            Gap::Missing(count) => self.missing += u64::from(count),
            Gap::Restarted => self.restarts += 1,
        }
        gap
    }
}
