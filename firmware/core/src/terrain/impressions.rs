//! First impressions, given up when more is known.
//!
//! What a tile far off shows first may be the flank of a car, taken for ground because there was none to tell it from; and between two rings, or two columns of
//! a sparse sensor, a bumper is hit where nothing above it is, so that no mark says that something stood there. Two rules take such cells back:
//!
//! * when 8, 16, 32 and 64 cells of a tile are known, those high above its floor that are not seen in this frame: a low wall is seen again, the car has gone;
//! * in a tile with risk, whenever its risk is told anew, those that stand out of it and are few, in the tile or around their place, if they were hit once or
//!   twice and not in the last second. What is really there, a stone or a curb's corner, goes on being hit.

use super::risk::SLOW;
use super::slope::{NONE, Rises, at_most, level, quantile};
use super::tile::{TILE_CELLS, TILE_SIDE, Tile};

/// Known cells from which a tile is reviewed for the first time; each time after that, twice as many.
const REVIEWED: u16 = 8;
const REVIEWS: u8 = 4;
/// Height above the tile's floor from which a first impression is given up, quarter millimetres, 0.17 m: above a curb of 15 cm, below a car's flank.
const IMPRESSION: i16 = 680;
/// The same of cells that are few, 8 cm: what is lower may be a bump's first points.
const LONE: i16 = 320;
/// Cells that are few, and few of those known: a curb across a tile raises more.
const FEW: u16 = 6;
const SHARE: u16 = 4;
/// Cells that are few in 5 x 5, with at least so many low ones for each of them.
const LONELY: u32 = 4;
const LOW: u32 = 2;
/// Weight of a cell that was hit once or twice: a sigma of 4 mm.
const SLIGHT: u16 = 256;
/// Frames without a hit, a second.
const SINCE: u8 = 10;

/// Empties cells that the rest of the tile contradicts, as the module says; whether there were any.
#[inline(always)]
pub(super) fn review(tile: &mut Tile, stamp: u8) -> bool {
    let first = tile.reviewed < REVIEWS && tile.known >= REVIEWED << tile.reviewed;
    tile.reviewed += u8::from(first);
    (first || tile.risk.iter().any(|risk| *risk >= SLOW)) && give_up(tile, stamp, first)
}

/// Heights count above the level that a tenth of the tile's cells keep below, under the neighbourhood's gradient: the tile's own may be that of the body.
#[inline(always)]
fn give_up(tile: &mut Tile, stamp: u8, first: bool) -> bool {
    let mut levels = [NONE; TILE_CELLS];
    let [lowest, highest] = level(&tile.height, &tile.margin, tile.rise, &mut levels);
    // The floor is not below the lowest.
    if highest <= lowest.saturating_add(LONE) {
        return false;
    }
    let floor = quantile([lowest, highest], tile.known / 10 + 1, |bound| at_most(&levels, bound));
    let above = |level: i16, height: i16| level != NONE && level > floor.saturating_add(height);
    // At most 256.
    let raised = levels.iter().filter(|level| above(**level, LONE / 2)).count() as u16;
    let few = raised <= FEW && raised * SHARE <= tile.known;
    let mut any = false;
    for (index, level) in levels.iter().enumerate() {
        let held = tile.held[index & 255];
        let gone = first && above(*level, IMPRESSION) && held.stamp != stamp;
        let slight = held.weight <= SLIGHT && stamp.wrapping_sub(held.stamp) >= SINCE;
        let stray = slight && above(*level, LONE) && (few || is_lonely(&levels, index, floor.saturating_add(LONE / 2)));
        if gone || stray {
            tile.clear(index as u8);
            any = true;
        }
    }
    any
}

/// Whether there are few cells above a level in the 5 x 5 around a cell, as far as they lie in its tile, and more below it.
#[inline(never)]
fn is_lonely(levels: &Rises, index: usize, bound: i16) -> bool {
    let (column, row) = (index % TILE_SIDE, index / TILE_SIDE);
    let (mut high, mut low) = (0, 0);
    for levels in levels.chunks_exact(TILE_SIDE).take(row + 3).skip(row.saturating_sub(2)) {
        for level in levels.iter().take(column + 3).skip(column.saturating_sub(2)).filter(|level| **level != NONE) {
            *(if *level > bound { &mut high } else { &mut low }) += 1;
        }
    }
    high <= LONELY && high * LOW <= low
}

#[cfg(test)]
mod tests {
    use super::super::tile::{Update, margin_table};
    use super::*;
    extern crate std;

    /// A risky tile whose every other cell was hit at level 0 in frame 3, and some at 13 cm in frame 1.
    fn tile(raised: &[u8], hits: u32) -> Tile {
        let mut tile = Tile::EMPTY;
        let margins = margin_table();
        for cell in (0..TILE_CELLS as u32).step_by(2) {
            tile.fuse(cell as u8, 0, 90, &Update { margins: &margins, stamp: 3 });
        }
        for cell in raised {
            for _ in 0..hits {
                tile.fuse(*cell, 520, 90, &Update { margins: &margins, stamp: 1 });
            }
        }
        (tile.known, tile.reviewed) = (TILE_CELLS as u16 / 2, REVIEWS);
        tile.risk[0] = SLOW;
        tile
    }

    fn is_known(tile: &Tile, cell: u8) -> bool {
        tile.margin[usize::from(cell)] != 0
    }

    #[test]
    fn a_cell_that_stands_out_is_given_up_a_second_after_its_only_hit_and_not_before() {
        let held = tile(&[101, 103], 1);
        let mut early = held.clone();
        assert!(!review(&mut early, 10) && is_known(&early, 101));
        let mut late = held.clone();
        assert!(review(&mut late, 11) && !is_known(&late, 101) && !is_known(&late, 103) && is_known(&late, 100));
        let mut plain = Tile { risk: [0; TILE_CELLS], ..held };
        assert!(!review(&mut plain, 11), "without risk nothing is looked for");
    }

    #[test]
    fn what_was_hit_often_and_what_crosses_the_tile_is_kept() {
        let mut stone = tile(&[101], 3);
        assert!(!review(&mut stone, 60));
        // Its upper side goes on to the tile's end.
        let pavement: std::vec::Vec<u8> = (96..=255).collect();
        let mut curb = tile(&pavement, 1);
        assert!(!review(&mut curb, 60));
    }

    #[test]
    fn a_cell_that_stands_out_beside_a_curb_is_given_up_and_the_curb_is_not() {
        // The two highest rows, and one cell in the middle.
        let mut all: std::vec::Vec<u8> = (224..=255).collect();
        all.push(121);
        let mut tile = tile(&all, 1);
        assert!(review(&mut tile, 60) && !is_known(&tile, 121));
        assert!((224..=255).all(|cell| is_known(&tile, cell)));
    }
}
