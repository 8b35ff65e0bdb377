//! Every frame is fitted to the map before it enters.
//!
//! An attitude error of 0.05 degrees is 5 cm at 50 m, as high as the curbs that are looked for. Height, pitch and roll of the
//! frame are estimated against cells that the map already knows, by a robust fit to the differences (Tukey's weights, gates of 20, 8 and
//! 4 cm), held by a weak prior at what the pose says, so that the map does not drift from the poses in the long run.
//!
//! A spinning sensor takes a tenth of a second for a frame, in which a body that nods at 3 degrees/s turns by 0.3: the fit
//! therefore has a rate for each of the three, over the part of the turn that a point's azimuth tells (0 ahead, +/-1/2 behind).
//! The data decide their sign, so neither the sense of rotation nor the sensor's model need to be known, and a frame
//! that was corrected before comes out with rates of nothing. At most 5,000 points of the 144 degrees ahead take part.

use core::cmp::Ordering;

use super::geometry::dot;
use super::project::Projection;
use super::sight::Direction;
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
    let stride = (points.len() / pairs.len().clamp(1, 9_000)).max(1);
    let (near2, far2) = (near_far.0 * near_far.0, near_far.1 * near_far.1);
    let cells = f32::from(window.side) * 16.0;
    let mut used = 0;
    for &[x, y, z, _] in points.iter().step_by(stride) {
        let p = [x, y, z];
        let range2 = dot(p, p);
        if !(range2 >= near2 && range2 <= far2) {
            continue;
        }
        let turn = Direction::of(x, y, z).turn;
        // Behind the beam the turn is at its ends, where rates explain least.
        if turn.abs() > 0.2 {
            continue;
        }
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
        if off.abs() > 2000 {
            continue;
        }
        let Some(pair) = pairs.get_mut(used) else { break };
        *pair = Pair { x: offset[0] * SCALE, y: offset[1] * SCALE, turn, off: off as f32 };
        used += 1;
    }
    let pairs = pairs.get(..used).unwrap_or(&[]);
    let mut report = Alignment { compared: used as u32, ..Alignment::default() };
    if report.compared < FEW {
        return (report, Correction::default());
    }
    let mut fit = [0.0f32; TERMS];
    // Quarter millimetres: 20, 8, 4, 4 cm.
    for gate in [800.0f32, 320.0, 160.0, 160.0] {
        let inverse = 1.0 / (gate * gate);
        // The prior is worth two thousandths of the pairs; a tenth of that for tilts, whose unit is 25.6 m.
        let prior = used as f32 * 0.002;
        let mut normal = Normal::new([prior, 0.1 * prior, 0.1 * prior, prior, 0.1 * prior, 0.1 * prior]);
        report.within = 0;
        for pair in pairs {
            let terms = pair.terms();
            let left = pair.off - terms.iter().zip(&fit).map(|(a, b)| a * b).sum::<f32>();
            let u = left * left * inverse;
            if u < 1.0 {
                report.within += 1;
                normal.add(&terms, pair.off, (1.0 - u) * (1.0 - u));
            }
        }
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

impl Pair {
    fn terms(&self) -> [f32; TERMS] {
        [1.0, self.x, self.y, self.turn, self.turn * self.x, self.turn * self.y]
    }
}

/// Weighted normal equations of the six terms: the lower triangle and the right side.
struct Normal {
    matrix: [[f32; TERMS]; TERMS],
    right: [f32; TERMS],
}

impl Normal {
    fn new(prior: [f32; TERMS]) -> Self {
        let mut matrix = [[0.0; TERMS]; TERMS];
        for (index, (row, prior)) in matrix.iter_mut().zip(prior).enumerate() {
            if let Some(value) = row.get_mut(index) {
                *value = prior;
            }
        }
        Self { matrix, right: [0.0; TERMS] }
    }

    #[inline]
    fn add(&mut self, terms: &[f32; TERMS], value: f32, weight: f32) {
        for ((row, right), term) in self.matrix.iter_mut().zip(&mut self.right).zip(terms) {
            let weighted = weight * term;
            *right += weighted * value;
            for (entry, other) in row.iter_mut().zip(terms) {
                *entry += weighted * other;
            }
        }
    }

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
        let mut normal = Normal::new([1e-6; TERMS]);
        for k in 0..200 {
            let (x, y, turn) = ((k % 7) as f32 - 3.0, (k % 11) as f32 - 5.0, (k % 13) as f32 / 13.0 - 0.5);
            let pair = Pair { x, y, turn, off: 0.0 };
            let terms = pair.terms();
            let value = terms.iter().zip(wanted).map(|(a, b)| a * b).sum();
            normal.add(&terms, value, 0.7);
        }
        let fit = normal.solve().unwrap();
        for (got, wanted) in fit.iter().zip(wanted) {
            assert!((got - wanted).abs() < 1e-3, "{fit:?}");
        }
    }
}
