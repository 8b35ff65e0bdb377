//! The second seed's evaluation, on simulated scenes with known truth.
//!
//! Definitions. The **frame** is 8 m of the left curb, 0.5 m wide, centred on the curb's face, cut into columns 0.2 m long. **Occupancy**: the share of columns that
//! hold a cell of risk >= 0.5 (for the conventional method: an obstacle point). **Impassable**: no 2 m (10 columns) free in a row.
//! The distance is from the sensor to the frame's centre along the road. A method's reach is the largest distance
//! at which it holds there and at every nearer one down to 8 m, in steps of 1 m. Every map judged is at least 2 s old. **False risk**: share of the
//! known cells of the carriageway, 0.7 m off its curbs and 1 m off its features, of risk >= 0.5.

use anyhow::{Result, anyhow, ensure};
use crossfall_core::terrain::{SLOW, TerrainConfig};

use super::conventional::Conventional;
use super::drive::{SimulatedFrame, TerrainScene};
use super::mapper::{Mapper, Workshop};
use crate::interrupt;
use crate::statistics::upper_median;

/// Distances judged, m.
pub const DISTANCES: std::ops::RangeInclusive<u32> = 8..=75;
const COLUMNS: usize = 40;
const COLUMN_M: f64 = 0.2;
const FRAME_WIDTH_M: f64 = 0.5;

/// What one method says of the curb at every distance.
#[derive(Clone, Debug, Default)]
pub struct CurbCurve {
    /// Mean occupancy by distance, from 8 m on.
    pub occupancy: Vec<f64>,
    /// Longest run of free columns by distance, m: the median of the maps judged.
    pub gap_m: Vec<f64>,
    gaps: Vec<Vec<f64>>,
}

impl CurbCurve {
    fn add(&mut self, columns: impl Fn(f64) -> [bool; COLUMNS]) {
        let first = self.gaps.is_empty();
        for (index, distance) in DISTANCES.enumerate() {
            let columns = columns(f64::from(distance));
            let share = columns.iter().filter(|hit| **hit).count() as f64 / COLUMNS as f64;
            let (mut run, mut longest) = (0usize, 0);
            for hit in columns {
                run = if hit { 0 } else { run + 1 };
                longest = longest.max(run);
            }
            let gap = longest as f64 * COLUMN_M;
            if first {
                self.occupancy.push(share);
                self.gaps.push(vec![gap]);
            } else {
                self.occupancy[index] += share;
                self.gaps[index].push(gap);
            }
        }
    }

    fn finish(&mut self, maps: usize) {
        for share in &mut self.occupancy {
            *share /= maps.max(1) as f64;
        }
        for gaps in &mut self.gaps {
            self.gap_m.push(upper_median(gaps).unwrap_or(f64::INFINITY));
        }
    }

    /// Largest distance with a mean occupancy above 0.54 there and nearer, m; 0 when not even at 8 m.
    #[must_use]
    pub fn occupied_to(&self) -> u32 {
        reach(self.occupancy.iter().map(|share| *share > 0.54))
    }

    /// Largest distance at which no 2 m are free in the median map, there and nearer, m.
    #[must_use]
    pub fn impassable_to(&self) -> u32 {
        reach(self.gap_m.iter().map(|gap| *gap < 2.0 - 1e-9))
    }
}

fn reach(holds: impl Iterator<Item = bool>) -> u32 {
    DISTANCES.zip(holds).take_while(|(_, holds)| *holds).last().map_or(0, |(distance, _)| distance)
}

/// What was found of one bump.
#[derive(Clone, Copy, Debug)]
pub struct BumpSeen {
    /// Height, m.
    pub height_m: f64,
    /// Distance from the sensor, m.
    pub distance_m: f64,
    /// Share of its length across the road with a risky cell.
    pub share: f64,
    /// Share of its risky cells that are told to be a bump.
    pub told: f64,
}

/// Result of a scene.
#[derive(Clone, Debug, Default)]
pub struct Judged {
    /// The map's curve.
    pub map: CurbCurve,
    /// The conventional method's.
    pub conventional: CurbCurve,
    /// Risky cells of plain road, and all known.
    pub false_cells: (u64, u64),
    /// Bumps in the last map.
    pub bumps: Vec<BumpSeen>,
    /// Root mean square of elevation less truth on the carriageway up to 60 m ahead, m.
    pub elevation_rms_m: f64,
    /// Share of the left curb's risky cells, 8 to 50 m ahead, that are told to be a curb.
    pub curb_told: f64,
    /// Median time of a frame, ms.
    pub frame_ms: f64,
}

