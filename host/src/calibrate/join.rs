//! Several rock tests in one: what the ground tilts is told from what the scanner tilts by turning the vehicle round.
//!
//! Standing in the direction `a`, the scanner sees `tilt . left(a) - offset error`. The ground's tilt, a vector of two numbers, and the offset are
//! the unknowns of a least-squares fit. It is the surveyor's reversal: two logs from one spot in opposite directions give the offset without
//! any level ground. What a slow error of the unit does to all of them alike stays in the offset's standard error.

use super::Estimate;

/// Logs whose directions differ by less than this, in degrees, cannot tell the ground from the scanner.
const LEAST_TURN_DEG: f64 = 120.0;

/// Joins estimates of parked vehicles: the offset over all directions, the delay as the weighted mean.
///
/// `old_offset_deg` is the offset that the logs were made with; all must have been made with the same. With one estimate it is given back as
/// it is; `None` when there is none, or when the vehicle drove in one of several.
#[must_use]
pub fn join(mut estimates: Vec<Estimate>, old_offset_deg: f64) -> Option<Estimate> {
    if estimates.len() < 2 {
        return estimates.pop();
    }
    if estimates.iter().any(|estimate| !estimate.parked) {
        return None;
    }
    let azimuths: Vec<f64> = estimates.iter().map(|estimate| estimate.azimuth_deg).collect();
    let turned = azimuths.iter().flat_map(|a| azimuths.iter().map(move |b| turn(*a, *b))).fold(0.0, f64::max);
    // What was taken for the offset is the offset less the ground's slope to the left.
    let seen: Vec<(f64, f64)> = estimates.iter().map(|e| (e.roll_offset_deg - old_offset_deg, e.azimuth_deg)).collect();
    let (change_deg, tilt) = if turned >= LEAST_TURN_DEG { fit(&seen)? } else { (mean(&seen), [0.0; 2]) };
    let weights: Vec<f64> = estimates
        .iter()
        .map(|e| if e.delay_determined { e.lidar_delay_se_us.max(1e-3).powi(-2) } else { 0.0 })
        .collect();
    let total: f64 = weights.iter().sum();
    let delay = estimates.iter().zip(&weights).map(|(e, w)| e.lidar_delay_us * w).sum::<f64>() / total.max(1e-12);
    let worst = estimates.iter().map(|e| e.roll_offset_se_deg).fold(0.0, f64::max);
    let mut joined = estimates.swap_remove(0);
    joined.roll_offset_deg = old_offset_deg + change_deg;
    // The unit's slow error is taken to be the same in all: turning the vehicle does not take it out, nor do more logs.
    joined.roll_offset_se_deg = worst;
    joined.delay_determined = total > 0.0;
    if joined.delay_determined {
        joined.lidar_delay_us = delay;
        joined.lidar_delay_se_us = total.powf(-0.5);
    }
    for other in &estimates {
        joined.scans += other.scans;
        joined.offset_determined &= other.offset_determined;
        joined.remarks.extend(other.left_out.iter().cloned());
    }
    joined.remarks[0] = if turned >= LEAST_TURN_DEG {
        let [north, east] = tilt;
        format!(
            "{} directions: the ground was found to tilt by {:.3} degrees, which is not in the offset",
            azimuths.len(),
            north.hypot(east)
        )
    } else {
        format!(
            "the directions differ by {turned:.0} degrees only: the surface is taken for level; with a log in the opposite direction it \
             need not be"
        )
    };
    Some(joined)
}

/// Angle between two directions, in degrees.
fn turn(a: f64, b: f64) -> f64 {
    let apart = (a - b).rem_euclid(360.0);
    apart.min(360.0 - apart)
}

fn mean(seen: &[(f64, f64)]) -> f64 {
    seen.iter().map(|(offset, _)| offset).sum::<f64>() / seen.len() as f64
}

/// Offset, and the ground's tilt towards north and east, in degrees. A tilt that two opposite directions leave open is taken for none.
fn fit(seen: &[(f64, f64)]) -> Option<(f64, [f64; 2])> {
    // What was taken for the offset is offset - tilt . left: normal equations of offset, tilt north, tilt east, with 2 % of doubt in the tilt.
    let mut matrix = [[0.0; 4]; 3];
    for &(value, azimuth_deg) in seen {
        let (sin, cos) = azimuth_deg.to_radians().sin_cos();
        // To the left of a direction, towards north and east.
        let row = [1.0, -sin, cos, value];
        for (i, equation) in matrix.iter_mut().enumerate() {
            for (j, cell) in equation.iter_mut().enumerate() {
                *cell += row[i] * row[j];
            }
        }
    }
    for (i, equation) in matrix.iter_mut().enumerate().skip(1) {
        // An observation of no tilt, a hundred times less certain than what was seen.
        equation[i] += 1e-4;
    }
    for pivot in 0..3 {
        let row = matrix[pivot];
        if row[pivot].abs() < 1e-12 {
            return None;
        }
        for other in (0..3).filter(|other| *other != pivot) {
            let factor = matrix[other][pivot] / row[pivot];
            for (cell, value) in matrix[other].iter_mut().zip(row) {
                *cell -= factor * value;
            }
        }
    }
    let [offset, north, east] = [0, 1, 2].map(|i| matrix[i][3] / matrix[i][i]);
    Some((offset, [north, east]))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_ground_is_told_from_the_scanner_by_turning_round() {
        // A scanner tilted by 0.8 degrees on ground that rises by 1.3 degrees to the left of a vehicle heading north.
        let seen = |azimuth: f64| (0.8 - 1.3 * azimuth.to_radians().cos(), azimuth);
        let (offset, [_, east]) = fit(&[seen(0.0), seen(180.0)]).unwrap();
        assert!((offset - 0.8).abs() < 1e-3, "{offset}");
        assert!((east + 1.3).abs() < 1e-3, "to the left of north is west: {east}");
        let (offset, _) = fit(&[seen(10.0), seen(130.0), seen(250.0)]).unwrap();
        assert!((offset - 0.8).abs() < 1e-3, "{offset}");
    }
}
