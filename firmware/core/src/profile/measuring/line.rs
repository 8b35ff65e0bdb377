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
        // (difference x slope) / 2^30 as the upper half of one product: differences are below 2^26 (`meets`).
        self.z + ((i64::from((u - self.u) << 2) * i64::from(self.slope_q30)) >> 32) as i32
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

/// How far residuals count in a fit, with Tukey's biweight, and what that hides of their variance.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Gate {
    /// How wide it is above and below the line: 2^24 over its square in variances with 8 fraction bits.
    above: u32,
    below: u32,
    /// What the weighted mean square of normal residuals falls short of their variance by, 8 fraction bits.
    trim_q8: u32,
    /// A weighted mean square of r assumed variances, freed of that, comes of a variance of (limit - 1) r / (limit - r). 10 fraction bits.
    limit_q10: u32,
}

impl Gate {
    /// Where nothing grows: 4.5 sigma. The shortfall is 1.227 for normal errors (numerical integration); the intervals of simulated slopes hold as
    /// often as they should with 1.19.
    pub const BARE: Self = Self { above: inverse_width(45), below: inverse_width(45), trim_q8: 305, limit_q10: 4_300 };

    /// Vegetation is above and nothing is below, and a line that has samples below it is pulled down to them: 3.2 sigma above and 8 below. The
    /// shortfall is 1.23 for normal errors; some of the vegetation is within the gate, and the intervals hold with 1.29.
    pub const GROWN: Self = Self { above: inverse_width(32), below: inverse_width(80), trim_q8: 330, limit_q10: 7_746 };
}

/// Squared residuals over their variances, 8 fraction bits, from which on nothing counts on either side of any gate.
const WIDEST_Q8: u32 = 16_384;

/// How wide a gate of so many tenths of a sigma is.
const fn inverse_width(tenths: u32) -> u32 {
    (1 << 24) / (((tenths * tenths) << 8) / 100)
}

/// What a fit leaves behind.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Fit {
    pub line: Line,
    /// Samples with a weight.
    pub count: u32,
    /// How sure it is of its line, if the noise is as assumed.
    pub precision: Precision,
    /// Sum of squared residuals over their variances, Tukey-weighted and freed of the weights' bias, with 8 fraction bits.
    pub chi2_q8: u32,
    /// Sum of Tukey weights, with 8 fraction bits.
    pub effective_q8: u32,
    /// The gate in which they counted.
    pub gate: Gate,
}

/// How sure a fit is of its line.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Precision {
    /// Of weights w = 2^`scale` / variance: their sum, and that of w times the squared distance from the reference in units of 32 grains. Most fits
    /// are steps to the next: nobody asks for what takes divisions.
    Sums { w: i32, spread: i64, scale: i32 },
    /// Variance of the slope, and of the height at the reference in square grains.
    Variances { slope: Magnitude, height: Magnitude },
}

impl Fit {
    /// Variance of the slope.
    pub fn slope_variance(&self) -> Magnitude {
        match self.precision {
            Precision::Sums { spread, scale, .. } => {
                Magnitude::new(1, scale - 2 * ARM_BITS as i32).over(Magnitude::new(spread.unsigned_abs(), 0))
            }
            Precision::Variances { slope, .. } => slope,
        }
    }

    /// Variance of the height at the reference, in square grains.
    pub fn height_variance(&self) -> Magnitude {
        match self.precision {
            Precision::Sums { w, scale, .. } => {
                Magnitude::new(1, scale).over(Magnitude::new(u64::from(w.unsigned_abs()), 0))
            }
            Precision::Variances { height, .. } => height,
        }
    }

    /// Variance of the height at `u`, in square grains.
    pub fn variance_at(&self, u: i32) -> Magnitude {
        let arm = Magnitude::new(u64::from(u.abs_diff(self.line.u)), 0);
        self.height_variance().plus(arm.squared().times(self.slope_variance()))
    }

    /// Variance of the residuals over what was assumed, with `prior` observations as assumed, 10 fraction bits.
    ///
    /// The gate, as wide as the assumed noise wants it, hides the tails of a larger one. What is told of the variance is right within 4 % up to
    /// 4 times the assumed one (numerical integration), and no more than 9 times in a bare gate, 4.6 times in a grown one.
    pub fn ratio_q10(&self, prior: u32) -> u32 {
        let freedom_q8 = self.effective_q8.saturating_sub(2 << 8) + (prior << 8);
        let chi2_q8 = self.chi2_q8 + (prior << 8);
        // At most 3.1.
        let mean_q10 = ((u64::from(chi2_q8) << 10) / u64::from(freedom_q8.max(1))).min(3_174) as u32;
        (self.gate.limit_q10 - 1024) * mean_q10 / self.gate.limit_q10.saturating_sub(mean_q10).max(1)
    }
}

