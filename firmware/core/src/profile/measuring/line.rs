//! A straight line and its weighted fit.
//!
//! A fit corrects a line that is nearly right: with residuals e of the old line, it solves for the change of slope and
//! height. So the residuals carry the precision and the sums can be kept short: distances along the line are counted in
//! units of 32 grains (0.26 mm; 2^18 are more than twice the scanner's reach), weights in 12 bits, residuals in 15: 401 products w u u stay
//! below 2^57, w u e below 2^54. The line's reference is moved to the weighted centroid, where slope and height are uncorrelated.

use super::magnitude::Magnitude;
use super::sample::{Noise, Sample};

/// z = `z` + slope x (u - `u`).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Line {
    /// Reference, in grains outward.
    pub u: i32,
    /// Height at the reference, in grains.
    pub z: i32,
    /// Slope with 30 fraction bits, positive rising outward; within +/-2.
    pub slope_q30: i32,
}

/// Lines closer to parallel than this, about 0.1 degrees, meet nowhere in particular.
const LEAST_TURN_Q30: u64 = 1 << 21;

impl Line {
    pub fn height_at(&self, u: i32) -> i32 {
        self.z + ((i64::from(u - self.u) * i64::from(self.slope_q30)) >> 30) as i32
    }

    /// The place on the line at a distance outward.
    pub fn place_at(&self, u: i32) -> (i32, i32) {
        (u, self.height_at(u))
    }

    /// How far a sample lies above the line, vertically.
    pub fn residual(&self, sample: &Sample) -> i32 {
        sample.z - self.height_at(sample.u)
    }

    pub fn slope_q14(&self) -> i32 {
        self.slope_q30 >> 16
    }

    /// Where two lines meet; nothing when they are nearly parallel.
    pub fn meets(&self, other: &Self) -> Option<i32> {
        let turn = i64::from(other.slope_q30) - i64::from(self.slope_q30);
        let size = turn.unsigned_abs();
        if size < LEAST_TURN_Q30 {
            return None;
        }
        let gap = i64::from(self.height_at(other.u)) - i64::from(other.z);
        let away = ((gap.unsigned_abs() << 30) / size.max(LEAST_TURN_Q30)) as i64;
        let away = if (gap < 0) == (turn < 0) { away } else { -away };
        Some((i64::from(other.u) + away).clamp(-(1 << 24), 1 << 24) as i32)
    }
}

/// How far residuals count in a fit: Tukey's biweight, wider below than above because vegetation is above.
const ABOVE: Width = Width::sigmas(35);
const BELOW: Width = Width::sigmas(45);

/// How wide a gate is on one side.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Width {
    /// Its square in variances, 8 fraction bits.
    square_q8: u32,
    /// 2^24 over that.
    inverse: u32,
}

impl Width {
    const fn sigmas(tenths: u32) -> Self {
        let square_q8 = ((tenths * tenths) << 8) / 100;
        Self { square_q8, inverse: (1 << 24) / square_q8 }
    }
}

/// Tukey weights take more of the large residuals than of the small ones: for normal errors and these gates the
/// weighted mean square is 1/1.3076 of the variance (numerical integration). 8 fraction bits.
const TRIM_Q8: u64 = 335;

/// What a fit leaves behind.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Fit {
    pub line: Line,
    /// Samples with a weight.
    pub count: u32,
    /// Variance of the slope, if the noise is as assumed.
    pub slope_variance: Magnitude,
    /// Variance of the height at the reference, in square grains, likewise.
    pub height_variance: Magnitude,
    /// Sum of squared residuals over their variances, Tukey-weighted and freed of the weights' bias, with 8 fraction bits.
    pub chi2_q8: u32,
    /// Sum of Tukey weights, with 8 fraction bits.
    pub effective_q8: u32,
}

impl Fit {
    /// Variance of the height at `u`, in square grains.
    pub fn variance_at(&self, u: i32) -> Magnitude {
        let arm = Magnitude::new(u64::from(u.abs_diff(self.line.u)), 0);
        self.height_variance.plus(arm.squared().times(self.slope_variance))
    }
}

/// log2 of the grains in a unit of distance from a line's reference.
const ARM_BITS: u32 = 5;

