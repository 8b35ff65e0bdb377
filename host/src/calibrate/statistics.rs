//! Means and a regression over residuals whose errors last from one scan to the next.

pub use super::ground::Residual;

/// Length of the means that a lasting error is judged by, in seconds.
const BLOCK_S: f64 = 0.5;

/// How long errors are allowed to last in the regression, in seconds.
const MEMORY_S: f64 = 1.0;

/// A fit of the slope over the roll rate.
#[derive(Clone, Copy, Debug)]
pub struct Regression {
    /// Change of the delay that takes the roll rate out of the residuals, in microseconds.
    pub slope: f64,
    /// Its standard error.
    pub slope_se: f64,
}

/// Root of the mean square; 0 of nothing.
pub fn rms(values: impl Iterator<Item = f64>) -> f64 {
    let (count, sum) = values.fold((0.0, 0.0), |(count, sum), value| (count + 1.0, sum + value * value));
    if count > 0.0 { (sum / count).sqrt() } else { 0.0 }
}

/// Standard deviation; 0 of nothing.
pub fn deviation(values: impl Iterator<Item = f64> + Clone) -> f64 {
    let count = values.clone().count() as f64;
    let mean = values.clone().sum::<f64>() / count.max(1.0);
    rms(values.map(|value| value - mean))
}

/// Regresses the residuals on their derivative by the delay, with what varies slower than a second or so taken out of both: the drift
/// of the unit's attitude, the changing cross slope of a road.
pub fn regress(points: &[Residual]) -> Regression {
    let slopes = high_pass(points, |point| point.slope_deg);
    let rates = high_pass(points, |point| point.rate_deg_us);
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
    let slope_se = if power > 0.0 { variance.max(0.0).sqrt() / power } else { f64::INFINITY };
    Regression { slope, slope_se }
}

/// The mean of the residuals and what it may be off by.
#[derive(Clone, Copy, Debug, Default)]
pub struct Mean {
    /// The mean.
    pub mean: f64,
    /// Variance that lasts from one half second to the next, about the mean: what moved within the record.
    pub slow_variance: f64,
    /// Variance of the mean by noise that does not last.
    pub fast_variance: f64,
    /// Variance of the mean if half-second means are a first-order autoregression.
    pub autoregressive_variance: f64,
}

/// The mean of the residuals and its variances.
pub fn mean(points: &[Residual]) -> Mean {
    let count = points.len() as f64;
    let mean = points.iter().map(|point| point.slope_deg).sum::<f64>() / count;
    let block = scans_in(points, BLOCK_S).max(1);
    let blocks: Vec<f64> = points
        .chunks_exact(block)
        .map(|part| part.iter().map(|point| point.slope_deg - mean).sum::<f64>() / block as f64)
        .collect();
    let n = blocks.len() as f64;
    let power: f64 = blocks.iter().map(|b| b * b).sum();
    if n < 4.0 || power <= 0.0 {
        let fast_variance = deviation(points.iter().map(|point| point.slope_deg)).powi(2);
        return Mean { mean, fast_variance, ..Mean::default() };
    }
    let lagged: f64 = blocks.windows(2).map(|pair| pair[0] * pair[1]).sum();
    let slow_variance = (lagged / (n - 1.0)).max(0.0);
    // The autocorrelation of a short record is found too small by (1 + 3 rho) / n (Kendall 1954).
    let found = lagged / power;
    let rho = (found + (1.0 + 3.0 * found) / n).clamp(0.0, 0.98);
    // So is the variance about the record's own mean, by the variance of that mean.
    let inflation = (1.0 + rho) / (1.0 - rho);
    let own = (inflation / n).min(0.75);
    let variance = power / (n - 1.0) / (1.0 - own);
    Mean {
        mean,
        slow_variance,
        fast_variance: (power / n - slow_variance).max(0.0) / n,
        autoregressive_variance: variance * inflation.min(n) / n,
    }
}

/// How many scans there are in so many seconds, by the median interval.
fn scans_in(points: &[Residual], seconds: f64) -> usize {
    let mut steps: Vec<f64> = points.windows(2).map(|pair| pair[1].seconds - pair[0].seconds).collect();
    if steps.is_empty() {
        return 1;
    }
    let middle = steps.len() / 2;
    let (_, step, _) = steps.select_nth_unstable_by(middle, f64::total_cmp);
    (seconds / step.max(1e-3)).round() as usize
}

/// What remains of a quantity after its mean over two seconds around is taken off.
fn high_pass(points: &[Residual], pick: fn(&Residual) -> f64) -> Vec<f64> {
    let half = scans_in(points, 1.0);
    let mut sums = vec![0.0; points.len() + 1];
    for (i, point) in points.iter().enumerate() {
        sums[i + 1] = sums[i] + pick(point);
    }
    let mean = |i: usize| {
        let (from, to) = (i.saturating_sub(half), (i + half + 1).min(points.len()));
        (sums[to] - sums[from]) / (to - from) as f64
    };
    points.iter().enumerate().map(|(i, point)| pick(point) - mean(i)).collect()
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
