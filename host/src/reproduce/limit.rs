//! What the sensors' noise leaves to a perfect evaluation.

use crate::compare::Kind;
use crate::side::Side;
use crate::simulate::scene::Ins;
use crate::simulate::section::{Section, cast};

/// Angle between the scanner's beams.
const STEP_DEG: f64 = 0.5;

/// Beyond this nothing returns.
const MAX_RANGE_M: f64 = 30.0;

/// Cramer and Rao's bound of a slope, in degrees: the standard deviation of the best unbiased fit to the returns between the true ends of the
/// slope, of which a share counts. Every range errs by `sigma_m` along its beam, which shows in height by g = down + slope x out.
pub fn slope_deg(section: &Section, side: Side, kind: Kind, sigma_m: f64, share: f64) -> f64 {
    let left = side == Side::Left;
    let side = if left { &section.left } else { &section.right };
    let (from, to, slope_deg) = match kind {
        Kind::Adjacent => (side.edge_m, side.adjacent_end_m(), side.adjacent_slope_deg),
        Kind::Opposing => (side.opposing_start_m(), side.opposing_end_m(), side.opposing_slope_deg),
    };
    let ground = section.ground(left);
    let slope = slope_deg.to_radians().tan();
    let (mut weights, mut moment, mut squares) = (0.0, 0.0, 0.0);
    for beam in 0..(180.0 / STEP_DEG) as u32 {
        let angle = (f64::from(beam) * STEP_DEG).to_radians();
        let (out, down) = (angle.sin(), angle.cos());
        let Some(range) = cast(&ground, out, -down, 0.0).filter(|range| *range <= MAX_RANGE_M) else { continue };
        let y = range * out;
        if (from..to).contains(&y) {
            let weight = share / (sigma_m * (down + slope * out)).powi(2);
            weights += weight;
            moment += weight * y;
            squares += weight * y * y;
        }
    }
    let spread = squares - moment * moment / weights;
    // An angle's share of its tangent.
    (spread.powf(-0.5) / (1.0 + slope * slope)).to_degrees()
}

/// The bound of the ground's slope under the sensor, within so many metres to both sides, in degrees.
pub fn ground_deg(height_m: f64, reach_m: f64, sigma_m: f64) -> f64 {
    let mut squares = 0.0;
    for beam in 0..=(180.0 / STEP_DEG) as u32 {
        let angle = (f64::from(beam) * STEP_DEG - 90.0).to_radians();
        let y = height_m * angle.tan();
        if y.abs() <= reach_m {
            squares += (y / (sigma_m * angle.cos())).powi(2);
        }
    }
    squares.powf(-0.5).to_degrees()
}

/// What of a unit's roll error moves within a record, one sigma in degrees: white noise, and a drift without the part that the record's mean takes out.
pub fn roll_within_deg(ins: &Ins, seconds: f64) -> f64 {
    let drift = ins.attitude_drift_deg.powi(2) * (1.0 - mean_share(ins.attitude_drift_s, seconds));
    (drift + ins.attitude_white_deg.powi(2)).sqrt()
}

/// What the mean over a record is off by, one sigma in degrees.
pub fn roll_mean_deg(ins: &Ins, seconds: f64) -> f64 {
    ins.attitude_drift_deg * mean_share(ins.attitude_drift_s, seconds).sqrt()
}

/// The share of a drift's variance that the mean over a record has: a first-order process with this time constant.
fn mean_share(time_constant_s: f64, seconds: f64) -> f64 {
    let ratio = time_constant_s / seconds;
    2.0 * ratio * (1.0 - ratio * (1.0 - (-1.0 / ratio).exp()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::simulate::section::Side;

    /// Published with the method: sensor at 2.5 m, edge at 3.5 m, slopes of 1 in 6.
    #[test]
    fn bounds_are_those_that_were_worked_out_by_hand() {
        let side = |adjacent_length_m: f64| Side {
            edge_m: 3.5,
            adjacent_slope_deg: -9.46,
            adjacent_length_m,
            ditch_m: 0.5,
            opposing_slope_deg: 9.46,
            opposing_length_m: 6.0,
        };
        let section =
            |length: f64| Section { height_m: 2.5, cross_slope_deg: 0.0, left: side(length), right: side(length) };
        let close = |found: f64, expected: f64| assert!((found / expected - 1.0).abs() < 0.15, "{found}, {expected}");
        close(slope_deg(&section(3.0), super::Side::Left, Kind::Adjacent, 0.0035, 1.0), 0.0165);
        close(slope_deg(&section(5.0), super::Side::Left, Kind::Adjacent, 0.010, 1.0), 0.021);
        close(slope_deg(&section(3.0), super::Side::Left, Kind::Opposing, 0.0035, 1.0), 0.0088);
    }

    #[test]
    fn a_mean_over_a_long_record_has_little_of_a_drift() {
        assert!((mean_share(1e6, 60.0) - 1.0).abs() < 1e-3);
        assert!((mean_share(30.0, 60.0) - 0.5677).abs() < 1e-3);
        assert!(mean_share(1.0, 600.0) < 0.01);
    }
}
