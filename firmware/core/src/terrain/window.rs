//! The rolling window: tiles of the world on a torus of slots, so that driving on never copies a cell.
//!
//! A tile's slot is its world position modulo the window's side. When the window moves, tiles that fall out are handed
//! to the caller and their slots are emptied for what comes in: memory is constant however long the drive.

use super::tile::{Tile, TileKey};

pub(crate) struct Window<'a> {
    pub(crate) tiles: &'a mut [Tile],
    /// Tiles along a side, at least 1.
    pub(crate) side: u16,
    /// The tile in the window's lowest corner.
    pub(crate) origin: TileKey,
    /// The slot's column and row of the window's lowest corner.
    pub(crate) corner: [u32; 2],
    placed: bool,
}

/// A tile and the eight around it.
pub(crate) struct Neighbours<'a>([Option<&'a Tile>; 9]);

impl<'a> Neighbours<'a> {
    /// The tile `dx` towards x and `dy` towards y, each -1 to 1; none outside the window.
    #[inline]
    pub(crate) fn tile(&self, dx: i32, dy: i32) -> Option<&'a Tile> {
        self.0.get((3 * dy + dx + 4) as usize).copied().flatten()
    }

    /// All nine, by rows; the tile itself is the fifth.
    pub(crate) fn iter(&self) -> impl Iterator<Item = Option<&'a Tile>> + '_ {
        self.0.iter().copied()
    }
}

impl<'a> Window<'a> {
    /// `tiles` must hold `side` x `side` of them; the caller has checked it.
    pub(crate) fn new(tiles: &'a mut [Tile], side: u16) -> Self {
        // Nothing was ever written to those that are not in use.
        for tile in tiles.iter_mut().filter(|tile| tile.in_use) {
            *tile = Tile::EMPTY;
        }
        Self { tiles, side: side.max(1), origin: TileKey::default(), corner: [0; 2], placed: false }
    }

    /// Moves the window so that `origin` is its lowest corner.
    pub(crate) fn place(&mut self, origin: TileKey, mut retired: impl FnMut(&Tile)) {
        if self.placed && origin == self.origin {
            return;
        }
        self.origin = origin;
        self.placed = true;
        let side = i32::from(self.side);
        // rem_euclid by a positive number: 0 to side - 1. The side is at least 1.
        self.corner = [origin.x, origin.y].map(|key| key.checked_rem_euclid(side).unwrap_or(0) as u32);
        for (row, tiles) in self.tiles.chunks_mut(usize::from(self.side).max(1)).enumerate() {
            let y = key_in_window(row as i32, origin.y, side);
            for (column, tile) in tiles.iter_mut().enumerate() {
                let key = TileKey { x: key_in_window(column as i32, origin.x, side), y };
                if !tile.in_use {
                    // Nothing was ever written to it.
                    tile.key = key;
                } else if tile.key != key {
                    retired(tile);
                    tile.restart(key);
                }
            }
        }
    }

    /// Empties every tile, handing over those in use.
    pub(crate) fn clear(&mut self, mut retired: impl FnMut(&Tile)) {
        for tile in self.tiles.iter_mut().filter(|tile| tile.in_use) {
            retired(tile);
            let key = tile.key;
            tile.restart(key);
        }
    }

    /// The slot of a tile given relative to the window's lowest corner; any slot if it lies outside.
    #[inline]
    pub(crate) fn slot(&self, column: u32, row: u32) -> usize {
        let side = u32::from(self.side);
        let x = wrap(column.wrapping_add(self.corner[0]), side);
        let y = wrap(row.wrapping_add(self.corner[1]), side);
        (y.wrapping_mul(side).wrapping_add(x)) as usize
    }

