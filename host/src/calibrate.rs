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
//! cross slope is not known to better than roads are built, and the offset's uncertainty says so. Rock tests on one spot in
//! opposite directions need no level ground: [`join`] tells the ground's tilt from the scanner's.
//!
//! Standard errors allow for errors that last: those of the delay by Newey and West (1987) over one second, that of the offset by a
//! model of the unit's drift whose memory is unknown ([`drift`]).

mod drift;
mod estimate;
mod gather;
mod ground;
mod join;
mod layers;
mod picture;
pub(crate) mod statistics;

use std::path::Path;

use crossfall_core::instrument::Event;
use crossfall_core::protocol::Config;
use crossfall_core::protocol::config::Scanner;
use crossfall_core::protocol::frame::Gap;
use crossfall_core::protocol::message::{Message, Pose};
use crossfall_core::scan::RawScan;
use serde::Serialize;

use crate::container::Error;
use crate::interrupt;
use crate::stream::{Item, Stream};

pub use estimate::estimate;
pub use gather::Gatherer;
pub use join::join;
pub use layers::{DRAWN_SCANS, Layers, layers};
pub use picture::picture;

/// Scans that are read: half an hour. More would not make the answer better than the sensors are.
const MOST_SCANS: usize = 67_500;

/// Fewest scans that anything is said about: five seconds.
const LEAST_SCANS: usize = 187;

/// What a log holds for a calibration: of one boot of the board.
#[derive(Debug, Default)]
pub struct Drive {
    /// Its scans, in order.
    pub scans: Vec<RawScan>,
    /// Its poses near a scan, in order.
    pub poses: Vec<Pose>,
    /// The configuration in force.
    pub config: Config,
    /// Frames, gaps and parts of the file that could not be used.
    pub damage: u64,
    /// What was good and is not here; for a reader.
    pub left_out: Vec<String>,
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
    /// Its standard error, the unit's slow error included.
    pub roll_offset_se_deg: f64,
    /// Whether the offset is known well enough to be used.
    pub offset_determined: bool,
    /// How much later than documented the first byte of a telegram arrives, to be put into the configuration.
    pub lidar_delay_us: f64,
    /// Its standard error.
    pub lidar_delay_se_us: f64,
    /// Whether the delay could be told at all.
    pub delay_determined: bool,
    /// Why not, or what the answer rests on; for a reader.
    pub remarks: Vec<String>,
    /// Why the delay could not be told; among the remarks, too.
    #[serde(skip)]
    pub delay_remark: Option<String>,
    /// What of the log the answer does not rest on; among the remarks, too.
    #[serde(skip)]
    pub left_out: Vec<String>,
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
    /// What of `residual_after_deg` the noise of the ranges alone explains, by their scatter about each scan's own line.
    pub residual_ranges_deg: f64,
    /// The rest of it: the unit's noise and drift, and whatever the processing adds.
    pub residual_rest_deg: f64,
    /// Direction of the vehicle, clockwise from north, in degrees.
    pub azimuth_deg: f64,
}

impl Estimate {
    /// A scanner's settings with what was found put in; what could not be told stays as it was.
    ///
    /// # Errors
    /// When the offset is none of a scanner's: as an angle it would wrap to one that looks like one.
    pub fn scanner(&self, old: &Scanner) -> Result<Scanner, Refusal> {
        let mut new = *old;
        if self.offset_determined {
            if !(-90.0..=90.0).contains(&self.roll_offset_deg) {
                return Err(Refusal::Offset { degrees: self.roll_offset_deg });
            }
            new.mounting_offset = crate::units::angle_of(self.roll_offset_deg);
        }
        if self.delay_determined {
            new.delay_us = self.lidar_delay_us.round() as i32;
        }
        Ok(new)
    }
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
    /// The mounting offset cannot be one.
    #[error("a mounting offset of {degrees} degrees, expected one from -90 to 90")]
    Offset {
        /// What came out.
        degrees: f64,
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

/// Reads what a calibration needs: of a log in which the board booted again, the longest stretch without it.
///
/// # Errors
/// When the log cannot be opened, or the user asks to stop.
pub fn read(path: &Path) -> Result<Drive, Error> {
    let mut stream = Stream::open(path)?;
    let mut gatherer = Gatherer::new(Config::default(), MOST_SCANS);
    let mut stretches = Stretches::default();
    let (mut room, mut undecodable) = (RawScan::EMPTY, 0);
    while !gatherer.is_full()
        && let Some((_, item)) = stream.next()
    {
        let Item::Message { message, gap } = item else { continue };
        // Where the hello that tells of the boot is lost, time tells.
        let restarted = match (gap, &message) {
            (Gap::Restarted, _) => true,
            (_, Message::Scan(scan)) => gatherer.is_behind(scan.stx),
            (_, Message::Pose(pose)) => gatherer.is_behind(pose.time),
            _ => false,
        };
        if restarted {
            stretches.add(gatherer.restart());
        }
        match message {
            Message::Config(config) => gatherer.configure(config),
            Message::Pose(pose) => gatherer.pose(&pose),
            Message::Scan(_) => match Event::of(&message, &mut room) {
                Ok(_) => gatherer.scan(&room),
                Err(_) => undecodable += 1,
            },
            _ => {}
        }
    }
    interrupt::check()?;
    stretches.add(gatherer.into_drive());
    Ok(Drive { damage: stream.losses() + undecodable, ..stretches.longest() })
}

/// The stretches of a log between two boots of the board.
#[derive(Default)]
struct Stretches {
    longest: Drive,
    /// Those with scans, and their scans.
    count: u32,
    scans: usize,
}

impl Stretches {
    fn add(&mut self, drive: Drive) {
        self.count += u32::from(!drive.scans.is_empty());
        self.scans += drive.scans.len();
        if drive.scans.len() >= self.longest.scans.len() {
            self.longest = drive;
        }
    }

    fn longest(self) -> Drive {
        let Self { mut longest, count, scans } = self;
        if count > 1 {
            let used = longest.scans.len();
            let said = "the board booted again within the log";
            longest
                .left_out
                .push(format!("{said}: of {count} stretches only the longest was used, {used} of {scans} scans"));
        }
        longest
    }
}
