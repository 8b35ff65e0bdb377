//! The plane that most of a tile's known cells lie on.
//!
//! Least squares, then again through what lies near the plane before, three times, ever nearer: what a curb or a bump lifts falls out step by step.
//! Where a third of the cells or more lies off the last plane, as beside a curb through the tile's middle, there is none, and
//! neither where the cells lie along one line, which may tilt about itself.
//!
//! Sums are exact in integers: they hold for any 256 cells of heights within 31,000.

use super::slope::STEEPEST;
use super::tile::{TILE_SIDE, Tile};

/// Cells that a plane needs.
const ENOUGH: i64 = 8;
/// Variance that they need in every direction, in cells squared: 0.17 m. One line has a tenth of a cell; two lines 0.6 m apart have 9.
const EXTENT: i64 = 3;
/// Distances from the plane before within which cells make the next one, quarter millimetres: 8, 4 and 2.5 cm. The last is more than the noise of a
/// line's heights and of its pose.
const NEAR: [i32; 3] = [320, 160, 100];
/// Rises over four cells beyond which a plane on the way is not followed: products stay within 31 bits.
const WALL: i64 = 30_000;

/// Looks for a tile's plane anew.
#[inline(always)]
pub(crate) fn fit(tile: &mut Tile) {
    tile.plane = through_most(tile);
}

#[inline(always)]
fn through_most(tile: &Tile) -> Option<[i16; 2]> {
    let all = Sums::of(tile, |_| true);
    let mut sums = all;
    let mut rise = all.rise()?;
    for near in NEAR {
        let before = sums;
        sums = Sums::of(tile, |at| before.distance(rise, at) <= 4 * near * before.cells);
        rise = sums.rise()?;
    }
    let [x, y] = rise.map(|rise| rise as i16);
    let is_ground = x.abs() <= STEEPEST && y.abs() <= STEEPEST;
    (is_ground && 3 * sums.cells >= 2 * all.cells).then_some([x, y])
}

/// Sums over cells of column, row and height, and of their products.
#[derive(Clone, Copy, Default)]
struct Sums {
    cells: i32,
    at: [i32; 3],
    xx: i32,
    xy: i32,
    yy: i32,
    xz: i32,
    yz: i32,
}

impl Sums {
    /// Of the known cells that are kept.
    #[inline(always)]
    fn of(tile: &Tile, keep: impl Fn([i32; 3]) -> bool) -> Self {
        let mut sums = Self::default();
        for (index, (height, margin)) in tile.height.iter().zip(&tile.margin).enumerate() {
            let [x, y, z] = [(index % TILE_SIDE) as i32, (index / TILE_SIDE) as i32, i32::from(*height)];
            if *margin == 0 || !keep([x, y, z]) {
                continue;
            }
            // 256 x 15 x 31,000 at most: 27 bits.
            sums.cells += 1;
            sums.at = [sums.at[0] + x, sums.at[1] + y, sums.at[2] + z];
            (sums.xx, sums.xy, sums.yy) = (sums.xx + x * x, sums.xy + x * y, sums.yy + y * y);
            (sums.xz, sums.yz) = (sums.xz + x * z, sums.yz + y * z);
        }
        sums
    }

    /// Rises over four cells of the least-squares plane, towards zero; none if it has too few cells, or too little extent.
    #[inline(always)]
    fn rise(&self) -> Option<[i32; 2]> {
        let cells = i64::from(self.cells);
        let [x, y, z] = self.at.map(i64::from);
        // Covariances times the cells squared: those of places below 2^22, those with heights below 2^35.
        let about = |product: i32, a: i64, b: i64| cells * i64::from(product) - a * b;
        let (xx, xy, yy) = (about(self.xx, x, x), about(self.xy, x, y), about(self.yy, y, y));
        let (xz, yz) = (about(self.xz, x, z), about(self.yz, y, z));
        let determinant = xx * yy - xy * xy;
        // The lesser variance is at least the determinant over the trace.
        if cells < ENOUGH || determinant < EXTENT * cells * cells * (xx + yy) {
            return None;
        }
        let rise = |over: i64| Some((4 * over).checked_div(determinant)?.clamp(-WALL, WALL) as i32);
        Some([rise(xz * yy - yz * xy)?, rise(yz * xx - xz * xy)?])
    }

