//! The core's map with its storage on the heap, and the record of what the window leaves behind.

use std::io;
use std::path::Path;

use crossfall_core::terrain::{
    Cell, FrameReport, IMAGE_COLUMNS, IMAGE_ROWS, Marks, MovingBox, Pair, Pose, RangePixels, Sample, SetUpError,
    Storage, TILE_SIDE, TerrainConfig, TerrainMap, Tile, TileKey, Vectors,
};

use super::behind::Behind;
use super::lidar::SensorPose;
use super::vectors::Found;

/// The memory that a map works in.
pub struct Workshop {
    tiles: Vec<Tile>,
    marks: Vec<Marks>,
    samples: Vec<Sample>,
    pairs: Vec<Pair>,
    /// None where nothing is looked through.
    pixels: Option<Box<RangePixels>>,
    side: u16,
    config: TerrainConfig,
}

impl Workshop {
    /// Memory for a window of `side` x `side` tiles and frames of up to `points` points.
    #[must_use]
    pub fn new(config: TerrainConfig, side: u16, points: usize) -> Self {
        let count = usize::from(side) * usize::from(side);
        let pixels = || -> Box<RangePixels> {
            let pixels = vec![0u16; IMAGE_COLUMNS * IMAGE_ROWS].into_boxed_slice();
            pixels.try_into().unwrap_or_else(|_| Box::new([0; IMAGE_COLUMNS * IMAGE_ROWS]))
        };
        Self {
            tiles: vec![Tile::EMPTY; count],
            marks: vec![Marks::EMPTY; count],
            samples: vec![Sample::default(); points.max(1)],
            pairs: vec![Pair::default(); if config.push_broom { 256 } else { 10_000 }],
            pixels: (!config.push_broom).then(pixels),
            side,
            config,
        }
    }

    /// Memory and window for a range ahead: the window's centre lies 0.42 of the range ahead, its half side is 0.66 of it, so
    /// that the road ahead is covered past the range along the grid and further across it.
    #[must_use]
    pub fn for_range(config: TerrainConfig, range_m: f32, points: usize) -> Self {
        let config = TerrainConfig { ahead_m: 0.42 * range_m, ..config };
        let half = 0.66 * range_m;
        let tiles = (2.0 * half / (config.cell_m * TILE_SIDE as f32)).ceil() as u16 + 1;
        Self::new(config, tiles.clamp(3, 255), points)
    }

    /// Bytes lent to the map.
    #[must_use]
    pub fn bytes(&self) -> usize {
        size_of_val(self.tiles.as_slice())
            + size_of_val(self.marks.as_slice())
            + size_of_val(self.samples.as_slice())
            + size_of_val(self.pairs.as_slice())
            + self.pixels.as_ref().map_or(0, |_| size_of::<RangePixels>())
    }

    /// An empty map in this memory.
    ///
    /// # Errors
    /// A configuration out of its range.
    pub fn open(&mut self) -> Result<Mapper<'_>, SetUpError> {
        self.open_with(Found::new())
    }

    /// The same, by the vector instructions of a unit.
    ///
    /// # Errors
    /// A configuration out of its range.
    pub fn open_with<V: Vectors>(&mut self, unit: V) -> Result<Mapper<'_, V>, SetUpError> {
        let map = TerrainMap::with_vectors(
            unit,
            self.config,
            self.side,
            Storage {
                tiles: &mut self.tiles,
                marks: &mut self.marks,
                samples: &mut self.samples,
                pairs: &mut self.pairs,
                pixels: self.pixels.as_deref_mut(),
            },
        )?;
        Ok(Mapper { map, behind: Some(Behind::in_memory()) })
    }
}

/// A map and the tiles that its window has left behind.
pub struct Mapper<'a, V = Found> {
    map: TerrainMap<'a, V>,
    /// None where they are forgotten.
    behind: Option<Behind>,
}

/// What is kept of the tiles left behind.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Kept {
    /// Their number.
    pub tiles: usize,
    /// Bytes of memory.
    pub memory: u64,
    /// Bytes on the disk.
    pub disk: u64,
}

impl<'a, V: Vectors> Mapper<'a, V> {
    /// Keeps the tiles that leave the window in a nameless file of this folder, not in memory as it is at first.
    ///
    /// # Errors
    /// A folder that takes no file.
    pub fn keep_in(&mut self, folder: &Path) -> io::Result<()> {
        self.behind = Some(Behind::in_folder(folder)?);
        Ok(())
    }

    /// Forgets the tiles that leave the window.
    pub fn forget_behind(&mut self) {
        self.behind = None;
    }

