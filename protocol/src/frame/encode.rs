//! Encoding: one pass from the message to its frame in the caller's buffer.
//!
//! A postcard flavour of our own takes every byte through the CRC and the COBS encoder as it is serialised: nothing is
//! copied twice and no second buffer is needed. (postcard's own COBS flavour indexes its output and may panic.)

use cobs::CobsEncoder;
use crc::Digest;
use postcard::ser_flavors::Flavor;
use serde::Serialize;

use super::{CRC, DELIMITER, Direction, Tables, ToBoard, ToHost};
use crate::message::{Command, Message};

/// The buffer, or the direction's greatest frame, is too short for the message; nothing of use is in the buffer.
///
/// With a buffer of [`Direction::MAX_FRAME`] bytes it happens only to messages with texts longer than
/// [`MAX_TEXT`](super::MAX_TEXT) or [`MAX_NAME`](super::MAX_NAME).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct NoRoom;

impl core::fmt::Display for NoRoom {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.write_str("the message does not fit into a frame")
    }
}

impl core::error::Error for NoRoom {}

impl Message<'_> {
    /// Write the message's frame, delimiter included, to the start of `out`; the answer is its length.
    ///
    /// # Errors
    /// [`NoRoom`] when it would not fit.
    pub fn encode(&self, sequence: u16, out: &mut [u8]) -> Result<usize, NoRoom> {
        encode::<ToHost>(sequence, self, out)
    }
}

impl Command {
    /// Write the command's frame, delimiter included, to the start of `out`; the answer is its length.
    ///
    /// # Errors
    /// [`NoRoom`] when it would not fit.
    pub fn encode(&self, sequence: u16, out: &mut [u8]) -> Result<usize, NoRoom> {
        encode::<ToBoard>(sequence, self, out)
    }
}

fn encode<D: Direction>(sequence: u16, body: &D::Body<'_>, out: &mut [u8]) -> Result<usize, NoRoom> {
    let room = out.len().min(D::MAX_FRAME);
    let out = out.get_mut(..room).ok_or(NoRoom)?;
    let len = payload_into(&(sequence, body), FrameWriter::new(out))?;
    *out.get_mut(len).ok_or(NoRoom)? = DELIMITER;
    Ok(len + 1)
}

fn payload_into<T: Serialize>(payload: &T, writer: FrameWriter<'_>) -> Result<usize, NoRoom> {
    postcard::serialize_with_flavor(payload, writer).map_err(|_| NoRoom)
}

/// Takes serialised bytes into a frame. Its output is the frame's length without the delimiter.
struct FrameWriter<'a> {
    cobs: CobsEncoder<'a>,
    crc: Digest<'static, u32, Tables>,
}

impl<'a> FrameWriter<'a> {
    fn new(out: &'a mut [u8]) -> Self {
        Self { cobs: CobsEncoder::new(out), crc: CRC.digest() }
    }

    /// Kept out of line: one copy of the COBS encoder instead of one in every field's serialiser.
    #[inline(never)]
    fn push(&mut self, bytes: &[u8]) -> postcard::Result<()> {
        // An empty push is not neutral to the COBS encoder when it stands at the end of a block of 254.
        if bytes.is_empty() {
            return Ok(());
        }
        self.crc.update(bytes);
        self.cobs.push(bytes).map_err(|_| postcard::Error::SerializeBufferFull)
    }
}

impl Flavor for FrameWriter<'_> {
    type Output = usize;

    fn try_push(&mut self, byte: u8) -> postcard::Result<()> {
        self.try_extend(&[byte])
    }

    fn try_extend(&mut self, bytes: &[u8]) -> postcard::Result<()> {
        self.push(bytes)
    }

    fn finalize(mut self) -> postcard::Result<usize> {
        // What the check itself does to the digest no longer matters.
        let crc = self.crc.clone().finalize();
        self.push(&crc.to_le_bytes())?;
        // Where the last code byte has no room the encoder counts it all the same, and the delimiter finds none either.
        Ok(self.cobs.finalize())
    }
}