/// Drives a scene and judges the maps of its last `judged` frames.
///
/// # Errors
/// A scene out of range, or the user's wish to stop.
pub fn judge(scene: &TerrainScene, judged: u32, conventional: Option<Conventional>) -> Result<Judged> {
    scene.check()?;
    let config = TerrainConfig { farthest_m: 110.0, ..TerrainConfig::default() };
    let mut workshop = Workshop::for_range(config, 75.0, 300_000);
    let mut mapper = workshop.open().map_err(|what| anyhow!("the map cannot be set up: {what:?}"))?;
    mapper.forget_behind();
    let mut out = Judged::default();
    let step_us = (1e6 / scene.lidar.rate_hz) as u32;
    let mut times = Vec::new();
    for index in 0..scene.frames {
        ensure!(!interrupt::requested(), "interrupted");
        let frame = scene.frame(index)?;
        let started = std::time::Instant::now();
        mapper.integrate(&frame.points, &frame.reported, step_us, &[])?;
        times.push(started.elapsed().as_secs_f64() * 1e3);
        if index + judged < scene.frames {
            continue;
        }
        mapper.refresh();
        let station = scene.station(frame.time_s);
        out.map.add(|distance| map_columns(scene, &mapper, station + distance));
        if let Some(method) = &conventional {
            let obstacles = to_road(scene, &frame, &method.obstacles(&frame.points, u64::from(index)));
            out.conventional.add(|distance| point_columns(scene, &obstacles, station + distance));
        }
        count_false(scene, &mapper, station, &mut out);
    }
    out.map.finish(judged as usize);
    out.conventional.finish(judged as usize);
    let station = scene.station(f64::from(scene.frames.saturating_sub(1)) / scene.lidar.rate_hz);
    out.bumps = bumps(scene, &mapper, station);
    out.elevation_rms_m = elevation_rms(scene, &mapper, station);
    out.curb_told = curb_told(scene, &mapper, station);
    out.frame_ms = upper_median(&mut times).unwrap_or(0.0);
    Ok(out)
}

/// A road place in the map's world.
fn world(scene: &TerrainScene, station: f64, lateral: f64) -> (f64, f64) {
    let (x, y, _) = scene.road.place(station, lateral);
    (x + scene.origin_m[0], y + scene.origin_m[1])
}

fn map_columns(scene: &TerrainScene, mapper: &Mapper<'_>, centre: f64) -> [bool; COLUMNS] {
    let mut columns = [false; COLUMNS];
    for (index, hit) in columns.iter_mut().enumerate() {
        let start = centre - 4.0 + COLUMN_M * index as f64;
        // Sampled at 5 cm: every cell of which the column holds a quarter or so.
        for along in 0..4 {
            for across in 0..10 {
                let station = start + 0.025 + 0.05 * f64::from(along);
                let lateral = scene.road.left_curb_m - FRAME_WIDTH_M / 2.0 + 0.025 + 0.05 * f64::from(across);
                let (x, y) = world(scene, station, lateral);
                *hit |= mapper.cell_at(x, y).is_some_and(|cell| cell.risk >= SLOW);
            }
        }
    }
    columns
}

/// Points in road coordinates by the true pose: the conventional method owes nothing to the noise of poses.
fn to_road(scene: &TerrainScene, frame: &SimulatedFrame, points: &[[f64; 3]]) -> Vec<(f64, f64)> {
    points
        .iter()
        .map(|point| {
            let turned = frame.truth.turn(*point);
            let x = turned[0] + frame.truth.position[0] - scene.origin_m[0];
            let y = turned[1] + frame.truth.position[1] - scene.origin_m[1];
            scene.road.locate(x, y)
        })
        .collect()
}

fn point_columns(scene: &TerrainScene, points: &[(f64, f64)], centre: f64) -> [bool; COLUMNS] {
    let mut columns = [false; COLUMNS];
    for (station, lateral) in points {
        let index = ((station - centre + 4.0) / COLUMN_M).floor();
        if (lateral - scene.road.left_curb_m).abs() <= FRAME_WIDTH_M / 2.0 && index >= 0.0 && index < COLUMNS as f64 {
            columns[index as usize] = true;
        }
    }
    columns
}