    /// What is kept of the tiles that the window left.
    #[must_use]
    pub fn kept(&self) -> Kept {
        let Some(behind) = &self.behind else { return Kept::default() };
        let (memory, disk) = behind.bytes();
        Kept { tiles: behind.len(), memory, disk }
    }

    /// The lowest and the highest tile of the rectangle around all that the window left.
    #[must_use]
    pub fn bounds_behind(&self) -> Option<[TileKey; 2]> {
        self.behind.as_ref()?.bounds()
    }

    /// Takes a frame in.
    ///
    /// # Errors
    /// Tiles that could not be kept on the disk.
    pub fn integrate(
        &mut self,
        points: &[[f32; 4]],
        pose: &SensorPose,
        dt_us: u32,
        boxes: &[MovingBox],
    ) -> io::Result<FrameReport> {
        if self.behind.is_some() {
            self.map.finish_leaving(&to_core(pose));
        }
        let behind = &mut self.behind;
        let mut kept = Ok(());
        let report = self.map.integrate(points, &to_core(pose), dt_us, boxes, |tile| {
            if let Some(behind) = behind
                && kept.is_ok()
            {
                kept = behind.put(tile);
            }
        });
        kept?;
        if let Some(behind) = behind
            && report.restarted
        {
            behind.clear()?;
        }
        Ok(report)
    }

    /// Brings risk and classes up to date everywhere in the window.
    pub fn refresh(&mut self) {
        self.map.refresh_all();
    }

    /// The core's map.
    #[must_use]
    pub fn map(&self) -> &TerrainMap<'a, V> {
        &self.map
    }

    /// The places of all tiles: those of the window, and those left behind. Some come twice.
    pub fn keys(&self) -> impl Iterator<Item = TileKey> + '_ {
        self.map.tiles().map(Tile::key).chain(self.behind.iter().flat_map(Behind::keys))
    }

    /// Gives the cells of a tile with column and row: the window's own, else what is kept of it.
    ///
    /// # Errors
    /// A tile that cannot be read back.
    pub fn cells(&self, key: TileKey, mut each: impl FnMut(usize, usize, Cell)) -> io::Result<()> {
        if let Some(tile) = self.map.tile(key) {
            for index in 0..TILE_SIDE * TILE_SIDE {
                let (column, row) = (index % TILE_SIDE, index / TILE_SIDE);
                each(column, row, tile.cell(column, row));
            }
        } else if let Some(behind) = &self.behind {
            behind.cells(key, each)?;
        }
        Ok(())
    }

    /// The window's cell at a world position.
    #[must_use]
    pub fn cell_at(&self, x: f64, y: f64) -> Option<Cell> {
        let (key, column, row) = self.place(x, y);
        Some(self.map.tile(key)?.cell(column, row))
    }

    /// The same, also where the window has gone on.
    ///
    /// # Errors
    /// A tile that cannot be read back.
    pub fn kept_cell_at(&self, x: f64, y: f64) -> io::Result<Option<Cell>> {
        let (key, column, row) = self.place(x, y);
        let mut found = None;
        self.cells(key, |at, up, cell| {
            if (at, up) == (column, row) {
                found = Some(cell);
            }
        })?;
        Ok(found)
    }

    /// Tile, column and row of a world position.
    fn place(&self, x: f64, y: f64) -> (TileKey, usize, usize) {
        let cell = self.cell_m();
        let (ix, iy) = ((x / cell).floor() as i64, (y / cell).floor() as i64);
        let side = TILE_SIDE as i64;
        let key = TileKey { x: ix.div_euclid(side) as i32, y: iy.div_euclid(side) as i32 };
        (key, ix.rem_euclid(side) as usize, iy.rem_euclid(side) as usize)
    }

    /// Side of a cell, m: the nearest to its micrometres that there is, which their product with 1e-6 is not.
    #[must_use]
    pub fn cell_m(&self) -> f64 {
        self.map.cell_um() as f64 / 1e6
    }

    /// World height of a cell's quarter-millimetre height, m.
    #[must_use]
    pub fn elevation_m(&self, height: i32) -> f64 {
        f64::from(height) * 0.000_25 + self.map.datum_um() as f64 * 1e-6
    }
}

/// A pose in the core's units. Positions that are not finite become ones that the core refuses.
#[must_use]
pub fn to_core(pose: &SensorPose) -> Pose {
    let micrometres = |metres: f64| if metres.is_finite() { (metres * 1e6).round() as i64 } else { i64::MAX };
    Pose {
        rotation: pose.rotation.map(|row| row.map(|value| value as f32)),
        position_um: pose.position.map(micrometres),
    }
}