/// log2 of the grains in a unit of distance from a line's reference.
const ARM_BITS: u32 = 5;

/// Weighs every `stride`-th sample by its variance about a line of this slope; returns the common shift that [`fit`] wants: the
/// weights less so many bits are below 2^12, with the greatest above 2^10.
///
/// A weight is 2^37 / variance: below 2^27, as no variance is below 2^10.
pub fn weigh(samples: &mut [Sample], stride: usize, noise: &Noise, slope_q14: i32) -> u32 {
    // The variance along a line changes slowly and one way: the least is at an end, or near it.
    let (first, last) = (samples.first(), samples.last());
    let least = first.into_iter().chain(last).map(|s| noise.variance(s, slope_q14)).min().unwrap_or(1 << 10);
    let shift = least.max(1 << 10).leading_zeros().saturating_sub(6);
    weigh_by(samples, stride, noise, slope_q14, shift);
    shift
}

/// [`weigh`] with a shift that is known already.
pub fn weigh_by(samples: &mut [Sample], stride: usize, noise: &Noise, slope_q14: i32, shift: u32) {
    let most = (1 << (12 + shift)) - 1;
    let mut index = 0;
    while let Some(sample) = samples.get_mut(index) {
        index += stride.max(1);
        // Rounded down in 32 bits: by less than 1 in 2^4 for the largest variance there is, by 1 in 2^12 for a range noise of 10 mm. The lowest bit
        // of a variance, of which there are more than ten, only says that it is not zero.
        sample.weight = ((u32::MAX / (noise.variance(sample, slope_q14) | 1)) << 5).min(most);
    }
}

/// The square of a residual (below 2^15) over the variance by which [`weigh`] has weighed the sample, with so many fraction bits, up to 8:
/// below 2^(30 - 10 + 8). Other residuals give anything.
#[inline(always)]
pub fn ratio<const FRACTION: u32>(sample: &Sample, square: u32) -> u32 {
    ((u64::from(square) * u64::from(sample.weight)) >> (37 - FRACTION)) as u32
}

/// Residuals beyond this, 262 mm, count for nothing.
const E_MOST: i32 = (1 << 15) - 1;

/// Bits of the sum of roots of weights.
const KEPT_BITS: u32 = 21;

/// The sums of a fit over some samples, exact: those of more or fewer samples follow by adding and subtracting.
#[derive(Clone, Copy, Debug, Default)]
pub struct Sums {
    w: i32,
    wu: i64,
    we: i64,
    wuu: i64,
    wue: i64,
    count: u32,
    /// Sum of Tukey weight x squared residual over variance.
    chi2_q12: u32,
    /// Sum of Tukey weights.
    effective_q12: u32,
    /// Sum of their roots.
    kept_q12: u32,
}

impl Sums {
    /// Over samples that [`weigh`] has weighed, which gave `shift`.
    pub fn over(samples: &[Sample], stride: usize, line: &Line, shift: u32, gate: Gate) -> Self {
        let mut sums = Self::default();
        // Kept samples above, the roots of their weights below: 401 x 2^12 stays below 2^21.
        let mut count_kept = 0u32;
        let mut rest = samples;
        while let [sample, ..] = rest {
            rest = rest.get(stride.max(1)..).unwrap_or_default();
            let e = line.residual(sample);
            // As one comparison: what is not within +/- (2^15 - 1) wraps beyond.
            if e.wrapping_add(E_MOST) as u32 > 2 * E_MOST as u32 {
                continue;
            }
            // Which side of the line a sample is on, and whether it counts, cannot be predicted in vegetation: a sample past the gate is
            // kept with a weight of nothing. The product is at most 16384 x 6401, so below 2^27.
            let ratio_q8 = ratio::<8>(sample, (e * e) as u32).min(WIDEST_Q8);
            let inverse = gate.below + ((-e >> 31) as u32 & (gate.above - gate.below));
            let keep_q12 = 4096u32.saturating_sub((ratio_q8 * inverse) >> 12);
            let tukey_q12 = (keep_q12 * keep_q12) >> 12;
            let w = (((sample.weight >> shift) * tukey_q12) >> 12) as i32;
            let u = (sample.u - line.u) >> ARM_BITS;
            let wu = w * u;
            // Products of 64 bits are added in one instruction, those of 32 in three.
            sums.w += w;
            sums.wu += i64::from(w) * i64::from(u);
            sums.we += i64::from(w) * i64::from(e);
            sums.wuu += i64::from(wu) * i64::from(u);
            sums.wue += i64::from(wu) * i64::from(e);
            count_kept += u32::from(keep_q12 > 0) << KEPT_BITS | keep_q12;
            // Below 2^12 x 2^13 a sample; 401 of them, shifted, stay below 2^27.
            sums.effective_q12 += tukey_q12;
            sums.chi2_q12 += (tukey_q12 * ratio_q8) >> 8;
        }
        Self { count: count_kept >> KEPT_BITS, kept_q12: count_kept & ((1 << KEPT_BITS) - 1), ..sums }
    }

