//! The mean of residuals that carry the drifting error of an inertial unit, and what that mean is off by.
//!
//! A unit's roll error is noise that is new with every pose and a slow part that drifts. How long the slow part remembers is not published, and a
//! record of a minute cannot tell a memory of minutes by itself: it sees what moved, not what stayed. So the memory is an unknown
//! like the mean. For each of a series of memories, from a second to a fortnight, the slow part is a first-order Gauss-Markov process with the published
//! accuracy for its standard deviation (or more, where the record shows more: a road's cross slope); a Kalman filter gives the best linear unbiased
//! mean, its variance, and how likely the record is (Harvey, *Forecasting, structural time series models and the Kalman filter*, 1989, section 3.4). The
//! answer is the mean over all of these by their likelihoods, all memories being as likely beforehand in their logarithm.
//!
//! What this cannot do, nor can anything: with a memory m and a deviation s, a record of length t leaves s sqrt(2 / (2 + t / m)) in the mean, and all of s
//! when the error does not move. What stays over the whole record passes for mounting offset, and belongs into it.

use super::ground::Residual;
use super::statistics::scans_in;
use crate::intervals::ROLL_SD_DEG;
use crate::statistics::deviation;

/// Length of the means that the filter is given, in seconds.
const BLOCK_S: f64 = 0.5;

/// The memories that are tried: from one second on, each so many times the one before.
const MEMORIES: i32 = 21;
const MEMORY_RATIO: f64 = 2.0;

/// The mean of the residuals and its standard error, in degrees.
#[derive(Clone, Copy, Debug)]
pub struct Mean {
    pub mean_deg: f64,
    pub se_deg: f64,
}

/// What one model makes of a record.
#[derive(Clone, Copy, Debug)]
struct Filtered {
    mean: f64,
    variance: f64,
    log_likelihood: f64,
}

/// The mean of the residuals, in the order of time.
pub fn mean(points: &[Residual]) -> Mean {
    let per_block = scans_in(points, BLOCK_S).max(1);
    let (mut blocks, mut scatter, mut count) = (Vec::new(), 0.0, 0.0);
    for part in points.chunks_exact(per_block) {
        let size = part.len() as f64;
        let slope = part.iter().map(|point| point.slope_deg).sum::<f64>() / size;
        let seconds = part.iter().map(|point| point.seconds).sum::<f64>() / size;
        scatter += part.iter().map(|point| (point.slope_deg - slope).powi(2)).sum::<f64>();
        count += size - 1.0;
        blocks.push((seconds, slope));
    }
    if blocks.len() < 2 {
        let all = points.len().max(1) as f64;
        let mean_deg = points.iter().map(|point| point.slope_deg).sum::<f64>() / all;
        let se_deg = deviation(points.iter().map(|point| point.slope_deg)).hypot(ROLL_SD_DEG);
        return Mean { mean_deg, se_deg };
    }
    // Noise of a block; a ten-thousandth of a degree for what the model leaves out keeps perfect data from being infinitely sure.
    let noise = scatter / f64::max(count, 1.0) / per_block as f64 + 1e-8;
    averaged(&blocks, noise)
}

/// Over all memories, by how likely each makes the record. The drift's variance is the published one, or the record's own where that is more: what a record
/// shows does not tell variance and memory apart, so that one of the two must be known.
fn averaged(blocks: &[(f64, f64)], noise: f64) -> Mean {
    let count = blocks.len() as f64;
    let middle = blocks.iter().map(|(_, value)| value).sum::<f64>() / count;
    let moved = blocks.iter().map(|(_, value)| (value - middle).powi(2)).sum::<f64>() / count - noise;
    let variance = moved.max(ROLL_SD_DEG * ROLL_SD_DEG);
    let tried: Vec<Filtered> = (0..MEMORIES).map(|m| filtered(blocks, noise, variance, MEMORY_RATIO.powi(m))).collect();
    let most = tried.iter().map(|found| found.log_likelihood).fold(f64::NEG_INFINITY, f64::max);
    let weigh = |found: &Filtered| (found.log_likelihood - most).exp();
    let total: f64 = tried.iter().map(weigh).sum();
    let of =
        |part: &dyn Fn(&Filtered) -> f64| tried.iter().map(|found| weigh(found) * part(found)).sum::<f64>() / total;
    let mean_deg = of(&|found| found.mean);
    let variance = of(&|found| found.variance + (found.mean - mean_deg).powi(2));
    Mean { mean_deg, se_deg: variance.sqrt() }
}

