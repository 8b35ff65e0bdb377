//! A regression over residuals whose errors last from one scan to the next, and what else is taken of them.

pub use super::ground::Residual;
use crate::statistics::upper_median;

/// How long errors are allowed to last in the regression, in seconds.
const MEMORY_S: f64 = 1.0;

/// A longer pause between two residuals is a gap, in seconds: the road behind it is another one, and no mean is taken over both.
const GAP_S: f64 = 1.0;

/// A fit of the slope over the roll rate.
#[derive(Clone, Copy, Debug)]
pub struct Regression {
    /// Change of the delay that takes the roll rate out of the residuals, in microseconds.
    pub slope: f64,
    /// Its standard error.
    pub slope_se: f64,
}

/// What varies slowly is taken out of the residuals and of the roll rate alike, by what remains after their mean over twice `half_s` around is taken off,
/// `passes` times over: the drift of the unit's attitude, the changing cross slope of a road.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HighPass {
    half_s: f64,
    passes: u32,
}

impl HighPass {
    /// What a rock test wants: nearly all of its roll passes.
    pub const GENTLE: Self = Self { half_s: 1.0, passes: 1 };

    /// The one that leaves the delay the least standard error. A road whose cross slope changes as fast as the vehicle rolls wants a sharp one;
    /// where none halves the error, as on a rock test, it is the gentle one.
    pub fn best(points: &[Residual]) -> Self {
        let gentle = regress(points, Self::GENTLE).slope_se;
        let sharper =
            [0.7, 0.5, 0.35, 0.25].into_iter().flat_map(|half_s| [1, 2, 3].map(|passes| Self { half_s, passes }));
        let tried = sharper.map(|filter| (filter, regress(points, filter).slope_se));
        let best = tried.min_by(|a, b| a.1.total_cmp(&b.1)).filter(|(_, se)| *se < 0.5 * gentle);
        best.map_or(Self::GENTLE, |(filter, _)| filter)
    }

    fn of(self, points: &[Residual], pick: fn(&Residual) -> f64) -> Vec<f64> {
        let half = scans_in(points, self.half_s);
        let mut values: Vec<f64> = points.iter().map(pick).collect();
        let mut rest = values.as_mut_slice();
        for stretch in points.chunk_by(|a, b| b.seconds - a.seconds <= GAP_S) {
            let (here, others) = rest.split_at_mut(stretch.len());
            (0..self.passes).for_each(|_| without_mean_around(here, half));
            rest = others;
        }
        values
    }
}

/// Takes the mean over `half` values to either side off each value.
fn without_mean_around(values: &mut [f64], half: usize) {
    let mut sums = vec![0.0; values.len() + 1];
    for (i, value) in values.iter().enumerate() {
        sums[i + 1] = sums[i] + value;
    }
    let count = values.len();
    for (i, value) in values.iter_mut().enumerate() {
        let (from, to) = (i.saturating_sub(half), (i + half + 1).min(count));
        *value -= (sums[to] - sums[from]) / (to - from) as f64;
    }
}

/// Regresses the residuals on their derivative by the delay.
pub fn regress(points: &[Residual], filter: HighPass) -> Regression {
    let slopes = filter.of(points, |point| point.slope_deg);
    let rates = filter.of(points, |point| point.rate_deg_us);
    let power: f64 = rates.iter().map(|rate| rate * rate).sum();
    let product: f64 = rates.iter().zip(&slopes).map(|(rate, slope)| rate * slope).sum();
    // The residual must become independent of the rate: residual + rate x change = constant.
    let slope = if power > 0.0 { -product / power } else { 0.0 };
    let scores: Vec<f64> = rates.iter().zip(&slopes).map(|(rate, s)| rate * (s + rate * slope)).collect();
    let memory = scans_in(points, MEMORY_S);
    let mut variance: f64 = scores.iter().map(|score| score * score).sum();
    for lag in 1..=memory.min(scores.len().saturating_sub(1)) {
        let weight = 1.0 - lag as f64 / (memory + 1) as f64;
        variance += 2.0 * weight * scores.iter().zip(&scores[lag..]).map(|(a, b)| a * b).sum::<f64>();
    }
    // A sharp filter's notch lies within the resolution of a memory of one second: on white noise the estimate was two thirds of the truth.
    let notch = if filter == HighPass::GENTLE { 1.0 } else { 1.5 };
    let slope_se = if power > 0.0 { notch * variance.max(0.0).sqrt() / power } else { f64::INFINITY };
    Regression { slope, slope_se }
}

/// How many scans there are in so many seconds, by the median interval.
pub fn scans_in(points: &[Residual], seconds: f64) -> usize {
    let mut steps: Vec<f64> = points.windows(2).map(|pair| pair[1].seconds - pair[0].seconds).collect();
    upper_median(&mut steps).map_or(1, |step| (seconds / step.max(1e-3)).round() as usize)
}

/// Slope of the least-squares line through points.
pub fn line_slope(points: &[(f64, f64)]) -> f64 {
    let count = points.len().max(1) as f64;
    let (mean_x, mean_y) =
        (points.iter().map(|p| p.0).sum::<f64>() / count, points.iter().map(|p| p.1).sum::<f64>() / count);
    let product: f64 = points.iter().map(|(x, y)| (x - mean_x) * (y - mean_y)).sum();
    let spread: f64 = points.iter().map(|(x, _)| (x - mean_x) * (x - mean_x)).sum();
    product / spread
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Ten stretches of ten seconds on roads of different cross slopes, `pause_s` apart, with a delay of a millisecond.
    fn stretches(pause_s: f64) -> Vec<Residual> {
        let scan = |number: u32| {
            let (stretch, within) = (number / 375, f64::from(number) * 0.026_667);
            let cross_slope_deg = 1.5 * f64::from(stretch * 7 % 5) - 3.0;
            // Two degrees at 0.4 Hz and one at 1.1 Hz, in degrees a microsecond.
            let rate_deg_us = 1e-6 * (5.0 * (2.5 * within).cos() + 6.9 * (6.9 * within).cos());
            Residual {
                seconds: within + f64::from(stretch) * pause_s,
                slope_deg: cross_slope_deg - 1_000.0 * rate_deg_us,
                rate_deg_us,
                ..Residual::default()
            }
        };
        (0..3_750).map(scan).collect()
    }

    #[test]
    fn nothing_is_averaged_over_a_gap() {
        let found = regress(&stretches(5.0), HighPass::GENTLE);
        assert!((found.slope - 1_000.0).abs() < 0.1 && found.slope_se < 0.1, "{found:?}");
        // Where the road itself changes so, the delay is less certain, and said to be.
        let uncertain = regress(&stretches(0.0), HighPass::GENTLE);
        assert!(uncertain.slope_se > 1_000.0 * found.slope_se, "{uncertain:?}");
    }
}
