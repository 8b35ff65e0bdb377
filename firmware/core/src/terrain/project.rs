//! From a frame's points to samples of the map: which cell, how high, how certain.
//!
//! A point's height variance is (floor)^2 + (tilt x range)^2 + (range sigma x fall / range)^2: what alignment leaves
//! at the sensor, what it leaves of pitch and roll, and the range noise as it shows on ground seen at that incidence.

use super::align::Correction;
use super::config::TerrainConfig;
use super::geometry::{Pose, dot};
use super::marks::{Board, Lies, Tall};
use super::sight::{Direction, RangeImage, column_of};
use super::tile::{UNITS_PER_M, WEIGHT_ONE};
use super::window::Window;

/// One point, ready to enter the map.
#[derive(Clone, Copy, Debug, Default)]
pub struct Sample {
    /// Above the map's datum, quarter millimetres.
    pub(crate) z: i32,
    /// 256 times the slot, and the cell.
    place: i32,
    pub(crate) weight: u16,
    /// Azimuth and horizontal range, as in the range image.
    pub(crate) column: u16,
    pub(crate) range_cm: u16,
    /// Found not to be ground after all.
    pub(crate) left_out: bool,
}

impl Sample {
    /// Slot and cell.
    #[inline(always)]
    pub(crate) fn at(&self) -> (usize, u8) {
        ((self.place as u32 >> 8) as usize, self.place as u8)
    }
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
    /// On the ground right beside something that stands, or seen beneath it: left out of this frame.
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

    /// Cells from the sensor along x and y, and height above the datum, of one point.
    #[inline]
    pub(crate) fn apply(&self, p: [f32; 3], turn: f32) -> ([f32; 2], i32) {
        let offset = [dot(self.x, p), dot(self.y, p)];
        let up = dot(self.z, p) + self.rest + turn * (dot(self.z_rate, p) + self.lift_rate);
        (offset, self.whole.saturating_add(nearest(up)))
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
    #[inline(always)]
    fn weight(&self, range2: f32, fall: f32) -> f32 {
        let fall_m = fall * (1.0 / UNITS_PER_M);
        // The variance times range2, so that one division does.
        let variance = (self.floor + self.tilt * range2) * range2 + self.range * (fall_m * fall_m);
        WEIGHT_ONE * range2 / variance
    }
}

// Whole numbers by the bits of sums: a conversion that saturates, as `as` does, has no vector instruction.

/// To the nearest whole number, halves to even. |value| below 2^22; anything beyond that.
#[inline(always)]
pub(crate) fn nearest(value: f32) -> i32 {
    // 1.5 x 2^23: the last bit is worth one.
    const ONES: f32 = 12_582_912.0;
    (value + ONES).to_bits().wrapping_sub(ONES.to_bits()) as i32
}

/// The whole number below a value of 0 to 4096, or the one above where less than 1/4096 is missing; anything else gives
/// some number of 0 to 4095.
#[inline(always)]
pub(crate) fn below(value: f32) -> i32 {
    // Between 2^12 and 2^13 eleven bits of the mantissa are behind the point.
    ((value + 4096.0).to_bits() >> 11 & 4095) as i32
}

/// The smaller of two, the second where the first is not a number: the vector instruction.
#[inline(always)]
pub(crate) fn least(a: f32, b: f32) -> f32 {
    if a < b { a } else { b }
}

/// The larger of two, the second where the first is not a number.
#[inline(always)]
fn most(a: f32, b: f32) -> f32 {
    if a > b { a } else { b }
}

/// Points that are worked out together.
const BLOCK: usize = 32;
type Lane = [f32; BLOCK];
type Words = [i32; BLOCK];

/// What is worked out of a block of points by the same operations on each, which compilers turn into vectors: one lane a
/// quantity, in the order of the points.
struct Block {
    points: [Lane; 3],
    turn: Lane,
    range2: Lane,
    u: Lane,
    v: Lane,
    up: Lane,
    /// 256 times the slot, and the cell; -1 where the point is not to enter the map.
    place: Words,
    /// Quarter millimetres above the datum.
    height: Words,
    weight: Words,
    pixel: Words,
    range_cm: Words,
}

impl Block {
    const EMPTY: Self = Self {
        points: [[0.0; BLOCK]; 3],
        turn: [0.0; BLOCK],
        range2: [0.0; BLOCK],
        u: [0.0; BLOCK],
        v: [0.0; BLOCK],
        up: [0.0; BLOCK],
        place: [0; BLOCK],
        height: [0; BLOCK],
        weight: [0; BLOCK],
        pixel: [0; BLOCK],
        range_cm: [0; BLOCK],
    };

