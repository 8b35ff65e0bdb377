//! A whole drive in memory, small enough for a hundred miles: what reports and pictures are made of.
//!
//! Of every scan the slopes and the place are kept (96 bytes: 22 MB for a hundred miles), of sections at most [`SECTIONS`], evenly spread: when there
//! are more, every second one is let go. The log is read once.

mod along;

use std::path::Path;

use crossfall_core::protocol::Config;
use crossfall_core::protocol::message::{Message, Profile, PulseVerdict, flags};
use crossfall_core::sensors::novatel::Quality;

use crate::container::Error;
use crate::counters::Totals;
use crate::geodesy::Geodetic;
use crate::interrupt;
use crate::profiles::{Row, SlopeRow, UNRELIABLE, host_flags, sides};
use crate::section::Section;
use crate::side::{Side, WhichSlope};
use crate::units::{degrees, drift_ppm};
use crate::walk::Walk;
use crate::way::{Reach, Way};

pub use along::Unit;

/// Sections kept.
pub const SECTIONS: usize = 240;

/// One scan, in short.
#[derive(Clone, Copy, Debug)]
pub struct Scan {
    /// Its number.
    pub number: u32,
    /// GPS seconds of the week, NaN where not known.
    pub gps_seconds: f64,
    /// Metres along the track, NaN where not known.
    pub station_m: f64,
    /// Where the scanner was; NaN where not known.
    pub place: Geodetic,
    /// Roll at straight down, degrees.
    pub roll_deg: f32,
    /// [The four slopes](WhichSlope::ALL) in degrees and the half widths of their intervals; NaN where not found.
    pub slopes: [(f32, f32); 4],
    /// Left and right edge of the road in metres, left positive; NaN where not found.
    pub edges_m: [f32; 2],
    /// Flags of the scan and of each side, left and right.
    pub flags: [u16; 2],
}

impl Scan {
    /// Whether a side does not say itself [unreliable](UNRELIABLE).
    #[must_use]
    pub fn is_reliable(&self, side: Side) -> bool {
        self.flags[side.index()] & UNRELIABLE == 0
    }

    /// One of the four slopes and the half width of its interval (NaN where it has none) in degrees, where it was found and can be relied on.
    #[must_use]
    pub fn reliable(&self, slope: WhichSlope) -> Option<(f64, f64)> {
        let (value, ci95) = self.slopes[slope.index()];
        (value.is_finite() && self.is_reliable(slope.side)).then_some((f64::from(value), f64::from(ci95)))
    }
}

#[cfg(test)]
impl Scan {
    /// One at a station of which nothing else is known.
    pub(crate) fn at(number: u32, station_m: f64) -> Self {
        Self {
            number,
            gps_seconds: f64::NAN,
            station_m,
            place: [f64::NAN; 3],
            roll_deg: f32::NAN,
            slopes: [(f32::NAN, f32::NAN); 4],
            edges_m: [f32::NAN; 2],
            flags: [0; 2],
        }
    }
}

/// A section that was kept.
#[derive(Clone, Debug)]
pub struct Kept {
    /// Which of [`Drive::scans`].
    pub scan: usize,
    /// It.
    pub section: Section,
}

/// How the instrument did.
#[derive(Clone, Debug, Default)]
pub struct Health {
    /// Damaged, broken or missing parts of the log.
    pub damage: u64,
    /// Profiles whose scan is not in the log.
    pub unmatched: u64,
    /// The board's counters, over all its boots.
    pub totals: Totals,
    /// Poses, and how many of them were timed by pulses.
    pub poses: u64,
    /// See `poses`.
    pub poses_by_pulse: u64,
    /// Poses whose state was good.
    pub poses_good: u64,
    /// Pulses accepted.
    pub pulses: u64,
    /// Pulses that fitted no second.
    pub pulses_spurious: u64,
    /// Drift of the board's clock in parts per million, the last known.
    pub drift_ppm: Option<f64>,
    /// Scans that have each flag, by its bit.
    pub flagged: [u64; 16],
}

impl Health {
    /// Parts of the drive that are damaged, broken or missing, profiles without their scan included.
    #[must_use]
    pub fn passed_over(&self) -> u64 {
        self.damage + self.unmatched
    }
}

/// A drive.
#[derive(Clone, Debug, Default)]
pub struct Drive {
    /// Every scan that has a profile, in order.
    pub scans: Vec<Scan>,
    /// Sections, evenly spread over the scans.
    pub sections: Vec<Kept>,
    /// How the instrument did.
    pub health: Health,
    /// The last configuration in force.
    pub config: Config,
    /// Firmware and board, as they said.
    pub identity: Option<(String, String)>,
    /// GPS week of the first scan that has one.
    pub gps_week: Option<u16>,
}

impl Drive {
    /// Reads a log. `progress` is told how far it has been read, in bytes.
    ///
    /// # Errors
    /// When the log cannot be read at all, or the user asks to stop.
    pub fn read(log: &Path, progress: impl FnMut(u64)) -> Result<Self, Error> {
        Self::read_with(log, progress, |_| ())
    }

