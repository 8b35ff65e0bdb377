//! What moving bodies leave behind: cells of the carriageway that are still risky although they have been seen for a second.
//!
//! A cell counts as visible again once the sensor could see its ground, by line of sight past the bodies' outlines, in every one of
//! the last ten frames; by then it must not be risky. Cells beyond 40 m, where rings are metres apart, are left out.

use anyhow::{Result, anyhow, ensure};
use crossfall_core::terrain::{SLOW, TerrainConfig};

use super::drive::{Body, Shape, TerrainScene};
use super::mapper::Workshop;
use crate::interrupt;

/// What one scene left behind.
#[derive(Clone, Debug)]
pub struct Ghost {
    /// The scene.
    pub name: &'static str,
    /// Cells that a body passed and that have been visible for a second.
    pub visible: u32,
    /// Of these, risky.
    pub risky: u32,
}

/// Drives scenes with moving bodies and no boxes.
///
/// # Errors
/// A scene out of range, or the user's wish to stop.
pub fn ghosts(seed: u64) -> Result<Vec<Ghost>> {
    let body = |shape, at_m, lateral_m, speed_mps, across_mps| Body { shape, at_m, lateral_m, speed_mps, across_mps };
    let cases: [(&'static str, Vec<Body>); 3] = [
        ("moving: oncoming car", vec![body(Shape::Car, 70.0, 1.75, -10.0, 0.0)]),
        ("moving: car ahead", vec![body(Shape::Car, 12.0, 0.0, 11.0, 0.0)]),
        ("moving: pedestrian crossing", vec![body(Shape::Pedestrian, 45.0, 3.0, 0.0, -1.3)]),
    ];
    let mut out = Vec::new();
    for (name, bodies) in cases {
        let scene = TerrainScene { seed, frames: 50, bodies, ..TerrainScene::default() };
        out.push(drive(name, &scene)?);
    }
    Ok(out)
}

fn drive(name: &'static str, scene: &TerrainScene) -> Result<Ghost> {
    let mut workshop = Workshop::for_range(TerrainConfig::default(), 60.0, 300_000);
    let mut mapper = workshop.open().map_err(|what| anyhow!("the map cannot be set up: {what:?}"))?;
    let (rows, columns) = (56usize, 900usize);
    // Per cell of the carriageway: frames seen in a row, and whether a body was ever there.
    let mut seen = vec![0u32; rows * columns];
    let mut passed = vec![false; rows * columns];
    let mut ghost = Ghost { name, visible: 0, risky: 0 };
    let place = |row: usize, column: usize| (0.05 + 0.1 * column as f64, -2.75 + 0.1 * row as f64);
    for index in 0..scene.frames {
        ensure!(!interrupt::requested(), "interrupted");
        let frame = scene.frame(index)?;
        mapper.integrate(&frame.points, &frame.reported, 100_000, &[])?;
        mapper.refresh();
        let sensor = scene.station(frame.time_s);
        for row in 0..rows {
            for column in 0..columns {
                let (station, lateral) = place(row, column);
                let at = row * columns + column;
                let over = scene.bodies.iter().any(|body| covers(body, frame.time_s, station, lateral));
                let hidden = scene.bodies.iter().any(|body| hides(body, frame.time_s, sensor, station, lateral));
                passed[at] |= over;
                seen[at] = if hidden { 0 } else { seen[at] + 1 };
                let near = station > sensor + 5.0 && station < sensor + 40.0;
                if passed[at] && near && seen[at] > 10 {
                    ghost.visible += 1;
                    let (x, y, _) = scene.road.place(station, lateral);
                    ghost.risky += u32::from(mapper.cell_at(x, y).is_some_and(|cell| cell.risk >= SLOW));
                }
            }
        }
    }
    Ok(ghost)
}

fn half_size(shape: Shape) -> (f64, f64) {
    match shape {
        Shape::Car => (2.2, 0.9),
        Shape::Pedestrian => (0.25, 0.25),
        Shape::House => (5.0, 2.0),
        Shape::Post => (0.08, 0.08),
    }
}

fn covers(body: &Body, time_s: f64, station: f64, lateral: f64) -> bool {
    let (length, width) = half_size(body.shape);
    (station - body.at_m - body.speed_mps * time_s).abs() < length
        && (lateral - body.lateral_m - body.across_mps * time_s).abs() < width
}

/// Whether the line from the sensor (on the road's axis) to a cell passes a body's outline, grown by 0.3 m.
fn hides(body: &Body, time_s: f64, sensor: f64, station: f64, lateral: f64) -> bool {
    let (length, width) = half_size(body.shape);
    let (length, width) = (length + 0.3, width + 0.3);
    let (u, v) = (body.at_m + body.speed_mps * time_s, body.lateral_m + body.across_mps * time_s);
    (0..=100).any(|step| {
        let part = f64::from(step) / 100.0;
        let (s, l) = (sensor + part * (station - sensor), part * lateral);
        (s - u).abs() < length && (l - v).abs() < width
    })
}
