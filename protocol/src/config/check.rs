//! What a configuration must fulfil before it is put in force.
//!
//! The fixed-point code downstream relies on these ranges, no divisor is zero and no pair of thresholds contradicts itself. Nothing that passes is
//! clamped further on: what is put in force is what is measured with. A board keeps its old configuration when the
//! new one fails.

use core::fmt;
use core::ops::RangeInclusive;

use super::{Attitude, Config, Ins, Limits, Measuring, Method, Scanner, Seed, Survey};
use crate::units::Angle;

/// The ranges of single fields, in the wire's units. What a user is told is made of these too.
pub mod range {
    use core::ops::RangeInclusive;

    /// A field's least and greatest value.
    pub type Range = RangeInclusive<i64>;

    /// `scanner.mounting_offset`, microdegrees.
    pub const MOUNTING_OFFSET: Range = -90_000_000..=90_000_000;
    /// `scanner.delay_us`.
    pub const DELAY_US: Range = -200_000..=200_000;
    /// `scanner.measuring_mode`.
    pub const MEASURING_MODE: Range = 0..=6;
    /// `ins.latency_us`.
    pub const LATENCY_US: Range = 0..=200_000;
    /// `ins.lever_arm_mm`, each of the three.
    pub const LEVER_ARM_MM: Range = -50_000..=50_000;
    /// `attitude.max_gap_us`.
    pub const MAX_GAP_US: Range = 1..=1_000_000;
    /// `attitude.hold_us`.
    pub const HOLD_US: Range = 0..=1_000_000;
    /// `survey.limits.min_length_um` and `max_length_um`: 50 m in micrometres leave five bits of an `i32` free.
    pub const LENGTH_UM: Range = 1..=50_000_000;
    /// `survey.limits.min_slope` and `max_slope`, microdegrees. The paper's search ends at [`STEEPEST_BY_SEED`].
    pub const SLOPE: Range = 0..=60_000_000;
    /// Steepest slope that the paper's search looks for, microdegrees.
    pub const STEEPEST_BY_SEED: i64 = 45_000_000;
    /// `survey.limits.obstruction_um`: residuals have 15 bits of 8 micrometres.
    pub const OBSTRUCTION_UM: Range = 1..=262_000;
    /// `survey.seed.spacing_um`: closer would be closer than the beams on a road, and a search of 50 mm takes a board many times as long as a scan lasts.
    pub const SPACING_UM: Range = 50_000..=1_000_000;
    /// `survey.seed.inlier_um`.
    pub const INLIER_UM: Range = 1..=262_000;
    /// `survey.seed.departure_um`: the search's thresholds have 22 bits.
    pub const DEPARTURE_UM: Range = 1..=4_194_000;
    /// `survey.seed.departure_points`.
    pub const DEPARTURE_POINTS: Range = 1..=100;
    /// `survey.seed.onset_um`.
    pub const ONSET_UM: Range = 0..=4_194_000;
    /// `survey.measuring.range_sigma_um`.
    pub const RANGE_SIGMA_UM: Range = 100..=60_000;
    /// `survey.measuring.roughness_um`: its square has 24 bits of 8 micrometres squared.
    pub const ROUGHNESS_UM: Range = 0..=32_700;
}

/// Baud rates of an LMS 2xx (TL, command 20h).
pub const SCANNER_BAUDS: [u32; 4] = [9_600, 19_200, 38_400, 500_000];

/// Baud rates of a NovAtel serial port (`SERIALCONFIG`).
pub const INS_BAUDS: [u32; 8] = [9_600, 19_200, 38_400, 57_600, 115_200, 230_400, 460_800, 921_600];

/// Why a configuration cannot be put in force.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum ConfigError {
    /// A field lies outside its range; angles in microdegrees, all else in the field's own unit.
    OutOfRange {
        /// Its path in the configuration.
        field: &'static str,
        /// What it is.
        value: i64,
        /// Least allowed value.
        min: i64,
        /// Greatest allowed value.
        max: i64,
    },
    /// The device has no such baud rate.
    NoSuchBaud {
        /// Path of the field in the configuration.
        field: &'static str,
        /// What it is.
        value: u32,
    },
    /// T3 is not less than T1: a departure would begin after it has been noticed.
    OnsetNotBelowDeparture,
    /// The shortest slope is longer than the longest.
    MinLengthAboveMax,
    /// The least inclination is not below the greatest.
    MinSlopeNotBelowMax,
    /// Points that obstruct a line would count for it.
    InlierBeyondObstruction,
}

