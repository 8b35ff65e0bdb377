//! Decoding: a stream of bytes, cut anywhere and damaged anyhow, back to frames.
//!
//! Every byte belongs to exactly one event or to the frame under way, and to exactly one counter:
//! `bytes = good + skipped + idle + pending`. A damaged frame costs itself alone, since the next delimiter ends it; a
//! damaged delimiter joins two frames and costs both.
//!
//! A frame is good when its COBS code is whole, its CRC is right, its payload is understood to the last byte, and
//! encoding that again gives the same payload: postcard alone ignores what follows and accepts varints of needless
//! length, so that two payloads could mean the same. (The one freedom left is COBS's own: a block of 254 at the very
//! end may be followed by an empty one.)

use core::ffi::CStr;
use core::marker::PhantomData;

use postcard::ser_flavors::Flavor;
use serde::{Deserialize, Serialize};

use super::unstuff::unstuff;
use super::{CRC, CRC_LEN, DELIMITER, Direction, MAX_COMMAND_FRAME, MAX_MESSAGE_FRAME, ToBoard, ToHost};

/// Decoder on the host: messages from a board.
pub type HostDecoder = Decoder<ToHost, MAX_MESSAGE_FRAME>;

/// Decoder on the board: commands from a host.
pub type BoardDecoder = Decoder<ToBoard, MAX_COMMAND_FRAME>;

/// Streaming decoder of one direction. `N` is the longest frame that it takes, delimiter included: at least
/// [`Direction::MAX_FRAME`] to take all of them.
#[derive(Clone, Debug)]
pub struct Decoder<D, const N: usize> {
    /// The frame under way, as received.
    raw: [u8; N],
    /// How much of it there is; greater than `N` when it is too long to be one.
    len: u64,
    /// Its payload and check, once it is whole.
    plain: [u8; N],
    counters: Counters,
    direction: PhantomData<D>,
}

/// What became of the bytes and frames of a stream.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Counters {
    /// Bytes received: the sum of the next three and of the frame under way.
    pub bytes: u64,
    /// Bytes of good frames with their delimiters.
    pub good: u64,
    /// Bytes of rejected frames with their delimiters.
    pub skipped: u64,
    /// Delimiters with nothing before them.
    pub idle: u64,
    /// Good frames.
    pub frames: u64,
    /// Rejected: longer than any frame.
    pub too_long: u64,
    /// Rejected: not COBS.
    pub bad_cobs: u64,
    /// Rejected: the check does not match, or there is no room for one.
    pub bad_crc: u64,
    /// Rejected: the check matches and the payload is none that this version knows.
    pub not_understood: u64,
    /// Rejected: the stream ended within it.
    pub truncated: u64,
}

/// What ended at a delimiter.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Event<'a, B> {
    /// A good frame.
    Frame(Frame<'a, B>),
    /// Bytes that are none.
    Rejected(Rejected<'a>),
}

/// A good frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Frame<'a, B> {
    /// Number of bytes that the stream held before it.
    pub offset: u64,
    /// The frame as received, delimiter included.
    pub raw: &'a [u8],
    /// Its sequence number.
    pub sequence: u16,
    /// The message or command.
    pub body: B,
}

/// Bytes between delimiters that are no good frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Rejected<'a> {
    /// Number of bytes that the stream held before them.
    pub offset: u64,
    /// How many there are, delimiter included.
    pub len: u64,
    /// The bytes; only the first of them when there are too many for a frame.
    pub raw: &'a [u8],
    /// Why.
    pub fault: Fault,
    /// The sequence number, when the check matches and it is only the payload that is not understood.
    pub sequence: Option<u16>,
}

/// Why bytes are no good frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Fault {
    /// Longer than any frame.
    TooLong,
    /// Not COBS.
    BadCobs,
    /// The check does not match, or there is no room for one.
    BadCrc,
    /// The check matches; the payload is none that this version knows: a newer firmware's.
    NotUnderstood,
    /// The stream ended before the delimiter.
    Truncated,
}

impl core::fmt::Display for Fault {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.write_str(match self {
            Self::TooLong => "longer than any frame",
            Self::BadCobs => "broken framing",
            Self::BadCrc => "wrong check sum",
            Self::NotUnderstood => "unknown message",
            Self::Truncated => "the stream ends within a frame",
        })
    }
}

impl<D: Direction, const N: usize> Default for Decoder<D, N> {
    fn default() -> Self {
        Self::new()
    }
}

impl<D: Direction, const N: usize> Decoder<D, N> {
    /// A decoder at the start of a stream.
    #[must_use]
    pub const fn new() -> Self {
        Self { raw: [0; N], len: 0, plain: [0; N], counters: Counters::ZERO, direction: PhantomData }
    }

    /// The counters so far.
    #[must_use]
    pub const fn counters(&self) -> Counters {
        self.counters
    }

    /// Bytes of the frame under way.
    #[must_use]
    pub const fn pending(&self) -> u64 {
        self.len
    }

