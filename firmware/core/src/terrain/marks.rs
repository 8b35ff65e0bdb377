//! What one frame says of each tile: where its ground is, which cells stand up, which are closed to this frame.
//!
//! Ground of a tile that the map knows is the map's. Of a tile seen for the first time it is the lowest 0.1 m bin of the
//! frame's own points below which lie at least a tenth of them; single low strays are passed over. Neighbours that are
//! known overrule it when it comes out 0.3 m above them: then the first thing seen there was a body, not ground.

use super::tile::{TILE_SIDE, Tile};
use super::window::Window;

const BINS: usize = 64;
/// 0.1 m in quarter millimetres.
const BIN: i32 = 400;
/// Cells a tile must know before its own ground is believed.
const KNOWN: u16 = 8;

/// Per-tile scratch of one frame. 170 bytes.
#[derive(Clone)]
pub struct Marks {
    pub(crate) touched: bool,
    pub(crate) any_hit: bool,
    /// The map knows this tile's ground: its points need no histogram.
    settled: bool,
    points: u16,
    reference: i32,
    /// Ground at the tile's centre above the datum, and its rise over four cells.
    ground: i32,
    rise: [i32; 2],
    histogram: [u8; BINS],
    /// Cells hit by something that stands; one bit a cell, one word a row.
    pub(crate) hits: [u16; TILE_SIDE],
    /// The same grown by two cells.
    pub(crate) closed: [u16; TILE_SIDE],
    /// Cells inside the box of a moving object.
    pub(crate) boxed: [u16; TILE_SIDE],
}

impl Marks {
    /// Nothing seen.
    pub const EMPTY: Self = Self {
        touched: false,
        any_hit: false,
        settled: false,
        points: 0,
        reference: 0,
        ground: 0,
        rise: [0; 2],
        histogram: [0; BINS],
        hits: [0; TILE_SIDE],
        closed: [0; TILE_SIDE],
        boxed: [0; TILE_SIDE],
    };

    /// Ready for a frame over a tile.
    pub(crate) fn reset(&mut self, tile: &Tile) {
        if self.touched {
            *self = Self::EMPTY;
        }
        self.settled = tile.known >= KNOWN;
    }

    #[inline]
    pub(crate) fn touch(&mut self, z: i32) {
        self.touched = true;
        if self.settled {
            return;
        }
        if self.points == 0 {
            self.reference = z;
        }
        self.points = self.points.saturating_add(1);
        // Bins reach 3.2 m below and above the tile's first point; the outermost take the rest.
        let above = z.wrapping_sub(self.reference).clamp(-BIN * 32, BIN * 32 - 1);
        let bin = (above + BIN * 32) / BIN;
        if let Some(count) = self.histogram.get_mut(bin as usize) {
            *count = count.saturating_add(1);
        }
    }

    /// Lowest believable level of the frame's own points.
    fn lowest(&self) -> i32 {
        let needed = (u32::from(self.points) / 10).max(if self.points >= 8 { 2 } else { 1 });
        let mut below = 0;
        for (bin, count) in self.histogram.iter().enumerate() {
            below += u32::from(*count);
            if below >= needed {
                return self.reference.saturating_add((bin as i32 - 32) * BIN + BIN / 2);
            }
        }
        self.reference
    }

    /// Height of a sample above the ground of its tile, quarter millimetres.
    #[inline]
    pub(crate) fn above(&self, cell: u8, z: i32) -> i32 {
        let (column, row) = (i32::from(cell & 15), i32::from(cell >> 4));
        let slope = (self.rise[0] * (2 * column - 15) + self.rise[1] * (2 * row - 15)) >> 3;
        z.wrapping_sub(self.ground).wrapping_sub(slope)
    }

    #[inline]
    pub(crate) fn hit(&mut self, cell: u8) {
        self.any_hit = true;
        self.hits[usize::from(cell >> 4)] |= 1 << (cell & 15);
    }

    #[inline]
    pub(crate) fn is_set(rows: &[u16; TILE_SIDE], cell: u8) -> bool {
        rows[usize::from(cell >> 4)] >> (cell & 15) & 1 != 0
    }
}

/// Settles the ground of every tile that the frame touched.
pub(crate) fn settle_ground(window: &Window<'_>, marks: &mut [Marks]) {
    for (tile, mark) in window.tiles.iter().zip(marks.iter_mut()).filter(|(_, mark)| mark.touched) {
        mark.rise = tile.rise.map(i32::from);
        if tile.known >= KNOWN {
            mark.ground = tile.base.saturating_add(i32::from(tile.ground));
            continue;
        }
        mark.ground = mark.lowest();
        if let Some((level, rise)) = expected(window, tile) {
            mark.rise = rise;
            // 0.3 m in quarter millimetres: twice a curb.
            if mark.ground > level.saturating_add(1200) {
                mark.ground = level;
            }
        }
    }
}