    /// [`Drive::read`], and gives the rows of the table of profiles on the way to `also`, as [`Rows`](crate::profiles::Rows) does.
    ///
    /// # Errors
    /// As of [`Drive::read`].
    pub fn read_with(log: &Path, mut progress: impl FnMut(u64), mut also: impl FnMut([Row; 2])) -> Result<Self, Error> {
        let mut walk = Walk::open(log)?;
        let mut drive = Self::default();
        let mut spacing = 1;
        while let Some(step) = walk.next(|message, track| {
            let Message::Profile(profile) = message else {
                drive.note(message);
                return false;
            };
            let rows = sides(profile, track.at(profile.time));
            drive.add(profile, &rows);
            also(rows);
            (drive.scans.len() - 1).is_multiple_of(spacing)
        }) {
            drive.sections.push(Kept { scan: drive.scans.len() - 1, section: step.section() });
            if drive.sections.len() > SECTIONS {
                let mut keep = false;
                drive.sections.retain(|_| {
                    keep = !keep;
                    keep
                });
                spacing *= 2;
            }
            progress(walk.offset());
        }
        interrupt::check()?;
        drive.health.damage = walk.damage();
        drive.health.unmatched = walk.unmatched();
        drive.health.totals = walk.totals().clone();
        Ok(drive)
    }

    fn add(&mut self, profile: &Profile, [left, right]: &[Row; 2]) {
        let position = left.position;
        let pair = |slope: Option<SlopeRow>| {
            slope.map_or((f32::NAN, f32::NAN), |s| (s.slope_deg as f32, s.ci95_deg.map_or(f32::NAN, |ci| ci as f32)))
        };
        self.gps_week = self.gps_week.or(position.gps.map(|(week, _)| week));
        self.scans.push(Scan {
            number: profile.scan,
            gps_seconds: position.gps.map_or(f64::NAN, |(_, seconds)| seconds),
            station_m: position.station_m.unwrap_or(f64::NAN),
            place: position.geodetic.unwrap_or([f64::NAN; 3]),
            roll_deg: degrees(profile.roll) as f32,
            slopes: [pair(left.adjacent), pair(left.opposing), pair(right.adjacent), pair(right.opposing)],
            edges_m: [left.edge_y_m, right.edge_y_m].map(|edge| edge.map_or(f32::NAN, |edge| edge as f32)),
            flags: [left.flags, right.flags],
        });
        for (bit, count) in self.health.flagged.iter_mut().enumerate() {
            *count += u64::from((left.flags | right.flags) >> bit & 1);
        }
    }

    fn note(&mut self, message: &Message<'_>) {
        let health = &mut self.health;
        match message {
            Message::Hello(hello) => self.identity = Some((hello.firmware.to_owned(), hello.board.to_owned())),
            Message::Config(now) => self.config = *now,
            Message::Pose(pose) => {
                health.poses += 1;
                health.poses_by_pulse += u64::from(pose.timed_by_pulse);
                health.poses_good += u64::from(Quality::of(pose.status) == Quality::Good);
            }
            Message::Pulse(pulse) => match pulse.verdict {
                PulseVerdict::Spurious => health.pulses_spurious += 1,
                PulseVerdict::Accepted | PulseVerdict::Restarted => health.pulses += 1,
            },
            Message::Clock(clock) => health.drift_ppm = Some(drift_ppm(clock)),
            _ => {}
        }
    }

    /// The track, for places of other drives to be found on; nothing for a drive without positions and stations.
    #[must_use]
    pub fn way(&self) -> Option<Way> {
        let known = self.scans.iter().filter(|scan| scan.place[0].is_finite() && scan.station_m.is_finite());
        Way::through(known.map(|scan| (scan.place, scan.station_m)), Reach::ROAD)
    }

    /// First and last station, where there are any.
    #[must_use]
    pub fn span_m(&self) -> Option<(f64, f64)> {
        let known = || self.scans.iter().map(|scan| scan.station_m).filter(|station| station.is_finite());
        Some((known().next()?, known().next_back()?))
    }

    /// Scans of which a side says itself [unreliable](UNRELIABLE).
    #[must_use]
    pub fn unreliable(&self, side: Side) -> u64 {
        self.scans.iter().filter(|scan| !scan.is_reliable(side)).count() as u64
    }

    /// Share of the scans in which a slope was found and can be relied on.
    #[must_use]
    pub fn found(&self, slope: WhichSlope) -> f64 {
        let found = self.scans.iter().filter(|scan| scan.reliable(slope).is_some()).count();
        found as f64 / self.scans.len().max(1) as f64
    }

    /// Whether nothing was lost on the way. What a board had under way when it booted again nobody knows.
    #[must_use]
    pub fn is_whole(&self) -> bool {
        let totals = &self.health.totals;
        self.health.passed_over() == 0 && totals.restarts() == 0 && totals.losses().is_empty()
    }

    /// Scans that have a flag.
    #[must_use]
    pub fn flagged(&self, flag: u16) -> u64 {
        self.health.flagged.get(flag.trailing_zeros() as usize).copied().unwrap_or_default()
    }

    /// Flags that speak of the instrument and not of the ground, with what they mean.
    pub const OF_THE_INSTRUMENT: [(u16, &'static str); 7] = [
        (flags::NO_ATTITUDE, "without attitude"),
        (flags::ATTITUDE_HELD, "with attitude held past the last pose"),
        (flags::ATTITUDE_DEGRADED, "with attitude of a degraded state"),
        (flags::TIME_BY_ARRIVAL, "timed by arrivals, not by pulses"),
        (flags::SCANNER_STATUS, "with a warning of the scanner"),
        (host_flags::NO_POSITION, "without a position"),
        (host_flags::STATION_ESTIMATED, "with an estimated station"),
    ];
}
