//! Several rock tests in one: what the ground tilts is told from what the scanner tilts by turning the vehicle round.
//!
//! Standing in the direction `a`, the scanner sees `tilt . left(a) - offset error`. The ground's tilt, a vector of two numbers, and the offset are
//! the unknowns of a least-squares fit. It is the surveyor's reversal: two logs from one spot in opposite directions give the offset without
//! any level ground. What a slow error of the unit does to all of them alike stays in the offset's standard error.
//!
//! Two directions say nothing of the tilt along their bisector, which looks like an offset of its cosine: nothing in opposite directions, half of
//! the tilt 120 degrees apart. Of it is known what is known of any paved ground, and the doubt is in the offset's standard error.

use super::Estimate;
use super::estimate::{MAX_OFFSET_SE_DEG, ROAD_PRIOR_DEG, offset_remark};

/// Logs whose directions differ by less than this, in degrees, are not taken for a reversal: the ground is taken for level, as for a single one.
const LEAST_TURN_DEG: f64 = 120.0;

/// Least standard error of a log's offset, in degrees: keeps the fit regular.
const LEAST_SE_DEG: f64 = 1e-4;

/// Joins estimates of parked vehicles: the offset over all directions, the delay as the weighted mean, residuals over all scans.
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
    let worst = estimates.iter().map(|e| e.roll_offset_se_deg).fold(0.0, f64::max);
    let reversed = turned >= LEAST_TURN_DEG;
    let (change_deg, offset_se_deg, ground) = if reversed {
        let Fit { offset_deg, se_deg, tilt: [north, east] } = fit(&seen, worst)?;
        let said = if se_deg <= MAX_OFFSET_SE_DEG {
            let tilt_deg = north.hypot(east);
            format!(
                "{} directions: the ground was found to tilt by {tilt_deg:.3} degrees, which is not in the offset",
                seen.len()
            )
        } else {
            format!(
                "{} directions, {turned:.0} degrees apart at most: they do not tell the ground's tilt from the scanner's",
                seen.len()
            )
        };
        (offset_deg, se_deg, said)
    } else {
        let said = format!(
            "the directions differ by {turned:.0} degrees only: the surface is taken for level; with a log in the opposite direction it \
             need not be"
        );
        // Ground that is level looks the same in all directions.
        let values = seen.iter().map(|(value, _)| *value);
        let mean = values.clone().sum::<f64>() / seen.len() as f64;
        (mean, worst.max(crate::statistics::deviation(values)), said)
    };
    let offset_determined =
        offset_se_deg <= MAX_OFFSET_SE_DEG && estimates.iter().all(|estimate| estimate.offset_determined);
    let weights: Vec<f64> = estimates
        .iter()
        .map(|e| if e.delay_determined { e.lidar_delay_se_us.max(1e-3).powi(-2) } else { 0.0 })
        .collect();
    let total: f64 = weights.iter().sum();
    let delay_determined = total > 0.0;
    let delay = estimates.iter().zip(&weights).map(|(e, w)| e.lidar_delay_us * w).sum::<f64>() / total.max(1e-12);

    let first = estimates.first()?;
    let left_out: Vec<String> = estimates.iter().flat_map(|estimate| estimate.left_out.iter().cloned()).collect();
    let mut remarks = vec![ground];
    let delay_remark = first.delay_remark.clone().filter(|_| !delay_determined);
    remarks.extend(delay_remark.clone());
    if !offset_determined {
        let advice =
            "turn the vehicle right round, to within nine degrees of opposite, or add a log in a third direction";
        remarks.push(offset_remark(offset_se_deg, advice));
    }
    remarks.extend(left_out.iter().cloned());
    Some(Estimate {
        roll_offset_deg: old_offset_deg + change_deg,
        roll_offset_se_deg: offset_se_deg,
        offset_determined,
        lidar_delay_us: if delay_determined { delay } else { first.lidar_delay_us },
        lidar_delay_se_us: if delay_determined { total.powf(-0.5) } else { first.lidar_delay_se_us },
        delay_determined,
        remarks,
        delay_remark,
        left_out,
        parked: true,
        scans: estimates.iter().map(|estimate| estimate.scans).sum(),
        roll_rate_rms_deg_s: pooled(&estimates, |estimate| estimate.roll_rate_rms_deg_s),
        residual_before_deg: pooled(&estimates, |estimate| estimate.residual_before_deg),
        residual_after_deg: pooled(&estimates, |estimate| estimate.residual_after_deg),
        residual_ranges_deg: pooled(&estimates, |estimate| estimate.residual_ranges_deg),
        residual_rest_deg: pooled(&estimates, |estimate| estimate.residual_rest_deg),
        azimuth_deg: first.azimuth_deg,
    })
}