    /// Directions and ranges of the points: what the range image needs.
    fn look(&mut self, points: &[[f32; 4]; BLOCK]) {
        transpose(points, &mut self.points);
        polar(&self.points, &mut self.turn, &mut self.range2, &mut self.pixel, &mut self.range_cm);
    }

    /// Places, heights and weights.
    fn place(&mut self, projection: &Projection, weighting: &Weighting, limits: &Limits) {
        let Projection { x, y, z, z_rate, origin, .. } = projection;
        affine(&self.points, x, origin[0], &mut self.u);
        affine(&self.points, y, origin[1], &mut self.v);
        heights(&self.points, &self.turn, (z, projection.rest), (z_rate, projection.lift_rate), &mut self.up);
        weights(weighting, projection.whole, (&self.range2, &self.up), &mut self.weight, &mut self.height);
        cells(limits, [&self.range2, &self.turn, &self.u, &self.v], &mut self.place);
    }
}

/// What bounds the points that enter the map.
struct Limits {
    near2: f32,
    far2: f32,
    half_turn: f32,
    cells: f32,
    /// Tiles along the window's side, and where in the storage its lowest corner lies.
    side: i32,
    corner: [i32; 2],
}

// One loop each and never inlined: so they become vector instructions, and stay so.

#[inline(never)]
fn transpose(points: &[[f32; 4]; BLOCK], [xs, ys, zs]: &mut [Lane; 3]) {
    for lane in 0..BLOCK {
        [xs[lane], ys[lane], zs[lane], _] = points[lane];
    }
}

#[inline(never)]
fn polar(points: &[Lane; 3], turns: &mut Lane, range2: &mut Lane, pixels: &mut Words, range_cm: &mut Words) {
    let [xs, ys, zs] = points;
    for lane in 0..BLOCK {
        let (x, y, z) = (xs[lane], ys[lane], zs[lane]);
        let direction = Direction::of(x, y, z);
        turns[lane] = direction.turn;
        pixels[lane] = direction.pixel();
        range_cm[lane] = nearest(least(direction.range * 100.0, 65_535.0));
        range2[lane] = x * x + y * y + z * z;
    }
}

/// How many points are no numbers, out of range, and behind, each by its first reason.
#[inline(never)]
fn tally(limits: &Limits, range2: &Lane, turns: &Lane) -> [u32; 3] {
    let (mut numbers, mut in_range, mut ahead) = (0, 0, 0);
    for lane in 0..BLOCK {
        let (range2, turn) = (range2[lane], turns[lane]);
        // False for what is not a number.
        let within = (range2 >= limits.near2) & (range2 <= limits.far2);
        numbers += i32::from(range2 <= f32::MAX);
        in_range += i32::from(within);
        ahead += i32::from(within & (turn.abs() <= limits.half_turn));
    }
    [BLOCK as i32 - numbers, numbers - in_range, in_range - ahead].map(|count| count as u32)
}

#[inline(never)]
fn affine(points: &[Lane; 3], by: &[f32; 3], origin: f32, out: &mut Lane) {
    let [xs, ys, zs] = points;
    for lane in 0..BLOCK {
        out[lane] = by[0] * xs[lane] + by[1] * ys[lane] + by[2] * zs[lane] + origin;
    }
}

#[inline(never)]
fn heights(points: &[Lane; 3], turns: &Lane, still: (&[f32; 3], f32), rate: (&[f32; 3], f32), out: &mut Lane) {
    let [xs, ys, zs] = points;
    for lane in 0..BLOCK {
        let at = |by: (&[f32; 3], f32)| by.0[0] * xs[lane] + by.0[1] * ys[lane] + by.0[2] * zs[lane] + by.1;
        out[lane] = at(still) + turns[lane] * at(rate);
    }
}

#[inline(never)]
fn weights(weighting: &Weighting, whole: i32, (range2, ups): (&Lane, &Lane), out: &mut Words, heights: &mut Words) {
    for lane in 0..BLOCK {
        let weight = weighting.weight(range2[lane], ups[lane]);
        out[lane] = nearest(most(least(weight, 65_535.0), 1.0));
        heights[lane] = whole.wrapping_add(nearest(ups[lane]));
    }
}

#[inline(never)]
fn cells(limits: &Limits, [range2, turns, us, vs]: [&Lane; 4], places: &mut Words) {
    for lane in 0..BLOCK {
        let (range2, u, v) = (range2[lane], us[lane], vs[lane]);
        // Every comparison is false for what is not a number. No short circuits: they would be branches.
        let near = (range2 >= limits.near2) & (range2 <= limits.far2) & (turns[lane].abs() <= limits.half_turn);
        let inside = (u >= 0.0) & (v >= 0.0) & (u < limits.cells) & (v < limits.cells);
        let (column, row) = (below(u), below(v));
        let wrap = |tile: i32| tile - (limits.side & -i32::from(tile >= limits.side));
        let (x, y) = (wrap((column >> 4) + limits.corner[0]), wrap((row >> 4) + limits.corner[1]));
        // Both below 256: a product of 16 bits, which vector units have.
        let slot = i32::from((y as u16).wrapping_mul(limits.side as u16)) + x;
        places[lane] = (slot << 8 | (row & 15) << 4 | (column & 15)) | -i32::from(!(near & inside));
    }
}

/// What projection writes to.
pub(crate) struct Targets<'t, 'p> {
    pub(crate) samples: &'t mut [Sample],
    pub(crate) marks: &'t mut Board<'p>,
    pub(crate) image: &'t mut RangeImage<'p>,
    pub(crate) counts: &'t mut PointCounts,
}

/// Projects all points. Points of tiles whose ground is known are judged at once: what stands hits its mark, ground becomes samples from the front
/// of the storage on. Points of other tiles are counted in their marks and become samples from its back on. Returns how many there are of both.
pub(crate) fn project(
    points: &[[f32; 4]],
    projection: &Projection,
    config: &TerrainConfig,
    tall: Tall,
    window: &Window<'_>,
    targets: Targets<'_, '_>,
) -> [usize; 2] {
    let Targets { samples, marks, image, counts } = targets;
    let weighting = Weighting::new(config);
    let limits = Limits {
        near2: config.nearest_m * config.nearest_m,
        far2: config.farthest_m * config.farthest_m,
        half_turn: config.half_turn,
        cells: f32::from(window.side) * 16.0,
        side: i32::from(window.side),
        corner: window.corner.map(|tile| tile as i32),
    };
    let (mut front, mut back) = (0, samples.len());
    let mut block = Block::EMPTY;
    let (whole, rest) = points.as_chunks::<BLOCK>();
    // A block that is not full ends in what are no numbers.
    let mut last = [[f32::NAN; 4]; BLOCK];
    let missing = if rest.is_empty() { 0 } else { BLOCK - rest.len() };
    for (place, point) in last.iter_mut().zip(rest) {
        *place = *point;
    }
    counts.not_finite = 0u32.wrapping_sub(missing as u32);
    for points in whole.iter().chain((missing > 0).then_some(&last)) {
        block.look(points);
        image.see(&block.pixel, &block.range_cm);
        let [not_finite, out_of_range, behind] = tally(&limits, &block.range2, &block.turn);
        let left = BLOCK as u32 - not_finite - out_of_range - behind;
        counts.not_finite = counts.not_finite.wrapping_add(not_finite);
        counts.out_of_range += out_of_range;
        counts.behind += behind;
        if left == 0 {
            continue;
        }
        block.place(projection, &weighting, &limits);
        let mut inside = 0;
        for lane in 0..BLOCK {
            let (place, z) = (block.place[lane], block.height[lane]);
            if place < 0 {
                continue;
            }
            inside += 1;
            let Some(mark) = marks.touch((place >> 8) as usize, window) else { continue };
            let lies = mark.judge(place as u8, z, tall);
            if !matches!(lies, Lies::Ground | Lies::Unsettled) {
                counts.leave_out(lies);
                if lies == Lies::Standing {
                    image.stand(column_of(block.pixel[lane]), block.range_cm[lane] as u16);
                }
                continue;
            }
            if front >= back {
                counts.over_capacity += 1;
                continue;
            }
            let at = if lies == Lies::Ground {
                front += 1;
                front - 1
            } else {
                back -= 1;
                back
            };
            if let Some(sample) = samples.get_mut(at) {
                *sample = Sample {
                    z,
                    place,
                    weight: block.weight[lane] as u16,
                    column: column_of(block.pixel[lane]),
                    range_cm: block.range_cm[lane] as u16,
                    left_out: false,
                };
            }
        }
        counts.out_of_window += left - inside;
    }
    [front, samples.len() - back]
}

impl PointCounts {
    /// Counts a point that is not ground.
    pub(crate) fn leave_out(&mut self, lies: Lies) {
        match lies {
            Lies::Boxed => self.boxed += 1,
            Lies::Overhead => self.overhead += 1,
            Lies::Standing => self.standing += 1,
            Lies::Ground | Lies::Unsettled => {}
        }
    }
}
