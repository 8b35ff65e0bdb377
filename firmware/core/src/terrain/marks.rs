//! What one frame says of each tile: where its ground is, which cells stand up, which are closed to this frame.
//!
//! Ground of a tile that the map knows is the map's. Of a tile seen for the first time it is the lowest 0.1 m bin of the
//! frame's own points below which lie at least a tenth of them; single low strays are passed over. Neighbours that are
//! known overrule it when it comes out 0.3 m above them: then the first thing seen there was a body, not ground.

use super::tile::{TILE_SIDE, Tile, TileKey};
use super::window::Window;

const BINS: usize = 64;
/// 0.1 m in quarter millimetres.
const BIN: i32 = 400;
/// Cells a tile must know before its own ground is believed.
const KNOWN: u16 = 8;

/// Ends the chain of touched marks: there are at most 255 x 255.
const LAST: u16 = u16::MAX;

/// Per-tile scratch of one frame. 188 bytes.
#[derive(Clone)]
pub struct Marks {
    touched: bool,
    pub(crate) any_hit: bool,
    any_boxed: bool,
    /// What lies no higher than this is ground wherever in the tile it lies, quarter millimetres above the datum. Nothing does before the first touch.
    plain: i32,
    /// The map knows this tile's ground: its points need no histogram.
    settled: bool,
    /// The mark that was touched before this one.
    before: u16,
    points: u16,
    reference: i32,
    /// Ground at the tile's centre above the datum, and its rise over four cells.
    ground: i32,
    rise: [i32; 2],
    histogram: [u8; BINS],
    /// Cells hit by something that stands; one bit a cell, one word a row.
    pub(crate) hits: [u16; TILE_SIDE],
    /// The same grown by two cells.
    closed: [u16; TILE_SIDE],
    /// Cells inside the box of a moving object.
    boxed: [u16; TILE_SIDE],
}

/// What becomes of a point by where it lies.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(crate) enum Lies {
    /// In the box of a moving object.
    Boxed,
    /// Higher than any vehicle.
    Overhead,
    /// On something that stands.
    Standing,
    /// On the ground.
    Ground,
    /// In a tile whose ground is not known yet.
    Unsettled,
    /// In no tile of the window.
    Nowhere,
}

/// Heights above the ground, quarter millimetres, from which a point stands and from which it hangs over.
#[derive(Clone, Copy)]
pub(crate) struct Tall {
    pub(crate) stands: i32,
    pub(crate) hangs: i32,
}

impl Marks {
    /// Nothing seen.
    pub const EMPTY: Self = Self {
        touched: false,
        any_hit: false,
        any_boxed: false,
        plain: i32::MIN,
        settled: false,
        before: LAST,
        points: 0,
        reference: 0,
        ground: 0,
        rise: [0; 2],
        histogram: [0; BINS],
        hits: [0; TILE_SIDE],
        closed: [0; TILE_SIDE],
        boxed: [0; TILE_SIDE],
    };

    /// Works out what is plainly ground, from the tile's ground and its gradient.
    fn tell_plain(&mut self, stands: i32) {
        // The lowest that the gradient leaves of it: in a corner.
        let [along, across] = self.rise.map(|rise| rise.saturating_abs());
        let corner = along.saturating_add(across).saturating_mul(-15) >> 3;
        self.plain = self.ground.saturating_add(stands).saturating_add(corner);
    }

    /// Whether a point is certainly ground: nearly all of it is, told by one comparison.
    #[inline(always)]
    pub(crate) fn is_plain_ground(&self, z: i32) -> bool {
        z <= self.plain
    }

    /// Judges a point. In a settled tile that is all; in another it counts towards the tile's ground.
    #[inline(always)]
    fn judge(&mut self, cell: u8, z: i32, tall: Tall) -> Lies {
        if self.any_boxed && Self::is_set(&self.boxed, cell) {
            return Lies::Boxed;
        }
        if !self.settled {
            self.count(z);
            return Lies::Unsettled;
        }
        self.stands(cell, z, tall)
    }

    /// The same once the tile's ground is settled.
    #[inline]
    pub(crate) fn stands(&mut self, cell: u8, z: i32, tall: Tall) -> Lies {
        let above = self.above(cell, z);
        if above <= tall.stands {
            Lies::Ground
        } else if above > tall.hangs {
            Lies::Overhead
        } else {
            self.any_hit = true;
            self.hits[usize::from(cell >> 4)] |= 1 << (cell & 15);
            Lies::Standing
        }
    }

