//! Every frame is fitted to the map before it enters.
//!
//! An attitude error of 0.05 degrees is 5 cm at 50 m, as high as the curbs that are looked for. Height, pitch and roll of the
//! frame are estimated against cells that the map already knows, by a robust fit to the differences (Tukey's weights, gates of 20, 8 and
//! 4 cm), held by a weak prior at what the pose says, so that the map does not drift from the poses in the long run.
//!
//! A spinning sensor takes a tenth of a second for a frame, in which a body that nods at 3 degrees/s turns by 0.3: the fit
//! therefore has a rate for each of the three, over the part of the turn that a point's azimuth tells (0 ahead, +/-1/2 behind).
//! The data decide their sign, so neither the sense of rotation nor the sensor's model need to be known, and a frame
//! that was corrected before comes out with rates of nothing. 6,000 points of a frame are looked at; those of the 144 degrees ahead take part.

use core::cmp::Ordering;

use super::geometry::dot;
use super::project::{Projection, least};
use super::sight::Bearing;
use super::tile::UNITS_PER_M;
use super::window::Window;

/// A point and how far it lies above the map.
#[derive(Clone, Copy, Debug, Default)]
pub struct Pair {
    /// Cells from the sensor, divided by 256 to keep the normal equations near one.
    x: f32,
    y: f32,
    /// Part of the sensor's turn, 0 ahead, -1/2 to 1/2.
    turn: f32,
    /// Quarter millimetres.
    off: f32,
}

/// What the fit found.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Alignment {
    /// Points compared with known cells.
    pub compared: u32,
    /// Of these, within the last gate.
    pub within: u32,
    /// Correction of the height, mm.
    pub lift_mm: f32,
    /// Correction of the tilt towards x and y of the world, mm a metre.
    pub tilt_mm_per_m: [f32; 2],
}

/// What is added to a frame's heights: quarter millimetres, and quarter millimetres a cell towards x and y of the world;
/// the rates a whole turn of the sensor.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Correction {
    pub(crate) lift: f32,
    pub(crate) tilt: [f32; 2],
    pub(crate) lift_rate: f32,
    pub(crate) tilt_rate: [f32; 2],
}

/// Cells of 256 are one unit of the fit.
const SCALE: f32 = 1.0 / 256.0;
/// Pairs below which nothing is corrected: the map is too young.
const FEW: u32 = 60;
/// Points of a frame that are looked at.
const MOST: usize = 6_000;
/// Points that are read at a time.
const BLOCK: usize = 64;
/// Largest difference that is looked at, quarter millimetres.
const FARTHEST: f32 = 2000.0;
/// Weight margin of a settled cell: 0.7 sigma at most 8 mm.
const SETTLED: u8 = 32;

