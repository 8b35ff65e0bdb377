//! Link framing: how a message becomes bytes on a serial line, and back.
//!
//! ```text
//! frame = COBS( payload || CRC-32 of the payload, little endian ) || 00
//! payload = postcard( sequence number u16, Message or Command )
//! ```
//!
//! COBS (Cheshire and Baker, 1999) takes every zero out of a frame for at most one byte in 254, so that a zero always
//! ends one: whatever happened before, the next frame is found. The CRC is CRC-32/ISO-HDLC (that of Ethernet and zip):
//! it sees every burst of up to 32 bits, and passes noise once in 2^32. Frames carry a sequence number, counted even
//! for those that found no room, so that the receiver knows how many it lost.
//!
//! Bounds: a frame is never longer than [`Direction::MAX_FRAME`]; [`Decoder`] holds one frame as received and once
//! more decoded, and nothing else. No step of this module can panic.

mod decode;
mod encode;
mod limits;
mod sequence;
mod unstuff;

use crc::{CRC_32_ISO_HDLC, Crc, Table};
use postcard_schema::Schema;
use serde::{Deserialize, Serialize};

pub use decode::{BoardDecoder, Counters, Decoder, Event, Fault, Frame, HostDecoder, Rejected};
pub use encode::NoRoom;
pub use limits::{MAX_COMMAND_FRAME, MAX_MESSAGE_FRAME, MAX_NAME, MAX_TEXT};
pub use sequence::{Gap, Sequence, Sequencer};

use crate::message::{Command, Message};

/// What ends every frame and occurs nowhere in one.
pub const DELIMITER: u8 = 0;

/// Bytes of the check at the end of a payload.
const CRC_LEN: usize = 4;

/// The check's tables: of 1 KiB, a lookup a byte, on a microcontroller; of 16 KiB, sixteen bytes a step, on a desk.
#[cfg(not(target_pointer_width = "64"))]
type Tables = Table<1>;
#[cfg(target_pointer_width = "64")]
type Tables = Table<16>;

static CRC: Crc<u32, Tables> = Crc::<u32, Tables>::new(&CRC_32_ISO_HDLC);

/// One of the two directions of the link.
pub trait Direction {
    /// What travels this way.
    type Body<'a>: Serialize + Deserialize<'a> + Schema + Copy;
    /// Longest frame, delimiter included.
    const MAX_FRAME: usize;
}

/// From the board to the host.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ToHost {}

/// From the host to the board.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ToBoard {}

impl Direction for ToHost {
    type Body<'a> = Message<'a>;
    const MAX_FRAME: usize = MAX_MESSAGE_FRAME;
}

impl Direction for ToBoard {
    type Body<'a> = Command;
    const MAX_FRAME: usize = MAX_COMMAND_FRAME;
}