    fn count(&mut self, z: i32) {
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

    /// Height of a point above the ground of its tile, quarter millimetres.
    #[inline(always)]
    fn above(&self, cell: u8, z: i32) -> i32 {
        let (column, row) = (i32::from(cell & 15), i32::from(cell >> 4));
        let slope = (self.rise[0] * (2 * column - 15) + self.rise[1] * (2 * row - 15)) >> 3;
        z.wrapping_sub(self.ground).wrapping_sub(slope)
    }

    #[inline(always)]
    pub(crate) fn is_set(rows: &[u16; TILE_SIDE], cell: u8) -> bool {
        rows[usize::from(cell >> 4)] >> (cell & 15) & 1 != 0
    }

    /// Whether a cell of a touched mark is closed to this frame.
    #[inline(always)]
    pub(crate) fn is_closed(&self, cell: u8) -> bool {
        Self::is_set(&self.closed, cell)
    }
}

/// The marks of all slots. Those touched in a frame form a chain, so that what a frame costs goes with the tiles that it sees.
pub(crate) struct Board<'a> {
    marks: &'a mut [Marks],
    newest: u16,
    tall: Tall,
}

impl<'a> Board<'a> {
    pub(crate) fn new(marks: &'a mut [Marks]) -> Self {
        // Those that no frame touched are empty.
        for mark in marks.iter_mut().filter(|mark| mark.touched) {
            *mark = Marks::EMPTY;
        }
        Self { marks, newest: LAST, tall: Tall { stands: 0, hangs: 0 } }
    }

    /// Ready for a frame.
    pub(crate) fn clear(&mut self, tall: Tall) {
        while let Some(mark) = self.marks.get_mut(usize::from(self.newest)) {
            (mark.touched, mark.plain) = (false, i32::MIN);
            self.newest = mark.before;
        }
        (self.newest, self.tall) = (LAST, tall);
    }

    /// The mark of a slot, touched or not.
    #[inline(always)]
    pub(crate) fn any(&self, slot: usize) -> Option<&Marks> {
        self.marks.get(slot)
    }

    /// Judges a point at its mark, which is made ready at its first touch in a frame.
    #[inline(always)]
    pub(crate) fn judge(&mut self, slot: usize, cell: u8, z: i32, window: &Window<'_>) -> Lies {
        let tall = self.tall;
        self.touch(slot, window).map_or(Lies::Nowhere, |mark| mark.judge(cell, z, tall))
    }

    pub(crate) fn get(&self, slot: usize) -> Option<&Marks> {
        self.marks.get(slot).filter(|mark| mark.touched)
    }

    pub(crate) fn get_mut(&mut self, slot: usize) -> Option<&mut Marks> {
        self.marks.get_mut(slot).filter(|mark| mark.touched)
    }

    /// The mark of a slot, made ready at its first touch in a frame.
    #[inline(always)]
    fn touch(&mut self, slot: usize, window: &Window<'_>) -> Option<&mut Marks> {
        let mark = self.marks.get_mut(slot)?;
        if !mark.touched {
            begin(mark, window.tiles.get(slot), self.newest, self.tall.stands);
            self.newest = slot as u16;
        }
        Some(mark)
    }

    /// The touched slots, the newest first.
    pub(crate) fn touched(&self) -> impl Iterator<Item = (usize, &Marks)> {
        let mut next = self.newest;
        core::iter::from_fn(move || {
            let slot = usize::from(next);
            let mark = self.marks.get(slot)?;
            next = mark.before;
            Some((slot, mark))
        })
    }

    /// Puts the box of a moving object over a cell.
    pub(crate) fn cover(&mut self, slot: usize, cell: u8, window: &Window<'_>) {
        if let Some(mark) = self.touch(slot, window) {
            (mark.any_boxed, mark.plain) = (true, i32::MIN);
            mark.boxed[usize::from(cell >> 4)] |= 1 << (cell & 15);
        }
    }

    /// Settles the ground of every touched tile that the map does not know; `any_known` says that it knows others.
    pub(crate) fn settle(&mut self, window: &Window<'_>, any_known: bool) {
        let mut next = self.newest;
        while let Some(mark) = self.marks.get_mut(usize::from(next)) {
            let slot = usize::from(next);
            next = mark.before;
            if let Some(tile) = window.tiles.get(slot).filter(|_| !mark.settled && mark.points > 0) {
                mark.ground = mark.lowest();
                if any_known && let Some((level, rise)) = expected(window, tile) {
                    mark.rise = rise;
                    // 0.3 m in quarter millimetres: twice a curb.
                    if mark.ground > level.saturating_add(1200) {
                        mark.ground = level;
                    }
                }
                mark.tell_plain(self.tall.stands);
            }
        }
    }

