//! The frame: a long header (`AA 44 12`) or a short one (`AA 44 13`), a body, a CRC-32 over both; little endian.
//!
//! Bodies are taken up to [`LONGEST_BODY`] bytes, twice what the logs of this instrument need. A longer log that
//! someone else requests on the same port counts as skipped bytes.

use crossfall_protocol::DeviceTime;

use crate::clock::{GpsTime, WEEK_US};
use crate::sensors::framing::{Frame, Protocol, Verdict};

/// The longest body decoded: INSCOV, the longest in use, has 228 bytes.
pub const LONGEST_BODY: usize = 256;

/// Header lengths that occur: documented as 28 and to be read, so that a few more bytes are accepted.
const LONG_HEADER: core::ops::RangeInclusive<u8> = 28..=32;

const SHORT_HEADER: usize = 12;

/// The longest frame.
pub const LONGEST: usize = 32 + LONGEST_BODY + 4;

const POLYNOMIAL: u32 = 0xedb8_8320;

/// The check after one more zero byte, for each low byte: x^8 times it modulo the polynomial.
static TABLE: [u32; 256] = {
    let mut table = [0; 256];
    let mut byte = 0;
    while byte < 256 {
        let mut value = byte as u32;
        let mut bit = 0;
        while bit < 8 {
            value = times_x(value);
            bit += 1;
        }
        table[byte] = value;
        byte += 1;
    }
    table
};

/// x^(8 n) modulo the polynomial; bit 31 stands for x^0.
static POWERS: [u32; LONGEST] = {
    let mut powers = [1 << 31; LONGEST];
    let mut n = 1;
    while n < LONGEST {
        let mut value = powers[n - 1];
        let mut bit = 0;
        while bit < 8 {
            value = times_x(value);
            bit += 1;
        }
        powers[n] = value;
        n += 1;
    }
    powers
};

const fn times_x(value: u32) -> u32 {
    (value >> 1) ^ (POLYNOMIAL & 0u32.wrapping_sub(value & 1))
}

/// The product in GF(2)[x] modulo the polynomial.
fn multiply(a: u32, b: u32) -> u32 {
    (0..32).fold(0, |product, bit| times_x(product) ^ (b & 0u32.wrapping_sub(a >> bit & 1)))
}

fn step(crc: u32, byte: u8) -> u32 {
    (crc >> 8) ^ TABLE[usize::from(crc as u8 ^ byte)]
}

/// The frame's check: reflected polynomial EDB88320h, start 0, no final inversion.
#[must_use]
pub fn crc32(bytes: &[u8]) -> u32 {
    bytes.iter().fold(0, |crc, &byte| step(crc, byte))
}

/// NovAtel frames as [`crate::sensors::framing`] wants them described.
pub(super) struct Frames;

impl Protocol for Frames {
    type Check = u32;
    const SYNC: u8 = 0xaa;
    const HEADER: usize = SHORT_HEADER;
    const LONGEST: usize = LONGEST;
    const TRAILER: usize = 4;
    const SPACING: usize = 3;

    /// Long: the header's length, a binary message type and the body's length must be ones that occur. Short: the
    /// body's length and the time of week must.
    fn judge(beginning: &[u8]) -> Verdict {
        let at = |i: usize| beginning.get(i).copied();
        let word = |i: usize| Some(u16::from_le_bytes([at(i)?, at(i + 1)?]));
        if at(0).is_some_and(|sync| sync != 0xaa) || at(1).is_some_and(|sync| sync != 0x44) {
            return Verdict::No;
        }
        let total = match at(2) {
            None => return Verdict::More,
            Some(0x12) => {
                let plausible = at(3).is_none_or(|header| LONG_HEADER.contains(&header))
                    && at(6).is_none_or(|message_type| message_type & 0x60 == 0)
                    && word(8).is_none_or(|body| usize::from(body) <= LONGEST_BODY);
                plausible.then(|| u16::from(at(3).unwrap_or(0)) + word(8).unwrap_or(0))
            }
            Some(0x13) => {
                let ms = beginning.get(8..12).and_then(|ms| ms.try_into().ok()).map_or(0, u32::from_le_bytes);
                let plausible = u64::from(ms) < WEEK_US / 1_000;
                plausible.then(|| SHORT_HEADER as u16 + u16::from(at(3).unwrap_or(0)))
            }
            Some(_) => None,
        };
        match total {
            None => Verdict::No,
            Some(_) if beginning.len() < Self::HEADER => Verdict::More,
            Some(total) => Verdict::Frame(total + Self::TRAILER as u16),
        }
    }

