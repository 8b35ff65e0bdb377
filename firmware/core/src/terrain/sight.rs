//! Visibility: a place that the sensor looks through is empty, whatever stood there before.
//!
//! Every frame is drawn into a small image of horizontal ranges, by azimuth and by tangent of elevation. A cell that
//! was tall and is not hit now is looked up in it: where the rays that cross its volume end well behind it, nothing stands there any more.
//! For each azimuth the nearest thing that stands is noted too: what is seen beneath it, between the wheels of a car, is no ground to be trusted.
//! Azimuth is the "diamond angle" y / (|x| + |y|), which needs a division and no arctangent; a cubic makes the
//! horizontal range of |x| + |y|.

use super::project::below;

/// Columns of the range image.
pub const COLUMNS: usize = 1024;
/// Rows of the range image.
pub const ROWS: usize = 112;
/// Tangent of the lowest elevation, and rows a unit of tangent: -0.5 to +0.15 (-26.6 to +8.5 degrees).
const LOWEST: f32 = -0.5;
const ROWS_PER_TANGENT: f32 = ROWS as f32 / 0.65;

/// Storage of the range image: farthest horizontal range a pixel, centimetres; 0 where nothing was seen.
pub type RangePixels = [u16; COLUMNS * ROWS];

/// Where a point lies in the plan, as seen from the sensor.
#[derive(Clone, Copy)]
pub(crate) struct Bearing {
    /// Part of a turn off straight ahead, positive to the left, -1/2 to 1/2: the diamond angle, within 0.011 of the true one.
    pub(crate) turn: f32,
    /// Horizontal range within 0.1 %, m.
    pub(crate) range: f32,
}

/// sqrt(1/2 + 2 q) for q of 0 to 1/4, by the cubic through Chebyshev's points: within 0.1 %.
const RANGE: [f32; 4] = [0.707_18, 1.404_687, -1.202_74, 1.079_352];

impl Bearing {
    #[inline(always)]
    pub(crate) fn of(x: f32, y: f32) -> Self {
        let manhattan = x.abs() + y.abs();
        let manhattan = if manhattan > 0.01 { manhattan } else { 0.01 };
        let inverse = 1.0 / manhattan;
        let side = 0.25 * y * inverse;
        let behind = if y >= 0.0 { 0.5 - side } else { -0.5 - side };
        // With s = |y| / (|x| + |y|) the range over |x| + |y| is sqrt(s^2 + (1 - s)^2) = sqrt(1/2 + 2 (s - 1/2)^2).
        let off = y.abs() * inverse - 0.5;
        let q = off * off;
        let range = manhattan * (RANGE[0] + q * (RANGE[1] + q * (RANGE[2] + q * RANGE[3])));
        Self { turn: if x >= 0.0 { side } else { behind }, range }
    }
}

/// The same, and how high.
#[derive(Clone, Copy)]
pub(crate) struct Direction {
    turn: f32,
    pub(crate) range: f32,
    /// Row of the image as a real number.
    pub(crate) row: f32,
}

impl Direction {
    /// Of a point at a bearing and `z` metres above the sensor.
    #[inline(always)]
    pub(crate) fn at(bearing: Bearing, z: f32) -> Self {
        let Bearing { turn, range } = bearing;
        Self { turn, range, row: (z / range - LOWEST) * ROWS_PER_TANGENT }
    }

    fn of([x, y, z]: [f32; 3]) -> Self {
        Self::at(Bearing::of(x, y), z)
    }

    #[inline(always)]
    pub(crate) fn column(&self) -> i32 {
        // Half a turn to each side: from 1/2 to 3/2 of the columns, modulo their number.
        below((self.turn + 1.0) * COLUMNS as f32) & (COLUMNS as i32 - 1)
    }

    /// Neither above the image nor below it.
    #[inline(always)]
    pub(crate) fn is_inside(&self) -> bool {
        (self.row >= 0.0) & (self.row < ROWS as f32)
    }
}

/// Pixel of the image in a column, at a row that lies inside it.
#[inline(always)]
pub(crate) fn pixel(column: i32, row: f32) -> i32 {
    // Times 112 = 128 - 16, which vector units do without a multiplication.
    (column << 7) - (column << 4) + below(row)
}

/// Nothing stands in an azimuth.
const OPEN: u16 = u16::MAX;
/// How far behind something that stands a point may still lie beneath it, cm: the length of a car.
const LONGEST_CM: u16 = 500;
/// Nearer behind it than this, cm, the point is on its face.
const FACE_CM: u16 = 15;

pub(crate) struct RangeImage<'a> {
    /// None where nothing is looked through.
    pixels: Option<&'a mut RangePixels>,
    /// Nearest range at which something stands by azimuth, cm.
    standing: [u16; COLUMNS],
}

impl<'a> RangeImage<'a> {
    pub(crate) fn new(mut pixels: Option<&'a mut RangePixels>) -> Self {
        if let Some(pixels) = &mut pixels {
            pixels.fill(0);
        }
        Self { pixels, standing: [OPEN; COLUMNS] }
    }

    /// Ready for a frame; for its pixels only if they will be looked at.
    pub(crate) fn clear(&mut self, see: bool) {
        if see && let Some(pixels) = &mut self.pixels {
            pixels.fill(0);
        }
        self.standing = [OPEN; COLUMNS];
    }

    /// Something stands here.
    pub(crate) fn stand(&mut self, (column, range_cm): (u16, u16)) {
        if let Some(nearest) = self.standing.get_mut(usize::from(column)) {
            *nearest = (*nearest).min(range_cm);
        }
    }

