//! Simulated drives: the bytes that both sensors would send on a drive whose truth is known.
//!
//! The same scene and seed give the same bytes on every platform: see [`noise`]. Simplifications: the vehicle rolls about the
//! scanner; pitch is in the poses alone; the ground varies across and slowly along the road.

pub mod cola;
pub mod lms;
pub mod motion;
pub mod noise;
pub mod scene;
pub mod section;
pub mod span;
pub mod surface;
pub mod truth;

use self::lms::Lms;
use self::motion::Attitude;
use self::noise::{Noise, Purpose};
use self::scene::Scene;
use self::section::Road;
use self::span::{Frame, Mount, Span};
use self::surface::Surface;
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
    /// Poses of the first unit.
    pub poses: u64,
    /// Pulses.
    pub pulses: u64,
}

/// The number of scans of a scene.
#[must_use]
pub fn scans(scene: &Scene) -> usize {
    (libm::floor(scene.drive.seconds / Lms::scan_s(&scene.scanner)) as usize).max(1)
}

/// Simulates a drive into a capture, in the order of time. `progress` is told the number of scans done.
///
/// # Errors
/// When the capture cannot be written or the user asks to stop.
pub fn simulate(scene: &Scene, capture: &mut Writer, mut progress: impl FnMut(usize)) -> Result<Summary, Error> {
    let seed = scene.drive.seed;
    let count = scans(scene);
    let scan_s = Lms::scan_s(&scene.scanner);
    let end_s = LEAD_S + count as f64 * scan_s + TAIL_S;
    let attitude = Attitude::new(&scene.vehicle, &mut Noise::new(seed, Purpose::Motion));
    let length_m = scene.drive.start_m + end_s * scene.drive.speed_m_s;
    let road_seed = scene.sections.seed.unwrap_or(seed);
    let road = Road::new(&scene.sections, length_m, count, &mut Noise::new(road_seed, Purpose::Sections));
    let surface = Surface::new(&scene.sections.surface, &mut Noise::new(road_seed, Purpose::Undulation));
    let mut lms = Lms::new(scene, &attitude, &road, &surface);
    let mut units = vec![Unit::new(Channel::Ins, Span::new(scene, &scene.ins, Mount::Vehicle, &attitude))];
    if let Some(second) = &scene.ins2 {
        units.push(Unit::new(Channel::Ins2, Span::new(scene, second, Mount::Scanner, &attitude)));
    }
    let device_s = |t: f64| scene.clock.start_s + t * (1.0 + scene.clock.drift_ppm * 1e-6);
    let device_ns = |t: f64| libm::round(device_s(t) * 1e9) as u64;

    let mut summary = Summary { truth: Vec::with_capacity(count), poses: 0, pulses: 0 };
    let mut scan = 0;
    let mut telegram = Some(lms.scan(0, LEAD_S));
    let mut second = Some(0.0);
    loop {
        // Whatever comes first; a pulse before bytes of the same instant.
        let frames = units.iter().filter_map(Unit::arrival_s);
        let others = second.into_iter().chain(telegram.as_ref().map(|scan| scan.arrival_s));
        let Some(next) = others.chain(frames).min_by(f64::total_cmp) else { break };
        if second == Some(next) {
            capture.write(Channel::Pps, device_ns(next), &[])?;
            summary.pulses += 1;
            second = Some(next + 1.0).filter(|&next| next <= end_s);
        } else if let Some(unit) = units.iter_mut().find(|unit| unit.arrival_s() == Some(next)) {
            if let Some(now) = unit.next(end_s) {
                capture.write(unit.channel, device_ns(next), &now.bytes)?;
                // The TIME log is the other kind.
                summary.poses += u64::from(unit.channel == Channel::Ins && now.bytes.len() == 104);
            }
        } else if let Some(now) = telegram.take() {
            if interrupt::requested() {
                return Err(Error::Interrupted);
            }
            capture.write(Channel::Lidar, device_ns(next), &now.bytes)?;
            let turn_s = Lms::turn_s(&scene.scanner);
            let middle_s = now.start_s + Lms::middle_s(&scene.scanner);
            let station_m = scene.drive.start_m + scene.drive.speed_m_s * middle_s;
            summary.truth.push(truth::Row {
                scan,
                start_device_s: device_s(now.start_s),
                roll_deg: attitude.scanner_roll_deg(now.start_s + turn_s / 4.0),
                station_m,
                section: road.at(station_m, scan).from_further_left(attitude.lateral_m(middle_s)),
            });
            scan += 1;
            progress(scan);
            telegram = (scan < count).then(|| lms.scan(scan, LEAD_S + scan as f64 * scan_s));
        }
    }
    Ok(summary)
}

/// An inertial unit and its next frame.
struct Unit<'a> {
    channel: Channel,
    span: Span<'a>,
    frame: Option<Frame>,
}

impl<'a> Unit<'a> {
    fn new(channel: Channel, mut span: Span<'a>) -> Self {
        let frame = Some(span.frame());
        Self { channel, span, frame }
    }

    fn arrival_s(&self) -> Option<f64> {
        self.frame.as_ref().map(|frame| frame.arrival_s)
    }

    /// The frame that is due; the one after it is prepared, up to the end of the drive.
    fn next(&mut self, end_s: f64) -> Option<Frame> {
        let due = self.frame.take();
        self.frame = (self.span.valid_s() <= end_s).then(|| self.span.frame());
        due
    }
}

#[cfg(test)]
mod tests;