impl fmt::Display for ConfigError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::OutOfRange { field, value, min, max } => write!(f, "{field} is {value}, must be {min} to {max}"),
            Self::NoSuchBaud { field, value } => write!(f, "{field} is {value}, which the device does not have"),
            Self::OnsetNotBelowDeparture => {
                f.write_str("survey.seed.onset_um (T3) must be less than survey.seed.departure_um (T1)")
            }
            Self::MinLengthAboveMax => {
                f.write_str("survey.limits.min_length_um must not exceed survey.limits.max_length_um")
            }
            Self::MinSlopeNotBelowMax => {
                f.write_str("survey.limits.min_slope must be less than survey.limits.max_slope")
            }
            Self::InlierBeyondObstruction => {
                f.write_str("survey.seed.inlier_um must not exceed survey.limits.obstruction_um")
            }
        }
    }
}

impl core::error::Error for ConfigError {}

/// A field within its range.
fn within(field: &'static str, value: impl Into<i64>, range: RangeInclusive<i64>) -> Result<(), ConfigError> {
    let value = value.into();
    let (min, max) = range.into_inner();
    if (min..=max).contains(&value) { Ok(()) } else { Err(ConfigError::OutOfRange { field, value, min, max }) }
}

/// An angle within a range in microdegrees. Compared as binary angles, so that rounding to microdegrees decides nothing.
fn angle(field: &'static str, value: Angle, range: RangeInclusive<i64>) -> Result<(), ConfigError> {
    let (min, max) = range.into_inner();
    if value < Angle::from_microdegrees(min as i32) || value > Angle::from_microdegrees(max as i32) {
        return Err(ConfigError::OutOfRange { field, value: value.to_microdegrees().into(), min, max });
    }
    Ok(())
}

fn baud(field: &'static str, value: u32, known: &[u32]) -> Result<(), ConfigError> {
    if known.contains(&value) { Ok(()) } else { Err(ConfigError::NoSuchBaud { field, value }) }
}

impl Config {
    /// Whether the configuration can be put in force.
    ///
    /// # Errors
    /// The first [`ConfigError`] in the order of the fields.
    pub fn check(&self) -> Result<(), ConfigError> {
        self.scanner.check()?;
        self.ins.check()?;
        self.attitude.check()?;
        self.survey.check()
    }
}

impl Scanner {
    fn check(&self) -> Result<(), ConfigError> {
        angle("scanner.mounting_offset", self.mounting_offset, range::MOUNTING_OFFSET)?;
        within("scanner.delay_us", self.delay_us, range::DELAY_US)?;
        within("scanner.measuring_mode", self.measuring_mode, range::MEASURING_MODE)?;
        baud("scanner.baud", self.baud, &SCANNER_BAUDS)
    }
}

impl Ins {
    fn check(&self) -> Result<(), ConfigError> {
        baud("ins.baud", self.baud, &INS_BAUDS)?;
        within("ins.latency_us", self.latency_us, range::LATENCY_US)?;
        self.lever_arm_mm.iter().try_for_each(|&arm| within("ins.lever_arm_mm", arm, range::LEVER_ARM_MM))
    }
}

impl Attitude {
    fn check(&self) -> Result<(), ConfigError> {
        within("attitude.max_gap_us", self.max_gap_us, range::MAX_GAP_US)?;
        within("attitude.hold_us", self.hold_us, range::HOLD_US)
    }
}

impl Survey {
    fn check(&self) -> Result<(), ConfigError> {
        self.limits.check()?;
        self.seed.check()?;
        self.measuring.check()?;
        if self.seed.inlier_um > self.limits.obstruction_um {
            return Err(ConfigError::InlierBeyondObstruction);
        }
        match self.method {
            Method::Seed => angle("survey.limits.max_slope", self.limits.max_slope, 0..=range::STEEPEST_BY_SEED),
            Method::Measuring => Ok(()),
        }
    }
}

impl Limits {
    fn check(&self) -> Result<(), ConfigError> {
        within("survey.limits.min_length_um", self.min_length_um, range::LENGTH_UM)?;
        within("survey.limits.max_length_um", self.max_length_um, range::LENGTH_UM)?;
        angle("survey.limits.min_slope", self.min_slope, range::SLOPE)?;
        angle("survey.limits.max_slope", self.max_slope, range::SLOPE)?;
        within("survey.limits.obstruction_um", self.obstruction_um, range::OBSTRUCTION_UM)?;
        if self.min_length_um > self.max_length_um {
            return Err(ConfigError::MinLengthAboveMax);
        }
        if self.min_slope >= self.max_slope {
            return Err(ConfigError::MinSlopeNotBelowMax);
        }
        Ok(())
    }
}