/// Root of the mean square over all scans of what is a root mean square over each log's.
fn pooled(estimates: &[Estimate], of: fn(&Estimate) -> f64) -> f64 {
    let scans: usize = estimates.iter().map(|estimate| estimate.scans).sum();
    let sum: f64 = estimates.iter().map(|estimate| estimate.scans as f64 * of(estimate).powi(2)).sum();
    (sum / scans.max(1) as f64).sqrt()
}

/// Angle between two directions, in degrees.
fn turn(a: f64, b: f64) -> f64 {
    let apart = (a - b).rem_euclid(360.0);
    apart.min(360.0 - apart)
}

/// What several directions tell.
#[derive(Clone, Copy, Debug)]
struct Fit {
    offset_deg: f64,
    se_deg: f64,
    /// The ground's tilt towards north and east.
    tilt: [f64; 2],
}

/// Offset and tilt by least squares, from what was taken for the offset in each direction, with the standard error of each.
///
/// With rows `a` of the offset's and the tilt's parts in each value, an error of deviation `s` in each, and a tilt of deviation `p` before anything was
/// seen, the most likely unknowns solve `(sum a a' + (s / p)^2 diag(0, 1, 1)) x = sum a value`. So `x = G value`, and the offset's weights `g`
/// add up to 1. Its error is made of three parts: what the tilt leaks, `p |sum g left|`; what errors of each log alone make, `s sqrt(sum g^2)`; and
/// what an error that is the same in all makes, `s`. Which of the latter two the unit's slow error is, is not known: the greater one counts.
fn fit(seen: &[(f64, f64)], se_deg: f64) -> Option<Fit> {
    let se_deg = se_deg.max(LEAST_SE_DEG);
    // To the left of a direction is (sin, -cos) towards north and east; what was taken for the offset is offset - tilt . left.
    let row = |azimuth_deg: f64| {
        let (sin, cos) = azimuth_deg.to_radians().sin_cos();
        [1.0, -sin, cos]
    };
    let mut normal = [[0.0; 3]; 3];
    for (_, azimuth_deg) in seen {
        let row = row(*azimuth_deg);
        for (equation, a) in normal.iter_mut().zip(row) {
            equation.iter_mut().zip(row).for_each(|(cell, b)| *cell += a * b);
        }
    }
    for (i, equation) in normal.iter_mut().enumerate().skip(1) {
        equation[i] += (se_deg / ROAD_PRIOR_DEG).powi(2);
    }
    let inverse = inverse(normal)?;
    let mut unknowns = [0.0; 3];
    let (mut squares, mut leak) = (0.0, [0.0; 2]);
    for (value, azimuth_deg) in seen {
        let row = row(*azimuth_deg);
        let weights = inverse.map(|line| line.iter().zip(row).map(|(a, b)| a * b).sum::<f64>());
        unknowns.iter_mut().zip(weights).for_each(|(unknown, weight)| *unknown += weight * value);
        squares += weights[0].powi(2);
        leak.iter_mut().zip(&row[1..]).for_each(|(leak, part)| *leak += weights[0] * part);
    }
    let [offset_deg, north, east] = unknowns;
    let own_deg = se_deg * f64::max(1.0, squares).sqrt();
    Some(Fit { offset_deg, se_deg: own_deg.hypot(ROAD_PRIOR_DEG * leak[0].hypot(leak[1])), tilt: [north, east] })
}

