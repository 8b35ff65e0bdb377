//! The road: a line under the sensor, followed outward to where the surface leaves it.

use super::line::{Fit, Gate, Line, fit, weigh};
use super::sample::{Noise, Sample, millimetres};

/// How far on the other side of the sensor the road line still takes its points: short of a crown between lanes.
pub const INNER: i32 = millimetres(1_000);

/// The first piece of road reaches this far out ...
const FIRST_REACH: i32 = millimetres(1_200);
/// ... and each further one by this much, always with the line of the piece before.
const STRIDE: i32 = millimetres(1_200);

/// A departure is this many samples in a row beyond the threshold.
const DEPARTURE_SAMPLES: u32 = 4;

/// The fit ends this far before a departure, whose onset the threshold hides.
const MARGIN: i32 = millimetres(350);

/// A road of which fewer samples than this are seen is none.
const MIN_SAMPLES: u32 = 12;

/// Pseudo-observations that the assumed range noise counts for against the road's own residuals.
const PRIOR: u32 = 24;

/// The road line of one side.
#[derive(Clone, Copy, Debug)]
pub struct Road {
    pub fit: Fit,
    /// Index of the first sample of the significant departure; the number of samples when there is none.
    pub departure: usize,
    /// The noise with its range part brought up to date.
    pub noise: Noise,
}

/// Finds the road line.
pub fn find(samples: &mut [Sample], noise: Noise) -> Option<Road> {
    let mut noise = noise;
    let first = samples.partition_point(|s| s.u < FIRST_REACH);
    let mut line = Line { u: 0, z: median_height(samples), slope_q30: 0 };
    let near = samples.get_mut(..first)?;
    if near.len() < MIN_SAMPLES as usize {
        return None;
    }
    // Wide first: a cross slope of 5 degrees is 100 mm at the ends of the first piece.
    for range in [millimetres(40), millimetres(15)] {
        let wide = Noise { range: range as u32, ..noise };
        let shift = weigh(near, &wide, 0);
        line = fit(near, &line, shift, Gate::TUKEY)?.line;
    }
    let mut end = first;
    let mut best: Option<(Fit, u32)> = None;
    for _ in 0..8 {
        let part = samples.get_mut(..end)?;
        let shift = weigh(part, &noise, line.slope_q14());
        let once = fit(part, &line, shift, Gate::TUKEY)?;
        let found = fit(part, &once.line, shift, Gate::TUKEY)?;
        line = found.line;
        noise = updated(&noise, &found);
        best = Some((found, end as u32));
        let limit = departure(samples, &line, &noise, end.saturating_sub(1));
        let reach = samples.get(end.saturating_sub(1))?.u + STRIDE;
        let margin = samples.get(limit).map_or(i32::MAX, |s| s.u - MARGIN);
        let next = samples.partition_point(|s| s.u < reach.min(margin)).max(first);
        if next <= end {
            break;
        }
        end = next;
    }
    let (found, end) = best?;
    // Where less than half of the samples lie on the line, it is not the road.
    if found.count < MIN_SAMPLES || 2 * found.count < end {
        return None;
    }
    let departure = departure(samples, &found.line, &noise, end as usize);
    Some(Road { fit: found, departure, noise })
}

/// The point of significant departure, from sample `from` on: the first of [`DEPARTURE_SAMPLES`] in a row further from
/// the line than 4 sigma of the range noise and 3 mm, and than 12 mm.
fn departure(samples: &[Sample], line: &Line, noise: &Noise, from: usize) -> usize {
    let mut row = 0;
    for (index, sample) in samples.iter().enumerate().skip(from) {
        let g_q14 = i32::from(sample.down_q14) + ((line.slope_q14() * i32::from(sample.out_q14)) >> 14);
        let sigma = (noise.range as i32 * g_q14.abs()) >> 14;
        let threshold = (4 * sigma + millimetres(3)).max(millimetres(12));
        row = if line.residual(sample).abs() > threshold { row + 1 } else { 0 };
        if row == DEPARTURE_SAMPLES {
            return index + 1 - DEPARTURE_SAMPLES as usize;
        }
    }
    samples.len()
}

/// The range noise that explains the residuals of a fit, with the assumed one as a prior.
fn updated(noise: &Noise, found: &Fit) -> Noise {
    // Residuals of n effective samples have n - 2 degrees of freedom; ratio = mean square over what was assumed.
    let freedom_q8 = found.effective_q8.saturating_sub(2 << 8) + (PRIOR << 8);
    let chi2_q8 = found.chi2_q8 + (PRIOR << 8);
    let ratio_q10 = ((u64::from(chi2_q8) << 10) / u64::from(freedom_q8.max(1))).min(1 << 16);
    // At the road the beam is nearly square to the surface: g is about 0.9, and the surface's part is taken off.
    let assumed = u64::from(noise.range * noise.range) + u64::from(noise.rough2);
    let total = (assumed * ratio_q10) >> 10;
    let range = total.saturating_sub(u64::from(noise.rough2)).isqrt() as u32;
    Noise { range: range.clamp(millimetres(1) as u32 / 2, Noise::MAX_RANGE), ..*noise }
}

/// Median height of the nine samples nearest to straight down.
fn median_height(samples: &[Sample]) -> i32 {
    let middle = samples.partition_point(|s| s.u < 0);
    let from = middle.saturating_sub(4);
    let mut heights = [0i32; 9];
    let mut taken = 0;
    for (height, sample) in heights.iter_mut().zip(samples.iter().skip(from)) {
        *height = sample.z;
        taken += 1;
    }
    let Some(heights) = heights.get_mut(..taken) else { return 0 };
    heights.sort_unstable();
    heights.get(taken / 2).copied().unwrap_or(0)
}