/// The generalized least-squares mean of a Gauss-Markov process in noise, by one pass of a Kalman filter over the record and over ones.
fn filtered(blocks: &[(f64, f64)], noise: f64, drift: f64, memory_s: f64) -> Filtered {
    let (mut state, mut unit, mut variance) = (0.0, 0.0, drift);
    let (mut squares, mut product, mut information, mut logs) = (0.0, 0.0, 0.0, 0.0);
    let mut before: Option<f64> = None;
    for &(seconds, value) in blocks {
        if let Some(before) = before.replace(seconds) {
            let keep = (-(seconds - before).max(0.0) / memory_s).exp();
            (state, unit) = (keep * state, keep * unit);
            // What is forgotten is new; 1 - keep^2 without cancellation.
            let renewed = -(-2.0 * (seconds - before).max(0.0) / memory_s).exp_m1();
            variance = keep * keep * variance + drift * renewed;
        }
        let spread = variance + noise;
        let (off, one) = (value - state, 1.0 - unit);
        squares += off * off / spread;
        product += off * one / spread;
        information += one * one / spread;
        logs += spread.ln();
        let gain = variance / spread;
        state += gain * off;
        unit += gain * one;
        variance *= 1.0 - gain;
    }
    let mean = product / information;
    let log_likelihood = -0.5 * (logs + information.ln() + squares - product * mean);
    Filtered { mean, variance: 1.0 / information, log_likelihood }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::simulate::noise::{Drift, Noise, Purpose};

    /// Half-second means of a unit's error with this memory, about a mean of 0.
    fn record(seed: u64, seconds: f64, memory_s: f64, drift_deg: f64) -> Vec<(f64, f64)> {
        let mut noise = Noise::new(seed, Purpose::Inertial);
        let mut drift = Drift::new(memory_s, BLOCK_S, &mut noise);
        (0..(seconds / BLOCK_S) as u32)
            .map(|i| (f64::from(i) * BLOCK_S, drift_deg * drift.step(&mut noise) + 0.003 * noise.normal()))
            .collect()
    }

    /// Root mean square of the error, the same in standard errors, and the root mean square of the standard error over many records.
    fn judged(seconds: f64, memory_s: f64) -> (f64, f64, f64) {
        let (mut squares, mut normalized, mut claimed) = (0.0, 0.0, 0.0);
        let records = 200;
        for seed in 0..records {
            let found = averaged(&record(seed, seconds, memory_s, ROLL_SD_DEG), 0.003_f64.powi(2));
            squares += found.mean_deg.powi(2);
            normalized += (found.mean_deg / found.se_deg).powi(2);
            claimed += found.se_deg.powi(2);
        }
        let root = |sum: f64| (sum / records as f64).sqrt();
        (root(squares), root(normalized), root(claimed))
    }

    #[test]
    fn standard_errors_hold_whatever_the_memory() {
        for (seconds, memory_s) in
            [(60.0, 3.0), (60.0, 30.0), (60.0, 300.0), (60.0, 1e7), (600.0, 30.0), (600.0, 300.0)]
        {
            let (error, normalized, claimed) = judged(seconds, memory_s);
            let bound = ROLL_SD_DEG * (2.0 / (2.0 + seconds / memory_s)).sqrt();
            println!(
                "{seconds} s, memory {memory_s} s: error {error:.4}, claimed {claimed:.4}, bound {bound:.4}, ratio {normalized:.2}"
            );
            // Never too sure, and as good as a memory that is known would allow.
            assert!(normalized < 1.15, "{seconds} s of {memory_s} s: {normalized}");
            assert!(error < 1.15 * bound + 0.0005, "{seconds} s of {memory_s} s: {error} for {bound}");
        }
    }

    #[test]
    fn a_filter_gives_the_mean_of_least_squares() {
        // Without memory between blocks the mean is the plain one; with a memory beyond the record its variance is the drift's.
        let blocks: Vec<(f64, f64)> = (0..8).map(|i| (f64::from(i), f64::from(i * i % 5))).collect();
        let plain = blocks.iter().map(|(_, value)| value).sum::<f64>() / 8.0;
        let forgetful = filtered(&blocks, 0.5, 1.5, 1e-3);
        assert!((forgetful.mean - plain).abs() < 1e-12 && (forgetful.variance - 2.0 / 8.0).abs() < 1e-12);
        let lasting = filtered(&blocks, 0.5, 1.5, 1e12);
        assert!((lasting.mean - plain).abs() < 1e-6 && (lasting.variance - (1.5 + 0.5 / 8.0)).abs() < 1e-6);
    }
}