    #[inline]
    fn step(check: u32, _previous: u8, byte: u8) -> u32 {
        step(check, byte)
    }

    fn holds(before: u32, _previous: u8, after: u32, frame: &[u8]) -> bool {
        let Some((covered, &crc)) = frame.split_last_chunk::<4>() else { return false };
        let Some(&power) = POWERS.get(covered.len()) else { return false };
        after ^ multiply(before, power) == u32::from_le_bytes(crc)
    }
}

/// What a header tells.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Header {
    /// Message number.
    pub id: u16,
    /// Week of the header's time.
    pub week: u16,
    /// Milliseconds into that week.
    pub ms: u32,
    /// Quality of that time in a long header: 20 unknown, 100 and above known from coarse to fine (180 = FINESTEERING).
    pub time_status: Option<u8>,
    /// Receiver status word of a long header.
    pub receiver_status: Option<u32>,
    /// A response to a command, not a log.
    pub response: bool,
    /// Arrival of the frame's first byte.
    pub arrival: DeviceTime,
}

impl Header {
    /// Splits a whole frame into its header and body.
    pub(super) fn split(frame: Frame<'_>) -> Option<(Self, &[u8])> {
        let (bytes, _) = frame.bytes.split_last_chunk::<4>()?;
        let byte = |i: usize| bytes.get(i).copied();
        let word = |i: usize| Some(u16::from_le_bytes([byte(i)?, byte(i + 1)?]));
        let long = |i: usize| Some(u32::from_le_bytes(bytes.get(i..i + 4)?.try_into().ok()?));
        let header = if byte(2)? == 0x12 {
            Self {
                id: word(4)?,
                week: word(14)?,
                ms: long(16)?,
                time_status: byte(13),
                receiver_status: long(20),
                response: byte(6)? & 0x80 != 0,
                arrival: frame.at,
            }
        } else {
            Self {
                id: word(4)?,
                week: word(6)?,
                ms: long(8)?,
                time_status: None,
                receiver_status: None,
                response: false,
                arrival: frame.at,
            }
        };
        let front = if byte(2)? == 0x12 { usize::from(byte(3)?) } else { SHORT_HEADER };
        Some((header, bytes.get(front..)?))
    }

    /// The header's time; none when it lies beyond the week's end.
    #[must_use]
    pub fn gps_time(&self) -> Option<GpsTime> {
        GpsTime::from_milliseconds(self.week, self.ms)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn check_value() {
        assert_eq!(crc32(b"123456789"), 0x2dfd_2d88);
    }

    #[test]
    fn the_check_of_a_stretch_follows_from_running_checks() {
        let covered = [0xaa, 0x44, 0x13, 3, 0x3f, 1, 0xa1, 8, 0x10, 0x27, 0, 0, 1, 2, 3];
        let mut frame = [0; 19];
        frame[..15].copy_from_slice(&covered);
        frame[15..].copy_from_slice(&crc32(&covered).to_le_bytes());
        for front in [&[][..], &[0xff], b"<OK\r\n[COM1]", &[0x44; 700]] {
            let before = crc32(front);
            let after = covered.iter().fold(before, |crc, &byte| step(crc, byte));
            assert!(Frames::holds(before, 0, after, &frame));
            assert!(!Frames::holds(before, 0, after ^ 1, &frame));
        }
    }
}
