//! One levelled section out of a log: what the survey saw and what it made of it.

use std::collections::VecDeque;
use std::path::Path;

use crossfall_core::attitude::History;
use crossfall_core::instrument::{Event, WAITING};
use crossfall_core::protocol::config::Scanner;
use crossfall_core::protocol::message::{Message, Profile, ScanMode, Session};
use crossfall_core::protocol::{Angle, Config, DeviceTime};
use crossfall_core::scan::{MAX_BEAMS, Points, RawScan, RollTrack, level};

use crate::container::Error;
use crate::stream::{Item, Stream};

/// A place in a section: metres to the left of the sensor and above it.
pub type Place = (f64, f64);

/// A section.
#[derive(Clone, Debug)]
pub struct Section {
    /// Points as measured, without roll and mounting offset.
    pub raw: Vec<Place>,
    /// Points with every beam turned by the roll of its own instant.
    pub levelled: Vec<Place>,
    /// What the board made of it.
    pub profile: Profile,
}

/// The section of a scan, by the scan's number; nothing when the log has no profile of it.
///
/// # Errors
/// When the file cannot be read or is no log.
pub fn of_scan(path: &Path, number: u32) -> Result<Option<Section>, Error> {
    let mut stream = Stream::open(path)?;
    let mut history = History::default();
    let mut config = Config::default();
    let mut recent: VecDeque<RawScan> = VecDeque::new();
    let mode = ScanMode { span_deg: 180, step_cdeg: 50, measuring: 6 };
    let mut room =
        RawScan { index: 0, stx: DeviceTime(0), layout: 0, mode, status: 0, counters: None, values: [0; MAX_BEAMS] };
    while let Some((_, item)) = stream.next() {
        let Item::Message { message, .. } = item else { continue };
        match message {
            Message::Config(now) => config = now,
            Message::Pose(pose) => history.push(&pose),
            Message::Session(Session::Started(_)) => history.clear(),
            Message::Scan(_) => {
                if let Ok(Event::Scan(scan)) = Event::of(&message, &mut room) {
                    if recent.len() > WAITING {
                        recent.pop_front();
                    }
                    recent.push_back(scan.clone());
                }
            }
            Message::Profile(profile) if profile.scan == number => {
                let Some(scan) = recent.iter().find(|scan| scan.index == number) else { return Ok(None) };
                let roll = history.over_scan(scan, profile.time, &config.attitude);
                let mut untilted = config.scanner;
                untilted.mounting_offset = Angle::ZERO;
                return Ok(Some(Section {
                    raw: places(scan, &RollTrack::constant(Angle::ZERO), &untilted),
                    levelled: places(scan, &roll.track, &config.scanner),
                    profile,
                }));
            }
            _ => {}
        }
    }
    Ok(None)
}

fn places(scan: &RawScan, track: &RollTrack, scanner: &Scanner) -> Vec<Place> {
    let mut points = Points::new();
    level(scan, track, scanner, &mut points);
    points.iter().map(|echo| (f64::from(echo.point.y_um) * 1e-6, f64::from(echo.point.z_um) * 1e-6)).collect()
}