/// Compares a thinned frame with the map and works the correction out.
pub(crate) fn align(
    points: &[[f32; 4]],
    projection: &Projection,
    window: &Window<'_>,
    pairs: &mut [Pair],
    near_far: (f32, f32),
    cell_m: f32,
) -> (Alignment, Correction) {
    let stride = (points.len() / pairs.len().clamp(1, MOST)).max(1);
    let (near2, far2) = (near_far.0 * near_far.0, near_far.1 * near_far.1);
    let cells = f32::from(window.side) * 16.0;
    let mut used = 0;
    let mut thinned = points.iter().step_by(stride);
    let mut block = [[0.0; 4]; BLOCK];
    // Copied block by block, so that points far apart are on their way from memory side by side.
    'all: while thinned.len() > 0 {
        let filled = block.iter_mut().zip(&mut thinned).map(|(place, point)| *place = *point).count();
        for &[x, y, z, _] in block.iter().take(filled) {
            let p = [x, y, z];
            let range2 = dot(p, p);
            if !(range2 >= near2 && range2 <= far2) {
                continue;
            }
            // The turn is within a fifth of straight ahead. Behind the beam it is at its ends, where rates explain least.
            if y.abs() > 4.0 * x {
                continue;
            }
            let turn = Bearing::of(x, y).turn;
            let (offset, height) = projection.apply(p, turn);
            let (u, v) = (offset[0] + projection.origin[0], offset[1] + projection.origin[1]);
            if !(u >= 0.0 && v >= 0.0 && u < cells && v < cells) {
                continue;
            }
            let (ix, iy) = (u as u32, v as u32);
            let Some(tile) = window.tiles.get(window.slot(ix >> 4, iy >> 4)) else { continue };
            let index = ((iy & 15) << 4 | (ix & 15)) as usize;
            let margin = tile.margin[index & 255];
            if margin == 0 || margin > SETTLED || tile.tall[index & 255] != 0 {
                continue;
            }
            let known = tile.base.saturating_add(i32::from(tile.height[index & 255]));
            let off = height.saturating_sub(known);
            // Beyond half a metre it is another thing, not a misfit.
            if off.abs() > FARTHEST as i32 {
                continue;
            }
            let Some(pair) = pairs.get_mut(used) else { break 'all };
            *pair = Pair { x: offset[0] * SCALE, y: offset[1] * SCALE, turn, off: off as f32 };
            used += 1;
        }
    }
    let pairs = pairs.get(..used).unwrap_or(&[]);
    let mut report = Alignment { compared: used as u32, ..Alignment::default() };
    if report.compared < FEW {
        return (report, Correction::default());
    }
    let mut fit = [0.0f32; TERMS];
    // Quarter millimetres: 20, 8, 4, 4 cm.
    for gate in [800.0f32, 320.0, 160.0, 160.0] {
        // The prior is worth two thousandths of the pairs; a tenth of that for tilts, whose unit is 25.6 m.
        let prior = used as f32 * 0.002;
        let mut sums = Sums::new();
        let mut block = [[0.0; LANES]; 4];
        report.within = 0;
        for pairs in pairs.chunks(LANES) {
            // What a block lacks is far off.
            block[3] = [f32::MAX; LANES];
            for (lane, pair) in pairs.iter().enumerate() {
                for (lanes, value) in block.iter_mut().zip([pair.x, pair.y, pair.turn, pair.off]) {
                    lanes[lane & (LANES - 1)] = value;
                }
            }
            report.within += sums.add(&block, &fit, gate);
        }
        let normal = sums.finish([prior, 0.1 * prior, 0.1 * prior, prior, 0.1 * prior, 0.1 * prior]);
        fit = normal.solve().unwrap_or(fit);
    }
    let fit = fit.map(|term| term * KEPT);
    let per_m = SCALE / cell_m;
    let mm = 1000.0 / UNITS_PER_M;
    report.lift_mm = -fit[0] * mm;
    report.tilt_mm_per_m = [-fit[1] * per_m * mm, -fit[2] * per_m * mm];
    let correction = Correction {
        lift: -fit[0],
        tilt: [-fit[1] * SCALE, -fit[2] * SCALE],
        lift_rate: -fit[3],
        tilt_rate: [-fit[4] * SCALE, -fit[5] * SCALE],
    };
    (report, correction)
}

const TERMS: usize = 6;
/// Share of the correction that is applied. The rest lets the map follow the poses' own mean within 50 frames: an error
/// of the first pose would otherwise stay in it for ever.
const KEPT: f32 = 0.98;

/// Pairs that are summed side by side.
const LANES: usize = 8;
type Lanes = [f32; LANES];

/// The terms of the fit: one, x, y, turn, turn x, turn y.
#[inline(always)]
fn terms([x, y, turn, _]: &[Lanes; 4]) -> [Lanes; TERMS] {
    let mut out = [[1.0; LANES], *x, *y, *turn, *x, *y];
    for lane in 0..LANES {
        out[4][lane] *= turn[lane];
        out[5][lane] *= turn[lane];
    }
    out
}

/// Sums of the weighted normal equations, lane by lane: of the matrix the lower triangle.
struct Sums {
    matrix: [[Lanes; TERMS]; TERMS],
    right: [Lanes; TERMS],
}

impl Sums {
    fn new() -> Self {
        Self { matrix: [[[0.0; LANES]; TERMS]; TERMS], right: [[0.0; LANES]; TERMS] }
    }

