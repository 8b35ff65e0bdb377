//! The longest frame of each direction, from the longest form of each field.
//!
//! postcard writes integers wider than a byte as varints of seven bits a byte: a `u16` takes at most 3 bytes, a `u32`
//! or `i32` 5, a `u64` or `i64` 10. A test builds the worst instance of every message and meets these sums exactly.

use super::CRC_LEN;
use crate::ranges::MAX_CODE;

/// Longest `firmware` or `board` in a hello, in bytes.
pub const MAX_NAME: usize = 64;

/// Longest text of a log line or of a restart cause, in bytes.
pub const MAX_TEXT: usize = 512;

const U8: usize = 1;
const U16: usize = 3;
const U32: usize = 5;
const U64: usize = 10;
const TAG: usize = 1;

/// Sequence number and variant.
const HEAD: usize = U16 + TAG;

/// Index, arrival, packed format (at most 2^41), status, counters, code with its length.
const SCAN: usize = HEAD + U32 + U64 + 6 * U8 + U8 + (TAG + 2) + 2 + MAX_CODE;

/// Schema, three texts with their lengths, boot.
const HELLO: usize = HEAD + U64 + 2 * (1 + MAX_NAME) + U32 + (2 + MAX_TEXT);

/// Time, level, text with its length.
const LOG: usize = HEAD + U64 + TAG + 2 + MAX_TEXT;

const HINGE: usize = 3 * U32;
const SLOPE: usize = TAG + 3 * U32 + U16 + 2 * HINGE;
const SIDE: usize = (TAG + U32) + (TAG + HINGE) + 2 * SLOPE + U16;

/// Scan, time, method, flags, roll, two sides.
const PROFILE: usize = HEAD + U32 + U64 + TAG + U16 + U32 + 2 * SIDE;

const SCANNER: usize = U32 + U8 + U32 + U8 + U32;
const INS: usize = U32 + U32 + 3 * U32;
const ATTITUDE: usize = 2 * U32;
const SURVEY: usize = TAG + 5 * U32 + (4 * U32 + U8) + 2 * U32;
const CONFIG: usize = HEAD + SCANNER + INS + ATTITUDE + SURVEY;

const LINE: usize = 2 * U64 + 3 * U32;

/// Time, both lines, eleven counters.
const STATUS: usize = HEAD + U64 + 2 * LINE + 11 * U32;

/// Time, latency, timing, week, microseconds, three angles, fix, status.
const POSE: usize = HEAD + U64 + U32 + U8 + U16 + U64 + 3 * U32 + (TAG + 2 * U64 + 4 * U32) + U8;

const fn longest(lengths: &[usize]) -> usize {
    let mut most = 0;
    let mut i = 0;
    while i < lengths.len() {
        if lengths[i] > most {
            most = lengths[i];
        }
        i += 1;
    }
    most
}

/// Length of the frame around a payload: its check, COBS, delimiter.
const fn framed(payload: usize) -> usize {
    cobs::max_encoding_length(payload + CRC_LEN) + 1
}

/// Longest frame from the board to the host, delimiter included. Pulses, clock states, replies, sessions
/// and markers are shorter than a pose.
pub const MAX_MESSAGE_FRAME: usize = framed(longest(&[SCAN, HELLO, LOG, PROFILE, CONFIG, STATUS, POSE]));

/// Longest frame from the host to the board, delimiter included: a configuration.
pub const MAX_COMMAND_FRAME: usize = framed(CONFIG);