fn plain(scene: &TerrainScene, station: f64, lateral: f64) -> bool {
    scene.road.outside(lateral) < -0.7
        && scene.road.bumps.iter().all(|bump| (station - bump.at_m).abs() > bump.length_m / 2.0 + 1.0)
        && scene
            .road
            .potholes
            .iter()
            .all(|hole| (station - hole.at_m).hypot(lateral - hole.lateral_m) > hole.radius_m + 1.0)
}

fn carriageway(scene: &TerrainScene, from: f64, to: f64) -> impl Iterator<Item = (f64, f64)> {
    let (right, left) = (scene.road.right_curb_m, scene.road.left_curb_m);
    let rows = ((left - right) / 0.1) as i32;
    let columns = ((to - from) / 0.1) as i32;
    (0..columns).flat_map(move |i| {
        (0..rows).map(move |k| (from + 0.1 * f64::from(i) + 0.05, right + 0.1 * f64::from(k) + 0.05))
    })
}

fn count_false(scene: &TerrainScene, mapper: &Mapper<'_>, station: f64, out: &mut Judged) {
    for (s, lateral) in carriageway(scene, station, station + 75.0).filter(|(s, l)| plain(scene, *s, *l)) {
        let (x, y) = world(scene, s, lateral);
        if let Some(cell) = mapper.cell_at(x, y).filter(|cell| cell.height.is_some() || cell.risk > 0) {
            out.false_cells.1 += 1;
            out.false_cells.0 += u64::from(cell.risk >= SLOW);
        }
    }
}

fn bumps(scene: &TerrainScene, mapper: &Mapper<'_>, station: f64) -> Vec<BumpSeen> {
    let across = ((scene.road.left_curb_m - scene.road.right_curb_m - 1.2) / 0.1) as i32;
    let seen = |bump: &super::scene::Bump| {
        let (mut hits, mut risky, mut told) = (0, 0, 0);
        for k in 0..across {
            let lateral = scene.road.right_curb_m + 0.65 + 0.1 * f64::from(k);
            let mut hit = false;
            for i in 0..(bump.length_m / 0.05) as i32 {
                let (x, y) = world(scene, bump.at_m - bump.length_m / 2.0 + 0.05 * f64::from(i), lateral);
                if let Some(cell) = mapper.cell_at(x, y).filter(|cell| cell.risk >= SLOW) {
                    hit = true;
                    risky += 1;
                    told += i32::from(cell.class == crossfall_core::terrain::Class::Bump);
                }
            }
            hits += i32::from(hit);
        }
        BumpSeen {
            height_m: bump.height_m,
            distance_m: bump.at_m - station,
            share: f64::from(hits) / f64::from(across.max(1)),
            told: f64::from(told) / f64::from(risky.max(1)),
        }
    };
    scene.road.bumps.iter().map(seen).collect()
}

fn elevation_rms(scene: &TerrainScene, mapper: &Mapper<'_>, station: f64) -> f64 {
    let (mut sum, mut count) = (0.0, 0u32);
    for (s, lateral) in carriageway(scene, station, station + 60.0).filter(|(s, l)| plain(scene, *s, *l)) {
        let (x, y) = world(scene, s, lateral);
        if let Some(height) = mapper.cell_at(x, y).and_then(|cell| cell.height) {
            let truth = scene.road.height(x - scene.origin_m[0], y - scene.origin_m[1]) + scene.origin_m[2];
            let off = mapper.elevation_m(height) - truth;
            sum += off * off;
            count += 1;
        }
    }
    (sum / f64::from(count.max(1))).sqrt()
}

fn curb_told(scene: &TerrainScene, mapper: &Mapper<'_>, station: f64) -> f64 {
    let (mut risky, mut told) = (0u32, 0u32);
    for i in 0..420 {
        for k in -2..=2 {
            let (x, y) = world(scene, station + 8.0 + 0.1 * f64::from(i), scene.road.left_curb_m + 0.1 * f64::from(k));
            if let Some(cell) = mapper.cell_at(x, y).filter(|cell| cell.risk >= SLOW) {
                risky += 1;
                told += u32::from(cell.class == crossfall_core::terrain::Class::Curb);
            }
        }
    }
    f64::from(told) / f64::from(risky.max(1))
}
