//! Doubles and floats of the logs as integers of the project's units, without floating point.
//!
//! A finite IEEE 754 number is a whole mantissa times a power of two. It is scaled exactly in 128 bits and rounded
//! once, to nearest, ties away from zero; NaN, infinities and what does not fit are refused. The same bits on every target.

use crossfall_protocol::Angle;

/// A finite number: (-1)^negative x mantissa x 2^exponent.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Number {
    negative: bool,
    /// Below 2^53.
    mantissa: u64,
    /// -1074 to 971.
    exponent: i32,
}

impl Number {
    /// Reads the bits of a binary64; none for NaN and infinities.
    #[must_use]
    pub fn from_f64_bits(bits: u64) -> Option<Self> {
        let fraction = bits & ((1 << 52) - 1);
        let (mantissa, exponent) = match (bits >> 52) as i32 & 0x7ff {
            0x7ff => return None,
            0 => (fraction, -1074),
            biased => (fraction | 1 << 52, biased - 1075),
        };
        Some(Self { negative: bits >> 63 == 1, mantissa, exponent })
    }

    /// Reads the bits of a binary32; none for NaN and infinities.
    #[must_use]
    pub fn from_f32_bits(bits: u32) -> Option<Self> {
        let fraction = u64::from(bits & ((1 << 23) - 1));
        let (mantissa, exponent) = match (bits >> 23) as i32 & 0xff {
            0xff => return None,
            0 => (fraction, -149),
            biased => (fraction | 1 << 23, biased - 150),
        };
        Some(Self { negative: bits >> 31 == 1, mantissa, exponent })
    }

    /// Whether the magnitude is no more than `limit`, exactly.
    #[must_use]
    pub fn is_within(self, limit: u32) -> bool {
        match self.exponent {
            // Mantissa below 2^53, so below 2^64 times any limit but 0.
            ..=-64 => limit > 0 || self.mantissa == 0,
            exponent @ -63..=0 => u128::from(self.mantissa) <= u128::from(limit) << -exponent,
            exponent @ 1..=32 => u128::from(self.mantissa) << exponent <= u128::from(limit),
            _ => self.mantissa == 0,
        }
    }

    /// The number times `factor`, rounded to nearest, ties away from zero; none beyond 64 bits.
    #[must_use]
    pub fn scaled(self, factor: u32) -> Option<i64> {
        // Below 2^85.
        let product = u128::from(self.mantissa) * u128::from(factor);
        let magnitude = match self.exponent {
            ..=-87 => 0,
            exponent @ -86..=-1 => (product + (1 << (-exponent - 1))) >> -exponent,
            exponent @ 0..=40 => product << exponent,
            _ if product == 0 => 0,
            _ => return None,
        };
        let magnitude = i64::try_from(magnitude).ok()?;
        Some(if self.negative { -magnitude } else { magnitude })
    }

    /// The number times `factor` as 32 bits.
    #[must_use]
    pub fn scaled_i32(self, factor: u32) -> Option<i32> {
        self.scaled(factor)?.try_into().ok()
    }

    /// The number times `factor` as unsigned 32 bits.
    #[must_use]
    pub fn scaled_u32(self, factor: u32) -> Option<u32> {
        self.scaled(factor)?.try_into().ok()
    }

    /// Degrees as a binary angle, rounded to nearest, ties away from zero; none beyond one turn either way.
    #[must_use]
    pub fn degrees(self) -> Option<Angle> {
        if !self.is_within(360) {
            return None;
        }
        // 2^32 / 360 = 2^29 / 45. The value is below 2^9, so its product with 2^29 below 2^39.
        let magnitude = match self.exponent + 29 {
            shift @ 0.. if self.mantissa != 0 => ((self.mantissa << shift) + 22) / 45,
            shift @ -57..=-1 => (self.mantissa + (45 << (-shift - 1))) / (45 << -shift),
            _ => 0,
        };
        let angle = Angle(magnitude as i32);
        Some(if self.negative { -angle } else { angle })
    }
}
