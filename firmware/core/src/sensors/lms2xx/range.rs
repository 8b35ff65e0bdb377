//! What one value of a scan means: a range or one of the special values, and the bits above it (TL, command B0h).
//!
//! | measuring mode | value bits | bits above |
//! |---|---|---|
//! | 00h | 13 | field A, field B, dazzle |
//! | 01h | 13 | 3 of reflector |
//! | 02h | 13 | field A, field B, field C |
//! | 03h | 14 | 2 of reflector |
//! | 04h | 14 | field A, field B |
//! | 05h | 15 | 1 of reflector |
//! | 06h | 15 | field A |
//!
//! The assignment in modes 03h to 06h follows the listing's order; the recordings exercise 00h and 04h only.

use crossfall_protocol::message::ScanMode;

use crate::scan::RawScan;

/// A value that is not a range.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Special {
    /// No stop signal: nothing came back.
    NoStop,
    /// Dazzle: too much light.
    Dazzle,
    /// Operation overflow.
    Overflow,
    /// Signal to noise too small.
    LowSignal,
    /// Error reading channel 1.
    Channel1,
    /// Beyond the largest range.
    BeyondMaximum,
    /// Among the special values, but not defined.
    Undefined,
}

/// A range or why there is none.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Measure {
    /// A range in micrometres, 0 to 81.83 m. A survey takes 0 for none.
    Range(i32),
    /// A special value.
    Special(Special),
}

/// The bits above a value.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Fields {
    /// The beam infringes field A.
    pub a: bool,
    /// The beam infringes field B.
    pub b: bool,
    /// The beam infringes field C.
    pub c: bool,
    /// The beam was dazzled.
    pub dazzle: bool,
    /// Reflector level, 0 where the mode has none.
    pub reflector: u8,
}

/// One value, interpreted.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Reading {
    /// The range or why there is none.
    pub measure: Measure,
    /// The bits above it.
    pub fields: Fields,
}

/// Interprets the values of one scan: masks and unit are worked out once, a value then costs a mask, a comparison and
/// a multiplication.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Reader {
    /// All value bits set: the largest special value.
    top: u16,
    unit_um: i32,
    mode: u8,
}

/// Distance of the lowest special value from the largest.
const SPECIALS: u16 = 8;

impl Reader {
    /// A reader for a measuring mode (an unknown one reads as 06h, 15 bits) and a unit of 1,000 or 10,000 micrometres.
    #[must_use]
    pub fn new(mode: ScanMode, unit_um: i32) -> Self {
        let top = ((1u32 << mode.value_bits()) - 1) as u16;
        Self { top, unit_um, mode: mode.measuring }
    }

    /// The reader of a scan.
    #[must_use]
    pub fn of(scan: &RawScan) -> Self {
        Self::new(scan.mode, scan.unit_um())
    }

    /// The range in micrometres, none for a special value.
    #[inline]
    #[must_use]
    pub fn range_um(self, value: u16) -> Option<i32> {
        let value = value & self.top;
        // At most 32,758 x 10,000 um, far from overflow.
        (value < self.top - SPECIALS).then(|| i32::from(value) * self.unit_um)
    }

    /// The range, or which special value it is.
    #[must_use]
    pub fn measure(self, value: u16) -> Measure {
        if let Some(range) = self.range_um(value) {
            return Measure::Range(range);
        }
        Measure::Special(match self.top - (value & self.top) {
            0 => Special::NoStop,
            1 => Special::Dazzle,
            2 => Special::Overflow,
            4 => Special::LowSignal,
            5 => Special::Channel1,
            8 => Special::BeyondMaximum,
            _ => Special::Undefined,
        })
    }

    /// The bits above the value.
    #[must_use]
    pub fn fields(self, value: u16) -> Fields {
        let bit = |n: u16| value >> n & 1 == 1;
        let none = Fields::default();
        match self.mode {
            0x00 => Fields { a: bit(13), b: bit(14), dazzle: bit(15), ..none },
            0x01 => Fields { reflector: (value >> 13) as u8, ..none },
            0x02 => Fields { a: bit(13), b: bit(14), c: bit(15), ..none },
            0x03 => Fields { reflector: (value >> 14) as u8, ..none },
            0x04 => Fields { a: bit(14), b: bit(15), ..none },
            0x05 => Fields { reflector: (value >> 15) as u8, ..none },
            0x06 => Fields { a: bit(15), ..none },
            _ => none,
        }
    }

    /// Range and bits.
    #[must_use]
    pub fn read(self, value: u16) -> Reading {
        Reading { measure: self.measure(value), fields: self.fields(value) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn reader(measuring: u8, unit_um: i32) -> Reader {
        Reader::new(ScanMode { span_deg: 180, step_cdeg: 50, measuring }, unit_um)
    }

    #[test]
    fn every_special_value_of_the_listing_by_its_meaning() {
        let listing = [
            ([8191, 16383, 32767], Special::NoStop),
            ([8190, 16382, 32766], Special::Dazzle),
            ([8189, 16381, 32765], Special::Overflow),
            ([8187, 16379, 32763], Special::LowSignal),
            ([8186, 16378, 32762], Special::Channel1),
            ([8183, 16375, 32759], Special::BeyondMaximum),
        ];
        for (values, special) in listing {
            for (mode, width) in [(0, 0), (1, 0), (2, 0), (3, 1), (4, 1), (5, 2), (6, 2)] {
                let above = !reader(mode, 1_000).top;
                for value in [values[width], values[width] | above] {
                    assert_eq!(reader(mode, 1_000).measure(value), Measure::Special(special), "{mode} {value}");
                }
            }
        }
    }

    #[test]
    fn every_value_of_every_mode_is_one_range_or_special() {
        for (mode, bits) in [(0u8, 13u32), (1, 13), (2, 13), (3, 14), (4, 14), (5, 15), (6, 15)] {
            for (unit_um, value) in [1_000, 10_000].into_iter().flat_map(|u| (0..=u16::MAX).map(move |v| (u, v))) {
                let plain = u32::from(value) % (1 << bits);
                let reading = reader(mode, unit_um).read(value);
                match reading.measure {
                    Measure::Range(um) => {
                        assert!(plain < (1 << bits) - 9);
                        assert_eq!(um as u32, plain * unit_um as u32);
                    }
                    Measure::Special(_) => assert!(plain >= (1 << bits) - 9),
                }
            }
        }
    }

    #[test]
    fn the_bits_above_by_mode() {
        let none = Fields::default();
        for (mode, value, fields) in [
            (0, 0x2000, Fields { a: true, ..none }),
            (0, 0x4000, Fields { b: true, ..none }),
            (0, 0x8000, Fields { dazzle: true, ..none }),
            (1, 0xe000, Fields { reflector: 7, ..none }),
            (2, 0x8000, Fields { c: true, ..none }),
            (3, 0xc000, Fields { reflector: 3, ..none }),
            (4, 0x4000, Fields { a: true, ..none }),
            (4, 0x8000, Fields { b: true, ..none }),
            (5, 0x8000, Fields { reflector: 1, ..none }),
            (6, 0x8000, Fields { a: true, ..none }),
            (6, 0x7fff, none),
        ] {
            assert_eq!(reader(mode, 1_000).fields(value), fields, "{mode} {value:04x}");
        }
    }
}