    /// Lends what stands to the azimuths beside it. Once a frame, when all of it is known.
    pub(crate) fn widen(&mut self) {
        let narrow = self.standing;
        for (column, nearest) in self.standing.iter_mut().enumerate() {
            for near in [column + COLUMNS - 1, column + 1] {
                *nearest = (*nearest).min(narrow.get(near & (COLUMNS - 1)).copied().unwrap_or(OPEN));
            }
        }
    }

    /// Whether a point `below` the sensor (quarter millimetres) is seen beneath something that stands: its ray passed that thing's range at less
    /// than `stands` (quarter millimetres) above the point's own level, which is too low to have passed over it.
    #[inline]
    pub(crate) fn is_beneath(&self, (column, range_cm): (u16, u16), below: i32, stands: i32) -> bool {
        let nearest = self.standing.get(usize::from(column)).copied().unwrap_or(OPEN);
        let behind = range_cm.saturating_sub(nearest);
        if behind <= FACE_CM || behind > LONGEST_CM {
            return false;
        }
        // Height of the ray over the level of its end falls in proportion to what is left of its way.
        i64::from(below) * i64::from(behind) < i64::from(stands) * i64::from(range_cm)
    }

    /// Enters horizontal ranges, in centimetres.
    pub(crate) fn see(&mut self, pixels: &[i32], ranges_cm: &[i32]) {
        let Some(image) = &mut self.pixels else { return };
        for (pixel, range_cm) in pixels.iter().zip(ranges_cm) {
            if let Some(held) = image.get_mut(*pixel as u32 as usize) {
                *held = (*held).max(*range_cm as u16);
            }
        }
    }

    /// How many pixels that look through the upright line from `foot` to `head` (sensor axes, metres) end beyond it, and how many at or before it.
    pub(crate) fn through(&self, foot: [f32; 3], head: [f32; 3]) -> (u32, u32) {
        let (foot, head) = (Direction::of(foot), Direction::of(head));
        let (column, range, low, high) = (foot.column() as usize, foot.range, foot.row, head.row);
        let first = low.max(0.0) as usize + usize::from(low > 0.0);
        let last = high.min(ROWS as f32 - 1.0).max(0.0) as usize;
        // Behind by half a metre and 2 % of the range: further than the cell, its neighbour and the noise.
        let behind = ((range * 1.02 + 0.5) * 100.0) as u16;
        let (mut beyond, mut blocked) = (0, 0);
        let Some(pixels) = &self.pixels else { return (beyond, blocked) };
        for step in [COLUMNS - 1, 0, 1] {
            let column = (column + step) & (COLUMNS - 1);
            for row in first..=last {
                match pixels.get(column * ROWS + row) {
                    None | Some(0) => {}
                    Some(seen) if *seen >= behind => beyond += 1,
                    Some(_) => blocked += 1,
                }
            }
        }
        (beyond, blocked)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    extern crate std;

    #[test]
    fn the_diamond_azimuth_gives_horizontal_range_all_round() {
        for step in 0..3600 {
            let (sin, cos) = libm::sincosf(step as f32 * 0.001745);
            let direction = Direction::of([30.0 * cos, 30.0 * sin, -1.9]);
            assert!((direction.range - 30.0).abs() < 0.03, "{step}: {}", direction.range);
            assert!((direction.row - (0.5 - 1.9 / 30.0) * ROWS_PER_TANGENT).abs() < 0.02);
        }
    }

    #[test]
    fn a_point_is_beneath_what_stands_before_it_unless_its_ray_passed_above() {
        let mut pixels = std::boxed::Box::new([0; COLUMNS * ROWS]);
        let mut image = RangeImage::new(Some(&mut pixels));
        image.stand((1023, 4000));
        image.widen();
        // From 1.9 m up. At 41 m the ray was 5 cm above the ground where the thing stands; at 45 m 21 cm; at 60 m, and behind a car's length, far more.
        let beneath = |column, range_cm| image.is_beneath((column, range_cm), 7600, 1400);
        assert!(beneath(1023, 4100) && beneath(0, 4500) && beneath(1022, 4100));
        assert!(!beneath(1, 4100) && !beneath(1023, 4600) && !beneath(1023, 3900) && !beneath(1023, 4010));
        assert!(!beneath(u16::MAX, 4100));
        // From 10 m up the same ray passes over it.
        assert!(!image.is_beneath((1023, 4300), 40_000, 1400));
    }

    #[test]
    fn a_volume_is_seen_through_when_its_rays_end_behind_it() {
        let mut pixels = std::boxed::Box::new([0; COLUMNS * ROWS]);
        let mut image = RangeImage::new(Some(&mut pixels));
        for step in -20..20 {
            for up in 0..20 {
                let scale = 40.0;
                let (y, z) = (step as f32 * 0.1, scale * (-0.05 + up as f32 * 0.003));
                let seen = Direction::of([scale, y, z]);
                image.see(&[pixel(seen.column(), seen.row)], &[(seen.range * 100.0) as i32]);
            }
        }
        let (beyond, blocked) = image.through([20.0, 0.0, -1.0], [20.0, 0.0, 0.0]);
        assert!(beyond > 5 && blocked == 0, "{beyond} {blocked}");
        let (beyond, blocked) = image.through([50.0, 0.0, -1.0], [50.0, 0.0, 0.0]);
        assert!(beyond == 0 && blocked > 0, "{beyond} {blocked}");
    }
}
