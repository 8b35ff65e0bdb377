//! The units of the wire and of the core: integers, each with its unit in its type or its name.
//!
//! | quantity | unit | type |
//! |---|---|---|
//! | angle | 2^-32 turn, two's complement: -180 to +180 degrees | [`Angle`] |
//! | device time | microsecond since boot, never wrapping | [`DeviceTime`] |
//! | length | micrometre, names end in `_um` (+/-2147 m) | `i32` |
//! | slope | an angle above the horizontal, positive = rising away from the vehicle | [`Angle`] |

use core::ops::{Add, Neg, Sub};

use postcard_schema::Schema;
use serde::{Deserialize, Serialize};

/// A binary angle: 2^32 units are one turn, so that adding wraps as angles do and nothing can overflow.
///
/// One unit is 8.4e-8 degrees. The range read as signed is -180 degrees (included) to +180 (excluded).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize, Schema)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[serde(transparent)]
pub struct Angle(pub i32);

impl Angle {
    /// No rotation.
    pub const ZERO: Self = Self(0);

    /// The binary angle of a number of microdegrees, rounded to nearest, ties away from zero.
    ///
    /// Exact arithmetic in 64 bits: |microdegrees| < 2^31, times 2^32 stays below 2^63.
    #[must_use]
    pub const fn from_microdegrees(microdegrees: i32) -> Self {
        let scaled = (microdegrees as i64) << 32;
        let half = if scaled >= 0 { 180_000_000 } else { -180_000_000 };
        // Casting to i32 keeps the angle modulo one turn.
        Self(((scaled + half) / 360_000_000) as i32)
    }

    /// The angle in microdegrees, rounded to nearest, ties away from zero.
    #[must_use]
    pub const fn to_microdegrees(self) -> i32 {
        let scaled = self.0 as i64 * 360_000_000;
        let half = if scaled >= 0 { 1 << 31 } else { -(1 << 31) };
        ((scaled + half) / (1 << 32)) as i32
    }
}

impl Add for Angle {
    type Output = Self;
    fn add(self, other: Self) -> Self {
        Self(self.0.wrapping_add(other.0))
    }
}

impl Sub for Angle {
    type Output = Self;
    fn sub(self, other: Self) -> Self {
        Self(self.0.wrapping_sub(other.0))
    }
}

impl Neg for Angle {
    type Output = Self;
    fn neg(self) -> Self {
        Self(self.0.wrapping_neg())
    }
}

/// Microseconds since the board booted. 64 bits last 584,000 years: never wraps.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize, Schema)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[serde(transparent)]
pub struct DeviceTime(pub u64);

impl DeviceTime {
    /// The signed distance `self - earlier` in microseconds, saturating at the ends of `i64`.
    #[must_use]
    pub const fn since(self, earlier: Self) -> i64 {
        let distance = self.0.wrapping_sub(earlier.0) as i64;
        if self.0 >= earlier.0 && distance < 0 {
            i64::MAX
        } else if self.0 < earlier.0 && distance >= 0 {
            i64::MIN
        } else {
            distance
        }
    }

    /// This instant moved by a signed number of microseconds, saturating at boot and at the end of time.
    #[must_use]
    pub const fn offset(self, microseconds: i64) -> Self {
        Self(self.0.saturating_add_signed(microseconds))
    }
}
