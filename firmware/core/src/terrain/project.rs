//! From a frame's points to samples of the map: which cell, how high, how certain.
//!
//! A point's height variance is (floor)^2 + (tilt x range)^2 + (range sigma x fall / range)^2: what alignment leaves
//! at the sensor, what it leaves of pitch and roll, and the range noise as it shows on ground seen at that incidence.

use super::align::Correction;
use super::config::TerrainConfig;
use super::geometry::{Pose, dot};
use super::marks::{Board, Lies};
use super::sight::{Bearing, Direction, RangeImage, pixel};
use super::tile::{HEAVIEST, UNITS_PER_M, WEIGHT_ONE};
use super::vectors::Vectors;
use super::window::Window;

/// One point, ready to enter the map.
#[derive(Clone, Copy, Debug, Default)]
pub struct Sample {
    /// Above the map's datum, quarter millimetres.
    pub(crate) z: i32,
    /// 256 times the slot, and the cell; -1 for a point that does not enter the map.
    place: i32,
    /// Weight, and above its 16 bits the azimuth's column of the range image.
    weight_column: u32,
    /// Horizontal range, as in the range image.
    range_cm: u32,
}

impl Sample {
    /// Slot and cell; a slot beyond any there is (255 x 255) where the point does not enter the map.
    #[inline(always)]
    pub(crate) fn at(&self) -> (usize, u8) {
        ((self.place as u32 >> 8) as usize, self.place as u8)
    }

    #[inline(always)]
    pub(crate) fn weight(&self) -> u32 {
        self.weight_column & 0xffff
    }

    /// Azimuth and horizontal range, as in the range image.
    #[inline(always)]
    pub(crate) fn seen_at(&self) -> (u16, u16) {
        ((self.weight_column >> 16) as u16, self.range_cm as u16)
    }

