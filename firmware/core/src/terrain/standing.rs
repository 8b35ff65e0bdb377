//! Things that stand: raised by hits, struck when the sensor looks through them.
//!
//! A mark is struck when the rays through the cell's volume end behind it and none of its 3 x 3 cells is hit. Around a struck
//! mark, what the last two seconds wrote above the tile's ground is emptied too: it was the body's lower edge.

use super::config::TerrainConfig;
use super::geometry::Pose;
use super::marks::{Board, Marks};
use super::project::Projection;
use super::sight::RangeImage;
use super::tile::{TILE_SIDE, Tile, TileKey, UNITS_PER_M};
use super::window::Window;

/// Hits that a cell counts: more only make it slower to strike.
const MOST: u8 = 3;
/// Pixels that must end behind a cell before it is struck.
const THROUGH: u32 = 2;
/// Frames that count as recent.
const RECENT: u8 = 20;
/// The age in frames at which a cell's stamp stands still. A stamp is a byte: one left alone would be recent again after 256 frames.
const OLD: u8 = 100;
/// Every how many frames a tile's stamps are looked through for it. An age stays below `OLD` and this together, 228, which fits a byte.
const SWEEP: u32 = 128;
/// Height above the tile's ground from which recent content is taken for the body's edge: 4 cm.
const EDGE: i32 = 160;

/// Counts this frame's hits into the tiles, each as `by`.
pub(crate) fn raise(window: &mut Window<'_>, marks: &Board<'_>, by: u8, stamp: u8) {
    for (slot, mark) in marks.touched().filter(|(_, mark)| mark.any_hit) {
        let Some(tile) = window.tiles.get_mut(slot) else { continue };
        tile.begin();
        tile.has_tall = true;
        tile.dirty = true;
        for (index, tall) in tile.tall.iter_mut().enumerate() {
            if Marks::is_set(&mark.hits, index as u8) {
                *tall = tall.saturating_add(by).min(MOST);
                tile.held[index & 255].stamp = stamp;
            }
        }
    }
}

/// Keeps old stamps old, in every so manyth slot: a sweep that passes a few tiles a frame.
pub(crate) fn forget_ages(window: &mut Window<'_>, frame: u32) {
    let stamp = (frame & 255) as u8;
    let first = (frame % SWEEP) as usize;
    for tile in window.tiles.iter_mut().skip(first).step_by(SWEEP as usize).filter(|tile| tile.in_use) {
        for held in &mut tile.held {
            held.stamp = stamp.wrapping_sub(stamp.wrapping_sub(held.stamp).min(OLD));
        }
    }
}

/// Strikes what the frame sees through; returns how many cells lost their mark, and whether any is left.
pub(crate) fn look_through(
    window: &mut Window<'_>,
    marks: &Board<'_>,
    image: &RangeImage<'_>,
    projection: &Projection,
    pose: &Pose,
    config: &TerrainConfig,
    stamp: u8,
) -> (u32, bool) {
    let (mut struck, mut any_left) = (0, false);
    for slot in 0..window.tiles.len() {
        let Some(tile) = window.tiles.get(slot).filter(|tile| tile.has_tall) else { continue };
        let mark = marks.get(slot);
        let key = tile.key;
        let mut gone = [0u16; TILE_SIDE];
        let mut left = false;
        let column0 = key.x.wrapping_sub(window.origin.x).wrapping_mul(16) as f32 - projection.origin[0];
        let row0 = key.y.wrapping_sub(window.origin.y).wrapping_mul(16) as f32 - projection.origin[1];
        let ground = tile.base.saturating_add(i32::from(tile.ground)).wrapping_sub(projection.sensor_height()) as f32;
        for (index, tall) in tile.tall.iter().enumerate() {
            if *tall == 0 {
                continue;
            }
            let (column, row) = (index & 15, index >> 4);
            if mark.is_some_and(|mark| hit_near(mark, column, row)) {
                left = true;
                continue;
            }
            let offset = [column0 + column as f32 + 0.5, row0 + row as f32 + 0.5];
            let foot = ground + (config.tall_above_m + 0.1) * UNITS_PER_M;
            let head = ground + 1.6 * UNITS_PER_M;
            let foot = projection.to_sensor(offset, foot, pose, config.cell_m);
            let head = projection.to_sensor(offset, head, pose, config.cell_m);
            let (beyond, blocked) = image.through(foot, head);
            if beyond >= THROUGH && beyond > 2 * blocked {
                gone[row & 15] |= 1 << column;
                struck += 1;
            } else {
                left = true;
            }
        }
        if gone != [0; TILE_SIDE] {
            strike(window, key, &gone, stamp);
        }
        if let Some(tile) = window.tiles.get_mut(slot) {
            tile.has_tall = left;
        }
        any_left |= left;
    }
    (struck, any_left)
}

