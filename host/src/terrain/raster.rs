//! The map as one grid of cells, north up, handed out block by block: a drive of an hour spans 57 x 57 km of them and more, of which it knows the width
//! of a road.
//!
//! Blocks are squares of [`SIDE`] cells, counted from the grid's north-west corner as the tiles of a GeoTIFF are. Only those that hold a tile
//! of the map are visited, one at a time: what is written takes the memory of one block, however long the drive.

use std::collections::BTreeSet;
use std::io;

use crossfall_core::terrain::{Cell, Class, SLOW, TILE_SIDE, TileKey};

use super::behind::around;
use super::mapper::Mapper;

/// Cells along a block's side.
pub const SIDE: usize = 512;
/// Tiles along a block's side.
const TILES: usize = SIDE / TILE_SIDE;
/// Most blocks of a grid, known or not: the list of them is what a GeoTIFF of mostly unknown ground consists of. A square of 297 km of 0.1 m cells.
const MOST: u64 = 1 << 25;

/// One cell with what the map says of it.
#[derive(Clone, Copy, Debug)]
pub struct RasterCell {
    /// Elevation in the world, m: measured, or between the neighbours that reach the cell.
    pub elevation_m: f64,
    /// Its standard deviation, m.
    pub sigma_m: f64,
    /// Whether the cell was measured itself.
    pub measured: bool,
    /// The map's cell.
    pub cell: Cell,
}

/// The rectangle around all that is known.
pub struct Grid {
    /// Side of a cell, m.
    pub cell_m: f64,
    /// Its lowest and its highest tile.
    low: TileKey,
    high: TileKey,
    /// Blocks that hold a tile, by row from the north and column from the west.
    blocks: BTreeSet<[u32; 2]>,
    /// What the window has left behind does not belong to it.
    window_only: bool,
}

/// A map has become too large for one grid.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
#[error("the map spans {:.0} x {:.0} km, more than a map of such small cells can: larger cells (--cell) span more", span_m[0] * 1e-3, span_m[1] * 1e-3)]
pub struct TooLarge {
    /// Its extent towards east and north, m.
    pub span_m: [f64; 2],
}

impl Grid {
    /// Whether what a map has left behind is small enough for a grid: to be asked while it grows, so that no work is lost.
    ///
    /// # Errors
    /// A map of which no frame more should be taken in.
    pub fn check(mapper: &Mapper<'_>) -> Result<(), TooLarge> {
        let cell_m = mapper.cell_m();
        mapper.bounds_behind().map_or(Ok(()), |bounds| check(bounds, cell_m))
    }

    /// All that a map knows; none if it knows nothing.
    #[must_use]
    pub fn of(mapper: &Mapper<'_>) -> Option<Self> {
        Self::of_tiles(mapper, || mapper.keys(), false)
    }

    /// What the map's window knows.
    #[must_use]
    pub fn of_window(mapper: &Mapper<'_>) -> Option<Self> {
        Self::of_tiles(mapper, || mapper.map().tiles().map(|tile| tile.key()), true)
    }

    fn of_tiles<K: Iterator<Item = TileKey>>(
        mapper: &Mapper<'_>,
        keys: impl Fn() -> K,
        window_only: bool,
    ) -> Option<Self> {
        let cell_m = mapper.cell_m();
        let [low, high] = keys().fold(None, |bounds, key| Some(around(bounds, key)))?;
        let blocks = keys().map(|key| block_of(key, low, high)).collect();
        Some(Self { cell_m, low, high, blocks, window_only })
    }

    /// Cells towards east.
    #[must_use]
    pub fn width(&self) -> usize {
        self.high.x.abs_diff(self.low.x) as usize * TILE_SIDE + TILE_SIDE
    }

    /// Cells towards north.
    #[must_use]
    pub fn height(&self) -> usize {
        self.high.y.abs_diff(self.low.y) as usize * TILE_SIDE + TILE_SIDE
    }

    /// Column and row of the south-western cell, counted from the world's zero.
    #[must_use]
    pub fn corner(&self) -> [i64; 2] {
        [self.low.x, self.low.y].map(|key| i64::from(key) * TILE_SIDE as i64)
    }

    /// World position of the north-western corner, m.
    #[must_use]
    pub fn north_west(&self) -> [f64; 2] {
        let [column, row] = self.corner();
        // To the micrometre, which is what a cell's side is told in.
        [column, row + self.height() as i64].map(|cells| (cells as f64 * self.cell_m * 1e6).round() / 1e6)
    }

    /// Number of blocks that hold something.
    #[must_use]
    pub fn known_blocks(&self) -> usize {
        self.blocks.len()
    }

