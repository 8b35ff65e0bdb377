//! The map as rasters: one rectangle of cells around all that is known, north up, for GeoTIFF, tables and pictures.

use std::collections::BTreeMap;
use std::io::Write;
use std::path::Path;

use anyhow::{Context, Result};
use crossfall_core::terrain::{Cell, Class, TILE_SIDE, Tile, TileKey};
use tiff::encoder::{Compression, TiffEncoder, colortype};
use tiff::tags::Tag;

use super::mapper::Mapper;
use super::picture::View;
use crate::output::Output;

/// What stands for "unknown" in the rasters of floats.
pub const NO_DATA: f32 = -9999.0;

/// One cell with what the map says of it.
#[derive(Clone, Copy, Debug)]
pub struct RasterCell {
    /// Elevation in the world, m: measured, or (with `filled`) between the neighbours that reach the cell.
    pub elevation_m: f64,
    /// Its standard deviation, m.
    pub sigma_m: f64,
    /// Whether the cell was measured itself.
    pub measured: bool,
    /// The map's cell.
    pub cell: Cell,
}

/// A rectangle of cells.
pub struct Raster {
    /// Side of a cell, m.
    pub cell_m: f64,
    /// World position of the lowest corner, m.
    pub corner: [f64; 2],
    /// Cells towards x.
    pub width: usize,
    /// Cells towards y.
    pub height: usize,
    /// Easting and northing of the world's zero, and the EPSG code of the coordinates: what the files say, where it is known.
    pub georeference: Option<([f64; 2], u16)>,
    cells: Vec<Option<RasterCell>>,
}

impl Raster {
    /// All that a map knows; none if it knows nothing.
    #[must_use]
    pub fn of(mapper: &Mapper<'_>) -> Option<Self> {
        Self::of_tiles(mapper, &mapper.tiles())
    }

    /// What the map's window knows.
    #[must_use]
    pub fn of_window(mapper: &Mapper<'_>) -> Option<Self> {
        Self::of_tiles(mapper, &mapper.map().tiles().map(|tile| (tile.key(), tile)).collect())
    }

    fn of_tiles(mapper: &Mapper<'_>, tiles: &BTreeMap<TileKey, &Tile>) -> Option<Self> {
        let (mut low, mut high) = ([i32::MAX; 2], [i32::MIN; 2]);
        for key in tiles.keys() {
            low = [low[0].min(key.x), low[1].min(key.y)];
            high = [high[0].max(key.x), high[1].max(key.y)];
        }
        if tiles.is_empty() {
            return None;
        }
        let side = TILE_SIDE;
        let span = |axis: usize| (high[axis] - low[axis] + 1) as usize * side;
        let cell_m = mapper.map().cell_um() as f64 * 1e-6;
        let corner = [f64::from(low[0]), f64::from(low[1])].map(|tile| tile * side as f64 * cell_m);
        let mut raster = Self { cell_m, corner, width: span(0), height: span(1), georeference: None, cells: vec![None; span(0) * span(1)] };
        for (key, tile) in tiles {
            for row in 0..side {
                for column in 0..side {
                    let cell = tile.cell(column, row);
                    let x = (key.x - low[0]) as usize * side + column;
                    let y = (key.y - low[1]) as usize * side + row;
                    raster.cells[y * raster.width + x] = read(mapper, &cell);
                }
            }
        }
        raster.fill();
        Some(raster)
    }

    /// A cell by column (towards x) and row (towards y).
    #[must_use]
    pub fn get(&self, column: usize, row: usize) -> Option<&RasterCell> {
        if column >= self.width {
            return None;
        }
        self.cells.get(row * self.width + column)?.as_ref()
    }

    /// World position of a cell's centre, m.
    #[must_use]
    pub fn centre(&self, column: usize, row: usize) -> [f64; 2] {
        let along = |index: usize, corner: f64| corner + (index as f64 + 0.5) * self.cell_m;
        [along(column, self.corner[0]), along(row, self.corner[1])]
    }

    /// Where the world's zero lies in the files' coordinates.
    fn zero(&self) -> [f64; 2] {
        self.georeference.map_or([0.0; 2], |(zero, _)| zero)
    }

    /// The whole raster as a picture of at most 4,000 pixels a side.
    #[must_use]
    pub fn view(&self) -> View {
        let half = [self.width, self.height].map(|cells| 0.5 * cells as f64 * self.cell_m);
        let zoom = (4000 / self.width.max(self.height).max(1)).clamp(1, 3);
        View { centre: [self.corner[0] + half[0], self.corner[1] + half[1]], half, zoom }
    }