    /// It is not ground.
    pub(crate) fn leave_out(&mut self) {
        self.place = -1;
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

/// Points that are worked out together: about a column of a sensor with 64 rings.
const BLOCK: usize = 64;
type Lane = [f32; BLOCK];
type Words = [i32; BLOCK];

/// What is worked out of a block of points by the same operations on each, which compilers turn into vectors: one lane a
/// quantity, in the order of the points.
struct Block {
    points: [Lane; 3],
    turn: Lane,
    /// Horizontal, m.
    range: Lane,
    range2: Lane,
    u: Lane,
    v: Lane,
    /// All ones where the point is no number, out of range or behind.
    shut: Words,
    /// 256 times the slot, and the cell; -1 where the point is not to enter the map.
    place: Words,
    /// Quarter millimetres above the datum.
    height: Words,
    /// As in a sample.
    weight_column: Words,
    /// Column of the range image in the upper half, all ones above and below it; row as a real number; pixel, -1 above and below; horizontal range.
    column: Words,
    row: Lane,
    pixel: Words,
    range_cm: Words,
}

impl Block {
    const EMPTY: Self = Self {
        points: [[0.0; BLOCK]; 3],
        turn: [0.0; BLOCK],
        range: [0.0; BLOCK],
        range2: [0.0; BLOCK],
        u: [0.0; BLOCK],
        v: [0.0; BLOCK],
        shut: [0; BLOCK],
        place: [0; BLOCK],
        height: [0; BLOCK],
        weight_column: [0; BLOCK],
        column: [0; BLOCK],
        row: [0.0; BLOCK],
        pixel: [0; BLOCK],
        range_cm: [0; BLOCK],
    };

    /// What a lane says of its point.
    #[inline(always)]
    fn sample(&self, lane: usize) -> Sample {
        let lane = lane & (BLOCK - 1);
        Sample {
            z: self.height[lane],
            place: self.place[lane],
            weight_column: self.weight_column[lane] as u32,
            range_cm: self.range_cm[lane] as u32,
        }
    }

    /// Places, heights and weights; how many points lie in the window.
    fn place(&mut self, projection: &Projection, weighting: &Weighting, limits: &Limits, unit: impl Vectors) -> u32 {
        let Projection { x, y, z, z_rate, origin, .. } = projection;
        unit.run(|| affine(&self.points, x, origin[0], &mut self.u));
        unit.run(|| affine(&self.points, y, origin[1], &mut self.v));
        let rates = [(z, projection.rest), (z_rate, projection.lift_rate)];
        let out = (&mut self.height, &mut self.weight_column);
        let seen = [&self.turn, &self.range2];
        unit.run(|| rise(&self.points, seen, &self.column, (rates, projection.whole), weighting, out));
        unit.run(|| cells(limits, &self.shut, [&self.u, &self.v], &mut self.place))
    }
}

/// What bounds the points that enter the map.
struct Limits {
    near2: f32,
    far2: f32,
    half_turn: f32,
    /// What lies behind, and to the side by less than this times as much, lies further round than half the turn.
    rear: f32,
    cells: f32,
    /// Tiles along the window's side, and where in the storage its lowest corner lies.
    side: i32,
    corner: [i32; 2],
}

// One loop each, run as a function of its own.

#[inline(always)]
fn transpose(points: &[[f32; 4]; BLOCK], [xs, ys, zs]: &mut [Lane; 3]) {
    for lane in 0..BLOCK {
        [xs[lane], ys[lane], zs[lane], _] = points[lane];
    }
}

#[inline(always)]
fn polar(points: &[Lane; 3], turns: &mut Lane, ranges: &mut Lane, range2: &mut Lane) {
    let [xs, ys, zs] = points;
    for lane in 0..BLOCK {
        let (x, y, z) = (xs[lane], ys[lane], zs[lane]);
        let bearing = Bearing::of(x, y);
        turns[lane] = bearing.turn;
        ranges[lane] = bearing.range;
        range2[lane] = x * x + y * y + z * z;
    }
}

/// Half a turn is 1/2 less a quarter of |y| / (|x| + |y|) behind the sensor: |y| / |x| there at `half_turn`, a hundredth less for what roundings may do. At
/// most a hundred.
fn rear_slope(half_turn: f32) -> f32 {
    let side = 2.0 - 4.0 * half_turn;
    if side < 0.99 { 0.99 * side / (1.0 - side) } else { 98.0 }
}

/// Of a block that lies behind as a whole, without a word on where: the same as `tally`. None of other blocks.
#[inline(always)]
fn rear(limits: &Limits, points: &[[f32; 4]; BLOCK], lanes: &[Lane; 3], unit: impl Vectors) -> Option<[u32; 3]> {
    // Most blocks show at a few of their points that they are others.
    let shows = |lane: usize| points[lane][0] < 0.0;
    if !(shows(0) && shows(BLOCK / 2) && shows(BLOCK - 1)) {
        return None;
    }
    let [others, not_finite, out_of_range] = unit.run(|| tally_rear(limits, lanes));
    (others == 0).then_some([not_finite, out_of_range, BLOCK as u32 - not_finite - out_of_range])
}

/// How many points do not surely lie behind, are no numbers, and are out of range.
#[inline(always)]
fn tally_rear(limits: &Limits, [xs, ys, zs]: &[Lane; 3]) -> [u32; 3] {
    let (mut rear, mut numbers, mut in_range) = (0, 0, 0);
    for lane in 0..BLOCK {
        let (x, y, z) = (xs[lane], ys[lane], zs[lane]);
        let range2 = x * x + y * y + z * z;
        rear += i32::from(y.abs() < -limits.rear * x);
        numbers += i32::from(range2 <= f32::MAX);
        in_range += i32::from((range2 >= limits.near2) & (range2 <= limits.far2));
    }
    [BLOCK as i32 - rear, BLOCK as i32 - numbers, numbers - in_range].map(|count| count as u32)
}

/// How many points are no numbers, out of range, and behind, each by its first reason.
#[inline(always)]
fn tally(limits: &Limits, range2: &Lane, turns: &Lane, shut: &mut Words) -> [u32; 3] {
    let (mut numbers, mut in_range, mut ahead) = (0, 0, 0);
    for lane in 0..BLOCK {
        let (range2, turn) = (range2[lane], turns[lane]);
        // False for what is not a number. No short circuits: they would be branches.
        let within = (range2 >= limits.near2) & (range2 <= limits.far2);
        let open = -i32::from(within & (turn.abs() <= limits.half_turn));
        numbers -= -i32::from(range2 <= f32::MAX);
        in_range -= -i32::from(within);
        ahead -= open;
        shut[lane] = !open;
    }
    [BLOCK as i32 - numbers, numbers - in_range, in_range - ahead].map(|count| count as u32)
}

/// Where the points lie as seen from the sensor.
#[inline(always)]
fn look([zs, turns, ranges]: [&Lane; 3], columns: &mut Words, rows: &mut Lane, range_cm: &mut Words) {
    for lane in 0..BLOCK {
        let direction = Direction::at(Bearing { turn: turns[lane], range: ranges[lane] }, zs[lane]);
        columns[lane] = (direction.column() | -i32::from(!direction.is_inside())) << 16;
        rows[lane] = direction.row;
        range_cm[lane] = nearest(least(direction.range * 100.0, 65_535.0));
    }
}

/// The pixels of the range image that they fall on.
#[inline(always)]
fn pick(columns: &Words, rows: &Lane, pixels: &mut Words) {
    for lane in 0..BLOCK {
        let column = columns[lane] >> 16;
        pixels[lane] = pixel(column, rows[lane]) | (column >> 15);
    }
}

#[inline(always)]
fn affine(points: &[Lane; 3], by: &[f32; 3], origin: f32, out: &mut Lane) {
    let [xs, ys, zs] = points;
    for lane in 0..BLOCK {
        out[lane] = by[0] * xs[lane] + by[1] * ys[lane] + by[2] * zs[lane] + origin;
    }
}

#[inline(always)]
fn rise(
    points: &[Lane; 3],
    [turns, range2]: [&Lane; 2],
    columns: &Words,
    ([still, rate], whole): ([(&[f32; 3], f32); 2], i32),
    weighting: &Weighting,
    (heights, weight_columns): (&mut Words, &mut Words),
) {
    let [xs, ys, zs] = points;
    for lane in 0..BLOCK {
        let at = |by: (&[f32; 3], f32)| by.0[0] * xs[lane] + by.0[1] * ys[lane] + by.0[2] * zs[lane] + by.1;
        let up = at(still) + turns[lane] * at(rate);
        let weight = weighting.weight(range2[lane], up);
        weight_columns[lane] = nearest(most(least(weight, HEAVIEST), 1.0)) | columns[lane];
        heights[lane] = whole.wrapping_add(nearest(up));
    }
}

#[inline(always)]
fn cells(limits: &Limits, shut: &Words, [us, vs]: [&Lane; 2], places: &mut Words) -> u32 {
    let mut outside = 0;
    for lane in 0..BLOCK {
        let (u, v) = (us[lane], vs[lane]);
        // Every comparison is false for what is not a number.
        let inside = (u >= 0.0) & (v >= 0.0) & (u < limits.cells) & (v < limits.cells);
        let (column, row) = (below(u), below(v));
        let wrap = |tile: i32| tile - (limits.side & -i32::from(tile >= limits.side));
        let (x, y) = (wrap((column >> 4) + limits.corner[0]), wrap((row >> 4) + limits.corner[1]));
        // Both below 256: a product of 16 bits, which vector units have.
        let slot = i32::from((y as u16).wrapping_mul(limits.side as u16)) + x;
        let out = shut[lane] | -i32::from(!inside);
        outside -= out;
        places[lane] = (slot << 8 | (row & 15) << 4 | (column & 15)) | out;
    }
    (BLOCK as i32 - outside) as u32
}

/// What projection writes to.
pub(crate) struct Targets<'t, 'p> {
    pub(crate) samples: &'t mut [Sample],
    pub(crate) marks: &'t mut Board<'p>,
    pub(crate) image: &'t mut RangeImage<'p>,
    /// Something stood before this frame, so that the image will be looked at.
    pub(crate) see: bool,
    pub(crate) counts: &'t mut PointCounts,
}

/// Projects all points. Points of tiles whose ground is known are judged at once: what stands hits its mark, ground becomes samples from the front
/// of the storage on. Points of other tiles are counted in their marks and become samples from its back on. Returns how many there are of both.
pub(crate) fn project(
    points: &[[f32; 4]],
    projection: &Projection,
    config: &TerrainConfig,
    window: &Window<'_>,
    targets: Targets<'_, '_>,
    unit: impl Vectors,
) -> [usize; 2] {
    let Targets { samples, marks, image, see, counts } = targets;
    let weighting = Weighting::new(config);
    let limits = Limits {
        near2: config.nearest_m * config.nearest_m,
        far2: config.farthest_m * config.farthest_m,
        half_turn: config.half_turn,
        rear: rear_slope(config.half_turn),
        cells: f32::from(window.side) * 16.0,
        side: i32::from(window.side),
        corner: window.corner.map(|tile| tile as i32),
    };
    let storage = samples.len();
    let mut free = samples.iter_mut();
    let mut back = 0;
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
        unit.run(|| transpose(points, &mut block.points));
        if !see && let Some([not_finite, out_of_range, behind]) = rear(&limits, points, &block.points, unit) {
            counts.not_finite = counts.not_finite.wrapping_add(not_finite);
            counts.out_of_range += out_of_range;
            counts.behind += behind;
            continue;
        }
        unit.run(|| polar(&block.points, &mut block.turn, &mut block.range, &mut block.range2));
        let [not_finite, out_of_range, behind] =
            unit.run(|| tally(&limits, &block.range2, &block.turn, &mut block.shut));
        let left = BLOCK as u32 - not_finite - out_of_range - behind;
        counts.not_finite = counts.not_finite.wrapping_add(not_finite);
        counts.out_of_range += out_of_range;
        counts.behind += behind;
        if left == 0 && !see {
            continue;
        }
        let lanes = [&block.points[2], &block.turn, &block.range];
        unit.run(|| look(lanes, &mut block.column, &mut block.row, &mut block.range_cm));
        if see {
            unit.run(|| pick(&block.column, &block.row, &mut block.pixel));
            image.see(&block.pixel, &block.range_cm);
        }
        if left == 0 {
            continue;
        }
        let inside = block.place(projection, &weighting, &limits, unit);
        counts.out_of_window += left - inside;
        let mut lane = 0;
        loop {
            lane = enter_plain(&block, lane, marks, &mut free);
            if lane >= BLOCK {
                break;
            }
            // The next ones are hardly plain either, until one is ground.
            while lane < BLOCK {
                let sample = block.sample(lane);
                lane += 1;
                let (slot, cell) = sample.at();
                let lies = marks.judge(slot, cell, sample.z, window);
                let place = match lies {
                    Lies::Ground => free.next(),
                    Lies::Unsettled => {
                        let place = free.next_back();
                        back += usize::from(place.is_some());
                        place
                    }
                    Lies::Standing => {
                        counts.standing += 1;
                        image.stand(sample.seen_at());
                        continue;
                    }
                    other => {
                        counts.leave_out(other);
                        continue;
                    }
                };
                match place {
                    Some(place) => *place = sample,
                    None => counts.over_capacity += 1,
                }
                if lies == Lies::Ground {
                    break;
                }
            }
        }
    }
    [storage - free.len() - back, back]
}

/// Makes samples of a block's points from `lane` on as long as they are plainly ground and there is room; the first lane that is not, or `BLOCK`.
/// A loop of its own, so that all of it stays in registers.
#[inline(never)]
fn enter_plain(block: &Block, lane: usize, marks: &Board<'_>, free: &mut core::slice::IterMut<'_, Sample>) -> usize {
    let mut places = core::mem::take(free);
    let mut stopped = BLOCK;
    for lane in lane..BLOCK {
        let sample = block.sample(lane);
        let (slot, _) = sample.at();
        // Beyond the marks: a point that does not enter the map.
        let Some(mark) = marks.any(slot) else { continue };
        let plain = mark.is_plain_ground(sample.z);
        let Some(place) = (if plain { places.next() } else { None }) else {
            stopped = lane;
            break;
        };
        *place = sample;
    }
    *free = places;
    stopped
}

impl PointCounts {
    /// Counts a point that is not ground.
    pub(crate) fn leave_out(&mut self, lies: Lies) {
        match lies {
            Lies::Boxed => self.boxed += 1,
            Lies::Overhead => self.overhead += 1,
            Lies::Standing => self.standing += 1,
            Lies::Ground | Lies::Unsettled | Lies::Nowhere => {}
        }
    }
}
