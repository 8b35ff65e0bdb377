//! Pictures of the risk map, as the second seed's figure 2: shade is degree.
//!
//! Known ground is light grey, risk goes through yellow and orange to dark red, what stands is dark blue, unknown is white; the vehicle
//! is drawn as an outline of 4.4 x 1.8 m. One cell is a square of whole pixels, north is up. Of a map that is larger than a picture one pixel is a square of
//! whole cells, and shows the worst of them.

use std::collections::BTreeSet;
use std::io::Write;
use std::path::Path;

use anyhow::{Context, Result};
use crossfall_core::terrain::Class;

use super::lidar::SensorPose;
use super::raster::{Block, Grid};
use crate::output::Output;

/// Most pixels along a side of the picture of a whole map.
const LONGEST: usize = 4000;

/// The part of the world to show.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct View {
    /// Column and row of the south-western cell, counted from the world's zero.
    pub corner: [i64; 2],
    /// Cells towards east and north.
    pub cells: [usize; 2],
    /// Pixels along a cell's side: 1 where a pixel is more than a cell.
    pub zoom: usize,
    /// Cells along a pixel's side.
    pub step: usize,
}

impl View {
    /// A square around a place, m.
    #[must_use]
    pub fn around(centre: [f64; 2], half_m: f64, cell_m: f64, zoom: usize) -> Self {
        let corner = centre.map(|centre| ((centre - half_m) / cell_m).round() as i64);
        let cells = ((2.0 * half_m / cell_m).ceil() as usize).clamp(1, 8000 / zoom);
        Self { corner, cells: [cells; 2], zoom, step: 1 }
    }

    /// The whole of a map, at most 4,000 pixels a side.
    #[must_use]
    pub fn whole(grid: &Grid) -> Self {
        let cells = [grid.width(), grid.height()];
        let longest = cells[0].max(cells[1]).max(1);
        Self { corner: grid.corner(), cells, zoom: (LONGEST / longest).clamp(1, 3), step: longest.div_ceil(LONGEST) }
    }
}

const UNKNOWN: [u8; 3] = [255, 255, 255];
const STANDING: [u8; 3] = [38, 50, 96];
const VEHICLE: [u8; 3] = [0, 110, 200];

/// Colour of a risk of 0 to 255: light grey, yellow, orange, dark red.
#[must_use]
pub fn shade(risk: u8) -> [u8; 3] {
    const STOPS: [(f32, [f32; 3]); 5] = [
        (0.0, [226.0, 228.0, 230.0]),
        (64.0, [236.0, 226.0, 170.0]),
        (128.0, [250.0, 190.0, 60.0]),
        (192.0, [226.0, 90.0, 30.0]),
        (255.0, [140.0, 12.0, 20.0]),
    ];
    let risk = f32::from(risk);
    for pair in STOPS.windows(2) {
        if risk <= pair[1].0 {
            let part = (risk - pair[0].0) / (pair[1].0 - pair[0].0);
            let mut colour = [0; 3];
            for (out, (a, b)) in colour.iter_mut().zip(pair[0].1.iter().zip(pair[1].1)) {
                *out = (a + part * (b - a)).round() as u8;
            }
            return colour;
        }
    }
    [140, 12, 20]
}

/// A picture under way.
pub struct Picture {
    view: View,
    cell_m: f64,
    /// Squares of cells towards east and north.
    squares: [usize; 2],
    /// The worst of each square, row by row from the south: 0 unknown, risk + 1, `TALL`.
    worst: Vec<u16>,
}

/// Something that stands is worse than any risk.
const TALL: u16 = 300;

impl Picture {
    /// Nothing but unknown ground.
    #[must_use]
    pub fn new(view: View, cell_m: f64) -> Self {
        let squares = view.cells.map(|cells| cells.div_ceil(view.step));
        Self { view, cell_m, squares, worst: vec![0; squares[0] * squares[1]] }
    }

    /// Draws what a block holds of the view.
    pub fn draw(&mut self, block: &Block) {
        for (place, cell) in block.iter() {
            let [Some(column), Some(row)] = [0, 1].map(|axis| {
                let from = usize::try_from(place[axis] - self.view.corner[axis]).ok()?;
                (from < self.view.cells[axis]).then_some(from / self.view.step)
            }) else {
                continue;
            };
            let rank = if cell.cell.class == Class::Tall { TALL } else { u16::from(cell.cell.risk) + 1 };
            if let Some(held) = self.worst.get_mut(row * self.squares[0] + column) {
                *held = rank.max(*held);
            }
        }
    }

    /// Writes the picture as PNG, with the vehicle's outline.
    ///
    /// # Errors
    /// A file that cannot be written.
    pub fn write(&self, vehicle: &SensorPose, path: &Path) -> Result<()> {
        let View { zoom, .. } = self.view;
        let [width, height] = self.squares.map(|squares| squares * zoom);
        let outline = self.outline(vehicle);
        let mut out = Output::create(path)?;
        {
            let writing = || format!("writing {}", path.display());
            let mut encoder = png::Encoder::new(&mut out, width as u32, height as u32);
            encoder.set_color(png::ColorType::Rgb);
            encoder.set_depth(png::BitDepth::Eight);
            let mut writer = encoder.write_header().with_context(writing)?;
            let mut stream = writer.stream_writer().with_context(writing)?;
            let mut row = vec![UNKNOWN; width];
            for y in 0..height {
                let from = (self.squares[1] - 1 - y / zoom) * self.squares[0];
                for (pixels, worst) in row.chunks_mut(zoom).zip(self.worst.iter().skip(from)) {
                    pixels.fill(match *worst {
                        0 => UNKNOWN,
                        TALL => STANDING,
                        risk => shade((risk - 1).min(255) as u8),
                    });
                }
                for (_, x) in outline.range((y, 0)..(y + 1, 0)) {
                    if let Some(pixel) = row.get_mut(*x) {
                        *pixel = VEHICLE;
                    }
                }
                stream.write_all(row.as_flattened()).with_context(writing)?;
            }
            stream.finish().with_context(writing)?;
            writer.finish().with_context(writing)?;
        }
        out.commit()?;
        Ok(())
    }

    /// Row and column of the pixels of a vehicle's outline.
    fn outline(&self, pose: &SensorPose) -> BTreeSet<(usize, usize)> {
        let View { corner, zoom, step, .. } = self.view;
        let scale = zoom as f64 / (step as f64 * self.cell_m);
        let height = (self.squares[1] * zoom) as f64;
        let place = |along: f64, left: f64| {
            let of = |axis: usize| {
                let world = pose.position[axis] + pose.rotation[axis][0] * along + pose.rotation[axis][1] * left;
                (world - corner[axis] as f64 * self.cell_m) * scale
            };
            let (x, y) = (of(0), height - of(1));
            (x >= 0.0 && y >= 0.0).then_some((y as usize, x as usize))
        };
        (0..=440)
            .flat_map(|step| {
                let part = f64::from(step) / 440.0;
                let sides = [-0.9, 0.9].map(|side| place(-2.2 + 4.4 * part, side));
                sides.into_iter().chain([-2.2, 2.2].map(|end| place(end, -0.9 + 1.8 * part)))
            })
            .flatten()
            .collect()
    }
}
