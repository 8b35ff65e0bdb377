//! The lossless code of one scan's ranges, on its own: a lost frame costs one scan.

use crate::message::ScanMode;

/// Values in the largest scan: 100 degrees in steps of a quarter.
pub const MAX_VALUES: usize = 401;

/// Longest code: a kind and the values as they are.
pub const MAX_CODE: usize = 1 + 2 * MAX_VALUES;

/// The first byte of a code: the values follow as they are, low byte first.
const RAW: u8 = 0;

/// Why a code does not decode.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum RangeError {
    /// The count word names more values than a scan can have.
    Count,
    /// The first byte names no kind of code.
    Kind,
    /// The code is not the one that encoding the values makes: cut, continued or damaged.
    Damaged,
}

impl core::fmt::Display for RangeError {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.write_str(match self {
            Self::Count => "more values than a scan can have",
            Self::Kind => "unknown kind of range code",
            Self::Damaged => "damaged range code",
        })
    }
}

impl core::error::Error for RangeError {}

/// Number of values that a count word names.
const fn count(layout: u16) -> usize {
    (layout & 0x3ff) as usize
}

/// Code as many values as the count word `layout` names, at most [`MAX_VALUES`]; values missing from `values` count as 0.
/// The count word and the mode only steer the prediction: any values at all are kept.
pub fn encode<'a>(layout: u16, _mode: ScanMode, values: &[u16], out: &'a mut [u8; MAX_CODE]) -> &'a [u8] {
    let count = count(layout).min(MAX_VALUES);
    let values = values.iter().copied().chain(core::iter::repeat(0)).take(count);
    let (kind, raw) = out.split_at_mut(1);
    kind.fill(RAW);
    for (place, value) in raw.chunks_exact_mut(2).zip(values) {
        place.copy_from_slice(&value.to_le_bytes());
    }
    out.get(..1 + 2 * count).unwrap_or_default()
}

/// The values of a code, as many as the count word names, at the start of `out`.
///
/// # Errors
/// [`RangeError`] unless [`encode`] makes this very code from the values.
pub fn decode<'a>(
    layout: u16,
    _mode: ScanMode,
    code: &[u8],
    out: &'a mut [u16; MAX_VALUES],
) -> Result<&'a [u16], RangeError> {
    let values = out.get_mut(..count(layout)).ok_or(RangeError::Count)?;
    let (&kind, raw) = code.split_first().ok_or(RangeError::Damaged)?;
    if kind != RAW {
        return Err(RangeError::Kind);
    }
    if raw.len() != 2 * values.len() {
        return Err(RangeError::Damaged);
    }
    for (value, bytes) in values.iter_mut().zip(raw.chunks_exact(2)) {
        *value = bytes.iter().rev().fold(0, |high, &byte| high << 8 | u16::from(byte));
    }
    Ok(values)
}
