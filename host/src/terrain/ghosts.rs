//! What moving bodies leave behind: cells of the carriageway that are still risky although they have been seen for a second.
//!
//! A cell counts as visible again once the sensor could see its ground, by line of sight past the bodies' outlines, in every one of
//! the last ten frames; by then it must not be risky, by the risk that the map holds, which is told anew every fourth frame and far off
//! every eighth. Cells are judged up to 60 m ahead, those beyond 40 m, where rings are metres apart, on their own; sensors with fewer rings or columns than the default one show what is left where hardly a ray ever passes a place twice.

use anyhow::{Result, anyhow, ensure};
use crossfall_core::terrain::{SLOW, TerrainConfig};

use super::drive::{Body, Shape, TerrainScene};
use super::lidar::Lidar;
use super::mapper::Workshop;
use crate::interrupt;

/// Cells that a body passed and that have been visible for a second.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Passed {
    /// How many, over all frames.
    pub visible: u32,
    /// Of these, risky.
    pub risky: u32,
}

/// What one scene left behind.
#[derive(Clone, Debug)]
pub struct Ghost {
    /// The scene.
    pub name: &'static str,
    /// From 5 to 40 m ahead.
    pub near: Passed,
    /// From 40 to 60 m.
    pub far: Passed,
}

/// Scenes of moving bodies, by name.
fn scenes(seed: u64) -> Vec<(&'static str, TerrainScene)> {
    let body = |shape, at_m, lateral_m, speed_mps, across_mps| Body { shape, at_m, lateral_m, speed_mps, across_mps };
    let with = |bodies| TerrainScene { seed, frames: 50, bodies, ..TerrainScene::default() };
    let lidar = |rings, columns| Lidar { rings, columns, ..Lidar::default() };
    let oncoming = || vec![body(Shape::Car, 70.0, 1.75, -10.0, 0.0)];
    let ahead = || vec![body(Shape::Car, 12.0, 0.0, 11.0, 0.0)];
    vec![
        ("moving: oncoming car", with(oncoming())),
        ("moving: car ahead", with(ahead())),
        ("moving: pedestrian crossing", with(vec![body(Shape::Pedestrian, 45.0, 3.0, 0.0, -1.3)])),
        (
            "moving: oncoming, 20 m/s",
            TerrainScene { speed_mps: 15.0, ..with(vec![body(Shape::Car, 120.0, 1.75, -20.0, 0.0)]) },
        ),
        ("moving: car cutting in", with(vec![body(Shape::Car, 12.0, 2.5, 12.0, -1.0)])),
        ("moving: pedestrian far", with(vec![body(Shape::Pedestrian, 65.0, 3.0, 0.0, -1.3)])),
        ("moving: oncoming, 32 rings", TerrainScene { lidar: lidar(32, 2000), ..with(oncoming()) }),
        ("moving: oncoming, 800 columns", TerrainScene { lidar: lidar(64, 800), ..with(oncoming()) }),
        ("moving: oncoming, 400 columns", TerrainScene { lidar: lidar(64, 400), ..with(oncoming()) }),
        ("moving: car ahead, 32 rings", TerrainScene { lidar: lidar(32, 1000), ..with(ahead()) }),
        ("moving: car ahead, 400 columns", TerrainScene { lidar: lidar(64, 400), ..with(ahead()) }),
    ]
}

/// Drives scenes with moving bodies and no boxes.
///
/// # Errors
/// A scene out of range, or the user's wish to stop.
pub fn ghosts(seed: u64, only: &str) -> Result<Vec<Ghost>> {
    scenes(seed).iter().filter(|(name, _)| name.contains(only)).map(|(name, scene)| drive(name, scene)).collect()
}

fn drive(name: &'static str, scene: &TerrainScene) -> Result<Ghost> {
    let mut workshop = Workshop::for_range(TerrainConfig::default(), 60.0, 300_000);
    let mut mapper = workshop.open().map_err(|what| anyhow!("the map cannot be set up: {what:?}"))?;
    let (rows, columns) = (56usize, 1400usize);
    // Per cell of the carriageway: frames seen in a row, and whether a body was ever there.
    let mut seen = vec![0u32; rows * columns];
    let mut passed = vec![false; rows * columns];
    let mut ghost = Ghost { name, near: Passed::default(), far: Passed::default() };
    let place = |row: usize, column: usize| (0.05 + 0.1 * column as f64, -2.75 + 0.1 * row as f64);
    for index in 0..scene.frames {
        ensure!(!interrupt::requested(), "interrupted");
        let frame = scene.frame(index)?;
        mapper.integrate(&frame.points, &frame.reported, 100_000, &[])?;
        let sensor = scene.station(frame.time_s);
        for row in 0..rows {
            for column in 0..columns {
                let (station, lateral) = place(row, column);
                let at = row * columns + column;
                let over = scene.bodies.iter().any(|body| covers(body, frame.time_s, station, lateral));
                let hidden = scene.bodies.iter().any(|body| hides(body, frame.time_s, sensor, station, lateral));
                passed[at] |= over;
                seen[at] = if hidden { 0 } else { seen[at] + 1 };
                let ahead = station - sensor;
                let count = if ahead < 40.0 { &mut ghost.near } else { &mut ghost.far };
                if passed[at] && ahead > 5.0 && ahead < 60.0 && seen[at] > 10 {
                    count.visible += 1;
                    let (x, y, _) = scene.road.place(station, lateral);
                    count.risky += u32::from(mapper.cell_at(x, y).is_some_and(|cell| cell.risk >= SLOW));
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