/// Weighs every `stride`-th sample by its variance about a line of this slope; returns the common shift that [`fit`] wants.
///
/// A weight is 2^20 / (variance >> shift), below 2^12, where the shift leaves 8 or 9 bits of the least variance.
pub fn weigh(samples: &mut [Sample], stride: usize, noise: &Noise, slope_q14: i32) -> u32 {
    // The variance along a line changes slowly and one way: the least is at an end, or near it.
    let (first, last) = (samples.first(), samples.last());
    let least = first.into_iter().chain(last).map(|s| noise.variance(s, slope_q14)).min().unwrap_or(1 << 8);
    let shift = 23u32.saturating_sub(least.leading_zeros());
    for sample in samples.iter_mut().step_by(stride) {
        let scaled = noise.variance(sample, slope_q14) >> shift;
        sample.weight = ((1 << 20) / scaled.max(1)).min(4095) as u16;
    }
    shift
}

/// One step of iteratively reweighted least squares from `line`, over the samples that [`weigh`] has weighed, which gave `shift`.
/// Nothing when fewer than 3 samples are within the gate or all lie at one distance.
pub fn fit(samples: &[Sample], stride: usize, line: &Line, shift: u32) -> Option<Fit> {
    let (mut sum_w, mut sum_wu, mut sum_we, mut sum_wuu, mut sum_wue) = (0i32, 0i64, 0i64, 0i64, 0i64);
    let (mut count, mut chi2_q12, mut effective_q12) = (0u32, 0u32, 0u32);
    for sample in samples.iter().step_by(stride) {
        let e = line.residual(sample);
        if e.unsigned_abs() >= 1 << 15 {
            continue;
        }
        let base = u32::from(sample.weight);
        // e^2 / variance with 8 fraction bits: (e^2 >> shift) weight / 2^20. A square that would not fit 32 bits then is that of a
        // residual of 16 times the least sigma of the fit and more.
        let square = ((e * e) as u32 >> shift).min((1 << 20) - 1);
        let ratio_q8 = (square * base) >> 12;
        let width = if e > 0 { ABOVE } else { BELOW };
        if ratio_q8 >= width.square_q8 {
            continue;
        }
        let keep_q12 = 4096 - ((ratio_q8 * width.inverse) >> 12);
        let tukey_q12 = (keep_q12 * keep_q12) >> 12;
        let w = ((base * tukey_q12) >> 12) as i32;
        let u = (sample.u - line.u) >> ARM_BITS;
        let wu = w * u;
        sum_w += w;
        sum_wu += i64::from(wu);
        sum_we += i64::from(w) * i64::from(e);
        sum_wuu += i64::from(wu) * i64::from(u);
        sum_wue += i64::from(wu) * i64::from(e);
        count += 1;
        effective_q12 += tukey_q12;
        // Below 2^12 x 2^13 a sample: 401 of them, shifted, stay below 2^27.
        chi2_q12 += (tukey_q12 * ratio_q8) >> 8;
    }
    if count < 3 || sum_w <= 0 {
        return None;
    }
    let mean_u = sum_wu / i64::from(sum_w);
    let mean_e = sum_we / i64::from(sum_w);
    let spread = sum_wuu - 2 * mean_u * sum_wu + mean_u * mean_u * i64::from(sum_w);
    let lean = sum_wue - mean_u * sum_we;
    if spread <= 0 {
        return None;
    }
    // Both to 31 bits at most; the quotient is a change of slope in grains a 32 grains.
    let excess = 33u32.saturating_sub(spread.leading_zeros());
    let turn_q30 = (((lean >> excess) << (30 - ARM_BITS)) / (spread >> excess).max(1)).clamp(-(1 << 30), 1 << 30);
    let u = line.u + (mean_u << ARM_BITS) as i32;
    let slope_q30 = (i64::from(line.slope_q30) + turn_q30).clamp(-(1 << 31) + 1, (1 << 31) - 1) as i32;
    let fitted = Line { u, z: line.height_at(u) + mean_e as i32, slope_q30 };
    // weight = 2^(20 + shift) / variance.
    let scale = 20 + shift as i32;
    Some(Fit {
        line: fitted,
        count,
        slope_variance: Magnitude::new(1, scale - 2 * ARM_BITS as i32).over(Magnitude::new(spread as u64, 0)),
        height_variance: Magnitude::new(1, scale).over(Magnitude::new(sum_w as u64, 0)),
        chi2_q8: ((u64::from(chi2_q12) * TRIM_Q8) >> 12) as u32,
        effective_q8: effective_q12 >> 4,
    })
}
