//! Pictures of the risk map, as the second seed's figure 2: shade is degree.
//!
//! Known ground is light grey, risk goes through yellow and orange to dark red, what stands is dark blue, unknown is white; the vehicle
//! is drawn as an outline of 4.4 x 1.8 m. One cell is a square of whole pixels, north is up.

use std::path::Path;

use anyhow::{Context, Result};
use crossfall_core::terrain::Class;

use super::lidar::SensorPose;
use super::raster::Raster;
use crate::output::Output;

/// The part of the world to show: centre and half sides, m.
#[derive(Clone, Copy, Debug)]
pub struct View {
    /// Centre, m.
    pub centre: [f64; 2],
    /// Half width and half height, m.
    pub half: [f64; 2],
    /// Pixels a cell.
    pub zoom: usize,
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

/// Draws the risk map as a PNG.
///
/// # Errors
/// A file that cannot be written.
pub fn draw(raster: &Raster, view: View, vehicle: Option<&SensorPose>, path: &Path) -> Result<()> {
    let zoom = view.zoom.clamp(1, 16);
    let cells = |half: f64| ((2.0 * half / raster.cell_m).ceil() as usize).clamp(1, 8000 / zoom);
    let (columns, rows) = (cells(view.half[0]), cells(view.half[1]));
    let (width, height) = (columns * zoom, rows * zoom);
    let mut pixels = vec![UNKNOWN; width * height];
    let corner = [view.centre[0] - view.half[0], view.centre[1] - view.half[1]];
    let index = |world: f64, axis: usize| ((world - raster.corner[axis]) / raster.cell_m).floor();
    for row in 0..rows {
        for column in 0..columns {
            let x = index(corner[0] + (column as f64 + 0.5) * raster.cell_m, 0);
            let y = index(corner[1] + (row as f64 + 0.5) * raster.cell_m, 1);
            let cell = (x >= 0.0 && y >= 0.0).then(|| raster.get(x as usize, y as usize)).flatten();
            let colour = match cell {
                None => UNKNOWN,
                Some(cell) if cell.cell.class == Class::Tall => STANDING,
                Some(cell) => shade(cell.cell.risk),
            };
            for dy in 0..zoom {
                let start = ((rows - 1 - row) * zoom + dy) * width + column * zoom;
                pixels[start..start + zoom].fill(colour);
            }
        }
    }
    if let Some(pose) = vehicle {
        let scale = zoom as f64 / raster.cell_m;
        let mut dot = |along: f64, left: f64| {
            let x = pose.position[0] + pose.rotation[0][0] * along + pose.rotation[0][1] * left;
            let y = pose.position[1] + pose.rotation[1][0] * along + pose.rotation[1][1] * left;
            let (px, py) = ((x - corner[0]) * scale, height as f64 - (y - corner[1]) * scale);
            if px >= 0.0 && py >= 0.0 && (px as usize) < width && (py as usize) < height {
                pixels[py as usize * width + px as usize] = VEHICLE;
            }
        };
        for step in 0..=440 {
            let part = f64::from(step) / 440.0;
            for side in [-0.9, 0.9] {
                dot(-2.2 + 4.4 * part, side);
            }
            for end in [-2.2, 2.2] {
                dot(end, -0.9 + 1.8 * part);
            }
        }
    }
    let mut out = Output::create(path)?;
    {
        let writing = || format!("writing {}", path.display());
        let mut encoder = png::Encoder::new(&mut out, width as u32, height as u32);
        encoder.set_color(png::ColorType::Rgb);
        encoder.set_depth(png::BitDepth::Eight);
        let mut writer = encoder.write_header().with_context(writing)?;
        writer.write_image_data(pixels.as_flattened()).with_context(writing)?;
        writer.finish().with_context(writing)?;
    }
    out.commit()?;
    Ok(())
}
