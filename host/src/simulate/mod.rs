//! Simulated drives: the bytes that both sensors would send on a drive whose truth is known.
//!
//! The same scene and seed give the same bytes on every platform: see [`noise`]. Simplifications: the vehicle rolls about the
//! scanner; pitch is in the poses alone; the ground varies across and slowly along the road.

pub mod lms;
pub mod motion;
pub mod noise;
pub mod scene;
pub mod section;
pub mod span;
pub mod truth;

use self::lms::Lms;
use self::motion::Attitude;
use self::noise::{Noise, Purpose};
use self::scene::Scene;
use self::section::Road;
use self::span::Span;
use crate::capture::{Channel, Writer};
use crate::{interrupt, output};

/// Time from the first pose and pulse to the first scan.
pub const LEAD_S: f64 = 0.5;

/// Poses go on for so long after the last scan, so that late ones still cover it.
const TAIL_S: f64 = 0.25;

/// Why a simulation ended early.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// The capture cannot be written.
    #[error(transparent)]
    Output(#[from] output::Error),
    /// The user asked to stop.
    #[error("interrupted")]
    Interrupted,
}

/// What a simulation made.
#[derive(Clone, Debug)]
pub struct Summary {
    /// The truth of every scan.
    pub truth: Vec<truth::Row>,
    /// Poses.
    pub poses: u64,
    /// Pulses.
    pub pulses: u64,
}

/// The number of scans of a scene.
#[must_use]
pub fn scans(scene: &Scene) -> usize {
    (libm::floor(scene.drive.seconds / (2.0 * Lms::turn_s(&scene.scanner))) as usize).max(1)
}

/// Simulates a drive into a capture, in the order of time. `progress` is told the number of scans done.
///
/// # Errors
/// When the capture cannot be written or the user asks to stop.
pub fn simulate(scene: &Scene, capture: &mut Writer, mut progress: impl FnMut(usize)) -> Result<Summary, Error> {
    let seed = scene.drive.seed;
    let count = scans(scene);
    let scan_s = 2.0 * Lms::turn_s(&scene.scanner);
    let end_s = LEAD_S + count as f64 * scan_s + TAIL_S;
    let attitude = Attitude::new(&scene.vehicle, &mut Noise::new(seed, Purpose::Motion));
    let length_m = end_s * scene.drive.speed_m_s;
    let road = Road::new(&scene.sections, length_m, count, &mut Noise::new(seed, Purpose::Sections));
    let mut lms = Lms::new(scene, &attitude, &road);
    let mut span = Span::new(scene, &attitude);
    let device_s = |t: f64| scene.clock.start_s + t * (1.0 + scene.clock.drift_ppm * 1e-6);
    let device_ns = |t: f64| libm::round(device_s(t) * 1e9) as u64;

    let mut summary = Summary { truth: Vec::with_capacity(count), poses: 0, pulses: 0 };
    let mut scan = 0;
    let mut telegram = Some(lms.scan(0, LEAD_S));
    let mut frame = Some(span.frame());
    let mut second = Some(0.0);
    loop {
        // Whatever comes first; a pulse before bytes of the same instant.
        let times = [second, frame.as_ref().map(|frame| frame.arrival_s), telegram.as_ref().map(|scan| scan.arrival_s)];
        let Some(next) = times.iter().flatten().copied().min_by(f64::total_cmp) else { break };
        if times[0] == Some(next) {
            capture.write(Channel::Pps, device_ns(next), &[])?;
            summary.pulses += 1;
            second = Some(next + 1.0).filter(|&next| next <= end_s);
        } else if times[1] == Some(next) {
            if let Some(now) = frame.take() {
                capture.write(Channel::Ins, device_ns(next), &now.bytes)?;
                // The TIME log is the other kind.
                summary.poses += u64::from(now.bytes.len() == 104);
            }
            frame = (span.valid_s() <= end_s).then(|| span.frame());
        } else if let Some(now) = telegram.take() {
            if interrupt::requested() {
                return Err(Error::Interrupted);
            }
            capture.write(Channel::Lidar, device_ns(next), &now.bytes)?;
            let turn_s = scan_s / 2.0;
            // Beams of both turns: half a turn of measuring in each, a turn apart.
            let station_m = scene.drive.speed_m_s * (now.start_s + 0.75 * turn_s);
            summary.truth.push(truth::Row {
                scan,
                start_device_s: device_s(now.start_s),
                roll_deg: attitude.roll_deg(now.start_s + turn_s / 4.0),
                station_m,
                section: road.at(station_m, scan),
            });
            scan += 1;
            progress(scan);
            telegram = (scan < count).then(|| lms.scan(scan, LEAD_S + scan as f64 * scan_s));
        }
    }
    Ok(summary)
}

#[cfg(test)]
mod tests;
