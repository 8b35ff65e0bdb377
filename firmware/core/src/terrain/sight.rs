//! Visibility: a place that the sensor looks through is empty, whatever stood there before.
//!
//! Every frame is drawn into a small image of horizontal ranges, by azimuth and by tangent of elevation. A cell that
//! was tall and is not hit now is looked up in it: where the rays that cross its volume end well behind it, nothing stands there any more.
//! Azimuth is the "diamond angle" y / (|x| + |y|), which needs a division and no arctangent; a table of 1,024 columns turns
//! |x| + |y| into the horizontal range.

/// Columns of the range image.
pub const COLUMNS: usize = 1024;
/// Rows of the range image.
pub const ROWS: usize = 112;
/// Tangent of the lowest elevation, and rows a unit of tangent: -0.5 to +0.15 (-26.6 to +8.5 degrees).
const LOWEST: f32 = -0.5;
const ROWS_PER_TANGENT: f32 = ROWS as f32 / 0.65;

/// Storage of the range image: farthest horizontal range a pixel, centimetres; 0 where nothing was seen.
pub type RangePixels = [u16; COLUMNS * ROWS];

pub(crate) struct RangeImage<'a> {
    pixels: &'a mut RangePixels,
    /// 1 / (|cos| + |sin|) of each column's azimuth: horizontal range over |x| + |y|.
    norm: [f32; COLUMNS],
}

impl<'a> RangeImage<'a> {
    pub(crate) fn new(pixels: &'a mut RangePixels) -> Self {
        let mut norm = [1.0; COLUMNS];
        for (column, value) in norm.iter_mut().enumerate() {
            // Position along the diamond's edge at the column's middle, 0 to 1.
            let along = ((column % (COLUMNS / 4)) as f32 + 0.5) / (COLUMNS as f32 / 4.0);
            *value = libm::sqrtf(along * along + (1.0 - along) * (1.0 - along));
        }
        pixels.fill(0);
        Self { pixels, norm }
    }

    pub(crate) fn clear(&mut self) {
        self.pixels.fill(0);
    }

    /// Column, row as a real number, and horizontal range.
    #[inline]
    fn locate(&self, p: [f32; 3]) -> (usize, f32, f32) {
        let manhattan = p[0].abs() + p[1].abs();
        let inverse = 1.0 / manhattan.max(0.01);
        let quarter = COLUMNS as f32 / 4.0;
        let along = p[1].abs() * inverse * quarter;
        // Quadrants in turn: +x+y, -x+y, -x-y, +x-y; every quarter runs from its x axis or back to it.
        let diamond = match (p[0] >= 0.0, p[1] >= 0.0) {
            (true, true) => along,
            (false, true) => 2.0 * quarter - along,
            (false, false) => 2.0 * quarter + along,
            (true, false) => 4.0 * quarter - along,
        };
        let column = (diamond as usize) & (COLUMNS - 1);
        let range = manhattan * self.norm[column];
        let row = (p[2] / range.max(0.01) - LOWEST) * ROWS_PER_TANGENT;
        (column, row, range)
    }

    /// Enters a point.
    #[inline]
    pub(crate) fn see(&mut self, p: [f32; 3]) {
        let (column, row, range) = self.locate(p);
        if row >= 0.0 && row < ROWS as f32 {
            let pixel = column * ROWS + row as usize;
            let centimetres = (range * 100.0) as u16;
            if let Some(held) = self.pixels.get_mut(pixel) {
                *held = (*held).max(centimetres);
            }
        }
    }

    /// How many pixels that look through the upright line from `foot` to `head` (sensor axes, metres) end beyond it, and how many at or before it.
    pub(crate) fn through(&self, foot: [f32; 3], head: [f32; 3]) -> (u32, u32) {
        let (column, low, range) = self.locate(foot);
        let (_, high, _) = self.locate(head);
        let first = low.max(0.0) as usize + usize::from(low > 0.0);
        let last = high.min(ROWS as f32 - 1.0).max(0.0) as usize;
        // Behind by half a metre and 2 % of the range: further than the cell, its neighbour and the noise.
        let behind = ((range * 1.02 + 0.5) * 100.0) as u16;
        let (mut beyond, mut blocked) = (0, 0);
        for step in [COLUMNS - 1, 0, 1] {
            let column = (column + step) & (COLUMNS - 1);
            for row in first..=last {
                match self.pixels.get(column * ROWS + row) {
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
        let mut pixels = std::boxed::Box::new([0; COLUMNS * ROWS]);
        let image = RangeImage::new(&mut pixels);
        for step in 0..3600 {
            let (sin, cos) = libm::sincosf(step as f32 * 0.001745);
            let (_, row, range) = image.locate([30.0 * cos, 30.0 * sin, -1.9]);
            assert!((range - 30.0).abs() < 0.12, "{step}: {range}");
            assert!((row - (0.5 - 1.9 / 30.0) * ROWS_PER_TANGENT).abs() < 0.1);
        }
    }

    #[test]
    fn a_volume_is_seen_through_when_its_rays_end_behind_it() {
        let mut pixels = std::boxed::Box::new([0; COLUMNS * ROWS]);
        let mut image = RangeImage::new(&mut pixels);
        for step in -20..20 {
            for up in 0..20 {
                let scale = 40.0;
                image.see([scale, step as f32 * 0.1, scale * (-0.05 + up as f32 * 0.003)]);
            }
        }
        let (beyond, blocked) = image.through([20.0, 0.0, -1.0], [20.0, 0.0, 0.0]);
        assert!(beyond > 5 && blocked == 0, "{beyond} {blocked}");
        let (beyond, blocked) = image.through([50.0, 0.0, -1.0], [50.0, 0.0, 0.0]);
        assert!(beyond == 0 && blocked > 0, "{beyond} {blocked}");
    }
}
