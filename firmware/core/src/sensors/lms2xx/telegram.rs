//! The telegram: `02 | address | length u16 | command | data ... | status | CRC u16`, little endian (TL section 5).
//!
//! The length counts command through status. Replies carry address and command with bit 7 set; a scanner answers as
//! 80h or 81h. The shortest reply has a command and a status (8 bytes in all), the longest is a scan of 401 values with
//! its two index bytes (814).

use crate::sensors::framing::{Protocol, Verdict};

/// Bytes of the longest telegram, 401 values with indices.
pub const LONGEST: usize = 814;

/// First byte of every telegram.
pub(super) const STX: u8 = 0x02;

/// Bytes in front of what the length counts.
pub(super) const FRONT: usize = 4;

/// Bytes of the CRC.
pub(super) const TRAILER: usize = 2;

/// The telegram's check over STX through status. It shifts by one bit a byte, so it is not a CRC-16 in the usual sense.
#[must_use]
pub fn crc(bytes: &[u8]) -> u16 {
    let (crc, _) = bytes.iter().fold((0, 0), |(crc, previous), &byte| (step(crc, previous, byte), byte));
    crc
}

/// The value times x modulo x^16 + x^15 + x^2 + 1.
const fn times_x(value: u16) -> u16 {
    (value << 1) ^ (0x8005 & 0u16.wrapping_sub(value >> 15))
}

const fn step(crc: u16, previous: u8, byte: u8) -> u16 {
    times_x(crc) ^ ((previous as u16) << 8 | byte as u16)
}

/// The product in GF(2)[x] modulo the check's polynomial.
fn multiply(a: u16, b: u16) -> u16 {
    (0..16).rev().fold(0, |product, bit| times_x(product) ^ (b & 0u16.wrapping_sub(a >> bit & 1)))
}

/// x^n modulo the check's polynomial.
static POWERS: [u16; LONGEST] = {
    let mut powers = [1; LONGEST];
    let mut n = 1;
    while n < LONGEST {
        powers[n] = times_x(powers[n - 1]);
        n += 1;
    }
    powers
};

/// Replies of a scanner as [`crate::sensors::framing`] wants them described.
pub(super) struct Telegrams;

impl Protocol for Telegrams {
    type Check = u16;
    const SYNC: u8 = STX;
    const HEADER: usize = 5;
    const LONGEST: usize = LONGEST;
    const TRAILER: usize = TRAILER;
    /// `02 80 len 02 80`: the high byte of one length can be the next STX, no earlier byte can.
    const SPACING: usize = 3;

    fn judge(beginning: &[u8]) -> Verdict {
        let at = |i: usize| beginning.get(i).copied();
        let length = u16::from_le_bytes([at(2).unwrap_or(2), at(3).unwrap_or(0)]);
        let plausible = at(0).is_none_or(|stx| stx == STX)
            && at(1).is_none_or(|address| matches!(address, 0x80 | 0x81))
            // A high byte that is not there yet may still make a small low byte valid.
            && (at(3).is_none() || (2..=LONGEST as u16 - 6).contains(&length))
            && at(4).is_none_or(|command| command & 0x80 != 0);
        match (plausible, beginning.len() >= Self::HEADER) {
            (false, _) => Verdict::No,
            (true, false) => Verdict::More,
            (true, true) => Verdict::Frame(length + (FRONT + TRAILER) as u16),
        }
    }

    #[inline]
    fn step(check: u16, previous: u8, byte: u8) -> u16 {
        step(check, previous, byte)
    }

    fn holds(before: u16, previous: u8, after: u16, frame: &[u8]) -> bool {
        // after = crc x^0 + (before x + previous x^8) x^(n-1), n covered bytes: the first step of a telegram on its own
        // knows no previous byte.
        let Some((covered, &[low, high])) = frame.split_last_chunk::<TRAILER>() else { return false };
        let Some(&power) = POWERS.get(covered.len().wrapping_sub(1)) else { return false };
        let front = times_x(before) ^ u16::from(previous) << 8;
        after ^ multiply(front, power) == u16::from_le_bytes([low, high])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn check_value() {
        assert_eq!(crc(b"123456789"), 0xa656);
    }

    #[test]
    fn a_length_is_judged_once_both_bytes_are_there() {
        for length in 0..=u16::MAX {
            let [low, high] = length.to_le_bytes();
            let verdict = Telegrams::judge(&[STX, 0x80, low, high, 0xb0]);
            let expected = if (2..=808).contains(&length) { Verdict::Frame(length + 6) } else { Verdict::No };
            assert_eq!(verdict, expected, "length {length}");
            assert_eq!(Telegrams::judge(&[STX, 0x80, low]), Verdict::More);
        }
    }

    #[test]
    fn the_check_of_a_stretch_follows_from_running_checks() {
        let telegram = [0x02, 0x80, 0x03, 0x00, 0xa0, 0x00, 0x10, 0x16, 0x0a];
        for front in [&[][..], &[0xff], &[0x02, 0x80, 0x17], &[0xaa; 900]] {
            let mut running = (0, 0);
            for &byte in front {
                running = (step(running.0, running.1, byte), byte);
            }
            let (before, previous) = running;
            for &byte in &telegram[..7] {
                running = (step(running.0, running.1, byte), byte);
            }
            assert!(Telegrams::holds(before, previous, running.0, &telegram));
            assert!(!Telegrams::holds(before ^ 1, previous, running.0, &telegram));
        }
    }
}