/// The inverse of a symmetric matrix that is positive definite, by elimination; nothing of another.
fn inverse(mut matrix: [[f64; 3]; 3]) -> Option<[[f64; 3]; 3]> {
    let mut inverse = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
    for pivot in 0..3 {
        let by = matrix[pivot][pivot];
        if by.is_nan() || by < 1e-12 {
            return None;
        }
        let (row, unit) = (matrix[pivot].map(|cell| cell / by), inverse[pivot].map(|cell| cell / by));
        for other in 0..3 {
            let factor = matrix[other][pivot];
            for i in 0..3 {
                matrix[other][i] -= factor * row[i];
                inverse[other][i] -= factor * unit[i];
            }
        }
        (matrix[pivot], inverse[pivot]) = (row, unit);
    }
    Some(inverse)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::simulate::noise::{Noise, Purpose};

    const SE_DEG: f64 = 0.0126;

    /// What is taken for the offset of a scanner tilted by 0.8 degrees, on ground that rises by so much towards north and east.
    fn seen([north, east]: [f64; 2], azimuth_deg: f64) -> (f64, f64) {
        let (sin, cos) = azimuth_deg.to_radians().sin_cos();
        (0.8 - (north * sin - east * cos), azimuth_deg)
    }

    #[test]
    fn the_ground_is_told_from_the_scanner_by_turning_round() {
        // Ground that rises by 1.3 degrees to the left of a vehicle heading north.
        let fit_of = |azimuths: &[f64]| {
            let seen: Vec<_> = azimuths.iter().map(|azimuth| seen([0.0, -1.3], *azimuth)).collect();
            fit(&seen, SE_DEG).unwrap()
        };
        let found = fit_of(&[0.0, 180.0]);
        assert!((found.offset_deg - 0.8).abs() < 1e-9 && found.se_deg == SE_DEG, "{found:?}");
        assert!((found.tilt[1] + 1.3).abs() < 1e-3, "to the left of north is west: {found:?}");
        for azimuths in [[10.0, 130.0, 250.0], [0.0, 90.0, 180.0], [0.0, 45.0, 200.0]] {
            let found = fit_of(&azimuths);
            assert!((found.offset_deg - 0.8).abs() < 1e-3 && found.se_deg < 0.03, "{azimuths:?}: {found:?}");
        }
    }

    #[test]
    fn what_two_directions_leave_open_is_in_the_standard_error() {
        // In closed form: by symmetry the offset is the mean of both, and the tilt along the bisector leaks by the cosine of half the turn.
        for apart in (0..=180).step_by(5) {
            for first in [0.0, 10.0, 123.0] {
                let apart = f64::from(apart);
                let both = [seen([1.15, 0.4], first), seen([1.15, 0.4], first + apart)];
                let found = fit(&both, SE_DEG).unwrap();
                let mean = (both[0].0 + both[1].0) / 2.0;
                let leak = ROAD_PRIOR_DEG * (apart.to_radians() / 2.0).cos();
                assert!((found.offset_deg - mean).abs() < 1e-9, "{first} {apart}: {found:?}");
                assert!((found.se_deg - SE_DEG.hypot(leak)).abs() < 1e-9, "{first} {apart}: {found:?}");
                assert_eq!(found.se_deg <= MAX_OFFSET_SE_DEG, apart >= 175.0, "{first} {apart}: {found:?}");
            }
        }
        let at = |apart: f64| fit(&[seen([0.0; 2], 10.0), seen([0.0; 2], 10.0 + apart)], SE_DEG).unwrap().se_deg;
        assert!(at(171.0) < MAX_OFFSET_SE_DEG && at(169.0) > MAX_OFFSET_SE_DEG && (at(155.0) - 0.249).abs() < 1e-3);
    }

    #[test]
    fn the_standard_error_holds_over_all_grounds() {
        let mut noise = Noise::new(1, Purpose::Inertial);
        let cases: [&[f64]; 9] = [
            &[30.0, 150.0],
            &[10.0, 165.0],
            &[0.0, 172.0],
            &[0.0, 180.0],
            &[0.0, 120.0, 240.0],
            &[0.0, 90.0, 180.0],
            &[0.0, 60.0, 120.0],
            &[5.0, 10.0, 170.0],
            &[0.0, 1.0, 150.0, 151.0],
        ];
        for azimuths in cases {
            // An error of each log alone, and one that is the same in all.
            let [alone, shared] = [false, true].map(|shared| {
                let draws = 4_000;
                let sum: f64 = (0..draws)
                    .map(|_| {
                        let tilt = [(); 2].map(|()| ROAD_PRIOR_DEG * noise.normal());
                        let same = noise.normal();
                        let seen: Vec<_> = azimuths
                            .iter()
                            .map(|azimuth| {
                                let (value, azimuth) = seen(tilt, *azimuth);
                                (value + SE_DEG * if shared { same } else { noise.normal() }, azimuth)
                            })
                            .collect();
                        let found = fit(&seen, SE_DEG).unwrap();
                        ((found.offset_deg - 0.8) / found.se_deg).powi(2)
                    })
                    .sum();
                (sum / f64::from(draws)).sqrt()
            });
            // 4,000 draws tell a deviation to 1.1 %; of the two, the greater one is what is claimed.
            let most = alone.max(shared);
            assert!((0.96..1.04).contains(&most), "{azimuths:?}: {alone} {shared}");
        }
    }

    fn estimate(azimuth_deg: f64, roll_offset_deg: f64, scans: usize) -> Estimate {
        Estimate {
            roll_offset_deg,
            roll_offset_se_deg: SE_DEG,
            offset_determined: true,
            lidar_delay_us: 1_500.0,
            lidar_delay_se_us: 21.0,
            delay_determined: true,
            remarks: vec!["the vehicle stood".to_owned()],
            delay_remark: None,
            left_out: Vec::new(),
            parked: true,
            scans,
            roll_rate_rms_deg_s: 9.0,
            residual_before_deg: 0.016,
            residual_after_deg: 0.010,
            residual_ranges_deg: 0.008,
            residual_rest_deg: 0.006,
            azimuth_deg,
        }
    }

    /// A log of a vehicle that was not rocked.
    fn still(azimuth_deg: f64, roll_offset_deg: f64, scans: usize) -> Estimate {
        let said = "the delay cannot be told: 857 us".to_owned();
        Estimate {
            lidar_delay_us: 0.0,
            lidar_delay_se_us: 857.0,
            delay_determined: false,
            remarks: vec!["the vehicle stood".to_owned(), said.clone()],
            delay_remark: Some(said),
            roll_rate_rms_deg_s: 0.0,
            residual_before_deg: 0.008,
            residual_after_deg: 0.008,
            residual_rest_deg: 0.0,
            ..estimate(azimuth_deg, roll_offset_deg, scans)
        }
    }

    #[test]
    fn one_log_that_tells_the_delay_is_enough_in_any_order() {
        let (still, rocked) = (still(0.0, 2.0, 1_000), estimate(180.0, -0.4, 3_000));
        let orders = [vec![still.clone(), rocked.clone()], vec![rocked, still.clone()]];
        let [one, other] = orders.map(|logs| join(logs, 0.0).unwrap());
        for joined in [&one, &other] {
            assert!(joined.delay_determined && joined.offset_determined);
            assert_eq!((joined.lidar_delay_us, joined.scans), (1_500.0, 4_000));
            assert!((joined.roll_offset_deg - 0.8).abs() < 1e-9 && (joined.roll_offset_se_deg - SE_DEG).abs() < 1e-12);
            assert_eq!(joined.remarks.len(), 1, "{:?}", joined.remarks);
            // Over all scans, a quarter of them those of the other log.
            let pooled = |rocked: f64, still: f64| (0.75 * rocked * rocked + 0.25 * still * still).sqrt();
            for (found, expected) in [
                (joined.roll_rate_rms_deg_s, pooled(9.0, 0.0)),
                (joined.residual_before_deg, pooled(0.016, 0.008)),
                (joined.residual_after_deg, pooled(0.010, 0.008)),
                (joined.residual_ranges_deg, 0.008),
                (joined.residual_rest_deg, pooled(0.006, 0.0)),
            ] {
                assert!((found - expected).abs() < 1e-12, "{found} {expected}");
            }
        }
        let neither = join(vec![still.clone(), still], 0.0).unwrap();
        assert!(!neither.delay_determined && neither.remarks[1].contains("857 us"), "{:?}", neither.remarks);
    }

    #[test]
    fn an_offset_that_the_directions_leave_open_is_refused() {
        // Ground that rises by 2 % to the north.
        let towards = |azimuth: f64| estimate(azimuth, seen([1.15, 0.0], azimuth).0, 2_000);
        for (azimuths, determined) in [
            (&[30.0, 150.0][..], false),
            (&[10.0, 165.0], false),
            (&[10.0, 185.0], true),
            (&[10.0, 165.0, 90.0], true),
            // Not turned round: level ground would look the same.
            (&[60.0, 120.0, 30.0], false),
            (&[90.0, 92.0], true),
        ] {
            let joined = join(azimuths.iter().map(|azimuth| towards(*azimuth)).collect(), 0.0).unwrap();
            assert_eq!(joined.offset_determined, determined, "{azimuths:?}: {joined:?}");
            assert_eq!(joined.remarks.len(), if determined { 1 } else { 2 }, "{:?}", joined.remarks);
        }
    }
}
