//! The slope of the ground under the sensor, scan by scan, for any assumed delay.
//!
//! Levelling is the core's own: the same attitude, the same roll for every beam, the same points. The line is fitted here in floating point,
//! robustly, over the points within three metres of the sensor on both sides.

use crossfall_core::attitude::{HISTORY, History};
use crossfall_core::protocol::message::{ScanMode, flags};
use crossfall_core::protocol::{Config, DeviceTime};
use crossfall_core::scan::{self, MAX_BEAMS, Points, RawScan};

use super::{Drive, Sample};
use crate::profiles::degrees;

/// Points this far to either side belong to the ground under the sensor, in metres.
const REACH_M: f64 = 3.0;

/// Fewest points that make a line.
const LEAST_POINTS: usize = 40;

/// Half of the interval over which the effect of a delay is taken, in microseconds.
const PROBE_US: f64 = 500.0;

/// One scan's residual.
#[derive(Clone, Copy, Debug)]
pub struct Residual {
    /// Number of the scan in the drive.
    pub scan: usize,
    /// Instant of its beam straight down, in seconds of device time.
    pub seconds: f64,
    /// Slope of the levelled ground to the left, in degrees.
    pub slope_deg: f64,
    /// How that slope changes with the assumed delay, in degrees a microsecond.
    pub rate_deg_us: f64,
    /// Roll at straight down, in degrees.
    pub roll_deg: f64,
}

/// The scans and poses of a drive, ready to be levelled with any delay.
pub struct Ground<'a> {
    drive: &'a Drive,
}

impl<'a> Ground<'a> {
    pub fn new(drive: &'a Drive) -> Self {
        Self { drive }
    }

    /// The residual of every scan that has ground and attitude.
    pub fn residuals(&self, delay_us: f64) -> Vec<Residual> {
        let mut points = Points::new();
        let mut found = Vec::with_capacity(self.drive.scans.len());
        for (number, scan) in self.drive.scans.iter().enumerate() {
            let at = |delay: f64, points: &mut Points| self.slope(scan, delay, points);
            let Some((slope_deg, roll_deg)) = at(delay_us, &mut points) else { continue };
            let Some((later, _)) = at(delay_us + PROBE_US, &mut points) else { continue };
            let Some((earlier, _)) = at(delay_us - PROBE_US, &mut points) else { continue };
            let seconds = scan.start(delay_us.round() as i32).0 as f64 * 1e-6;
            let rate_deg_us = (later - earlier) / (2.0 * PROBE_US);
            found.push(Residual { scan: number, seconds, slope_deg, rate_deg_us, roll_deg });
        }
        found
    }

    /// What the plot of a rock test shows, of every scan that has a residual both before and after.
    pub fn samples(&self, before: &[Residual], after: &[Residual], offset_change_deg: f64) -> Vec<Sample> {
        let mut samples = Vec::new();
        let mut before = before.iter().peekable();
        let first = after.first().map_or(0.0, |residual| residual.seconds);
        for residual in after {
            while before.next_if(|other| other.scan < residual.scan).is_some() {}
            let Some(other) = before.next_if(|other| other.scan == residual.scan) else { continue };
            samples.push(Sample {
                seconds: residual.seconds - first,
                roll_deg: residual.roll_deg,
                seen_roll_deg: residual.roll_deg - residual.slope_deg,
                before_deg: other.slope_deg,
                after_deg: residual.slope_deg + offset_change_deg,
            });
        }
        samples
    }

    /// Slope of the ground and roll at straight down, both in degrees, with this delay.
    fn slope(&self, scan: &RawScan, delay_us: f64, points: &mut Points) -> Option<(f64, f64)> {
        // The core's delay is whole microseconds; the rest of it is left to the derivative.
        let scanner = crossfall_core::protocol::config::Scanner {
            delay_us: delay_us.round() as i32,
            ..self.drive.config.scanner
        };
        let start = scan.start(scanner.delay_us);
        let history = self.history_around(start);
        let roll = history.over_scan(scan, start, &self.drive.config.attitude);
        if roll.flags & (flags::NO_ATTITUDE | flags::ATTITUDE_HELD) != 0 {
            return None;
        }
        scan::level(scan, &roll.track, &scanner, points);
        let section = points.iter().map(|echo| (f64::from(echo.point.y_um) * 1e-6, f64::from(echo.point.z_um) * 1e-6));
        let near: Vec<_> = section.filter(|(y, _)| y.abs() <= REACH_M).collect();
        Some((robust_slope(&near)?, degrees(roll.nadir)))
    }

    /// The poses around a scan, as the core's history would hold them.
    fn history_around(&self, start: DeviceTime) -> History {
        let poses = &self.drive.poses;
        let first = poses.partition_point(|pose| pose.time < start).saturating_sub(HISTORY / 4);
        let mut history = History::default();
        for pose in poses.iter().skip(first).take(HISTORY) {
            history.push(pose);
        }
        history
    }
}

/// Slope in degrees of the line through points, refitted with Tukey's weights until what lies off it no longer counts.
fn robust_slope(points: &[(f64, f64)]) -> Option<f64> {
    if points.len() < LEAST_POINTS {
        return None;
    }
    let mut weights = vec![1.0; points.len()];
    let mut line = weighted_line(points, &weights)?;
    for _ in 0..4 {
        let mut sizes: Vec<f64> = points.iter().map(|(y, z)| (z - line.0 - line.1 * y).abs()).collect();
        let middle = sizes.len() / 2;
        let (_, median, _) = sizes.select_nth_unstable_by(middle, f64::total_cmp);
        let scale = (4.685 * 1.4826 * *median).max(1e-4);
        for (weight, (y, z)) in weights.iter_mut().zip(points) {
            let u = (z - line.0 - line.1 * y) / scale;
            *weight = if u.abs() < 1.0 { (1.0 - u * u) * (1.0 - u * u) } else { 0.0 };
        }
        line = weighted_line(points, &weights)?;
    }
    Some(line.1.atan().to_degrees())
}

/// Height at 0 and slope.
fn weighted_line(points: &[(f64, f64)], weights: &[f64]) -> Option<(f64, f64)> {
    let total: f64 = weights.iter().sum();
    let mean = |pick: fn(&(f64, f64)) -> f64| points.iter().zip(weights).map(|(p, w)| pick(p) * w).sum::<f64>() / total;
    let (mean_y, mean_z) = (mean(|p| p.0), mean(|p| p.1));
    let (mut syy, mut syz) = (0.0, 0.0);
    for ((y, z), weight) in points.iter().zip(weights) {
        syy += weight * (y - mean_y) * (y - mean_y);
        syz += weight * (y - mean_y) * (z - mean_z);
    }
    (total > 0.0 && syy > 0.0).then(|| (mean_z - syz / syy * mean_y, syz / syy))
}

/// Room for a scan that is about to be decoded.
pub fn empty_scan() -> RawScan {
    RawScan {
        index: 0,
        stx: DeviceTime(0),
        layout: 0,
        mode: ScanMode { span_deg: 180, step_cdeg: 50, measuring: Config::default().scanner.measuring_mode },
        status: 0,
        counters: None,
        values: [0; MAX_BEAMS],
    }
}
