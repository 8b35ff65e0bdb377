//! Non-negative quantities of unknown size, for the few sums of variances that a slope needs.
//!
//! A value is `mantissa` x 2^`exponent` with 32 significant bits, so that the formulas of the intervals can be written
//! as they stand in a textbook and nothing can overflow. Every operation but the root rounds down by at most 2^-31 of its result.

/// A non-negative number; zero has mantissa 0, every other a mantissa of 2^31 at least.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Magnitude {
    mantissa: u32,
    exponent: i32,
}

impl Magnitude {
    pub const ZERO: Self = Self { mantissa: 0, exponent: 0 };

    /// `value` x 2^`exponent`.
    pub fn new(value: u64, exponent: i32) -> Self {
        let zeros = value.leading_zeros();
        if zeros == 64 {
            return Self::ZERO;
        }
        Self { mantissa: ((value << zeros) >> 32) as u32, exponent: exponent + 32 - zeros as i32 }
    }

    pub fn times(self, other: Self) -> Self {
        Self::new(u64::from(self.mantissa) * u64::from(other.mantissa), self.exponent + other.exponent)
    }

    pub fn squared(self) -> Self {
        self.times(self)
    }

    /// The quotient; a division by zero gives the largest magnitude that 64 bits of integer part can take.
    pub fn over(self, other: Self) -> Self {
        if other.mantissa == 0 {
            return Self { mantissa: u32::MAX, exponent: 32 };
        }
        let quotient = (u64::from(self.mantissa) << 32) / u64::from(other.mantissa);
        Self::new(quotient, self.exponent - other.exponent - 32)
    }

    pub fn plus(self, other: Self) -> Self {
        let (large, small) = if self.exponent >= other.exponent { (self, other) } else { (other, self) };
        if large.mantissa == 0 {
            return small;
        }
        let shift = (large.exponent - small.exponent) as u32;
        let low = (u64::from(small.mantissa) << 31).checked_shr(shift).unwrap_or(0);
        Self::new((u64::from(large.mantissa) << 31) + low, large.exponent - 31)
    }

    /// The square root, rounded down by at most 2^-15 of itself: it is the width of an interval that becomes of it.
    pub fn root(self) -> Self {
        // An even exponent and 31 or 32 significant bits before the root.
        let odd = self.exponent & 1;
        Self::new(u64::from((self.mantissa >> odd).isqrt()), (self.exponent + odd) / 2)
    }

    /// The integer part of the value x 2^`bits`, saturating.
    pub fn scaled(self, bits: i32) -> u32 {
        let shift = self.exponent + bits;
        if self.mantissa == 0 || shift <= -32 {
            0
        } else if shift > 0 {
            u32::MAX
        } else {
            self.mantissa >> (-shift)
        }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn value(m: Magnitude) -> f64 {
        f64::from(m.mantissa) * libm::exp2(f64::from(m.exponent))
    }

    proptest! {
        #[test]
        fn arithmetic_agrees_with_double_precision(
            a in 1u64..1 << 60, b in 1u64..1 << 60, p in -60i32..60, q in -60i32..60,
        ) {
            let (x, y) = (Magnitude::new(a, p), Magnitude::new(b, q));
            let (fx, fy) = (a as f64 * libm::exp2(f64::from(p)), b as f64 * libm::exp2(f64::from(q)));
            for (what, got, expected) in [
                ("sum", x.plus(y), fx + fy),
                ("product", x.times(y), fx * fy),
                ("quotient", x.over(y), fx / fy),
            ] {
                prop_assert!((value(got) / expected - 1.0).abs() < 2e-9, "{what}: {} for {expected}", value(got));
            }
            let low = 1.0 - value(x.root()) / libm::sqrt(fx);
            prop_assert!((-2e-9..1.0 / 32_768.0).contains(&low), "root: {} for {}", value(x.root()), libm::sqrt(fx));
        }
    }

    #[test]
    fn integers_come_out_again_and_saturate() {
        assert_eq!(Magnitude::new(1_000_001, 0).scaled(0), 1_000_001);
        assert_eq!(Magnitude::new(3, -1).scaled(1), 3);
        assert_eq!(Magnitude::new(3, -1).scaled(0), 1);
        assert_eq!(Magnitude::new(1, 40).scaled(0), u32::MAX);
        assert_eq!(Magnitude::new(1, -40).scaled(0), 0);
        assert_eq!(Magnitude::ZERO.plus(Magnitude::new(5, 0)).scaled(0), 5);
        assert_eq!(Magnitude::ZERO.root().scaled(0), 0);
        assert_eq!(Magnitude::new(5, 0).over(Magnitude::ZERO).scaled(0), u32::MAX);
    }
}
