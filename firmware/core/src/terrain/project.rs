//! From a frame's points to samples of the map: which cell, how high, how certain.
//!
//! A point's height variance is (floor)^2 + (tilt x range)^2 + (range sigma x fall / range)^2: what alignment leaves
//! at the sensor, what it leaves of pitch and roll, and the range noise as it shows on ground seen at that incidence.

use super::align::{Correction, turn};
use super::config::TerrainConfig;
use super::geometry::{Pose, dot};
use super::marks::Marks;
use super::sight::RangeImage;
use super::tile::{UNITS_PER_M, WEIGHT_ONE};
use super::window::Window;

/// One point, ready to enter the map.
#[derive(Clone, Copy, Debug, Default)]
pub struct Sample {
    /// Above the map's datum, quarter millimetres.
    pub(crate) z: i32,
    pub(crate) slot: u16,
    pub(crate) weight: u16,
    pub(crate) cell: u8,
    pub(crate) stands: bool,
}

/// Where a frame's points go: rotation, scaling and origin folded into one affine map.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Projection {
    /// Sensor axes to cells along x and y, relative to the window's lowest corner.
    x: [f32; 3],
    y: [f32; 3],
    /// Sensor axes to height in quarter millimetres.
    z: [f32; 3],
    /// Change of the two over a turn of the sensor.
    z_rate: [f32; 3],
    lift_rate: f32,
    pub(crate) origin: [f32; 2],
    /// Sensor height above the datum: whole units and the rest.
    whole: i32,
    rest: f32,
}

/// Counts of what became of a frame's points.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct PointCounts {
    /// Points given.
    pub given: u32,
    /// Points with a coordinate that is not a number or not finite.
    pub not_finite: u32,
    /// Nearer or further than the configuration allows.
    pub out_of_range: u32,
    /// Behind the sensor, further round than the configuration uses.
    pub behind: u32,
    /// Outside the window.
    pub out_of_window: u32,
    /// Beyond the sample storage.
    pub over_capacity: u32,
    /// Inside the box of a moving object.
    pub boxed: u32,
    /// Higher above ground than any vehicle.
    pub overhead: u32,
    /// On something that stands.
    pub standing: u32,
    /// On the ground right beside something that stands: left out of this frame.
    pub beside_standing: u32,
    /// Fused into the map.
    pub fused: u32,
}

impl Projection {
    pub(crate) fn new(pose: &Pose, cell_um: i64, window: &Window<'_>, datum_um: i64) -> Self {
        let scale = 1e6 / cell_um.max(1) as f32;
        let row = |row: [f32; 3], by: f32| [row[0] * by, row[1] * by, row[2] * by];
        let tile_um = cell_um.wrapping_mul(16);
        let into = |position: i64, tile: i32| {
            position.wrapping_sub(tile_um.wrapping_mul(i64::from(tile))) as f32 / cell_um.max(1) as f32
        };
        let up = pose.position_um[2].wrapping_sub(datum_um);
        let whole = up.div_euclid(250).clamp(-1_000_000_000, 1_000_000_000);
        Self {
            x: row(pose.rotation[0], scale),
            y: row(pose.rotation[1], scale),
            z: row(pose.rotation[2], UNITS_PER_M),
            z_rate: [0.0; 3],
            lift_rate: 0.0,
            origin: [into(pose.position_um[0], window.origin.x), into(pose.position_um[1], window.origin.y)],
            whole: whole as i32,
            rest: up.rem_euclid(250) as f32 / 250.0,
        }
    }

    /// Height of the sensor above the datum, quarter millimetres.
    pub(crate) fn sensor_height(&self) -> i32 {
        self.whole
    }

    /// Raises and tilts what follows.
    pub(crate) fn correct(&mut self, by: &Correction) {
        self.rest += by.lift;
        self.lift_rate = by.lift_rate;
        for axis in 0..3 {
            self.z[axis] += by.tilt[0] * self.x[axis] + by.tilt[1] * self.y[axis];
            self.z_rate[axis] = by.tilt_rate[0] * self.x[axis] + by.tilt_rate[1] * self.y[axis];
        }
    }

