//! The ground as the scanner has it, levelled with the old calibration, and with the new one: the median-slope paper's figure 6.

use crossfall_core::protocol::Angle;
use crossfall_core::protocol::config::Scanner;
use crossfall_core::scan::{Points, RawScan, RollTrack, level};

use super::ground::{Ground, REACH_M};
use super::{Drive, Estimate, Refusal};
use crate::section::Place;
use crate::statistics;
use crate::units::place;

/// Scans whose points make a picture.
pub const DRAWN_SCANS: usize = 60;

/// Points of some scans, and how far they lie from one line.
#[derive(Clone, Debug, Default)]
pub struct Layers {
    /// As measured.
    pub raw: Vec<Place>,
    /// Levelled with the offset and delay that the log was made with.
    pub compensated: Vec<Place>,
    /// Levelled with those found.
    pub corrected: Vec<Place>,
}

/// The ground within three metres of the sensor, of [`DRAWN_SCANS`] spread over the log.
///
/// # Errors
/// As of [`Estimate::scanner`].
pub fn layers(drive: &Drive, found: &Estimate) -> Result<Layers, Refusal> {
    let ground = Ground::new(drive);
    let old = drive.config.scanner;
    let untilted = Scanner { mounting_offset: Angle::ZERO, ..old };
    let new = found.scanner(&old)?;
    let step = (drive.scans.len() / DRAWN_SCANS).max(1);
    let mut layers = Layers::default();
    // From the middle of the first part, so that neither end of the log counts more.
    for scan in drive.scans.iter().skip(step / 2).step_by(step) {
        let (Some(before), Some(after)) = (ground.track(scan, old.delay_us), ground.track(scan, new.delay_us)) else {
            continue;
        };
        near(scan, &RollTrack::constant(Angle::ZERO), &untilted, &mut layers.raw);
        near(scan, &before.track, &old, &mut layers.compensated);
        near(scan, &after.track, &new, &mut layers.corrected);
    }
    Ok(layers)
}

impl Layers {
    /// Standard deviation of the heights of points, in metres.
    #[must_use]
    pub fn deviation_m(places: &[Place]) -> f64 {
        statistics::deviation(places.iter().map(|(_, z)| *z))
    }
}

fn near(scan: &RawScan, track: &RollTrack, scanner: &Scanner, places: &mut Vec<Place>) {
    let mut points = Points::new();
    level(scan, track, scanner, &mut points);
    places.extend(points.iter().map(place).filter(|(y, _)| y.abs() <= REACH_M));
}
