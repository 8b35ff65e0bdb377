//! Offset and delay of one log.

use crossfall_core::protocol::message::{Pose, flags};

use super::ground::{Ground, Residual};
use super::statistics::{HighPass, Regression};
use super::{Drive, Estimate, LEAST_SCANS, Refusal, Sample, Surface, drift, statistics};
use crate::interrupt;
use crate::statistics::{deviation, rms};
use crate::units::degrees;

/// The delay is refused when its standard error is above this: at ten degrees a second it is worth 0.005 degrees, a third of the unit's own error.
const MAX_DELAY_SE_US: f64 = 500.0;

/// A regression that is less sure than this is not followed at all.
const FOLLOWED_SE_US: f64 = 20_000.0;

/// The offset is refused when its standard error is above this.
pub(super) const MAX_OFFSET_SE_DEG: f64 = 0.1;

/// Standard deviation of the mean cross slope of a road that one knows nothing about, in degrees (about 2 %).
pub(super) const ROAD_PRIOR_DEG: f64 = 1.15;

/// Slower than this is parked, in metres a second.
const PARKED_M_S: f64 = 0.1;

/// Estimates offset and delay.
///
/// # Errors
/// [`Refusal::TooFew`] when there is too little to say anything, [`Refusal::Log`] when the user asks to stop.
pub fn estimate(drive: &Drive, surface: Surface) -> Result<(Estimate, Vec<Sample>), Refusal> {
    let stood = is_parked(&drive.poses);
    let parked = stood == Some(true);
    let ground = if parked { Ground::parked(drive) } else { Ground::new(drive) };
    let start_us = f64::from(drive.config.scanner.delay_us);
    let before = ground.residuals(start_us);
    interrupt::check()?;
    enough(&before, drive)?;
    let (mut delay_us, fit) = follow_delay(drive, &ground, &before)?;
    let by_arrival = before.iter().filter(|point| point.flags & flags::TIME_BY_ARRIVAL != 0).count();
    let timed = by_arrival * 2 <= before.len();
    let reversed = is_reversed(&before);
    let delay_determined = timed && !reversed && fit.slope_se <= MAX_DELAY_SE_US;
    if !delay_determined {
        delay_us = start_us;
    }
    let after = ground.residuals(delay_us);
    interrupt::check()?;
    let level = drift::mean(&after);
    let prior = prior(surface, stood);
    let old_offset_deg = degrees(drive.config.scanner.mounting_offset);
    let offset_deg = old_offset_deg + prior.slope_deg - level.mean_deg;
    let offset_se_deg = level.se_deg.hypot(prior.se_deg);
    let rate = rms(after.iter().map(|point| point.rate_deg_us * 1e6));
    let mut remarks = vec![prior.remark];
    let delay_remark = (!delay_determined)
        .then(|| if reversed { REVERSED.to_owned() } else { refused_delay(timed, &fit, rate, &after) });
    remarks.extend(delay_remark.clone());
    let offset_determined = !reversed && offset_se_deg <= MAX_OFFSET_SE_DEG;
    if !offset_determined && !reversed {
        remarks.push(offset_remark(offset_se_deg, "park on level ground, or give the cross slope"));
    }
    let mut left_out = drive.left_out.clone();
    if drive.damage > 0 {
        left_out.push(format!("{} parts of the log are damaged or missing", drive.damage));
    }
    remarks.extend(left_out.iter().cloned());
    let residual_after_deg = deviation(after.iter().map(|point| point.slope_deg));
    let residual_ranges_deg = rms(after.iter().map(|point| point.se_deg));
    let estimate = Estimate {
        roll_offset_deg: offset_deg,
        roll_offset_se_deg: offset_se_deg,
        offset_determined,
        lidar_delay_us: delay_us,
        lidar_delay_se_us: fit.slope_se,
        delay_determined,
        remarks,
        delay_remark,
        left_out,
        parked,
        scans: after.len(),
        roll_rate_rms_deg_s: rate,
        residual_before_deg: deviation(before.iter().map(|point| point.slope_deg)),
        residual_after_deg,
        residual_ranges_deg,
        residual_rest_deg: (residual_after_deg.powi(2) - residual_ranges_deg.powi(2)).max(0.0).sqrt(),
        azimuth_deg: azimuth(&drive.poses),
    };
    let samples = ground.samples(&before, &after, offset_deg - old_offset_deg);
    Ok((estimate, samples))
}

/// Refuses what says too little.
fn enough(points: &[Residual], drive: &Drive) -> Result<(), Refusal> {
    match points.len() {
        LEAST_SCANS.. => Ok(()),
        usable => Err(Refusal::TooFew { usable, scans: drive.scans.len() }),
    }
}

