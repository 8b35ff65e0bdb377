//! Profiles held against the truth of a simulated drive.

use serde::Serialize;

use crate::profiles::{Row, SlopeRow};
use crate::side::Side;
use crate::simulate::truth;
use crate::statistics::{rms, upper_median};

/// How well one quantity was measured.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Accuracy {
    /// The quantity.
    pub what: &'static str,
    /// `deg` or `m`.
    pub unit: &'static str,
    /// Share of scans in which it was found.
    pub found: f64,
    /// Root mean square of the error.
    pub rms: f64,
    /// Median of the error's magnitude.
    pub median: f64,
    /// Mean of the error.
    pub bias: f64,
    /// Share of 95 % intervals that hold the truth; absent for what has none.
    pub coverage: Option<f64>,
}

/// A value, its interval's half width if it has one, and the truth.
type Sample = (f64, Option<f64>, f64);

/// Compares every scan's profile with the scan's truth.
#[must_use]
pub fn hold_against(rows: &[Row], truth: &[truth::Row]) -> Vec<Accuracy> {
    let of = |row: &Row| truth.get(row.scan as usize);
    let slope = |found: Option<SlopeRow>, truth: f64| found.map(|s| (s.slope_deg, s.ci95_deg, truth));
    let side = |side: Side, sample: &dyn Fn(&Row, &truth::Row) -> Option<Sample>| -> Vec<Sample> {
        rows.iter().filter(|row| row.side == side).filter_map(|row| sample(row, of(row)?)).collect()
    };
    let scans = truth.len();
    vec![
        judge("roll", "deg", scans, &side(Side::Left, &|row, truth| Some((row.roll_deg, None, truth.roll_deg)))),
        judge(
            "left road edge",
            "m",
            scans,
            &side(Side::Left, &|row, truth| Some((row.edge_y_m?, None, truth.section.left.edge_m))),
        ),
        judge(
            "left adjacent slope",
            "deg",
            scans,
            &side(Side::Left, &|row, truth| slope(row.adjacent, truth.section.left.adjacent_slope_deg)),
        ),
        judge(
            "left opposing slope",
            "deg",
            scans,
            &side(Side::Left, &|row, truth| slope(row.opposing, truth.section.left.opposing_slope_deg)),
        ),
        judge(
            "right road edge",
            "m",
            scans,
            &side(Side::Right, &|row, truth| Some((row.edge_y_m?, None, -truth.section.right.edge_m))),
        ),
        judge(
            "right adjacent slope",
            "deg",
            scans,
            &side(Side::Right, &|row, truth| slope(row.adjacent, truth.section.right.adjacent_slope_deg)),
        ),
        judge(
            "right opposing slope",
            "deg",
            scans,
            &side(Side::Right, &|row, truth| slope(row.opposing, truth.section.right.opposing_slope_deg)),
        ),
    ]
}

fn judge(what: &'static str, unit: &'static str, scans: usize, samples: &[Sample]) -> Accuracy {
    let count = samples.len().max(1) as f64;
    let errors = samples.iter().map(|(value, _, truth)| value - truth);
    let mut sizes: Vec<f64> = errors.clone().map(f64::abs).collect();
    let intervals: Vec<bool> =
        samples.iter().filter_map(|(value, half, truth)| half.map(|half| (value - truth).abs() <= half)).collect();
    Accuracy {
        what,
        unit,
        found: samples.len() as f64 / scans.max(1) as f64,
        rms: rms(errors.clone()),
        median: upper_median(&mut sizes).unwrap_or_default(),
        bias: errors.sum::<f64>() / count,
        coverage: (!intervals.is_empty())
            .then(|| intervals.iter().filter(|held| **held).count() as f64 / intervals.len() as f64),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn errors_and_coverage_are_what_they_say() {
        let samples = [(1.0, Some(0.5), 1.4), (2.0, Some(0.5), 1.0), (3.0, None, 3.0)];
        let judged = judge("slope", "deg", 4, &samples);
        assert_eq!(judged.found, 0.75);
        assert!((judged.rms - (1.16_f64 / 3.0).sqrt()).abs() < 1e-12);
        assert!((judged.median - 0.4).abs() < 1e-12);
        assert!((judged.bias - 0.2).abs() < 1e-12);
        assert_eq!(judged.coverage, Some(0.5));
    }
}