    /// How far a cell lies above or below the plane with these rises through the cells' centre, in sixteenths of a millimetre, times the cells.
    #[inline(always)]
    fn distance(&self, [over_x, over_y]: [i32; 2], [x, y, z]: [i32; 3]) -> i32 {
        let [off_x, off_y, off_z] =
            [self.cells * x - self.at[0], self.cells * y - self.at[1], self.cells * z - self.at[2]];
        (4 * off_z - over_x * off_x - over_y * off_y).abs()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::terrain::tile::TileKey;

    /// A tile crossed by two lines 0.6 m apart, 30 degrees askew, of heights in quarter millimetres by place in cells.
    fn crossed(height: impl Fn(f64, f64) -> f64) -> Tile {
        let mut tile = Tile::EMPTY;
        tile.restart(TileKey { x: 0, y: 0 });
        for line in [2.0, 8.0] {
            for column in 0..TILE_SIDE {
                let row = line + column as f64 * 0.5;
                let index = TILE_SIDE * (row as usize).min(15) + column;
                tile.height[index] = height(column as f64 + 0.5, row.floor().min(15.0) + 0.5) as i16;
                tile.margin[index] = 10;
            }
        }
        tile
    }

    fn plane(height: impl Fn(f64, f64) -> f64) -> Option<[i16; 2]> {
        through_most(&crossed(height))
    }

    #[test]
    fn two_lines_askew_give_their_plane_up_to_45_percent() {
        for percent in [[0.0, 0.0], [14.0, -3.0], [-33.0, 7.0], [44.0, 44.0]] {
            // A cell is 400 units wide.
            let found = plane(|x, y| 4.0 * (percent[0] * x + percent[1] * y)).unwrap();
            let wanted = percent.map(|percent| 16.0 * percent);
            for (found, wanted) in found.iter().zip(wanted) {
                assert!((f64::from(*found) - wanted).abs() <= 3.0, "{found} for {wanted}");
            }
        }
        assert_eq!(plane(|x, _| 4.0 * 47.0 * x), None);
    }

    #[test]
    fn what_stands_on_a_quarter_of_the_cells_does_not_tilt_it_and_a_step_through_the_middle_has_none() {
        let curb = |edge: f64| move |x: f64, _: f64| if x > edge { 480.0 } else { 0.0 };
        let beside = plane(curb(13.0));
        assert!(beside.is_some_and(|rise| rise.iter().all(|rise| rise.abs() <= 16)), "{beside:?}");
        assert_eq!(plane(curb(8.0)), None);
    }

    #[test]
    fn one_line_or_a_handful_of_cells_have_none() {
        let mut tile = crossed(|_, _| 0.0);
        assert_eq!(through_most(&tile), Some([0, 0]));
        let mut kept = 0;
        for (index, margin) in tile.margin.iter_mut().enumerate() {
            // The upper line alone.
            if (index / TILE_SIDE) < 8 + (index % TILE_SIDE) / 2 {
                *margin = 0;
            }
            kept += i32::from(*margin != 0);
        }
        assert!(kept >= 8);
        assert_eq!(through_most(&tile), None);
        assert_eq!(through_most(&Tile::EMPTY), None);
    }

    #[test]
    fn the_largest_sums_there_can_be_do_not_overflow() {
        let mut tile = Tile::EMPTY;
        tile.margin = [1; 256];
        for (index, height) in tile.height.iter_mut().enumerate() {
            *height = if index < 128 { -31_000 } else { 31_000 };
        }
        assert_eq!(through_most(&tile), None);
        tile.height = [31_000; 256];
        assert_eq!(through_most(&tile), Some([0, 0]));
    }
}
