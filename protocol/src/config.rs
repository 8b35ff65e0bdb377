//! Everything that a user may change, in one structure, with the papers' values as defaults.
//!
//! The board echoes its configuration into the stream, so that a log always holds the one that its profiles were
//! made with. On the host the same numbers are written in degrees, millimetres and milliseconds (TOML).

mod check;

use postcard_schema::Schema;
use serde::{Deserialize, Serialize};

use crate::units::Angle;

pub use check::{ConfigError, INS_BAUDS, SCANNER_BAUDS, range};

/// The whole configuration of an instrument.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, Schema)]
pub struct Config {
    /// How the scanner is mounted, timed and read.
    pub scanner: Scanner,
    /// How the inertial unit is read.
    pub ins: Ins,
    /// How roll between and beyond poses is obtained.
    pub attitude: Attitude,
    /// How slopes are searched and measured.
    pub survey: Survey,
}

/// The laser scanner.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, Schema)]
pub struct Scanner {
    /// Added to the roll of every beam: the scanner's own tilt about the forward axis.
    pub mounting_offset: Angle,
    /// True when beam 0 looks to the vehicle's left: the scanner is mounted the other way round.
    pub mirrored: bool,
    /// How much later than its documented timing a telegram's first byte arrives, in microseconds.
    pub delay_us: i32,
    /// LMS measuring mode (configuration byte 101) assumed until the scanner's own B1 reply tells it.
    pub measuring_mode: u8,
    /// Baud rate of the scanner's line.
    pub baud: u32,
}

/// The inertial unit.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, Schema)]
pub struct Ins {
    /// Baud rate of the unit's line.
    pub baud: u32,
    /// How much earlier than its arrival a pose is valid, in microseconds: used only while there are no pulses.
    pub latency_us: u32,
    /// From the unit to the scanner in vehicle axes (forward, left, up), in millimetres.
    pub lever_arm_mm: [i32; 3],
}

/// The roll between and beyond poses.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, Schema)]
pub struct Attitude {
    /// The longest interval between two poses over which roll is interpolated, in microseconds.
    pub max_gap_us: u32,
    /// How long past the newest pose its roll is held, in microseconds; beyond, roll is 0 and the section is flagged.
    pub hold_us: u32,
}

/// Which algorithm selects and measures the slopes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, Schema)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Method {
    /// Bounded-loss selection and robust fit on the raw levelled points.
    Measuring,
    /// The criterion of the median-slope paper on resampled points: the exhaustive optimum.
    Seed,
}

/// Search and measurement.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, Schema)]
pub struct Survey {
    /// Which algorithm runs.
    pub method: Method,
    /// Limits of what counts as a slope, common to both methods.
    pub limits: Limits,
    /// Thresholds of [`Method::Seed`].
    pub seed: Seed,
    /// Parameters of [`Method::Measuring`].
    pub measuring: Measuring,
}

/// What counts as a slope (median-slope paper, step 3).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, Schema)]
pub struct Limits {
    /// Shortest segment.
    pub min_length_um: i32,
    /// Longest segment.
    pub max_length_um: i32,
    /// Least inclination.
    pub min_slope: Angle,
    /// Greatest inclination.
    pub max_slope: Angle,
    /// A point further from the line than this, before the line's end, obstructs it.
    pub obstruction_um: i32,
}

/// Thresholds of the paper's own search.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, Schema)]
pub struct Seed {
    /// Lateral spacing of the resampled points.
    pub spacing_um: i32,
    /// Half width of the band in which points count for a line.
    pub inlier_um: i32,
    /// T1: a departure is beyond this distance ...
    pub departure_um: i32,
    /// T2: ... for this many consecutive points.
    pub departure_points: u8,
    /// T3 < T1: the departure began where the distance first exceeded this.
    pub onset_um: i32,
}

/// Parameters of the measuring mode.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, Schema)]
pub struct Measuring {
    /// Standard deviation of one range (one sigma), the prior that a scan's own residuals update.
    pub range_sigma_um: i32,
    /// Standard deviation of the surface about its line, the prior likewise.
    pub roughness_um: i32,
}

impl Default for Scanner {
    fn default() -> Self {
        Self { mounting_offset: Angle::ZERO, mirrored: false, delay_us: 0, measuring_mode: 6, baud: 500_000 }
    }
}

impl Default for Ins {
    fn default() -> Self {
        Self { baud: 115_200, latency_us: 20_000, lever_arm_mm: [0; 3] }
    }
}

impl Default for Attitude {
    fn default() -> Self {
        Self { max_gap_us: 110_000, hold_us: 50_000 }
    }
}

impl Default for Survey {
    fn default() -> Self {
        Self {
            method: Method::Measuring,
            limits: Limits::default(),
            seed: Seed::default(),
            measuring: Measuring::default(),
        }
    }
}

impl Default for Limits {
    fn default() -> Self {
        Self {
            min_length_um: 1_500_000,
            max_length_um: 10_000_000,
            min_slope: Angle::from_microdegrees(4_000_000),
            max_slope: Angle::from_microdegrees(18_000_000),
            obstruction_um: 250_000,
        }
    }
}

impl Default for Seed {
    fn default() -> Self {
        Self { spacing_um: 100_000, inlier_um: 25_000, departure_um: 50_000, departure_points: 4, onset_um: 25_000 }
    }
}

impl Default for Measuring {
    fn default() -> Self {
        Self { range_sigma_um: 5_000, roughness_um: 2_000 }
    }
}