    /// The blocks that hold something, from north to south and from west to east.
    pub fn blocks<'g>(&'g self, mapper: &'g Mapper<'_>) -> impl Iterator<Item = io::Result<Block>> + 'g {
        self.blocks.iter().map(|at| self.read(mapper, *at))
    }

    /// Reads a block with a border of a tile, so that cells at its rim find their neighbours, and leaves the border out again.
    fn read(&self, mapper: &Mapper<'_>, [down, right]: [u32; 2]) -> io::Result<Block> {
        const WIDE: usize = SIDE + 2 * TILE_SIDE;
        let west = self.low.x.wrapping_add_unsigned(right * TILES as u32);
        let north = self.high.y.wrapping_sub_unsigned(down * TILES as u32);
        let south = north.wrapping_sub(TILES as i32 - 1);
        let mut wide: Vec<Option<RasterCell>> = vec![None; WIDE * WIDE];
        for up in 0..TILES + 2 {
            for along in 0..TILES + 2 {
                let key = TileKey { x: west.wrapping_add(along as i32 - 1), y: south.wrapping_add(up as i32 - 1) };
                if self.window_only && mapper.map().tile(key).is_none() {
                    continue;
                }
                mapper.cells(key, |column, row, cell| {
                    let at = (up * TILE_SIDE + row) * WIDE + along * TILE_SIDE + column;
                    if let Some(place) = wide.get_mut(at) {
                        *place = read(mapper, &cell);
                    }
                })?;
            }
        }
        fill(&mut wide, WIDE);
        let inner = wide.chunks(WIDE).skip(TILE_SIDE).take(SIDE);
        let cells = inner.flat_map(|row| row.iter().skip(TILE_SIDE).take(SIDE).copied()).collect();
        let corner = [west, south].map(|key| i64::from(key) * TILE_SIDE as i64);
        Ok(Block { at: [right, down], corner, cells })
    }
}

fn check([low, high]: [TileKey; 2], cell_m: f64) -> Result<(), TooLarge> {
    let tiles = [high.x.abs_diff(low.x), high.y.abs_diff(low.y)].map(|tiles| u64::from(tiles) + 1);
    let blocks = tiles.map(|tiles| tiles.div_ceil(TILES as u64));
    if blocks[0] * blocks[1] > MOST {
        return Err(TooLarge { span_m: tiles.map(|tiles| (tiles * TILE_SIDE as u64) as f64 * cell_m) });
    }
    Ok(())
}

/// Row from the north and column from the west of the block that holds a tile.
fn block_of(key: TileKey, low: TileKey, high: TileKey) -> [u32; 2] {
    [high.y.abs_diff(key.y), key.x.abs_diff(low.x)].map(|tiles| tiles / TILES as u32)
}

/// A square of cells.
pub struct Block {
    /// Column from the west and row from the north of the block.
    pub at: [u32; 2],
    /// Column and row of its south-western cell, counted from the world's zero.
    pub corner: [i64; 2],
    cells: Vec<Option<RasterCell>>,
}

impl Block {
    /// Its known cells with column and row counted from the world's zero, row by row from the south.
    pub fn iter(&self) -> impl Iterator<Item = ([i64; 2], &RasterCell)> {
        self.cells.iter().enumerate().filter_map(|(index, cell)| {
            let (column, row) = (index % SIDE, index / SIDE);
            Some(([self.corner[0] + column as i64, self.corner[1] + row as i64], cell.as_ref()?))
        })
    }

    /// All its cells row by row from the north.
    pub fn north_up(&self) -> impl Iterator<Item = Option<&RasterCell>> {
        self.cells.chunks(SIDE).rev().flatten().map(Option::as_ref)
    }
}

/// Gives risky cells between measured ones an elevation: the middle of their measured neighbours within three cells, and half of
/// their spread as its sigma. Other cells without a measurement are dropped.
fn fill(cells: &mut [Option<RasterCell>], width: usize) {
    let measured = |cells: &[Option<RasterCell>], index: usize| {
        cells.get(index).copied().flatten().filter(|cell| cell.measured).map(|cell| cell.elevation_m)
    };
    let height = cells.len() / width;
    let mut changes = Vec::new();
    for index in 0..cells.len() {
        let Some(cell) = cells[index].filter(|cell| !cell.measured) else { continue };
        let (column, row) = (index % width, index / width);
        let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
        for y in row.saturating_sub(3)..(row + 4).min(height) {
            for x in column.saturating_sub(3)..(column + 4).min(width) {
                if let Some(level) = measured(cells, y * width + x) {
                    (low, high) = (low.min(level), high.max(level));
                }
            }
        }
        let filled = (low <= high).then(|| RasterCell {
            elevation_m: 0.5 * (low + high),
            sigma_m: (0.5 * (high - low)).max(0.01),
            ..cell
        });
        changes.push((index, filled));
    }
    for (index, cell) in changes {
        cells[index] = cell;
    }
}

fn read(mapper: &Mapper<'_>, cell: &Cell) -> Option<RasterCell> {
    match (cell.height, cell.variance_mm2()) {
        (Some(height), Some(variance)) => Some(RasterCell {
            elevation_m: mapper.elevation_m(height),
            sigma_m: f64::from(variance).sqrt() * 1e-3,
            measured: true,
            cell: *cell,
        }),
        // Where a step runs between two lines of points, the map is to show it; plain ground that nobody measured it leaves open.
        _ if cell.risk >= SLOW || cell.class == Class::Tall => {
            Some(RasterCell { elevation_m: f64::NAN, sigma_m: f64::NAN, measured: false, cell: *cell })
        }
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_block_is_found_from_the_north_west_and_a_map_beyond_all_measure_is_refused() {
        let key = |x, y| TileKey { x, y };
        let [low, high] = around(Some(around(None, key(5, -3))), key(-2, 90));
        assert_eq!([low, high], [key(-2, -3), key(5, 90)]);
        assert_eq!(block_of(key(-2, 90), low, high), [0, 0]);
        assert_eq!(block_of(key(30, 58), low, high), [1, 1]);
        assert!(check([key(0, 0), key(180_000, 180_000)], 0.1).is_ok());
        let refused = check([key(i32::MIN, 0), key(i32::MAX, 40_000)], 0.1).unwrap_err().to_string();
        assert!(refused.contains("6871948 x 64 km") && refused.contains("--cell"), "{refused}");
    }
}