impl Seed {
    fn check(&self) -> Result<(), ConfigError> {
        within("survey.seed.spacing_um", self.spacing_um, range::SPACING_UM)?;
        within("survey.seed.inlier_um", self.inlier_um, range::INLIER_UM)?;
        within("survey.seed.departure_um", self.departure_um, range::DEPARTURE_UM)?;
        within("survey.seed.departure_points", self.departure_points, range::DEPARTURE_POINTS)?;
        within("survey.seed.onset_um", self.onset_um, range::ONSET_UM)?;
        if self.onset_um >= self.departure_um {
            return Err(ConfigError::OnsetNotBelowDeparture);
        }
        Ok(())
    }
}

impl Measuring {
    fn check(&self) -> Result<(), ConfigError> {
        within("survey.measuring.range_sigma_um", self.range_sigma_um, range::RANGE_SIGMA_UM)?;
        within("survey.measuring.roughness_um", self.roughness_um, range::ROUGHNESS_UM)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn refused(change: impl FnOnce(&mut Config)) -> ConfigError {
        let mut config = Config::default();
        change(&mut config);
        config.check().expect_err("refused")
    }

    #[test]
    fn the_defaults_are_in_order() {
        assert_eq!(Config::default().check(), Ok(()));
    }

    #[test]
    fn contradictions_are_named() {
        assert_eq!(refused(|c| c.survey.seed.onset_um = 50_000), ConfigError::OnsetNotBelowDeparture);
        assert_eq!(refused(|c| c.survey.limits.min_length_um = 10_000_001), ConfigError::MinLengthAboveMax);
        let most = Config::default().survey.limits.max_slope;
        assert_eq!(refused(|c| c.survey.limits.min_slope = most), ConfigError::MinSlopeNotBelowMax);
        assert_eq!(refused(|c| c.survey.limits.obstruction_um = 24_999), ConfigError::InlierBeyondObstruction);
    }

    #[test]
    fn every_range_ends_where_it_says() {
        type Set = fn(&mut Config, i64);
        let fields: [(&str, Set, i64, i64); 17] = [
            ("scanner.delay_us", |c, v| c.scanner.delay_us = v as i32, -200_000, 200_000),
            ("scanner.measuring_mode", |c, v| c.scanner.measuring_mode = v as u8, 0, 6),
            ("ins.latency_us", |c, v| c.ins.latency_us = v as u32, 0, 200_000),
            ("ins.lever_arm_mm", |c, v| c.ins.lever_arm_mm[2] = v as i32, -50_000, 50_000),
            ("attitude.max_gap_us", |c, v| c.attitude.max_gap_us = v as u32, 1, 1_000_000),
            ("attitude.hold_us", |c, v| c.attitude.hold_us = v as u32, 0, 1_000_000),
            ("survey.limits.min_length_um", |c, v| c.survey.limits.min_length_um = v as i32, 1, 10_000_000),
            ("survey.limits.max_length_um", |c, v| c.survey.limits.max_length_um = v as i32, 1_500_000, 50_000_000),
            ("survey.limits.obstruction_um", |c, v| c.survey.limits.obstruction_um = v as i32, 25_000, 262_000),
            ("survey.seed.spacing_um", |c, v| c.survey.seed.spacing_um = v as i32, 50_000, 1_000_000),
            ("survey.seed.inlier_um", |c, v| c.survey.seed.inlier_um = v as i32, 1, 250_000),
            ("survey.seed.departure_um", |c, v| c.survey.seed.departure_um = v as i32, 25_001, 4_194_000),
            ("survey.seed.departure_points", |c, v| c.survey.seed.departure_points = v as u8, 1, 100),
            ("survey.seed.onset_um", |c, v| c.survey.seed.onset_um = v as i32, 0, 49_999),
            ("survey.measuring.range_sigma_um", |c, v| c.survey.measuring.range_sigma_um = v as i32, 100, 60_000),
            ("survey.measuring.roughness_um", |c, v| c.survey.measuring.roughness_um = v as i32, 0, 32_700),
            (
                "scanner.mounting_offset",
                |c, v| c.scanner.mounting_offset = Angle::from_microdegrees(v as i32),
                -90_000_000,
                90_000_000,
            ),
        ];
        for (field, set, min, max) in fields {
            for (value, allowed) in [(min - 1, false), (min, true), (max, true), (max + 1, false)] {
                let mut config = Config::default();
                set(&mut config, value);
                // What wraps to a great unsigned number is refused as well.
                assert_eq!(config.check().is_ok(), allowed, "{field} = {value}");
            }
        }
    }

    #[test]
    fn only_the_devices_own_bauds_pass() {
        let error = ConfigError::NoSuchBaud { field: "scanner.baud", value: 115_200 };
        assert_eq!(refused(|c| c.scanner.baud = 115_200), error);
        assert_eq!(refused(|c| c.ins.baud = 0), ConfigError::NoSuchBaud { field: "ins.baud", value: 0 });
    }
}