/// Whether one of the cell's 3 x 3, within its tile, is hit in this frame.
fn hit_near(mark: &Marks, column: usize, row: usize) -> bool {
    if !mark.any_hit {
        return false;
    }
    let mask = (0b111u32 << column >> 1) as u16;
    let from = row.saturating_sub(1);
    mark.hits.iter().skip(from).take(row + 2 - from).any(|word| word & mask != 0)
}

fn strike(window: &mut Window<'_>, key: TileKey, gone: &[u16; TILE_SIDE], stamp: u8) {
    for row in 0..TILE_SIDE as i32 {
        let word = gone[(row & 15) as usize];
        if word == 0 {
            continue;
        }
        for column in (0..TILE_SIDE as i32).filter(|column| word >> column & 1 != 0) {
            if let Some(tile) = window.tile_mut(key) {
                tile.tall[((row << 4 | column) & 255) as usize] = 0;
                tile.dirty = true;
            }
            for dy in -2..=2 {
                for dx in -2..=2 {
                    let (x, y) = (column + dx, row + dy);
                    let near = TileKey { x: key.x.wrapping_add(x >> 4), y: key.y.wrapping_add(y >> 4) };
                    if let Some(tile) = window.tile_mut(near) {
                        empty_if_edge(tile, ((y & 15) << 4 | (x & 15)) as u8, stamp);
                    }
                }
            }
        }
    }
}

fn empty_if_edge(tile: &mut Tile, cell: u8, stamp: u8) {
    let index = usize::from(cell);
    let recent = stamp.wrapping_sub(tile.held[index].stamp) <= RECENT;
    let above = i32::from(tile.height[index]) - i32::from(tile.ground);
    if recent && tile.margin[index] != 0 && above > EDGE {
        tile.clear(cell);
    }
}

#[cfg(test)]
mod tests {
    use super::super::tile::{Update, margin_table};
    use super::*;
    extern crate std;

    #[test]
    fn beside_a_struck_mark_cells_are_emptied_if_they_were_written_in_the_last_two_seconds_and_never_later() {
        let key = TileKey { x: 0, y: 0 };
        let margins = margin_table();
        for written in [1u32, 90, 200, 255] {
            let mut tiles = std::vec![Tile::EMPTY; 1];
            let mut window = Window::new(&mut tiles, 1);
            window.place(key, |_| {});
            // The first cell sets the tile's level, the other lies 10 cm above it: on the body's edge, or on a step of the ground.
            let by = Update { margins: &margins, stamp: written as u8 };
            for (cell, z) in [(0, 0), (100, 400)] {
                window.tile_mut(key).unwrap().fuse(cell, z, 100, &by);
            }
            for frame in written..written + 1200 {
                forget_ages(&mut window, frame);
                let tile = window.tile_mut(key).unwrap();
                let held = tile.clone();
                empty_if_edge(tile, 100, (frame & 255) as u8);
                let emptied = tile.margin[100] == 0;
                assert_eq!(emptied, frame - written <= u32::from(RECENT), "written in {written}, struck in {frame}");
                *tile = held;
            }
        }
    }
}
