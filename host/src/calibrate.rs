//! What the documentation of the sensors does not tell: how far the scanner is tilted, and how much later its telegrams arrive.
//!
//! The ground under the sensor is levelled with the roll of the inertial unit; what is left of its slope, scan by scan, is
//!
//! ```text
//! residual(scan) = true slope - offset error + delay error x roll rate(scan) + noise
//! ```
//!
//! because a scan that is taken for later than it was gets the roll of a later instant. So the delay follows from the correlation of
//! residual and roll rate, and needs the vehicle to roll; the offset follows from the mean, and needs to know the true slope. On a
//! rock test (vehicle rocked while parked on level ground, the median-slope paper's figure 5) both are there. While driving, the
//! cross slope is not known to better than roads are built, and the offset's uncertainty says so.
//!
//! Standard errors allow for errors that last: those of the mean are taken from half-second means as a first-order autoregression, with the
//! unit's published accuracy on top; those of the delay by Newey and West (1987) over one second.

mod ground;
mod statistics;

use crossfall_core::protocol::Config;
use crossfall_core::protocol::message::{Message, Pose};
use crossfall_core::scan::RawScan;
use serde::Serialize;
use std::path::Path;

use crate::container::Error;
use crate::stream::{Item, Stream};
use ground::Ground;

/// Scans that are read: half an hour. More would not make the answer better than the sensors are.
const MOST_SCANS: usize = 67_500;

/// Fewest scans that anything is said about: five seconds.
const LEAST_SCANS: usize = 187;

/// The delay is refused when its standard error is above this.
const MAX_DELAY_SE_US: f64 = 2_000.0;

/// Standard deviation of the mean cross slope of a road that one knows nothing about, in degrees (about 2 %).
const ROAD_PRIOR_DEG: f64 = 1.15;

/// What a unit's roll is off by as a whole while a log is made, in degrees: SPAN's published accuracy, one sigma. Its filter lets this drift
/// over minutes, so no average over one log takes it out.
const UNIT_BIAS_DEG: f64 = 0.017;

/// Slower than this is parked, in metres a second.
const PARKED_M_S: f64 = 0.1;

/// What a log holds for a calibration.
#[derive(Debug, Default)]
pub struct Drive {
    /// Its scans, in order.
    pub scans: Vec<RawScan>,
    /// Its poses, in order.
    pub poses: Vec<Pose>,
    /// The configuration in force.
    pub config: Config,
    /// Frames, gaps and parts of the file that could not be used.
    pub damage: u64,
}

/// What is known of the surface that the vehicle stands or drives on.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Surface {
    /// Level if the vehicle is parked, a road like any other if it drives.
    #[default]
    Assumed,
    /// Its mean slope to the left, in degrees, measured by other means.
    Known(f64),
}

/// The answer.
#[derive(Clone, Debug, Serialize)]
pub struct Estimate {
    /// Tilt of the scanner about the forward axis, to be put into the configuration.
    pub roll_offset_deg: f64,
    /// Its standard error.
    pub roll_offset_se_deg: f64,
    /// How much later than documented the first byte of a telegram arrives, to be put into the configuration.
    pub lidar_delay_us: f64,
    /// Its standard error.
    pub lidar_delay_se_us: f64,
    /// Whether the delay could be told at all.
    pub delay_determined: bool,
    /// Why not, or what the answer rests on; for a reader.
    pub remarks: Vec<String>,
    /// Whether the vehicle stood.
    pub parked: bool,
    /// Scans that were used.
    pub scans: usize,
    /// Root of the mean square of the roll rate over them, in degrees a second.
    pub roll_rate_rms_deg_s: f64,
    /// Standard deviation of the ground's slope from scan to scan with the old and with the new delay, in degrees.
    pub residual_before_deg: f64,
    /// See `residual_before_deg`.
    pub residual_after_deg: f64,
}

/// Why there is no answer.
#[derive(Debug, thiserror::Error)]
pub enum Refusal {
    /// The log cannot be read.
    #[error(transparent)]
    Log(#[from] Error),
    /// There is too little in it.
    #[error(
        "{usable} of {scans} scans show ground under the sensor and have attitude; at least {LEAST_SCANS} are needed"
    )]
    TooFew {
        /// Scans with ground and attitude.
        usable: usize,
        /// Scans in the log.
        scans: usize,
    },
}

/// One scan's part in the answer, for the plot of the paper's figure 5.
#[derive(Clone, Copy, Debug)]
pub struct Sample {
    /// Seconds since the first.
    pub seconds: f64,
    /// Roll by the inertial unit.
    pub roll_deg: f64,
    /// Slope of the ground in the vehicle's axes: what the scanner alone sees of the roll, negated.
    pub seen_roll_deg: f64,
    /// What remains of the slope after levelling with the old delay and offset.
    pub before_deg: f64,
    /// What remains with the new ones.
    pub after_deg: f64,
}