    /// Cells from the sensor along x and y, and height above the datum.
    #[inline]
    pub(crate) fn apply(&self, p: [f32; 3], turn: f32) -> ([f32; 2], i32) {
        let offset = [dot(self.x, p), dot(self.y, p)];
        let up = dot(self.z, p) + self.rest + turn * (dot(self.z_rate, p) + self.lift_rate);
        let rounded = if up >= 0.0 { up + 0.5 } else { up - 0.5 };
        (offset, self.whole.saturating_add(rounded as i32))
    }

    /// A direction of the world (cells along x and y, units of height) in sensor axes, in metres.
    pub(crate) fn to_sensor(self, offset: [f32; 2], up: f32, pose: &Pose, cell_m: f32) -> [f32; 3] {
        let world = [offset[0] * cell_m, offset[1] * cell_m, up / UNITS_PER_M];
        let mut out = [0.0; 3];
        for (axis, value) in out.iter_mut().enumerate() {
            let column = pose.rotation.map(|row| row.get(axis).copied().unwrap_or(0.0));
            *value = dot(column, world);
        }
        out
    }
}

/// Variance to weight, with everything that does not change within a frame worked out.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Weighting {
    floor: f32,
    tilt: f32,
    range: f32,
}

impl Weighting {
    pub(crate) fn new(config: &TerrainConfig) -> Self {
        let square = |value: f32| value * value;
        Self {
            floor: square(config.floor_sigma_mm),
            tilt: square(config.tilt_sigma_mm_per_m),
            range: square(config.range_sigma_mm),
        }
    }

    /// `range2` in m^2, `fall` in quarter millimetres.
    #[inline]
    pub(crate) fn weight(&self, range2: f32, fall: f32) -> u16 {
        let fall_m = fall * (1.0 / UNITS_PER_M);
        let variance = self.floor + self.tilt * range2 + self.range * (fall_m * fall_m) / range2;
        ((WEIGHT_ONE / variance) as u16).max(1)
    }
}

/// Projects all points. Fills the samples, the marks of every touched tile and the range image; returns how many
/// samples there are.
#[allow(clippy::too_many_arguments)]
pub(crate) fn project(
    points: &[[f32; 4]],
    projection: &Projection,
    config: &TerrainConfig,
    window: &Window<'_>,
    samples: &mut [Sample],
    marks: &mut [Marks],
    image: &mut RangeImage<'_>,
    counts: &mut PointCounts,
) -> usize {
    let weighting = Weighting::new(config);
    let (near2, far2) = (config.nearest_m * config.nearest_m, config.farthest_m * config.farthest_m);
    let cells = f32::from(window.side) * 16.0;
    let mut used = 0;
    let side = u32::from(window.side);
    let (corner_x, corner_y) = (window.corner_slot(window.origin.x), window.corner_slot(window.origin.y));
    for &[x, y, z, _] in points {
        let p = [x, y, z];
        let range2 = dot(p, p);
        if !range2.is_finite() {
            counts.not_finite += 1;
            continue;
        }
        image.see(p);
        if range2 < near2 || range2 > far2 {
            counts.out_of_range += 1;
            continue;
        }
        let turn = turn(p);
        if turn.abs() > config.half_turn {
            counts.behind += 1;
            continue;
        }
        let (offset, height) = projection.apply(p, turn);
        let (u, v) = (offset[0] + projection.origin[0], offset[1] + projection.origin[1]);
        if !(u >= 0.0 && v >= 0.0 && u < cells && v < cells) {
            counts.out_of_window += 1;
            continue;
        }
        let (ix, iy) = (u as u32, v as u32);
        let (mut sx, mut sy) = ((ix >> 4) + corner_x, (iy >> 4) + corner_y);
        if sx >= side {
            sx -= side;
        }
        if sy >= side {
            sy -= side;
        }
        let slot = sy.wrapping_mul(side).wrapping_add(sx);
        let Some(sample) = samples.get_mut(used) else {
            counts.over_capacity += 1;
            continue;
        };
        let fall = height.wrapping_sub(projection.whole) as f32;
        *sample = Sample {
            z: height,
            slot: slot as u16,
            weight: weighting.weight(range2, fall),
            cell: ((iy & 15) << 4 | (ix & 15)) as u8,
            stands: false,
        };
        used += 1;
        if let Some(mark) = marks.get_mut(slot as usize) {
            mark.touch(height);
        }
    }
    used
}