    /// Grows every hit by two cells each way, across tiles: ground right beside something that stands is not trusted. Whether there was
    /// any hit.
    pub(crate) fn close_around_hits(&mut self, window: &Window<'_>) -> bool {
        let mut any = false;
        let mut next = self.newest;
        while let Some(mark) = self.marks.get(usize::from(next)) {
            let key = window.tiles.get(usize::from(next)).map(|tile| tile.key);
            next = mark.before;
            let Some(key) = key.filter(|_| mark.any_hit) else { continue };
            any = true;
            let hits = mark.hits;
            for dy in -1..=1 {
                for dx in -1..=1 {
                    let near = TileKey { x: key.x.wrapping_add(dx), y: key.y.wrapping_add(dy) };
                    if let Some(mark) = window.slot_of(near).and_then(|slot| self.get_mut(slot)) {
                        grow(&hits, [dx, dy], &mut mark.closed);
                    }
                }
            }
        }
        any
    }
}

#[inline(never)]
fn begin(mark: &mut Marks, tile: Option<&Tile>, before: u16, stands: i32) {
    *mark = Marks { touched: true, before, ..Marks::EMPTY };
    if let Some(tile) = tile {
        mark.rise = tile.rise.map(i32::from);
        if tile.known >= KNOWN {
            mark.settled = true;
            mark.ground = tile.base.saturating_add(i32::from(tile.ground));
            mark.tell_plain(stands);
        }
    }
}

/// Hits of one tile, grown by two cells each way, as they close the tile `dx` towards x and `dy` towards y of it.
fn grow(hits: &[u16; TILE_SIDE], [dx, dy]: [i32; 2], closed: &mut [u16; TILE_SIDE]) {
    for (row, word) in hits.iter().enumerate().filter(|(_, word)| **word != 0) {
        let word = u32::from(*word) << 8;
        let wide = word | word << 1 | word << 2 | word >> 1 | word >> 2;
        // Bits 8 to 23 are the tile's own columns; what runs over either end is the neighbour's.
        let there = match dx {
            -1 => wide << 8,
            1 => wide >> 24,
            _ => wide >> 8,
        } as u16;
        for reach in -2i32..=2 {
            let target = row as i32 - dy * TILE_SIDE as i32 + reach;
            if let Some(out) = usize::try_from(target).ok().and_then(|row| closed.get_mut(row)) {
                *out |= there;
            }
        }
    }
}

/// Ground of a tile as its known neighbours continue it: the lowest of them.
fn expected(window: &Window<'_>, tile: &Tile) -> Option<(i32, [i32; 2])> {
    let mut best: Option<(i32, [i32; 2])> = None;
    for (dx, dy) in [(-1, -1), (0, -1), (1, -1), (-1, 0), (1, 0), (-1, 1), (0, 1), (1, 1)] {
        let key = TileKey { x: tile.key.x.wrapping_add(dx), y: tile.key.y.wrapping_add(dy) };
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn hits_close_the_five_by_five_around_them_across_tile_borders() {
        extern crate std;
        let mut tiles = std::vec![Tile::EMPTY; 9];
        let mut window = Window::new(&mut tiles, 3);
        window.place(TileKey { x: 0, y: 0 }, |_| {});
        for (column, row) in [(16usize, 16usize), (31, 31), (17, 30), (24, 24), (30, 16), (31, 20)] {
            let mut marks = std::vec![Marks::EMPTY; 9];
            let mut board = Board::new(&mut marks);
            for slot in 0..9 {
                board.touch(slot, &window).unwrap().settled = true;
            }
            let cell = ((row & 15) << 4 | (column & 15)) as u8;
            let tall = Tall { stands: 1400, hangs: 10_400 };
            assert!(board.get_mut(4).unwrap().judge(cell, 4000, tall) == Lies::Standing);
            assert!(board.close_around_hits(&window));
            for y in 0..48usize {
                for x in 0..48usize {
                    let mark = board.get((y / 16) * 3 + x / 16).unwrap();
                    let closed = mark.is_closed(((y & 15) << 4 | (x & 15)) as u8);
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
            mark.count(5000 + k * 3);
        }
        mark.count(-6000);
        for _ in 0..60 {
            mark.count(9000);
        }
        assert!((mark.lowest() - 5000).abs() <= BIN, "{}", mark.lowest());
    }
}
