//! The frame: `02 02 02 02 | length u32 | payload ... | check u8`, big endian (telegram listing, "Framing and coding of the telegrams, binary").
//!
//! The length counts the payload; the check is the XOR of its bytes. A payload begins with `s` and two capitals: `sSN` for a scan that comes by
//! itself, `sRA` for one that was asked for, others for answers. The check is 8 bits: it sees every single flip and every odd number of them in
//! one column, and lets one in 256 other damages pass, so a scan must also be laid out as the listing says to its last channel. On Ethernet, which
//! these scanners are meant for, TCP has checks of its own.

use crate::sensors::framing::{Protocol, Verdict};

/// Bytes of the longest telegram that is taken: 541 values with 16 bits of signal strength each are 2,300. Longer ones are skipped and counted.
pub const LONGEST: usize = 2_600;

/// First four bytes of every telegram.
const STX: u8 = 0x02;

/// Bytes in front of the payload.
pub(super) const FRONT: usize = 8;

/// Bytes of the check.
pub(super) const TRAILER: usize = 1;

/// The check over a payload.
#[must_use]
pub fn checksum(payload: &[u8]) -> u8 {
    payload.iter().fold(0, |check, &byte| check ^ byte)
}

/// Telegrams of a scanner as [`crate::sensors::framing`] wants them described.
pub(super) struct Telegrams;

impl Protocol for Telegrams {
    type Check = u8;
    const SYNC: u8 = STX;
    const HEADER: usize = FRONT + 3;
    const LONGEST: usize = LONGEST;
    const TRAILER: usize = TRAILER;
    /// Four equal bytes, two zeros, a length and three letters: no header begins within another. The length may be 0202h, but letters follow it.
    const SPACING: usize = FRONT + 3;

    fn judge(beginning: &[u8]) -> Verdict {
        let at = |i: usize| beginning.get(i).copied();
        let length = u16::from_be_bytes([at(6).unwrap_or(0), at(7).unwrap_or(3)]);
        let plausible = (0..4).all(|i| at(i).is_none_or(|stx| stx == STX))
            && (4..6).all(|i| at(i).is_none_or(|high| high == 0))
            // A low byte that is not there yet may still make the length that the high byte begins.
            && (at(7).is_none() || (3..=(LONGEST - FRONT - TRAILER) as u16).contains(&length))
            && at(8).is_none_or(|first| first == b's')
            && (9..11).all(|i| at(i).is_none_or(|letter| letter.is_ascii_uppercase()));
        match (plausible, beginning.len() >= Self::HEADER) {
            (false, _) => Verdict::No,
            (true, false) => Verdict::More,
            (true, true) => Verdict::Frame(length + (FRONT + TRAILER) as u16),
        }
    }

    #[inline]
    fn step(check: u8, _previous: u8, byte: u8) -> u8 {
        check ^ byte
    }

    fn holds(before: u8, _previous: u8, after: u8, frame: &[u8]) -> bool {
        // XOR is its own inverse: what came before the payload is taken out of the running check again.
        let Some((covered, &[check])) = frame.split_last_chunk::<TRAILER>() else { return false };
        let Some((front, _)) = covered.split_at_checked(FRONT) else { return false };
        after ^ before ^ checksum(front) == check
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_length_is_judged_once_both_bytes_are_there() {
        for length in 0..=u16::MAX {
            let [high, low] = length.to_be_bytes();
            let verdict = Telegrams::judge(&[STX, STX, STX, STX, 0, 0, high, low, b's', b'S', b'N']);
            let expected = if (3..=2_591).contains(&length) { Verdict::Frame(length + 9) } else { Verdict::No };
            assert_eq!(verdict, expected, "length {length}");
            assert_eq!(Telegrams::judge(&[STX, STX, STX, STX, 0, 0, high]), Verdict::More);
        }
    }

    #[test]
    fn no_header_begins_within_another() {
        // Every header of 11 bytes, cut at each place and followed by the beginning of another: the rest of the first must contradict it.
        let header = [STX, STX, STX, STX, 0, 0, STX, STX, b's', b'S', b'N'];
        for begin in 1..Telegrams::SPACING {
            assert_eq!(Telegrams::judge(&header[begin..]), Verdict::No, "at {begin}");
        }
    }

    #[test]
    fn the_check_of_a_stretch_follows_from_running_checks() {
        // The listing's example of a payload without data: `sMN Run`, whose check is 19h.
        let telegram = *b"\x02\x02\x02\x02\x00\x00\x00\x07sMN Run\x19";
        assert_eq!(checksum(b"sMN Run"), 0x19);
        for front in [&[][..], &[0xff], &[0x02, 0x02, 0x02]] {
            let before = checksum(front);
            let after = before ^ checksum(&telegram[..15]);
            assert!(Telegrams::holds(before, 0, after, &telegram));
            assert!(!Telegrams::holds(before ^ 1, 0, after, &telegram));
        }
    }
}
