//! The files of a map: four GeoTIFFs, the table of its cells and its picture, written side by side in one passage over its blocks.

use std::io::Write;
use std::path::Path;

use anyhow::{Context, Result};
use crossfall_core::terrain::Decision;

use super::geotiff::{GeoTiff, Layout, Pixel};
use super::lidar::SensorPose;
use super::mapper::Mapper;
use super::picture::{Picture, View};
use super::raster::{Block, Grid, RasterCell, SIDE};
use crate::output::Output;

/// What stands for "unknown" in the rasters of floats.
pub const NO_DATA: f32 = -9999.0;

/// What is written beside the rasters, and where they lie.
#[derive(Clone, Copy, Debug)]
pub struct Choices {
    /// Easting and northing of the world's zero, and the EPSG code of the coordinates: what the files say, where it is known.
    pub georeference: Option<([f64; 2], u16)>,
    /// Also `cells.csv`.
    pub table: bool,
    /// What the picture shows.
    pub view: View,
    /// The vehicle in it.
    pub vehicle: SensorPose,
}

/// Cells that were written.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Cells {
    /// All.
    pub known: u64,
    /// Over which to slow down.
    pub slow: u64,
    /// Before which to stop.
    pub stop: u64,
}

/// Writes `elevation.tif`, `sigma.tif`, `risk.tif`, `class.tif`, `risk.png` and, if wanted, `cells.csv`. `before` is called before each block with the number
/// of those that are written, and ends the work with an error.
///
/// # Errors
/// A file that cannot be written, or a tile that cannot be read back.
pub fn write(
    mapper: &Mapper<'_>,
    grid: &Grid,
    folder: &Path,
    choices: &Choices,
    mut before: impl FnMut(u64) -> Result<()>,
) -> Result<Cells> {
    let zero = choices.georeference.map_or([0.0; 2], |(zero, _)| zero);
    let mut rasters = Rasters::create(grid, folder, choices, zero)?;
    let mut table = if choices.table { Some(Table::create(&folder.join("cells.csv"), grid, zero)?) } else { None };
    let mut picture = Picture::new(choices.view, grid.cell_m);
    let mut cells = Cells::default();
    for (written, block) in grid.blocks(mapper).enumerate() {
        before(written as u64)?;
        let block = block.context("reading back what was mapped")?;
        for (_, cell) in block.iter() {
            cells.known += 1;
            match Decision::of(cell.cell.risk) {
                Decision::Free => {}
                Decision::Slow => cells.slow += 1,
                Decision::Stop => cells.stop += 1,
            }
        }
        rasters.put(&block)?;
        if let Some(table) = &mut table {
            table.put(&block)?;
        }
        picture.draw(&block);
    }
    rasters.finish()?;
    if let Some(table) = table {
        table.out.commit()?;
    }
    picture.write(&choices.vehicle, &folder.join("risk.png"))?;
    Ok(cells)
}

/// What a raster says of a cell.
type Value = fn(&RasterCell) -> f32;

struct Rasters {
    floats: [(GeoTiff, Value); 3],
    classes: GeoTiff,
    pixels: Vec<u8>,
}

impl Rasters {
    fn create(grid: &Grid, folder: &Path, choices: &Choices, zero: [f64; 2]) -> Result<Self> {
        let [west, north] = grid.north_west();
        let layout = |pixel, no_data| Layout {
            // Positions lie within 4,000 km: 28 bits.
            width: grid.width() as u32,
            height: grid.height() as u32,
            tile: SIDE as u32,
            pixel,
            no_data,
            north_west: [zero[0] + west, zero[1] + north],
            pixel_m: grid.cell_m,
            epsg: choices.georeference.map_or(32_767, |(_, epsg)| epsg),
        };
        let most = grid.known_blocks() as u64;
        let floats = |name: &str| {
            let layout = layout(Pixel::Float, (NO_DATA.to_le_bytes().to_vec(), "-9999"));
            GeoTiff::create(&folder.join(name), layout, most)
        };
        Ok(Self {
            floats: [
                (floats("elevation.tif")?, |cell| cell.elevation_m as f32),
                (floats("sigma.tif")?, |cell| cell.sigma_m as f32),
                (floats("risk.tif")?, |cell| f32::from(cell.cell.risk) / 255.0),
            ],
            classes: GeoTiff::create(&folder.join("class.tif"), layout(Pixel::Byte, (vec![255], "255")), most)?,
            pixels: Vec::new(),
        })
    }

    fn put(&mut self, block: &Block) -> Result<()> {
        for (file, value) in &mut self.floats {
            self.pixels.clear();
            let values = block.north_up().map(|cell| cell.map_or(NO_DATA, *value));
            self.pixels.extend(values.flat_map(f32::to_le_bytes));
            file.put(block.at, &self.pixels)?;
        }
        self.pixels.clear();
        self.pixels.extend(block.north_up().map(|cell| cell.map_or(255, |cell| cell.cell.class as u8)));
        Ok(self.classes.put(block.at, &self.pixels)?)
    }

    fn finish(self) -> Result<()> {
        for (file, _) in self.floats {
            file.finish()?;
        }
        Ok(self.classes.finish()?)
    }
}

/// `x_m,y_m,elevation_m,sigma_m,risk,class`: one row a known cell, block by block.
struct Table {
    out: Output,
    zero: [f64; 2],
    cell_m: f64,
    digits: usize,
}

impl Table {
    fn create(path: &Path, grid: &Grid, zero: [f64; 2]) -> Result<Self> {
        let mut out = Output::create(path)?;
        writeln!(out, "x_m,y_m,elevation_m,sigma_m,risk,class")
            .with_context(|| format!("writing {}", path.display()))?;
        // Centres of cells of 0.1 m need two decimals, of other sizes at most four.
        let digits = if (grid.cell_m * 20.0).fract().abs() < 1e-9 { 2 } else { 4 };
        Ok(Self { out, zero, cell_m: grid.cell_m, digits })
    }

    fn put(&mut self, block: &Block) -> Result<()> {
        let digits = self.digits;
        for (place, cell) in block.iter() {
            let [x, y] = [0, 1].map(|axis| self.zero[axis] + (place[axis] as f64 + 0.5) * self.cell_m);
            let risk = f64::from(cell.cell.risk) / 255.0;
            let class = cell.cell.class.name();
            writeln!(
                self.out,
                "{x:.digits$},{y:.digits$},{:.4},{:.4},{risk:.3},{class}",
                cell.elevation_m, cell.sigma_m
            )
            .with_context(|| format!("writing {}", self.out.path().display()))?;
        }
        Ok(())
    }
}
