//! Tiles that the window has left behind, packed, in a file without a name or in memory.
//!
//! An hour of driving leaves more than a million tiles of 2.6 KB. What the outputs need of one are its known cells, at eight bytes each; in memory
//! stay its place and where it lies, so that a drive takes tens of megabytes an hour there and the rest on the disk. A tile that is left once
//! more replaces what was kept of it.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{self, Read, Seek, SeekFrom, Write};
use std::path::Path;

use crossfall_core::terrain::{Cell, Class, TILE_SIDE, Tile, TileKey};

/// Bytes of a packed cell: index, height above the tile's lowest, weight and what stands, scatter, risk, class and confidence.
const CELL: usize = 8;
/// Bytes before a tile's cells: its lowest height.
const HEAD: usize = 4;
/// A height that is not known. Heights of a tile lie within 62,000 of each other.
const NO_HEIGHT: u16 = u16::MAX;
/// Beside the weight, which is at most 4096.
const TALL: u16 = 1 << 15;

enum Store {
    Memory(Vec<u8>),
    File(File),
}

/// Where a tile lies in the store.
#[derive(Clone, Copy)]
struct Span {
    at: u64,
    bytes: u32,
}

/// The tiles left behind.
pub(super) struct Behind {
    store: Store,
    end: u64,
    index: BTreeMap<TileKey, Span>,
    bounds: Option<[TileKey; 2]>,
    packed: Vec<u8>,
}

impl Behind {
    /// Kept in memory.
    pub(super) fn in_memory() -> Self {
        Self::of(Store::Memory(Vec::new()))
    }

    /// Kept in a file of this folder that has no name and is gone with the process.
    pub(super) fn in_folder(folder: &Path) -> io::Result<Self> {
        Ok(Self::of(Store::File(tempfile::tempfile_in(folder)?)))
    }

    fn of(store: Store) -> Self {
        Self { store, end: 0, index: BTreeMap::new(), bounds: None, packed: Vec::new() }
    }

    /// The places of all tiles.
    pub(super) fn keys(&self) -> impl Iterator<Item = TileKey> + '_ {
        self.index.keys().copied()
    }

    /// The lowest and the highest tile of the rectangle around all of them.
    pub(super) fn bounds(&self) -> Option<[TileKey; 2]> {
        self.bounds
    }

    /// Number of tiles.
    pub(super) fn len(&self) -> usize {
        self.index.len()
    }

    /// Bytes in memory and in the file. A tree's nodes are two thirds full in the mean.
    pub(super) fn bytes(&self) -> (u64, u64) {
        let index = (self.index.len() * size_of::<(TileKey, Span)>() * 3 / 2) as u64;
        match &self.store {
            Store::Memory(held) => (index + held.capacity() as u64, 0),
            Store::File(_) => (index, self.end),
        }
    }

    /// Forgets all tiles.
    pub(super) fn clear(&mut self) -> io::Result<()> {
        self.index.clear();
        (self.end, self.bounds) = (0, None);
        match &mut self.store {
            Store::Memory(held) => held.clear(),
            Store::File(file) => file.set_len(0)?,
        }
        Ok(())
    }

    /// Keeps a tile. One of which nothing is known takes no room.
    pub(super) fn put(&mut self, tile: &Tile) -> io::Result<()> {
        self.packed.clear();
        pack(tile, &mut self.packed);
        let bytes = self.packed.len();
        match &mut self.store {
            Store::Memory(held) => held.extend_from_slice(&self.packed),
            Store::File(file) => {
                file.seek(SeekFrom::Start(self.end))?;
                file.write_all(&self.packed)?;
            }
        }
        self.bounds = Some(around(self.bounds, tile.key()));
        self.index.insert(tile.key(), Span { at: self.end, bytes: bytes as u32 });
        self.end += bytes as u64;
        Ok(())
    }

    /// Gives the known cells of a tile with column and row; whether there is such a tile.
    pub(super) fn cells(&self, key: TileKey, mut each: impl FnMut(usize, usize, Cell)) -> io::Result<bool> {
        let Some(span) = self.index.get(&key) else { return Ok(false) };
        let mut read;
        let packed = match &self.store {
            Store::Memory(held) => held.get(span.at as usize..).unwrap_or_default(),
            Store::File(file) => {
                let mut file = file;
                read = [0; HEAD + CELL * TILE_SIDE * TILE_SIDE];
                let wanted = read.get_mut(..span.bytes as usize).unwrap_or_default();
                file.seek(SeekFrom::Start(span.at))?;
                file.read_exact(wanted)?;
                &read
            }
        };
        unpack(packed.get(..span.bytes as usize).unwrap_or_default(), &mut each);
        Ok(true)
    }
}

/// A rectangle grown by a tile.
pub(super) fn around(bounds: Option<[TileKey; 2]>, key: TileKey) -> [TileKey; 2] {
    let [low, high] = bounds.unwrap_or([key; 2]);
    [TileKey { x: low.x.min(key.x), y: low.y.min(key.y) }, TileKey { x: high.x.max(key.x), y: high.y.max(key.y) }]
}

fn pack(tile: &Tile, out: &mut Vec<u8>) {
    let cells = || (0..TILE_SIDE * TILE_SIDE).map(|index| (index, tile.cell(index % TILE_SIDE, index / TILE_SIDE)));
    let lowest = cells().filter_map(|(_, cell)| cell.height).min().unwrap_or(0);
    out.extend_from_slice(&lowest.to_le_bytes());
    for (index, cell) in cells() {
        if cell.height.is_none() && cell.risk == 0 && cell.class == Class::Free && !cell.tall {
            continue;
        }
        let above = cell.height.and_then(|height| u16::try_from(height - lowest).ok()).unwrap_or(NO_HEIGHT);
        let weight = cell.weight | if cell.tall { TALL } else { 0 };
        let ([h0, h1], [w0, w1]) = (above.to_le_bytes(), weight.to_le_bytes());
        out.extend_from_slice(&[
            index as u8,
            h0,
            h1,
            w0,
            w1,
            cell.scatter_mm,
            cell.risk,
            cell.class as u8 | cell.confidence << 3,
        ]);
    }
}

fn unpack(packed: &[u8], each: &mut impl FnMut(usize, usize, Cell)) {
    let Some((lowest, cells)) = packed.split_first_chunk::<HEAD>() else { return };
    let lowest = i32::from_le_bytes(*lowest);
    for &[index, h0, h1, w0, w1, scatter_mm, risk, class] in cells.as_chunks::<CELL>().0 {
        let above = u16::from_le_bytes([h0, h1]);
        let weight = u16::from_le_bytes([w0, w1]);
        let cell = Cell {
            height: (above != NO_HEIGHT).then(|| lowest + i32::from(above)),
            weight: weight & !TALL,
            scatter_mm,
            tall: weight & TALL != 0,
            risk,
            class: Class::from_bits(class),
            confidence: class >> 3,
        };
        each(usize::from(index) % TILE_SIDE, usize::from(index) / TILE_SIDE, cell);
    }
}