/// The delay that takes the roll rate out of the residuals, in microseconds, and the fit with it taken out; from the log's own delay, whose residuals
/// are `before`.
fn follow_delay(drive: &Drive, ground: &Ground<'_>, before: &[Residual]) -> Result<(f64, Regression), Refusal> {
    let mut delay_us = f64::from(drive.config.scanner.delay_us);
    let mut filter = HighPass::best(before);
    let mut fit = statistics::regress(before, filter);
    // Gauss-Newton: the residual is linear in the delay up to the curvature of the roll, so a few steps settle it. Without roll there is
    // nothing to follow.
    for step in 0..6 {
        let step_us = fit.slope.clamp(-30_000.0, 30_000.0);
        if fit.slope_se.is_nan() || fit.slope_se > FOLLOWED_SE_US || step_us.abs() < 0.5 {
            break;
        }
        delay_us = (delay_us + step_us).clamp(-200_000.0, 200_000.0);
        let points = ground.residuals(delay_us);
        interrupt::check()?;
        enough(&points, drive)?;
        // With most of the delay taken out, what is left is what the filter is to keep away.
        if step == 0 {
            filter = HighPass::best(&points);
        }
        fit = statistics::regress(&points, filter);
    }
    Ok((delay_us, fit))
}

/// What is known of the surface before it is looked at.
struct Prior {
    /// Its slope to the left, and the standard error of that.
    slope_deg: f64,
    se_deg: f64,
    remark: String,
}

/// `stood` is whether the vehicle did, as far as that is known.
fn prior(surface: Surface, stood: Option<bool>) -> Prior {
    match (surface, stood) {
        (Surface::Known(slope_deg), _) => {
            let remark = format!("the surface's slope was given: {slope_deg} degrees to the left");
            Prior { slope_deg, se_deg: 0.0, remark }
        }
        (Surface::Assumed, Some(true)) => {
            let remark = "the vehicle stood: the surface under it is taken for level; a second log from the same spot in the opposite \
                          direction would make sure";
            Prior { slope_deg: 0.0, se_deg: 0.0, remark: remark.to_owned() }
        }
        (Surface::Assumed, moved) => {
            let why = if moved.is_none() { "no pose has a velocity, so the vehicle may have driven: " } else { "" };
            let remark = format!(
                "{why}the road's mean cross slope is not known: +/-{ROAD_PRIOR_DEG} degrees are allowed for it"
            );
            Prior { slope_deg: 0.0, se_deg: ROAD_PRIOR_DEG, remark }
        }
    }
}

/// What is said when roll was added to the ground instead of taken out of it.
const REVERSED: &str = "the ground moves with twice the vehicle's roll: the scanner looks the other way round than `scanner.mirrored` says, or the \
                        unit's roll has the other sign; change it in the configuration, and run the drive again";

/// Less roll than this, in degrees (standard deviation), does not show in which direction it was taken.
const LEAST_ROLL_DEG: f64 = 0.1;

/// Whether the levelled ground follows the roll at twice its size, one way or the other, as it does where the roll's sign is wrong.
fn is_reversed(points: &[Residual]) -> bool {
    let count = points.len().max(1) as f64;
    let mean = |of: fn(&Residual) -> f64| points.iter().map(of).sum::<f64>() / count;
    let (roll, slope) = (mean(|point| point.roll_deg), mean(|point| point.slope_deg));
    let (mut both, mut square) = (0.0, 0.0);
    for point in points {
        both += (point.roll_deg - roll) * (point.slope_deg - slope);
        square += (point.roll_deg - roll).powi(2);
    }
    (square / count).sqrt() >= LEAST_ROLL_DEG && ((both / square).abs() - 2.0).abs() < 0.2
}

/// What is said of an offset that is refused.
pub(super) fn offset_remark(se_deg: f64, advice: &str) -> String {
    format!("the offset is not known well enough to be used (standard error {se_deg:.2} degrees); {advice}")
}

/// Why the delay is refused, and what would tell it.
fn refused_delay(timed: bool, fit: &Regression, rate_deg_s: f64, points: &[Residual]) -> String {
    if !timed {
        return "the delay cannot be told: most poses are timed by their arrival, as there were no pulses, and the inertial unit's \
                own delay would pass for the scanner's"
            .to_owned();
    }
    let minutes = points.len() as f64 / statistics::scans_in(points, 60.0).max(1) as f64;
    let times = (fit.slope_se / MAX_DELAY_SE_US).powi(2);
    let longer = if times.is_finite() && times * minutes < 120.0 {
        format!(", or drive like this for {:.0} minutes", (times * minutes).ceil().max(1.0))
    } else {
        String::new()
    };
    format!(
        "the delay cannot be told: its standard error would be {:.0} us with the vehicle rolling at {rate_deg_s:.2} degrees/s RMS, and \
         {MAX_DELAY_SE_US:.0} us are the most that is taken; park and rock the vehicle for a minute{longer}",
        fit.slope_se
    )
}

/// Whether the vehicle stood all the time; nothing when no pose tells, as of a unit that logs its attitude alone.
fn is_parked(poses: &[Pose]) -> Option<bool> {
    let mut speeds = poses.iter().filter_map(|pose| pose.fix).peekable();
    speeds.peek()?;
    let speeds = speeds.map(|fix| {
        let [north, east, _] = fix.velocity_mm_s.map(|mm| f64::from(mm) * 1e-3);
        north.hypot(east)
    });
    Some(rms(speeds) < PARKED_M_S)
}

/// Mean direction, as that of the sum of unit vectors.
fn azimuth(poses: &[Pose]) -> f64 {
    let (north, east) = poses.iter().fold((0.0, 0.0), |(north, east), pose| {
        let azimuth = degrees(pose.azimuth).to_radians();
        (north + azimuth.cos(), east + azimuth.sin())
    });
    east.atan2(north).to_degrees().rem_euclid(360.0)
}