    /// With the samples of `more` as well.
    pub fn plus(&self, more: &Self) -> Self {
        Self {
            w: self.w + more.w,
            wu: self.wu + more.wu,
            we: self.we + more.we,
            wuu: self.wuu + more.wuu,
            wue: self.wue + more.wue,
            count: self.count + more.count,
            chi2_q12: self.chi2_q12 + more.chi2_q12,
            effective_q12: self.effective_q12 + more.effective_q12,
            kept_q12: self.kept_q12 + more.kept_q12,
        }
    }

    /// Without the samples of `fewer`, which are among them.
    pub fn minus(&self, fewer: &Self) -> Self {
        Self {
            w: self.w - fewer.w,
            wu: self.wu - fewer.wu,
            we: self.we - fewer.we,
            wuu: self.wuu - fewer.wuu,
            wue: self.wue - fewer.wue,
            count: self.count.saturating_sub(fewer.count),
            chi2_q12: self.chi2_q12.saturating_sub(fewer.chi2_q12),
            effective_q12: self.effective_q12.saturating_sub(fewer.effective_q12),
            kept_q12: self.kept_q12.saturating_sub(fewer.kept_q12),
        }
    }

    /// What Newton's step is of the reweighted one, 10 fraction bits: the sum of weights over that of the derivatives of weight x residual,
    /// which for Tukey's weight k^2 are 5 k^2 - 4 k. Between 1 (nothing but least squares) and 2.
    fn gain_q10(&self) -> i64 {
        let derivatives = (5 * self.effective_q12).saturating_sub(4 * self.kept_q12);
        if 2 * derivatives <= self.effective_q12 {
            return 2 << 10;
        }
        // Sums of 401 x 2^12 stay below 2^21.
        i64::from((self.effective_q12 << 10) / derivatives.max(1))
    }

    /// One step from `line`, about which the sums are, towards the line whose reweighted residuals balance: that of reweighted least
    /// squares, stretched to Newton's, which leaves a tenth of what the plain one does.
    /// Nothing when fewer than 3 samples are within the gate or all lie at one distance.
    pub fn solve(&self, line: &Line, shift: u32, gate: Gate) -> Option<Fit> {
        if self.count < 3 || self.w <= 0 {
            return None;
        }
        let mean_u = self.wu / i64::from(self.w);
        let mean_e = self.we / i64::from(self.w);
        let gain_q10 = self.gain_q10();
        let spread = self.wuu - 2 * mean_u * self.wu + mean_u * mean_u * i64::from(self.w);
        let lean = self.wue - mean_u * self.we;
        if spread <= 0 {
            return None;
        }
        // Both to 31 bits at most; the quotient is a change of slope in grains a 32 grains.
        let excess = 33u32.saturating_sub(spread.leading_zeros());
        let turn_q30 = (((lean >> excess) << (30 - ARM_BITS)) / (spread >> excess).max(1)).clamp(-(1 << 30), 1 << 30);
        let u = line.u + (mean_u << ARM_BITS) as i32;
        let slope_q30 =
            (i64::from(line.slope_q30) + ((turn_q30 * gain_q10) >> 10)).clamp(-(1 << 31) + 1, (1 << 31) - 1) as i32;
        let fitted = Line { u, z: line.height_at(u) + ((mean_e * gain_q10) >> 10) as i32, slope_q30 };
        // weight = 2^(37 - shift) / variance.
        let scale = 37 - shift as i32;
        // The residuals are those of the old line: the new one takes w (e - e')^2 out of them. The first product is below 2^51,
        // the second clamped to 2^62.
        let turned = (lean >> 16).clamp(-(1 << 32), 1 << 32) * turn_q30;
        let taken = mean_e * self.we + (turned >> (14 - ARM_BITS));
        let chi2_q12 = u64::from(self.chi2_q12).saturating_sub(taken.max(0) as u64 >> (scale - 12));
        Some(Fit {
            line: fitted,
            count: self.count,
            precision: Precision::Sums { w: self.w, spread, scale },
            chi2_q8: ((chi2_q12 * u64::from(gate.trim_q8)) >> 12) as u32,
            effective_q8: self.effective_q12 >> 4,
            gate,
        })
    }
}

/// [`Sums`] and their solution in one.
pub fn fit(samples: &[Sample], stride: usize, line: &Line, shift: u32, gate: Gate) -> Option<Fit> {
    Sums::over(samples, stride, line, shift, gate).solve(line, shift, gate)
}