/// Reads what a calibration needs.
///
/// # Errors
/// When the log cannot be opened.
pub fn read(path: &Path) -> Result<Drive, Error> {
    let mut stream = Stream::open(path)?;
    let mut drive = Drive::default();
    let mut room = ground::empty_scan();
    while let Some((_, item)) = stream.next() {
        let Item::Message { message, .. } = item else {
            drive.damage += 1;
            continue;
        };
        match message {
            Message::Config(config) => drive.config = config,
            Message::Pose(pose) => drive.poses.push(pose),
            Message::Scan(_) if drive.scans.len() < MOST_SCANS => {
                match crossfall_core::instrument::Event::of(&message, &mut room) {
                    Ok(_) => drive.scans.push(room.clone()),
                    Err(_) => drive.damage += 1,
                }
            }
            _ => {}
        }
    }
    Ok(drive)
}

/// Estimates offset and delay.
///
/// # Errors
/// [`Refusal::TooFew`] when there is too little to say anything.
pub fn estimate(drive: &Drive, surface: Surface) -> Result<(Estimate, Vec<Sample>), Refusal> {
    let ground = Ground::new(drive);
    let start_us = f64::from(drive.config.scanner.delay_us);
    let mut delay_us = start_us;
    let mut fit = None;
    // Gauss-Newton: the residual is linear in the delay up to the curvature of the roll, so a few steps settle it.
    for _ in 0..6 {
        let points = ground.residuals(delay_us);
        if points.len() < LEAST_SCANS {
            return Err(Refusal::TooFew { usable: points.len(), scans: drive.scans.len() });
        }
        let found = statistics::regress(&points);
        let step_us = found.slope.clamp(-30_000.0, 30_000.0);
        // Without roll there is nothing to follow.
        let told = found.slope_se.is_finite() && found.slope_se <= 10.0 * MAX_DELAY_SE_US;
        if told {
            delay_us = (delay_us + step_us).clamp(-200_000.0, 200_000.0);
        }
        fit = Some(found);
        if !told || step_us.abs() < 0.5 {
            break;
        }
    }
    let fit = fit.ok_or(Refusal::TooFew { usable: 0, scans: drive.scans.len() })?;
    let delay_determined = fit.slope_se.is_finite() && fit.slope_se <= MAX_DELAY_SE_US;
    if !delay_determined {
        delay_us = start_us;
    }
    let before = ground.residuals(start_us);
    let after = ground.residuals(delay_us);
    let parked = is_parked(&drive.poses);
    let (mean, mean_se) = statistics::mean(&after);
    let (true_slope, prior_se, said) = match surface {
        Surface::Known(degrees) => {
            (degrees, 0.0, format!("the surface's slope was given: {degrees} degrees to the left"))
        }
        Surface::Assumed if parked => {
            (0.0, 0.0, "the vehicle stood: the surface under it is taken for level".to_owned())
        }
        Surface::Assumed => (
            0.0,
            ROAD_PRIOR_DEG,
            format!("the road's mean cross slope is not known: +/-{ROAD_PRIOR_DEG} degrees are allowed for it"),
        ),
    };
    let old_offset_deg = crate::profiles::degrees(drive.config.scanner.mounting_offset);
    let offset_deg = old_offset_deg + true_slope - mean;
    let rate = statistics::rms(after.iter().map(|point| point.rate_deg_us * 1e6));
    let mut remarks = vec![said];
    if !delay_determined {
        remarks.push(format!(
            "the delay cannot be told: its standard error would be {:.0} us with the vehicle rolling at {rate:.2} degrees/s RMS; \
             rock the vehicle, or drive longer",
            fit.slope_se
        ));
    }
    if drive.damage > 0 {
        remarks.push(format!("{} damaged parts of the log were left out", drive.damage));
    }
    let estimate = Estimate {
        roll_offset_deg: offset_deg,
        roll_offset_se_deg: mean_se.hypot(prior_se).hypot(UNIT_BIAS_DEG),
        lidar_delay_us: delay_us,
        lidar_delay_se_us: fit.slope_se,
        delay_determined,
        remarks,
        parked,
        scans: after.len(),
        roll_rate_rms_deg_s: rate,
        residual_before_deg: statistics::deviation(before.iter().map(|point| point.slope_deg)),
        residual_after_deg: statistics::deviation(after.iter().map(|point| point.slope_deg)),
    };
    let samples = ground.samples(&before, &after, offset_deg - old_offset_deg);
    Ok((estimate, samples))
}

/// Whether the vehicle stood all the time, as far as its poses tell.
fn is_parked(poses: &[Pose]) -> bool {
    let speeds = poses.iter().filter_map(|pose| pose.fix).map(|fix| {
        let [north, east, _] = fix.velocity_mm_s.map(|mm| f64::from(mm) * 1e-3);
        north.hypot(east)
    });
    statistics::rms(speeds) < PARKED_M_S
}