    /// The tiles up to `REACH` away from one, by rows, those that the window covers.
    #[inline(always)]
    pub(crate) fn near<const REACH: i32>(&self, key: TileKey, mut each: impl FnMut(&Tile)) {
        let side = u32::from(self.side);
        let column = key.x.wrapping_sub(self.origin.x);
        let row = key.y.wrapping_sub(self.origin.y);
        for dy in -REACH..=REACH {
            let row = row.wrapping_add(dy) as u32;
            if row >= side {
                continue;
            }
            let first = wrap(row.wrapping_add(self.corner[1]), side).wrapping_mul(side);
            for dx in -REACH..=REACH {
                let column = column.wrapping_add(dx) as u32;
                let slot = first.wrapping_add(wrap(column.wrapping_add(self.corner[0]), side));
                if let Some(tile) = self.tiles.get(slot as usize).filter(|_| column < side) {
                    each(tile);
                }
            }
        }
    }

    /// A tile and the eight around it.
    pub(crate) fn around(&self, key: TileKey) -> Neighbours<'_> {
        let mut all = [None; 9];
        let mut places = all.iter_mut();
        for dy in -1..=1 {
            for dx in -1..=1 {
                if let Some(place) = places.next() {
                    *place = self.tile(TileKey { x: key.x.wrapping_add(dx), y: key.y.wrapping_add(dy) });
                }
            }
        }
        Neighbours(all)
    }

    /// The slot of a tile, if the window covers it.
    #[inline]
    pub(crate) fn slot_of(&self, key: TileKey) -> Option<usize> {
        let column = key.x.wrapping_sub(self.origin.x) as u32;
        let row = key.y.wrapping_sub(self.origin.y) as u32;
        let side = u32::from(self.side);
        (column < side && row < side).then(|| self.slot(column, row))
    }

    /// The tile at a world position, if the window covers it.
    #[inline]
    pub(crate) fn tile(&self, key: TileKey) -> Option<&Tile> {
        self.tiles.get(self.slot_of(key)?)
    }

    /// The same, to change it.
    pub(crate) fn tile_mut(&mut self, key: TileKey) -> Option<&mut Tile> {
        let slot = self.slot_of(key)?;
        self.tiles.get_mut(slot)
    }
}

/// `value` modulo `side` for a value below 2 x side.
#[inline]
fn wrap(value: u32, side: u32) -> u32 {
    if value >= side { value.wrapping_sub(side) } else { value }
}

/// The one position congruent to `slot` modulo `side` within a window that starts at `origin`.
fn key_in_window(slot: i32, origin: i32, side: i32) -> i32 {
    let into = slot.wrapping_sub(origin).checked_rem_euclid(side).unwrap_or(0);
    origin.wrapping_add(into)
}

#[cfg(test)]
mod tests {
    use super::super::tile::Update;
    use super::*;

    #[test]
    fn every_tile_of_the_window_has_a_slot_of_its_own_wherever_the_window_lies() {
        extern crate std;
        let mut tiles = std::vec![Tile::EMPTY; 25];
        let mut window = Window::new(&mut tiles, 5);
        for (x, y) in [(0, 0), (1, 0), (-7, 3), (1_000_003, -999_999), (-3, -3)] {
            window.place(TileKey { x, y }, |_| {});
            for dy in 0..5 {
                for dx in 0..5 {
                    let key = TileKey { x: x + dx, y: y + dy };
                    assert_eq!(window.tile(key).map(Tile::key), Some(key));
                }
            }
            assert!(window.tile(TileKey { x: x + 5, y }).is_none());
            assert!(window.tile(TileKey { x: x - 1, y }).is_none());
        }
    }

    #[test]
    fn a_tile_survives_while_the_window_covers_it_and_is_handed_over_once_when_it_does_not() {
        extern crate std;
        let mut tiles = std::vec![Tile::EMPTY; 25];
        let mut window = Window::new(&mut tiles, 5);
        window.place(TileKey { x: -2, y: -2 }, |_| {});
        let table = super::super::tile::margin_table();
        let key = TileKey { x: 1, y: 2 };
        window.tile_mut(key).unwrap().fuse(17, 4000, 100, &Update { margins: &table, stamp: 0 });
        let mut retired = std::vec::Vec::new();
        for x in -1..8 {
            window.place(TileKey { x, y: -2 }, |tile| retired.push((x, tile.key())));
        }
        assert_eq!(retired, [(2, key)]);
    }
}
