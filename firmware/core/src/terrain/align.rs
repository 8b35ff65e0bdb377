//! Every frame is fitted to the map before it enters.
//!
//! An attitude error of 0.05 degrees is 5 cm at 50 m, as high as the curbs that are looked for. Height, pitch and roll of the
//! frame are estimated against cells that the map already knows: a robust fit of a plane to the differences
//! (Tukey's weights, gates of 20, 8 and 4 cm), held by a weak prior at what the pose says, so that the map does not drift from
//! the poses in the long run. The frame is thinned to at most 10,000 points for it.

use super::geometry::dot;
use super::project::Projection;
use super::tile::UNITS_PER_M;
use super::window::Window;

/// A point and how far it lies above the map.
#[derive(Clone, Copy, Debug, Default)]
pub struct Pair {
    /// Cells from the sensor, divided by 256 to keep the normal equations near one.
    x: f32,
    y: f32,
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
) -> (Alignment, f32, [f32; 2]) {
    let stride = (points.len() / pairs.len().clamp(1, 10_000)).max(1);
    let (near2, far2) = (near_far.0 * near_far.0, near_far.1 * near_far.1);
    let cells = f32::from(window.side) * 16.0;
    let mut used = 0;
    for &[x, y, z, _] in points.iter().step_by(stride) {
        let p = [x, y, z];
        let range2 = dot(p, p);
        if !(range2 >= near2 && range2 <= far2) {
            continue;
        }
        let (offset, height) = projection.apply(p);
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
        *pair = Pair { x: offset[0] * SCALE, y: offset[1] * SCALE, off: off as f32 };
        used += 1;
    }
    let pairs = pairs.get(..used).unwrap_or(&[]);
    let mut report = Alignment { compared: used as u32, ..Alignment::default() };
    if report.compared < FEW {
        return (report, 0.0, [0.0; 2]);
    }
    let mut fit = [0.0f32; 3];
    // Quarter millimetres: 20, 8, 8, 4, 4 cm.
    for gate in [800.0f32, 320.0, 320.0, 160.0, 160.0] {
        let inverse = 1.0 / (gate * gate);
        // Upper triangle of the normal matrix, and the right side; the prior is worth two thousandths of the pairs.
        let prior = used as f32 * 0.002;
        let (mut n, mut xx, mut xy, mut yy, mut sx, mut sy) = (prior, 0.1 * prior, 0.0, 0.1 * prior, 0.0, 0.0);
        let mut right = [0.0f32; 3];
        report.within = 0;
        for pair in pairs {
            let left = pair.off - fit[0] - fit[1] * pair.x - fit[2] * pair.y;
            let u = left * left * inverse;
            if u >= 1.0 {
                continue;
            }
            report.within += 1;
            let w = (1.0 - u) * (1.0 - u);
            let (wx, wy) = (w * pair.x, w * pair.y);
            n += w;
            sx += wx;
            sy += wy;
            xx += wx * pair.x;
            xy += wx * pair.y;
            yy += wy * pair.y;
            right[0] += w * pair.off;
            right[1] += wx * pair.off;
            right[2] += wy * pair.off;
        }
        fit = solve([n, sx, sy, xx, xy, yy], right).unwrap_or(fit);
    }
    let to_mm_per_m = SCALE / cell_m / (UNITS_PER_M / 1000.0);
    report.lift_mm = -fit[0] / (UNITS_PER_M / 1000.0);
    report.tilt_mm_per_m = [-fit[1] * to_mm_per_m, -fit[2] * to_mm_per_m];
    (report, -fit[0], [-fit[1] * SCALE, -fit[2] * SCALE])
}

/// Solves the symmetric 3 x 3 system [n sx sy; sx xx xy; sy xy yy] f = r by elimination.
fn solve([n, sx, sy, xx, xy, yy]: [f32; 6], [r0, r1, r2]: [f32; 3]) -> Option<[f32; 3]> {
    if !(n > 0.0) {
        return None;
    }
    let (a, b) = (sx / n, sy / n);
    let (m11, m12, m22) = (xx - a * sx, xy - a * sy, yy - b * sy);
    let (q1, q2) = (r1 - a * r0, r2 - b * r0);
    if !(m11 > 0.0) {
        return None;
    }
    let c = m12 / m11;
    let d = m22 - c * m12;
    if !(d > 0.0) {
        return None;
    }
    let f2 = (q2 - c * q1) / d;
    let f1 = (q1 - m12 * f2) / m11;
    let f0 = (r0 - sx * f1 - sy * f2) / n;
    (f0.is_finite() && f1.is_finite() && f2.is_finite()).then_some([f0, f1, f2])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_system_is_solved() {
        let f = solve([4.0, 1.0, 0.5, 3.0, 0.2, 2.0], [4.0 + 2.0 + 1.5, 1.0 + 6.0 + 0.6, 0.5 + 0.4 + 6.0]).unwrap();
        for (got, wanted) in f.iter().zip([1.0, 2.0, 3.0]) {
            assert!((got - wanted).abs() < 1e-5, "{f:?}");
        }
    }
}
