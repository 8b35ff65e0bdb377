//! The road line: a regression over the points under the sensor (median-slope paper, step 2).
//!
//! "Immediately underneath" is taken as at most [`ROAD_HALF_WIDTH_UM`] to the side: half a lane and a bit, which no road is
//! narrower than. The paper gives no figure.

use crate::scan::Point;

use super::line::Line;

/// Points up to this far from straight below the sensor are taken as road.
pub const ROAD_HALF_WIDTH_UM: i32 = 2_000_000;

/// Fewer points than this make no road line.
pub const ROAD_MIN_POINTS: u32 = 5;

/// At most this many points are used; no scan has more on one side.
const MAX_POINTS: usize = 512;

/// Where the road line is pinned to whole micrometres, besides straight below the sensor: 2^23 um = 8.4 m.
const PIN_UM: i32 = 1 << 23;

/// The least-squares line of height over lateral distance, rounded to the micrometre at 0 and at 8.4 m: from there on it
/// is a line through two points like every other, and distances from it are exact. The rounding turns it by 4e-6 degrees at most.
///
/// None with fewer than [`ROAD_MIN_POINTS`] points under the sensor, with all of them at one place, or when it comes out
/// steeper than 45 degrees. The points must lie below the horizon of [`super::line`].
#[must_use]
pub fn road_line(points: &[Point]) -> Option<Line> {
    let under =
        || points.iter().filter(|p| p.y_um.unsigned_abs() <= ROAD_HALF_WIDTH_UM.unsigned_abs()).take(MAX_POINTS);
    let mut count = 0_u32;
    let (mut sum_y, mut sum_z) = (0_i64, 0_i64);
    for p in under() {
        count = count.saturating_add(1);
        sum_y = sum_y.wrapping_add(i64::from(p.y_um));
        sum_z = sum_z.wrapping_add(i64::from(p.z_um));
    }
    if count < ROAD_MIN_POINTS {
        return None;
    }
    let (mean_y, mean_z) = (sum_y.checked_div_euclid(count.into())?, sum_z.checked_div_euclid(count.into())?);
    // About the means rounded down; what that leaves (less than 1 um) is of no account beside the spread of the points.
    // |y - mean| < 2^22 and |z - mean| < 2^30: with up to 2^9 points the sums stay below 2^53 and 2^61.
    let (mut spread, mut rise) = (0_i64, 0_i64);
    for p in under() {
        let y = i64::from(p.y_um).wrapping_sub(mean_y);
        let z = i64::from(p.z_um).wrapping_sub(mean_z);
        spread = spread.wrapping_add(y.wrapping_mul(y));
        rise = rise.wrapping_add(y.wrapping_mul(z));
    }
    if rise.unsigned_abs() > spread.unsigned_abs() {
        return None;
    }
    let height_at = |y_um: i32| {
        let rise = i128::from(rise).wrapping_mul(i128::from(i64::from(y_um).wrapping_sub(mean_y)));
        let rounded = rise.wrapping_add(i128::from(spread >> 1)).checked_div_euclid(spread.into())?;
        // |rise / spread| <= 1, so that the height is within the horizon plus the distance: it fits.
        Some(Point { y_um, z_um: mean_z.wrapping_add(rounded as i64) as i32 })
    };
    Some(Line::through(height_at(0)?, height_at(PIN_UM)?))
}