    /// Adds a block of pairs, each with Tukey's weight of what the fit leaves of it; how many lie within the gate.
    #[inline(never)]
    fn add(&mut self, block: &[Lanes; 4], fit: &[f32; TERMS], gate: f32) -> u32 {
        let off = &block[3];
        let terms = terms(block);
        let inverse = 1.0 / (gate * gate);
        let mut weight = [0.0f32; LANES];
        let mut within = 0;
        for lane in 0..LANES {
            let mut left = off[lane];
            for term in 0..TERMS {
                left -= terms[term][lane] * fit[term];
            }
            let u = left * left * inverse;
            let inside = u < 1.0;
            within += u32::from(inside);
            weight[lane] = if inside { (1.0 - u) * (1.0 - u) } else { 0.0 };
        }
        for row in 0..TERMS {
            let mut weighted = [0.0; LANES];
            for lane in 0..LANES {
                weighted[lane] = weight[lane] * terms[row][lane];
                // Where nothing is to be weighed the difference may be as large as there are.
                self.right[row][lane] += weighted[lane] * least(off[lane], FARTHEST);
            }
            for (sums, term) in self.matrix[row].iter_mut().zip(&terms).take(row + 1) {
                for lane in 0..LANES {
                    sums[lane] += weighted[lane] * term[lane];
                }
            }
        }
        within
    }

    fn finish(&self, prior: [f32; TERMS]) -> Normal {
        let mut normal = Normal { matrix: [[0.0; TERMS]; TERMS], right: [0.0; TERMS] };
        for (row, prior) in prior.iter().enumerate() {
            normal.right[row] = self.right[row].iter().sum();
            for column in 0..=row {
                let sum = self.matrix[row][column].iter().sum();
                normal.matrix[row][column] = sum;
                normal.matrix[column][row] = sum;
            }
            normal.matrix[row][row] += prior;
        }
        normal
    }
}

/// Normal equations of the six terms.
struct Normal {
    matrix: [[f32; TERMS]; TERMS],
    right: [f32; TERMS],
}

impl Normal {
    /// Gaussian elimination; the matrix is symmetric and, with its prior, positive: pivots stay on the diagonal.
    fn solve(mut self) -> Option<[f32; TERMS]> {
        for pivot in 0..TERMS {
            let (row, right) = (self.matrix[pivot], self.right[pivot]);
            // NaN fails as well.
            if row[pivot].partial_cmp(&0.0) != Some(Ordering::Greater) {
                return None;
            }
            for below in pivot + 1..TERMS {
                let factor = self.matrix[below][pivot] / row[pivot];
                for (entry, above) in self.matrix[below].iter_mut().zip(&row) {
                    *entry -= factor * above;
                }
                self.right[below] -= factor * right;
            }
        }
        let mut out = [0.0f32; TERMS];
        for pivot in (0..TERMS).rev() {
            let known: f32 = self.matrix[pivot].iter().zip(&out).skip(pivot + 1).map(|(a, b)| a * b).sum();
            out[pivot] = (self.right[pivot] - known) / self.matrix[pivot][pivot];
        }
        out.iter().all(|value| value.is_finite()).then_some(out)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_normal_equations_return_the_terms_that_made_the_values() {
        let wanted = [12.0, -30.0, 7.0, 4.0, -9.0, 2.0];
        let mut sums = Sums::new();
        for k in 0..25 {
            let mut block = [[0.0; LANES]; 4];
            for lane in 0..LANES {
                let k = LANES * k + lane;
                let (x, y, turn) = ((k % 7) as f32 - 3.0, (k % 11) as f32 - 5.0, (k % 13) as f32 / 13.0 - 0.5);
                let terms = [1.0, x, y, turn, turn * x, turn * y];
                let off = terms.iter().zip(wanted).map(|(a, b)| a * b).sum();
                for (lanes, value) in block.iter_mut().zip([x, y, turn, off]) {
                    lanes[lane] = value;
                }
            }
            // A gate so wide that every weight is one.
            assert_eq!(sums.add(&block, &[0.0; TERMS], 1e9), LANES as u32);
        }
        let normal = sums.finish([1e-6; TERMS]);
        let fit = normal.solve().unwrap();
        for (got, wanted) in fit.iter().zip(wanted) {
            assert!((got - wanted).abs() < 1e-3, "{fit:?}");
        }
    }
}
