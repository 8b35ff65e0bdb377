//! How a [`Scan`] is laid out on the wire: its count word and its mode, seven bytes as fields, in one.
//!
//! | format | meaning |
//! |---|---|
//! | 0-127 | a whole scan: bits 0-2 index of span and step in [`WHOLE`], bit 3 unit is mm, bits 4-6 measuring mode |
//! | 128 + x | any other: x = count word + span * 2^16 + step * 2^24 + measuring mode * 2^32 |
//!
//! A whole scan always has the first form, so that every scan has exactly one: the frame decoder refuses the other.

use postcard_schema::Schema;
use postcard_schema::schema::NamedType;
use serde::de::Error;
use serde::{Deserialize, Deserializer, Serialize, Serializer};

use crate::message::{Scan, ScanMode};
use crate::units::DeviceTime;

/// Span in degrees, step in hundredths of a degree, number of values of the scanner's five whole scans.
const WHOLE: [(u8, u8, u16); 5] = [(180, 100, 181), (180, 50, 361), (100, 100, 101), (100, 50, 201), (100, 25, 401)];

/// First format number of the second form.
const OTHER: u64 = 128;

/// Count word (bits 14-15): the unit is millimetres.
const UNIT_MM: u16 = 1 << 14;

/// A scan as serde sees it.
#[derive(Serialize, Deserialize, Schema)]
struct WireScan<'a> {
    index: u32,
    stx: DeviceTime,
    format: u64,
    status: u8,
    counters: Option<[u8; 2]>,
    #[serde(borrow, serialize_with = "as_bytes")]
    code: &'a [u8],
}

/// Bytes as one run; serde's own way with a slice is one call a byte. The wire is the same.
pub(crate) fn as_bytes<S: Serializer>(bytes: &[u8], serializer: S) -> Result<S::Ok, S::Error> {
    serializer.serialize_bytes(bytes)
}

fn pack(layout: u16, mode: ScanMode) -> u64 {
    let known = WHOLE.iter().zip(0_u64..).find(|&(&(span, step, count), _)| {
        (mode.span_deg, mode.step_cdeg) == (span, step) && layout & !UNIT_MM == count && mode.measuring < 8
    });
    match known {
        Some((_, index)) => index | u64::from(layout & UNIT_MM != 0) << 3 | u64::from(mode.measuring) << 4,
        None => {
            OTHER
                + (u64::from(layout)
                    | u64::from(mode.span_deg) << 16
                    | u64::from(mode.step_cdeg) << 24
                    | u64::from(mode.measuring) << 32)
        }
    }
}

fn unpack(format: u64) -> Option<(u16, ScanMode)> {
    if let Some(other) = format.checked_sub(OTHER) {
        let [low, high, span_deg, step_cdeg, measuring, 0, 0, 0] = other.to_le_bytes() else { return None };
        return Some((u16::from_le_bytes([low, high]), ScanMode { span_deg, step_cdeg, measuring }));
    }
    let &(span_deg, step_cdeg, count) = WHOLE.get((format & 7) as usize)?;
    let unit = if format & 8 != 0 { UNIT_MM } else { 0 };
    Some((count | unit, ScanMode { span_deg, step_cdeg, measuring: (format >> 4) as u8 }))
}

impl Serialize for Scan<'_> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let Self { index, stx, layout, mode, status, counters, code } = *self;
        WireScan { index, stx, format: pack(layout, mode), status, counters, code }.serialize(serializer)
    }
}

impl<'de: 'a, 'a> Deserialize<'de> for Scan<'a> {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let WireScan { index, stx, format, status, counters, code } = WireScan::deserialize(deserializer)?;
        let (layout, mode) = unpack(format).ok_or_else(|| D::Error::custom("no such scan format"))?;
        Ok(Self { index, stx, layout, mode, status, counters, code })
    }
}

impl Schema for Scan<'_> {
    const SCHEMA: &'static NamedType = WireScan::SCHEMA;
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_whole_scan_packs_into_seven_bits_and_back() {
        for (span_deg, step_cdeg, count) in WHOLE {
            for layout in [count, count | UNIT_MM] {
                for measuring in 0..8 {
                    let mode = ScanMode { span_deg, step_cdeg, measuring };
                    let format = pack(layout, mode);
                    assert!(format < OTHER, "{mode:?}");
                    assert_eq!(unpack(format), Some((layout, mode)));
                }
            }
        }
    }

    #[test]
    fn partial_scans_and_strange_modes_keep_every_bit() {
        for layout in [0, 181 | 1 << 13, 361 | 3 << 14, 0x3ff, u16::MAX] {
            for mode in [
                ScanMode { span_deg: 180, step_cdeg: 50, measuring: 6 },
                ScanMode { span_deg: 255, step_cdeg: 255, measuring: 255 },
                ScanMode { span_deg: 0, step_cdeg: 0, measuring: 0 },
            ] {
                let format = pack(layout, mode);
                assert!((OTHER..1 << 41).contains(&format));
                assert_eq!(unpack(format), Some((layout, mode)));
            }
        }
    }

    #[test]
    fn formats_that_mean_nothing_are_refused() {
        for format in [5, 6, 7, 0x7f, OTHER + (1 << 40), u64::MAX] {
            assert_eq!(unpack(format), None);
        }
    }
}