    /// Gives risky cells between measured ones an elevation: the middle of their measured neighbours within three cells, and half of
    /// their spread as its sigma. Other cells without a measurement are dropped.
    fn fill(&mut self) {
        let measured = |cells: &[Option<RasterCell>], index: usize| {
            cells.get(index).copied().flatten().filter(|cell| cell.measured).map(|cell| cell.elevation_m)
        };
        let mut changes = Vec::new();
        for row in 0..self.height {
            for column in 0..self.width {
                let index = row * self.width + column;
                let Some(cell) = self.cells[index].filter(|cell| !cell.measured) else { continue };
                let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
                for y in row.saturating_sub(3)..(row + 4).min(self.height) {
                    for x in column.saturating_sub(3)..(column + 4).min(self.width) {
                        if let Some(level) = measured(&self.cells, y * self.width + x) {
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
        }
        for (index, cell) in changes {
            self.cells[index] = cell;
        }
    }

    /// All known cells with column and row, row by row.
    pub fn iter(&self) -> impl Iterator<Item = (usize, usize, &RasterCell)> {
        let width = self.width.max(1);
        self.cells
            .iter()
            .enumerate()
            .filter_map(move |(index, cell)| Some((index % width, index / width, cell.as_ref()?)))
    }

    /// Writes `x_m,y_m,elevation_m,sigma_m,risk,class`, one row a known cell.
    ///
    /// # Errors
    /// A file that cannot be written.
    pub fn write_csv(&self, path: &Path) -> Result<()> {
        let mut out = Output::create(path)?;
        let writing = || format!("writing {}", path.display());
        writeln!(out, "x_m,y_m,elevation_m,sigma_m,risk,class").with_context(writing)?;
        // Centres of cells of 0.1 m need two decimals, of other sizes at most four.
        let digits = if (self.cell_m * 20.0).fract().abs() < 1e-9 { 2 } else { 4 };
        let zero = self.zero();
        for (column, row, cell) in self.iter() {
            let [x, y] = self.centre(column, row);
            let (x, y) = (x + zero[0], y + zero[1]);
            let risk = f64::from(cell.cell.risk) / 255.0;
            let class = cell.cell.class.name();
            writeln!(out, "{x:.digits$},{y:.digits$},{:.4},{:.4},{risk:.3},{class}", cell.elevation_m, cell.sigma_m)
                .with_context(writing)?;
        }
        out.commit()?;
        Ok(())
    }

    /// Writes a raster of floats as GeoTIFF, north up, deflated, unknown cells as [`NO_DATA`].
    ///
    /// # Errors
    /// A file that cannot be written.
    pub fn write_floats(&self, path: &Path, value: impl Fn(&RasterCell) -> f32) -> Result<()> {
        let data = self.north_up(NO_DATA, value);
        self.write_tiff::<colortype::Gray32Float>(path, &data, "-9999")
    }

    /// Writes a raster of small numbers as GeoTIFF; unknown cells are 255.
    ///
    /// # Errors
    /// A file that cannot be written.
    pub fn write_bytes(&self, path: &Path, value: impl Fn(&RasterCell) -> u8) -> Result<()> {
        let data = self.north_up(255, value);
        self.write_tiff::<colortype::Gray8>(path, &data, "255")
    }

    fn north_up<T: Copy>(&self, unknown: T, value: impl Fn(&RasterCell) -> T) -> Vec<T> {
        let mut data = vec![unknown; self.width * self.height];
        for (column, row, cell) in self.iter() {
            data[(self.height - 1 - row) * self.width + column] = value(cell);
        }
        data
    }

    fn write_tiff<C: colortype::ColorType>(&self, path: &Path, data: &[C::Inner], no_data: &str) -> Result<()>
    where
        [C::Inner]: tiff::encoder::TiffValue,
    {
        let writing = || format!("writing {}", path.display());
        let mut out = Output::create(path)?;
        {
            let mut encoder = TiffEncoder::new(&mut out)
                .with_context(writing)?
                .with_compression(Compression::Deflate(Default::default()));
            let mut image = encoder.new_image::<C>(self.width as u32, self.height as u32).with_context(writing)?;
            let zero = self.zero();
            let (left, top) = (zero[0] + self.corner[0], zero[1] + self.corner[1] + self.height as f64 * self.cell_m);
            // GeoTIFF 1.1: scale, one tie point (raster 0,0 to the upper left corner), and the key directory: a projected
            // model, pixels are areas, the system's EPSG code or a user-defined one (32767), metres.
            let tags = image.encoder();
            tags.write_tag(Tag::ModelPixelScaleTag, &[self.cell_m, self.cell_m, 0.0][..]).with_context(writing)?;
            tags.write_tag(Tag::ModelTiepointTag, &[0.0, 0.0, 0.0, left, top, 0.0][..])
                .with_context(writing)?;
            let system = self.georeference.map_or(32_767, |(_, epsg)| epsg);
            let keys: [u16; 20] = [1, 1, 1, 4, 1024, 0, 1, 1, 1025, 0, 1, 1, 3072, 0, 1, system, 3076, 0, 1, 9001];
            tags.write_tag(Tag::GeoKeyDirectoryTag, &keys[..]).with_context(writing)?;
            tags.write_tag(Tag::GdalNodata, no_data).with_context(writing)?;
            image.write_data(data).with_context(writing)?;
        }
        out.commit()?;
        Ok(())
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
        _ if cell.risk > 0 || cell.class != Class::Free => {
            Some(RasterCell { elevation_m: f64::NAN, sigma_m: f64::NAN, measured: false, cell: *cell })
        }
        _ => None,
    }
}
