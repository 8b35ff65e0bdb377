//! The core's map with its storage on the heap, and the record of what the window leaves behind.

use std::collections::BTreeMap;

use crossfall_core::terrain::{
    Cell, FrameReport, IMAGE_COLUMNS, IMAGE_ROWS, Marks, MovingBox, Pair, Pose, RangePixels, Sample, SetUpError,
    Storage, TILE_SIDE, TerrainConfig, TerrainMap, Tile, TileKey,
};

use super::lidar::SensorPose;

/// The memory that a map works in.
pub struct Workshop {
    tiles: Vec<Tile>,
    marks: Vec<Marks>,
    samples: Vec<Sample>,
    pairs: Vec<Pair>,
    pixels: Box<RangePixels>,
    side: u16,
    config: TerrainConfig,
}

impl Workshop {
    /// Memory for a window of `side` x `side` tiles and frames of up to `points` points.
    #[must_use]
    pub fn new(config: TerrainConfig, side: u16, points: usize) -> Self {
        let count = usize::from(side) * usize::from(side);
        let pixels = vec![0u16; IMAGE_COLUMNS * IMAGE_ROWS].into_boxed_slice();
        Self {
            tiles: vec![Tile::EMPTY; count],
            marks: vec![Marks::EMPTY; count],
            samples: vec![Sample::default(); points.max(1)],
            pairs: vec![Pair::default(); 10_000],
            pixels: pixels.try_into().unwrap_or_else(|_| Box::new([0; IMAGE_COLUMNS * IMAGE_ROWS])),
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
            + size_of_val(self.pixels.as_ref())
    }

    /// An empty map in this memory.
    ///
    /// # Errors
    /// A configuration out of its range.
    pub fn open(&mut self) -> Result<Mapper<'_>, SetUpError> {
        let map = TerrainMap::new(
            self.config,
            self.side,
            Storage {
                tiles: &mut self.tiles,
                marks: &mut self.marks,
                samples: &mut self.samples,
                pairs: &mut self.pairs,
                pixels: &mut self.pixels,
            },
        )?;
        Ok(Mapper { map, behind: BTreeMap::new(), keep: true })
    }
}

/// A map and the tiles that its window has left behind.
pub struct Mapper<'a> {
    map: TerrainMap<'a>,
    behind: BTreeMap<TileKey, Tile>,
    keep: bool,
}

impl<'a> Mapper<'a> {
    /// Whether tiles that leave the window are kept for the outputs. They are, unless told otherwise.
    pub fn keep_behind(&mut self, keep: bool) {
        self.keep = keep;
    }

    /// Takes a frame in.
    pub fn integrate(
        &mut self,
        points: &[[f32; 4]],
        pose: &SensorPose,
        dt_us: u32,
        boxes: &[MovingBox],
    ) -> FrameReport {
        let (behind, keep) = (&mut self.behind, self.keep);
        if keep {
            self.map.finish_leaving(&to_core(pose));
        }
        let report = self.map.integrate(points, &to_core(pose), dt_us, boxes, |tile| {
            if keep {
                behind.insert(tile.key(), tile.clone());
            }
        });
        if report.restarted {
            behind.clear();
        }
        report
    }

    /// Brings risk and classes up to date everywhere in the window.
    pub fn refresh(&mut self) {
        self.map.refresh_all();
    }

    /// The core's map.
    #[must_use]
    pub fn map(&self) -> &TerrainMap<'a> {
        &self.map
    }

    /// All tiles: those of the window, and those left behind that it does not cover now. Ordered by place.
    #[must_use]
    pub fn tiles(&self) -> BTreeMap<TileKey, &Tile> {
        let mut all: BTreeMap<TileKey, &Tile> = self.behind.iter().map(|(key, tile)| (*key, tile)).collect();
        all.extend(self.map.tiles().map(|tile| (tile.key(), tile)));
        all
    }

    /// The cell at a world position.
    #[must_use]
    pub fn cell_at(&self, x: f64, y: f64) -> Option<Cell> {
        let cell = self.map.cell_um() as f64 * 1e-6;
        let (ix, iy) = ((x / cell).floor() as i64, (y / cell).floor() as i64);
        let side = TILE_SIDE as i64;
        let key = TileKey { x: ix.div_euclid(side) as i32, y: iy.div_euclid(side) as i32 };
        let tile = self.map.tile(key).or_else(|| self.behind.get(&key))?;
        Some(tile.cell(ix.rem_euclid(side) as usize, iy.rem_euclid(side) as usize))
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
