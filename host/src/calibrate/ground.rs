//! The slope of the ground under the sensor, scan by scan, for any assumed delay.
//!
//! Levelling is the core's own: the same attitude, the same roll for every beam, the same points. The line is fitted here in floating point,
//! robustly, over the points within three metres of the sensor on both sides, each with the variance that the noise of its range
//! has in height: the square of the cosine of its beam's angle from straight down, and a fifth of that noise for the surface.
//!
//! What a line knows of its slope grows with the third power of its reach (as the tangent of the outermost beam's angle, cubed). A parked vehicle sees
//! the same ground in every scan, so that the scans together tell to a millimetre how far it is even: as far as that, points count.

use crossfall_core::attitude::{History, ScanRoll};
use crossfall_core::protocol::message::flags;
use crossfall_core::protocol::{DeviceTime, config};
use crossfall_core::scan::{self, Points, RawScan};

use super::{Drive, Sample};
use crate::interrupt;
use crate::statistics::upper_median;
use crate::units::{degrees, place};

/// Points this far to either side belong to the ground under the sensor, in metres.
pub const REACH_M: f64 = 3.0;

/// The furthest that even ground is followed under a parked vehicle, in strips of this width, in metres.
const FURTHEST_M: f64 = 8.0;
const STRIP_M: f64 = 0.25;

/// Scans that are looked at for it, and the fewest points that tell the height of a strip.
const LOOKED_AT: usize = 120;
const STRIP_POINTS: usize = 40;

/// A strip further than this off the line of the inner three metres, by the median of its points, is not even with it, in metres.
const EVEN_M: f64 = 0.003;

/// Fewest points that make a line.
const LEAST_POINTS: usize = 40;

/// Half of the interval over which the effect of a delay is taken, in microseconds.
const PROBE_US: f64 = 500.0;

/// One scan's residual.
#[derive(Clone, Copy, Debug, Default)]
pub struct Residual {
    /// Number of the scan in the drive.
    pub scan: usize,
    /// Instant of its beam straight down, in seconds of device time.
    pub seconds: f64,
    /// Slope of the levelled ground to the left, in degrees.
    pub slope_deg: f64,
    /// Its standard error by the scatter of the points about the line.
    pub se_deg: f64,
    /// How that slope changes with the assumed delay, in degrees a microsecond.
    pub rate_deg_us: f64,
    /// Roll at straight down, in degrees.
    pub roll_deg: f64,
    /// Flags of the attitude.
    pub flags: u16,
}

/// The scans and poses of a drive, ready to be levelled with any delay.
pub struct Ground<'a> {
    drive: &'a Drive,
    /// How far points count to the right and to the left, in metres.
    reach_m: [f64; 2],
}

impl<'a> Ground<'a> {
    pub fn new(drive: &'a Drive) -> Self {
        Self { drive, reach_m: [REACH_M; 2] }
    }

    /// The same of a vehicle that stands: the ground is followed as far as it is even.
    pub fn parked(drive: &'a Drive) -> Self {
        let mut ground = Self::new(drive);
        ground.reach_m = ground.even_m();
        ground
    }

    /// How far the ground is even with that under the sensor, to the right and to the left.
    fn even_m(&self) -> [f64; 2] {
        let first = (REACH_M / STRIP_M) as usize;
        let strips = (FURTHEST_M / STRIP_M) as usize;
        let mut heights = [vec![Vec::new(); strips], vec![Vec::new(); strips]];
        let delay_us = self.drive.config.scanner.delay_us;
        let mut points = Points::new();
        let step = (self.drive.scans.len() / LOOKED_AT).max(1);
        for scan in self.drive.scans.iter().step_by(step) {
            let Some(roll) = self.track(scan, delay_us) else { continue };
            let section = self.section(scan, &roll, delay_us, &mut points);
            let near: Vec<_> = section.iter().filter(|(y, _)| y.abs() <= REACH_M).copied().collect();
            let Some(line) = robust_line(&near) else { continue };
            for (y, z) in section {
                let strips = &mut heights[usize::from(y > 0.0)];
                if let Some(strip) = strips.get_mut((y.abs() / STRIP_M) as usize) {
                    strip.push(z - line.height - line.slope * y);
                }
            }
        }
        heights.map(|strips| {
            let even = |mut strip: Vec<f64>| {
                strip.len() >= STRIP_POINTS && upper_median(&mut strip).is_some_and(|off| off.abs() <= EVEN_M)
            };
            let more = strips.into_iter().skip(first).map(even).take_while(|even| *even).count();
            (first + more) as f64 * STRIP_M
        })
    }

