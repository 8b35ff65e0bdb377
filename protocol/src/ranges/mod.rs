//! The lossless code of one scan's ranges, on its own: a lost frame costs one scan.
//!
//! `predictor` foresees each range from those before it, `residual` turns the difference into a symbol, `arithmetic`
//! packs symbols by how likely `shares` says they are, `estimate` finds what to tell the decoder beforehand, and
//! `code` ties them. Any values at all are kept; road sections just take the fewest bytes: about 209 for 361 values
//! with 3.5 mm of noise and 268 with 10 mm, where noise alone has 164 and 229 (`cargo bench -p crossfall-protocol` and
//! the test `sizes` measure).
//!
//! Bounds: never longer than the values themselves (the fallback), at most 60 coder steps a value, 1.8 KiB of
//! tables, half a KiB of state. Integers only and the same on every target; nothing here can panic.

mod arithmetic;
mod code;
mod estimate;
mod predictor;
mod residual;
mod shares;

use crate::message::ScanMode;
use code::Geometry;

/// Values in the largest scan: 100 degrees in steps of a quarter.
pub const MAX_VALUES: usize = 401;

/// Longest code: the values as they are.
pub const MAX_CODE: usize = 2 * MAX_VALUES;

/// Why a code does not decode.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum RangeError {
    /// The count word names more values than a scan can have.
    Count,
    /// No values make this code: it is cut, continued or damaged.
    Damaged,
}

impl core::fmt::Display for RangeError {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.write_str(match self {
            Self::Count => "more values than a scan can have",
            Self::Damaged => "damaged range code",
        })
    }
}

impl core::error::Error for RangeError {}

/// Number of values that a count word names.
const fn count(layout: u16) -> usize {
    (layout & 0x3ff) as usize
}

/// Code the values of a scan: as many as the count word `layout` names, at most [`MAX_VALUES`]; those that `values` lacks
/// count as 0. The count word and the mode only steer the prediction: any values at all are kept.
pub fn encode<'a>(layout: u16, mode: ScanMode, values: &[u16], out: &'a mut [u8; MAX_CODE]) -> &'a [u8] {
    let count = count(layout).min(MAX_VALUES);
    match values.get(..count) {
        Some(values) => encode_all(layout, mode, values, out),
        None => encode_short(layout, mode, values, out),
    }
}

/// Values of which some are lacking. Out of line: a whole scan, which is the rule, must not pay for this copy with its stack.
#[inline(never)]
fn encode_short<'a>(layout: u16, mode: ScanMode, values: &[u16], out: &'a mut [u8; MAX_CODE]) -> &'a [u8] {
    let mut whole = [0; MAX_VALUES];
    for (place, &value) in whole.iter_mut().zip(values) {
        *place = value;
    }
    encode_all(layout, mode, whole.get(..count(layout)).unwrap_or(&whole), out)
}

fn encode_all<'a>(layout: u16, mode: ScanMode, values: &[u16], out: &'a mut [u8; MAX_CODE]) -> &'a [u8] {
    let count = values.len();
    // A code as long as the values would be taken for them: it must be shorter.
    let room = out.get_mut(..(2 * count).saturating_sub(1)).unwrap_or_default();
    if let Some(len) = code::write(Geometry::of(layout, mode), values, room) {
        return out.get(..len).unwrap_or_default();
    }
    for (place, value) in out.chunks_exact_mut(2).zip(values) {
        place.copy_from_slice(&value.to_le_bytes());
    }
    out.get(..2 * count).unwrap_or_default()
}

/// The values of a code, as many as the count word names, at the start of `out`.
///
/// # Errors
/// [`RangeError`] when it is no code of so many values. The check on the frame tells damage; what this adds is that
/// no byte of a code is without meaning.
pub fn decode<'a>(
    layout: u16,
    mode: ScanMode,
    code: &[u8],
    out: &'a mut [u16; MAX_VALUES],
) -> Result<&'a [u16], RangeError> {
    let values = out.get_mut(..count(layout)).ok_or(RangeError::Count)?;
    if code.len() == 2 * values.len() {
        for (value, bytes) in values.iter_mut().zip(code.chunks_exact(2)) {
            *value = bytes.iter().rev().fold(0, |high, &byte| high << 8 | u16::from(byte));
        }
        return Ok(values);
    }
    if code.len() > 2 * values.len() {
        return Err(RangeError::Damaged);
    }
    code::read(Geometry::of(layout, mode), code, values).ok_or(RangeError::Damaged)?;
    Ok(values)
}