/// Ground of a tile as its known neighbours continue it: the lowest of them.
fn expected(window: &Window<'_>, tile: &Tile) -> Option<(i32, [i32; 2])> {
    let mut best: Option<(i32, [i32; 2])> = None;
    for (dx, dy) in [(-1, -1), (0, -1), (1, -1), (-1, 0), (1, 0), (-1, 1), (0, 1), (1, 1)] {
        let key = super::tile::TileKey { x: tile.key.x.wrapping_add(dx), y: tile.key.y.wrapping_add(dy) };
        let Some(other) = window.tile(key).filter(|other| other.known >= KNOWN) else { continue };
        let rise = other.rise.map(i32::from);
        // A tile is four times the four cells that the rise spans.
        let level =
            other.base.saturating_add(i32::from(other.ground)).saturating_sub(4 * (dx * rise[0] + dy * rise[1]));
        if best.is_none_or(|(held, _)| level < held) {
            best = Some((level, rise));
        }
    }
    best
}

/// Grows every hit by two cells each way, across tiles: ground right beside something that stands is not trusted.
pub(crate) fn close_around_hits(window: &Window<'_>, marks: &mut [Marks]) {
    for slot in 0..marks.len() {
        let Some(key) = window.tiles.get(slot).map(|tile| tile.key) else { continue };
        let around = |marks: &[Marks], dx: i32, dy: i32| -> Option<[u16; TILE_SIDE]> {
            let column = key.x.wrapping_add(dx).wrapping_sub(window.origin.x) as u32;
            let row = key.y.wrapping_add(dy).wrapping_sub(window.origin.y) as u32;
            let side = u32::from(window.side);
            if column >= side || row >= side {
                return None;
            }
            marks.get(window.slot(column, row)).filter(|mark| mark.any_hit).map(|mark| mark.hits)
        };
        if !marks.get(slot).is_some_and(|mark| mark.touched) {
            continue;
        }
        let mut grown = [0u16; TILE_SIDE];
        let mut any = false;
        for dy in -1..=1 {
            for dx in -1..=1 {
                let Some(hits) = around(marks, dx, dy) else { continue };
                any = true;
                for (row, word) in hits.iter().enumerate() {
                    let word = u32::from(*word) << 16;
                    let wide = word | word << 1 | word << 2 | word >> 1 | word >> 2;
                    // A neighbour on the left lends its right edge (carried past bit 15), one on the right its left.
                    let here = match dx {
                        -1 => carried_right(word),
                        1 => (wide & 0xFFFF) as u16,
                        _ => (wide >> 16) as u16,
                    };
                    for reach in -2i32..=2 {
                        let target = row as i32 + dy * TILE_SIDE as i32 + reach;
                        if let Some(out) = usize::try_from(target).ok().and_then(|row| grown.get_mut(row)) {
                            *out |= here;
                        }
                    }
                }
            }
        }
        if any && let Some(mark) = marks.get_mut(slot) {
            mark.closed = grown;
        }
    }
}

/// What a left neighbour's row carries over its right edge: bits 14 and 15 of it into bits 0 and 1.
fn carried_right(word: u32) -> u16 {
    let row = (word >> 16) as u16;
    let (last, before) = (row >> 15 & 1, row >> 14 & 1);
    (last | before) | last << 1
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::terrain::tile::TileKey;

    #[test]
    fn hits_close_the_five_by_five_around_them_across_tile_borders() {
        extern crate std;
        let mut tiles = std::vec![Tile::EMPTY; 9];
        let mut window = Window::new(&mut tiles, 3);
        window.place(TileKey { x: 0, y: 0 }, |_| {});
        for (column, row) in [(16usize, 16usize), (31, 31), (17, 30), (24, 24), (30, 16), (31, 20)] {
            let mut marks = std::vec![Marks::EMPTY; 9];
            for mark in &mut marks {
                mark.touched = true;
            }
            marks[4].hit(((row & 15) << 4 | (column & 15)) as u8);
            close_around_hits(&window, &mut marks);
            for y in 0..48usize {
                for x in 0..48usize {
                    let mark = &marks[(y / 16) * 3 + x / 16];
                    let closed = Marks::is_set(&mark.closed, ((y & 15) << 4 | (x & 15)) as u8);
                    let wanted = x.abs_diff(column) <= 2 && y.abs_diff(row) <= 2;
                    assert_eq!(closed, wanted, "hit {column},{row} at {x},{y}");
                }
            }
        }
    }

    #[test]
    fn ground_of_a_new_tile_passes_over_one_low_stray() {
        let mut mark = Marks::EMPTY;
        for k in 0..40 {
            mark.touch(5000 + k * 3);
        }
        mark.touch(-6000);
        for _ in 0..60 {
            mark.touch(9000);
        }
        assert!((mark.lowest() - 5000).abs() <= BIN, "{}", mark.lowest());
    }
}
