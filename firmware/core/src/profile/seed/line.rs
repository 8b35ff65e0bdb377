//! Straight lines through two points, and distances from them that are exact in 64 bits.
//!
//! A point p is within T of the line through a and b when its cross product c = (p - a) x (b - a) satisfies
//! |c| <= T |b - a|. c is an integer, so this is the same as |c| <= floor(T |b - a|): one root and one division a line,
//! then two 32 x 32 -> 64 bit multiplications and a comparison a point, without rounding anywhere.
//!
//! Bounds, from |coordinate| < [`HORIZON_UM`] = 2^29 and T <= [`MAX_THRESHOLD_UM`] < 2^22: differences stay below 2^30,
//! c below 2^61, |b - a| below 2^30.5 and T |b - a| below 2^53.

use crate::scan::Point;

/// Coordinates must be smaller than this (537 m; what [`Point`] promises).
pub const HORIZON_UM: i32 = 1 << 29;

/// Distances from a line are compared with thresholds up to this (4.2 m).
pub const MAX_THRESHOLD_UM: u32 = (1 << 22) - 1;

/// A line through two points, directed outward.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Line {
    origin: Point,
    dy_um: i32,
    dz_um: i32,
}

impl Line {
    /// The line through two different points whose coordinates are below [`HORIZON_UM`].
    ///
    /// Two equal points make a line of length 0, from which no point has any distance; it has no inclination either.
    #[must_use]
    pub fn through(a: Point, b: Point) -> Self {
        let (dy, dz) = (b.y_um.wrapping_sub(a.y_um), b.z_um.wrapping_sub(a.z_um));
        let inward = dy < 0;
        Self {
            origin: a,
            dy_um: if inward { dy.wrapping_neg() } else { dy },
            dz_um: if inward { dz.wrapping_neg() } else { dz },
        }
    }

    /// Lateral distance between the two points, never negative.
    #[must_use]
    pub fn dy_um(&self) -> i32 {
        self.dy_um
    }

    /// How much the line rises over [`Line::dy_um`].
    #[must_use]
    pub fn dz_um(&self) -> i32 {
        self.dz_um
    }

    /// The cross product of a point with the line: its signed distance times the line's length, positive above it.
    #[must_use]
    pub fn offset(&self, p: Point) -> i64 {
        let y = i64::from(p.y_um.wrapping_sub(self.origin.y_um));
        let z = i64::from(p.z_um.wrapping_sub(self.origin.z_um));
        z.wrapping_mul(i64::from(self.dy_um)).wrapping_sub(y.wrapping_mul(i64::from(self.dz_um)))
    }

    /// The distance between the two points, prepared for [`Length::times`].
    #[must_use]
    pub fn length(&self) -> Length {
        Length::of(square(self.dy_um).wrapping_add(square(self.dz_um)))
    }
}

/// The square of a difference of coordinates.
fn square(difference_um: i32) -> u64 {
    let wide = u64::from(difference_um.unsigned_abs());
    wide.wrapping_mul(wide)
}

/// The square of the distance between two points below the horizon: exact, below 2^61.
#[must_use]
pub fn distance_squared(a: Point, b: Point) -> u64 {
    square(b.y_um.wrapping_sub(a.y_um)).wrapping_add(square(b.z_um.wrapping_sub(a.z_um)))
}

/// The length of a line: its exact square, and its root to 2^-62 of itself.
#[derive(Clone, Copy, Debug)]
pub struct Length {
    squared: u64,
    /// The root is `mantissa` / 2^(32 + `shift`).
    mantissa: u64,
    shift: u32,
}

impl Length {
    /// From a square below 2^61.
    #[must_use]
    pub fn of(squared: u64) -> Self {
        // Scaled by an even power of two into [2^62, 2^64), the root q has 32 significant bits. The next 32 come from one
        // step of Newton's method, rem / 2q, which is too large by less than rem^2 / 8q^3 <= 1/2q <= 2^-32.
        let shift = squared.leading_zeros() / 2;
        let scaled = squared.checked_shl(2 * shift).unwrap_or(0);
        let root = scaled.isqrt();
        let rest = scaled.wrapping_sub(root.wrapping_mul(root));
        // rest <= 2 root < 2^33, so that the shift loses nothing; a length of 0 has no fraction.
        let fraction = (rest << 31).checked_div(root).unwrap_or(0);
        Self { squared, mantissa: (root << 32).saturating_add(fraction), shift }
    }

    /// The largest integer not above `threshold_um` times the length: exact for thresholds up to [`MAX_THRESHOLD_UM`].
    #[must_use]
    pub fn times(&self, threshold_um: u32) -> i64 {
        let threshold = u64::from(threshold_um);
        let high = (self.mantissa >> 32).wrapping_mul(threshold);
        let low = (self.mantissa & 0xffff_ffff).wrapping_mul(threshold);
        let near = high.wrapping_add(low >> 32).checked_shr(self.shift).unwrap_or(0);
        // `near` is the product to within one. Its square and that of the product differ by less than 2^56, so that the
        // difference is right although both overflow; its sign and size tell which integer is the floor.
        let square = threshold.wrapping_mul(threshold).wrapping_mul(self.squared);
        let short = square.wrapping_sub(near.wrapping_mul(near)) as i64;
        let near = near as i64;
        if short < 0 {
            near.wrapping_sub(1)
        } else if short > near.wrapping_mul(2) {
            near.wrapping_add(1)
        } else {
            near
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(20_000))]

        #[test]
        fn the_product_of_threshold_and_length_is_the_exact_floor(
            dy in -(1 << 30) + 1..1 << 30, dz in -(1 << 30) + 1..1 << 30, bits in 0..31_u32, threshold in 0..=MAX_THRESHOLD_UM,
        ) {
            let squared = square(dy >> bits) + square(dz >> bits);
            let exact = (u128::from(squared) * u128::from(threshold).pow(2)).isqrt();
            prop_assert_eq!(Length::of(squared).times(threshold) as u128, exact);
        }

        /// Where the product has the most digits, one in a thousand is so near a whole number that `near` is the wrong one.
        #[test]
        fn the_product_is_the_exact_floor_where_it_is_largest(
            parts in prop::array::uniform32((1 << 29..1 << 30, 1 << 29..1 << 30, 1_u32 << 21..=MAX_THRESHOLD_UM)),
        ) {
            for (dy, dz, threshold) in parts {
                let squared = square(dy) + square(dz);
                let exact = (u128::from(squared) * u128::from(threshold).pow(2)).isqrt();
                prop_assert_eq!(Length::of(squared).times(threshold) as u128, exact);
            }
        }

        #[test]
        fn the_floor_is_exact_where_the_product_is_a_whole_number_or_just_below(
            root in 1..(1_u64 << 30), threshold in 1..=MAX_THRESHOLD_UM, below in 0..3_u64,
        ) {
            let squared = root * root - below.min(root * root);
            let exact = (u128::from(squared) * u128::from(threshold).pow(2)).isqrt();
            prop_assert_eq!(Length::of(squared).times(threshold) as u128, exact);
        }
    }
}