    /// The residual of every scan that has ground and attitude; of fewer when the user asks to stop.
    pub fn residuals(&self, delay_us: f64) -> Vec<Residual> {
        let mut points = Points::new();
        let mut found = Vec::with_capacity(self.drive.scans.len());
        for (number, scan) in self.drive.scans.iter().enumerate() {
            if interrupt::requested() {
                break;
            }
            let mut at = |delay_us: f64| {
                // The core's delay is whole microseconds.
                let delay_us = delay_us.round() as i32;
                let roll = self.track(scan, delay_us)?;
                let line = self.line(scan, &roll, delay_us, &mut points)?;
                Some((line, roll))
            };
            let Some((line, roll)) = at(delay_us) else { continue };
            let Some((later, _)) = at(delay_us + PROBE_US) else { continue };
            let Some((earlier, _)) = at(delay_us - PROBE_US) else { continue };
            let rate_deg_us = (later.slope_deg - earlier.slope_deg) / (2.0 * PROBE_US);
            found.push(Residual {
                scan: number,
                seconds: scan.start(delay_us.round() as i32).0 as f64 * 1e-6,
                slope_deg: line.slope_deg + rate_deg_us * (delay_us - delay_us.round()),
                se_deg: line.se_deg,
                rate_deg_us,
                roll_deg: degrees(roll.nadir),
                flags: roll.flags,
            });
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

    /// Roll over a scan with this delay, where the log has it.
    pub fn track(&self, scan: &RawScan, delay_us: i32) -> Option<ScanRoll> {
        let start = scan.start(delay_us);
        let roll = self.history_around(start).over_scan(scan, start, &self.drive.config.attitude);
        (roll.flags & (flags::NO_ATTITUDE | flags::ATTITUDE_HELD) == 0).then_some(roll)
    }

    fn line(&self, scan: &RawScan, roll: &ScanRoll, delay_us: i32, points: &mut Points) -> Option<Line> {
        let [right_m, left_m] = self.reach_m;
        let mut near = self.section(scan, roll, delay_us, points);
        near.retain(|(y, _)| (-right_m..=left_m).contains(y));
        robust_line(&near)
    }

    /// The levelled points of a scan, in metres.
    fn section(&self, scan: &RawScan, roll: &ScanRoll, delay_us: i32, points: &mut Points) -> Vec<(f64, f64)> {
        let scanner = config::Scanner { delay_us, ..self.drive.config.scanner };
        scan::level(scan, &roll.track, &scanner, points);
        points.iter().map(place).collect()
    }

    /// Poses around a scan as the core's history would hold them: a few before it and more than it lasts.
    fn history_around(&self, start: DeviceTime) -> History {
        let poses = &self.drive.poses;
        let first = poses.partition_point(|pose| pose.time < start).saturating_sub(8);
        let mut history = History::default();
        for pose in poses.iter().skip(first).take(32) {
            history.push(pose);
        }
        history
    }
}

/// A line over the ground.
#[derive(Clone, Copy, Debug)]
struct Line {
    /// Height under the sensor, in metres, and rise a metre.
    height: f64,
    slope: f64,
    slope_deg: f64,
    se_deg: f64,
}

/// Variance of a surface about its line over that of a range.
const SURFACE_SHARE: f64 = 0.04;

/// The line through points, refitted with Tukey's weights until what lies off it no longer counts.
fn robust_line(points: &[(f64, f64)]) -> Option<Line> {
    if points.len() < LEAST_POINTS {
        return None;
    }
    // Inverse variances: noise along a beam shows in height by the cosine of its angle from straight down.
    let precisions: Vec<f64> = points.iter().map(|(y, z)| 1.0 / (z * z / (y * y + z * z) + SURFACE_SHARE)).collect();
    let mut weights = precisions.clone();
    let mut line = weighted_line(points, &weights)?;
    for _ in 0..4 {
        let size =
            |((y, z), precision): (&(f64, f64), &f64)| (z - line.height - line.slope * y).abs() * precision.sqrt();
        let mut sizes: Vec<f64> = points.iter().zip(&precisions).map(size).collect();
        let scale = (4.685 * 1.4826 * upper_median(&mut sizes)?).max(1e-4);
        for ((weight, precision), point) in weights.iter_mut().zip(&precisions).zip(points) {
            let u = size((point, precision)) / scale;
            *weight = if u < 1.0 { precision * (1.0 - u * u) * (1.0 - u * u) } else { 0.0 };
        }
        line = weighted_line(points, &weights)?;
    }
    // Scatter by the points that count, freed of what Tukey's weights take from it: E[k] / E[k u^2] = 0.915 / 0.758 for normal errors.
    let (mut squares, mut count) = (0.0, 0.0);
    for (((y, z), weight), precision) in points.iter().zip(&weights).zip(&precisions) {
        squares += weight * (z - line.height - line.slope * y).powi(2);
        count += weight / precision;
    }
    let variance = 1.208 * squares / (count - 2.0).max(1.0);
    let slope_se = (variance / line.spread).sqrt();
    Some(Line {
        height: line.height,
        slope: line.slope,
        slope_deg: line.slope.atan().to_degrees(),
        se_deg: (slope_se / (1.0 + line.slope * line.slope)).to_degrees(),
    })
}

#[derive(Clone, Copy)]
struct Weighted {
    height: f64,
    slope: f64,
    /// Weighted sum of squares of the places about their mean.
    spread: f64,
}

fn weighted_line(points: &[(f64, f64)], weights: &[f64]) -> Option<Weighted> {
    let total: f64 = weights.iter().sum();
    let mean = |pick: fn(&(f64, f64)) -> f64| points.iter().zip(weights).map(|(p, w)| pick(p) * w).sum::<f64>() / total;
    let (mean_y, mean_z) = (mean(|p| p.0), mean(|p| p.1));
    let (mut spread, mut product) = (0.0, 0.0);
    for ((y, z), weight) in points.iter().zip(weights) {
        spread += weight * (y - mean_y) * (y - mean_y);
        product += weight * (y - mean_y) * (z - mean_z);
    }
    let slope = product / spread;
    (total > 0.0 && spread > 0.0).then_some(Weighted { height: mean_z - slope * mean_y, slope, spread })
}