    /// Take bytes from the front of `input` up to the end of the next frame and say what it is; `None` when `input` is
    /// used up first. Call it until then.
    pub fn next<'a>(&'a mut self, input: &mut &[u8]) -> Option<Event<'a, D::Body<'a>>> {
        loop {
            let end = delimiter(input);
            let (taken, rest) = input.split_at_checked(end.map_or(input.len(), |end| end + 1))?;
            *input = rest;
            self.keep(taken);
            end?;
            if self.len > 1 {
                break;
            }
            self.counters.idle += 1;
            self.len = 0;
        }
        Some(self.conclude())
    }

    /// The stream has ended: what is left of a frame under way. The decoder may go on with another stream.
    pub fn finish(&mut self) -> Option<Rejected<'_>> {
        let len = core::mem::take(&mut self.len);
        if len == 0 {
            return None;
        }
        let fault = Fault::Truncated;
        self.counters.reject(fault, len);
        let raw = self.raw.get(..usize::try_from(len).unwrap_or(N).min(N)).unwrap_or_default();
        Some(Rejected { offset: self.counters.bytes - len, len, raw, fault, sequence: None })
    }

    /// Append to the frame under way as much as fits, and count the rest.
    fn keep(&mut self, bytes: &[u8]) {
        let free = usize::try_from(self.len).ok().and_then(|len| self.raw.get_mut(len..)).unwrap_or_default();
        for (place, &byte) in free.iter_mut().zip(bytes) {
            *place = byte;
        }
        self.len += bytes.len() as u64;
        self.counters.bytes += bytes.len() as u64;
    }

    /// Judge the frame under way, whose delimiter has come.
    fn conclude(&mut self) -> Event<'_, D::Body<'_>> {
        let len = core::mem::take(&mut self.len);
        let offset = self.counters.bytes - len;
        let whole = usize::try_from(len).ok().and_then(|len| self.raw.get(..len));
        let judged = match whole {
            None => Err((Fault::TooLong, None)),
            Some(raw) => unframe(raw, &mut self.plain).and_then(understand::<D>),
        };
        match judged {
            Ok((sequence, body)) => {
                self.counters.good += len;
                self.counters.frames += 1;
                Event::Frame(Frame { offset, raw: whole.unwrap_or_default(), sequence, body })
            }
            Err((fault, sequence)) => {
                self.counters.reject(fault, len);
                Event::Rejected(Rejected { offset, len, raw: whole.unwrap_or(&self.raw), fault, sequence })
            }
        }
    }
}

/// Where the first delimiter is. It is the byte that ends a C string, and the library looks for that many bytes at a time.
fn delimiter(bytes: &[u8]) -> Option<usize> {
    const { assert!(DELIMITER == 0, "what ends a C string") };
    CStr::from_bytes_until_nul(bytes).ok().map(CStr::count_bytes)
}

/// A fault, and the sequence number as far as it is known.
type Refusal = (Fault, Option<u16>);

/// The payload of a frame, delimiter included, whose check matches.
fn unframe<'a>(raw: &[u8], plain: &'a mut [u8]) -> Result<&'a [u8], Refusal> {
    let (_, code) = raw.split_last().ok_or((Fault::BadCobs, None))?;
    let framed = unstuff(code, plain).ok_or((Fault::BadCobs, None))?;
    let (payload, check) = framed.split_last_chunk::<CRC_LEN>().ok_or((Fault::BadCrc, None))?;
    if CRC.checksum(payload) == u32::from_le_bytes(*check) { Ok(payload) } else { Err((Fault::BadCrc, None)) }
}

/// Sequence number and body of a payload that is exactly the encoding of both.
fn understand<'a, D: Direction>(payload: &'a [u8]) -> Result<(u16, D::Body<'a>), Refusal> {
    match postcard::from_bytes::<(u16, D::Body<'a>)>(payload) {
        Ok((sequence, body)) if is_encoding_of(payload, &(sequence, body)) => Ok((sequence, body)),
        _ => Err((Fault::NotUnderstood, sequence_of(payload))),
    }
}

fn sequence_of(payload: &[u8]) -> Option<u16> {
    u16::deserialize(&mut postcard::Deserializer::from_bytes(payload)).ok()
}

/// Whether `value` encodes to `bytes`: compared as it is serialised, without a buffer.
fn is_encoding_of<T: Serialize>(bytes: &[u8], value: &T) -> bool {
    postcard::serialize_with_flavor(value, Comparison { rest: bytes }).unwrap_or(false)
}

/// Strikes serialised bytes off the front of what is expected; its output is whether nothing is left.
struct Comparison<'a> {
    rest: &'a [u8],
}

impl Flavor for Comparison<'_> {
    type Output = bool;

    fn try_push(&mut self, byte: u8) -> postcard::Result<()> {
        match self.rest.split_first() {
            Some((&first, rest)) if first == byte => {
                self.rest = rest;
                Ok(())
            }
            _ => Err(postcard::Error::SerializeBufferFull),
        }
    }

    #[inline(never)]
    fn try_extend(&mut self, bytes: &[u8]) -> postcard::Result<()> {
        self.rest = self.rest.strip_prefix(bytes).ok_or(postcard::Error::SerializeBufferFull)?;
        Ok(())
    }

    fn finalize(self) -> postcard::Result<bool> {
        Ok(self.rest.is_empty())
    }
}

impl Counters {
    const ZERO: Self = Self {
        bytes: 0,
        good: 0,
        skipped: 0,
        idle: 0,
        frames: 0,
        too_long: 0,
        bad_cobs: 0,
        bad_crc: 0,
        not_understood: 0,
        truncated: 0,
    };

    fn reject(&mut self, fault: Fault, len: u64) {
        self.skipped += len;
        *match fault {
            Fault::TooLong => &mut self.too_long,
            Fault::BadCobs => &mut self.bad_cobs,
            Fault::BadCrc => &mut self.bad_crc,
            Fault::NotUnderstood => &mut self.not_understood,
            Fault::Truncated => &mut self.truncated,
        } += 1;
    }

    /// Rejected frames, whatever the fault.
    #[must_use]
    pub const fn rejected(&self) -> u64 {
        self.too_long + self.bad_cobs + self.bad_crc + self.not_understood + self.truncated
    }
}
