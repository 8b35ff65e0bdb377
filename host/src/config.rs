//! The configuration as a user writes it: TOML in degrees, metres, millimetres and milliseconds.
//!
//! A file may hold only what differs from the defaults; an unknown key is an error, and so is a value out of range or two that
//! contradict each other. [`Config`] itself, as it goes over the wire, is in integers: what is written here is rounded to them
//! (angles to 8e-8 degrees, lengths to micrometres, times to microseconds).

use std::fmt::Write;
use std::path::Path;

use crossfall_protocol::config::{
    Attitude, Config, ConfigError, Ins, Limits, Measuring, Method, Scanner, Seed, Survey,
    range::{self, Range},
};
use crossfall_protocol::units::Angle;
use serde::Deserialize;

use crate::toml_file::{self, Invalid, within};
use crate::units::{self, angle_of};

/// Reads a configuration.
///
/// # Errors
/// When the file cannot be read, has an unknown key, or values that are out of range or contradict each other.
pub fn read(path: &Path) -> Result<Config, toml_file::Error> {
    let text =
        std::fs::read_to_string(path).map_err(|source| toml_file::Error::Io { path: path.to_path_buf(), source })?;
    parse(path, &text)
}

/// Parses the text of a configuration; `path` is for the error.
///
/// # Errors
/// As for [`read`].
pub fn parse(path: &Path, text: &str) -> Result<Config, toml_file::Error> {
    let file: File = toml_file::parse(path, text)?;
    file.config().map_err(|source| toml_file::Error::Value { path: path.to_path_buf(), source })
}

/// The whole configuration as commented TOML, which [`parse`] reads back.
#[must_use]
pub fn to_toml(config: &Config) -> String {
    let Config { scanner, ins, attitude, survey } = config;
    let mut out = String::new();
    let mut line = |text: std::fmt::Arguments| {
        // Writing to a string does not fail.
        let _ = writeln!(out, "{text}");
    };
    line(format_args!("# The laser scanner: how it is mounted, timed and read."));
    line(format_args!("[scanner]"));
    line(format_args!(
        "mounting_offset_deg = {:<10} # the scanner's own tilt, added to the roll of every beam",
        degrees(scanner.mounting_offset)
    ));
    line(format_args!("mirrored = {:<21} # true when beam 0 looks to the vehicle's left", scanner.mirrored));
    line(format_args!(
        "delay_ms = {:<21} # how much later than documented a telegram arrives",
        thousandths(i64::from(scanner.delay_us))
    ));
    line(format_args!(
        "measuring_mode = {:<15} # 0 to 6, assumed until the scanner tells its own",
        scanner.measuring_mode
    ));
    line(format_args!("baud = {:<25}", scanner.baud));
    line(format_args!("\n# The inertial unit."));
    line(format_args!("[ins]"));
    line(format_args!("baud = {:<25}", ins.baud));
    line(format_args!(
        "latency_ms = {:<19} # age of a pose at its arrival, used only while there are no pulses",
        thousandths(i64::from(ins.latency_us))
    ));
    let [forward, left, up] = ins.lever_arm_mm;
    let arm = format!("[{forward}, {left}, {up}]");
    line(format_args!("lever_arm_mm = {arm:<17} # from the unit to the scanner: forward, left, up"));
    line(format_args!("\n# The roll between and beyond poses."));
    line(format_args!("[attitude]"));
    line(format_args!(
        "max_gap_ms = {:<19} # the longest gap between poses that is interpolated over",
        thousandths(i64::from(attitude.max_gap_us))
    ));
    line(format_args!(
        "hold_ms = {:<22} # how long past the newest pose its roll is held",
        thousandths(i64::from(attitude.hold_us))
    ));
    line(format_args!("\n# How slopes are searched and measured."));
    line(format_args!("[survey]"));
    let method = match survey.method {
        Method::Measuring => "\"measuring\"",
        Method::Seed => "\"seed\"",
    };
    line(format_args!("method = {method:<23} # \"measuring\": robust fit on raw points; \"seed\": the paper's search"));
    let limits = survey.limits;
    line(format_args!("\n# What counts as a slope."));
    line(format_args!("[survey.limits]"));
    line(format_args!("min_length_m = {:<17}", millionths(limits.min_length_um)));
    line(format_args!("max_length_m = {:<17}", millionths(limits.max_length_um)));
    line(format_args!("min_slope_deg = {:<16}", degrees(limits.min_slope)));
    line(format_args!("max_slope_deg = {:<16}", degrees(limits.max_slope)));
    line(format_args!(
        "obstruction_mm = {:<15} # a point further from the line than this obstructs the slope",
        thousandths(i64::from(limits.obstruction_um))
    ));
    let seed = survey.seed;
    line(format_args!("\n# Thresholds of the method \"seed\"."));
    line(format_args!("[survey.seed]"));
    line(format_args!("spacing_mm = {:<19} # of the resampled points", thousandths(i64::from(seed.spacing_um))));
    line(format_args!(
        "inlier_mm = {:<20} # half width of the band in which points count",
        thousandths(i64::from(seed.inlier_um))
    ));
    line(format_args!(
        "departure_mm = {:<17} # T1: a line is left when points lie beyond this ...",
        thousandths(i64::from(seed.departure_um))
    ));
    line(format_args!("departure_points = {:<13} # T2: ... so many in a row ...", seed.departure_points));
    line(format_args!(
        "onset_mm = {:<21} # T3 < T1: ... from where they first lay beyond this",
        thousandths(i64::from(seed.onset_um))
    ));
    let measuring = survey.measuring;
    line(format_args!("\n# Priors of the method \"measuring\", which each scan's own residuals update."));
    line(format_args!("[survey.measuring]"));
    line(format_args!(
        "range_sigma_mm = {:<15} # standard deviation of a range",
        thousandths(i64::from(measuring.range_sigma_um))
    ));
    line(format_args!(
        "roughness_mm = {:<17} # standard deviation of the surface about its line",
        thousandths(i64::from(measuring.roughness_um))
    ));
    out.lines().map(str::trim_end).collect::<Vec<_>>().join("\n") + "\n"
}

#[derive(Deserialize)]
#[serde(default, deny_unknown_fields)]
#[derive(Default)]
struct File {
    scanner: ScannerTable,
    ins: InsTable,
    attitude: AttitudeTable,
    survey: SurveyTable,
}

/// A table of optional keys.
macro_rules! table {
    ($name:ident { $($key:ident: $type:ty),* $(,)? }) => {
        #[derive(Default, Deserialize)]
        #[serde(default, deny_unknown_fields)]
        struct $name { $($key: Option<$type>),* }
    };
}

table!(ScannerTable { mounting_offset_deg: f64, mirrored: bool, delay_ms: f64, measuring_mode: i64, baud: i64 });
table!(InsTable { baud: i64, latency_ms: f64, lever_arm_mm: [i64; 3] });
table!(AttitudeTable { max_gap_ms: f64, hold_ms: f64 });
table!(SurveyTable { method: String, limits: LimitsTable, seed: SeedTable, measuring: MeasuringTable });
table!(LimitsTable {
    min_length_m: f64,
    max_length_m: f64,
    min_slope_deg: f64,
    max_slope_deg: f64,
    obstruction_mm: f64
});
table!(SeedTable { spacing_mm: f64, inlier_mm: f64, departure_mm: f64, departure_points: i64, onset_mm: f64 });
table!(MeasuringTable { range_sigma_mm: f64, roughness_mm: f64 });

impl File {
    fn config(self) -> Result<Config, Invalid> {
        let config = Config {
            scanner: self.scanner.apply(Scanner::default())?,
            ins: self.ins.apply(Ins::default())?,
            attitude: self.attitude.apply(Attitude::default())?,
            survey: self.survey.apply(Survey::default())?,
        };
        agree(&config)?;
        Ok(config)
    }
}

impl ScannerTable {
    fn apply(self, default: Scanner) -> Result<Scanner, Invalid> {
        Ok(Scanner {
            mounting_offset: angle(
                "scanner.mounting_offset_deg",
                self.mounting_offset_deg,
                range::MOUNTING_OFFSET,
                default.mounting_offset,
            )?,
            mirrored: self.mirrored.unwrap_or(default.mirrored),
            delay_us: scaled("scanner.delay_ms", self.delay_ms, 1e3, range::DELAY_US, default.delay_us)?,
            measuring_mode: whole(
                "scanner.measuring_mode",
                self.measuring_mode,
                range::MEASURING_MODE,
                default.measuring_mode,
            )?,
            baud: whole("scanner.baud", self.baud, BAUD, default.baud)?,
        })
    }
}

impl InsTable {
    fn apply(self, default: Ins) -> Result<Ins, Invalid> {
        let mut lever_arm_mm = default.lever_arm_mm;
        for (into, value) in
            lever_arm_mm.iter_mut().zip(self.lever_arm_mm.unwrap_or(default.lever_arm_mm.map(i64::from)))
        {
            *into = whole("ins.lever_arm_mm", Some(value), range::LEVER_ARM_MM, 0)?;
        }
        Ok(Ins {
            baud: whole("ins.baud", self.baud, BAUD, default.baud)?,
            latency_us: scaled("ins.latency_ms", self.latency_ms, 1e3, range::LATENCY_US, default.latency_us)?,
            lever_arm_mm,
        })
    }
}

impl AttitudeTable {
    fn apply(self, default: Attitude) -> Result<Attitude, Invalid> {
        Ok(Attitude {
            max_gap_us: scaled("attitude.max_gap_ms", self.max_gap_ms, 1e3, range::MAX_GAP_US, default.max_gap_us)?,
            hold_us: scaled("attitude.hold_ms", self.hold_ms, 1e3, range::HOLD_US, default.hold_us)?,
        })
    }
}

impl SurveyTable {
    fn apply(self, default: Survey) -> Result<Survey, Invalid> {
        let method = match self.method.as_deref() {
            None => default.method,
            Some("measuring") => Method::Measuring,
            Some("seed") => Method::Seed,
            Some(other) => {
                return Err(Invalid::new("survey.method", format!("{other:?}"), "\"measuring\" or \"seed\""));
            }
        };
        let limits = self.limits.unwrap_or_default().apply(default.limits)?;
        let seed = self.seed.unwrap_or_default().apply(default.seed)?;
        let measuring = self.measuring.unwrap_or_default().apply(default.measuring)?;
        Ok(Survey { method, limits, seed, measuring })
    }
}

impl LimitsTable {
    fn apply(self, default: Limits) -> Result<Limits, Invalid> {
        let key = "survey.limits";
        Ok(Limits {
            min_length_um: scaled(
                &format!("{key}.min_length_m"),
                self.min_length_m,
                1e6,
                range::LENGTH_UM,
                default.min_length_um,
            )?,
            max_length_um: scaled(
                &format!("{key}.max_length_m"),
                self.max_length_m,
                1e6,
                range::LENGTH_UM,
                default.max_length_um,
            )?,
            min_slope: angle(&format!("{key}.min_slope_deg"), self.min_slope_deg, range::SLOPE, default.min_slope)?,
            max_slope: angle(&format!("{key}.max_slope_deg"), self.max_slope_deg, range::SLOPE, default.max_slope)?,
            obstruction_um: scaled(
                &format!("{key}.obstruction_mm"),
                self.obstruction_mm,
                1e3,
                range::OBSTRUCTION_UM,
                default.obstruction_um,
            )?,
        })
    }
}

impl SeedTable {
    fn apply(self, default: Seed) -> Result<Seed, Invalid> {
        let key = "survey.seed";
        Ok(Seed {
            spacing_um: scaled(
                &format!("{key}.spacing_mm"),
                self.spacing_mm,
                1e3,
                range::SPACING_UM,
                default.spacing_um,
            )?,
            inlier_um: scaled(&format!("{key}.inlier_mm"), self.inlier_mm, 1e3, range::INLIER_UM, default.inlier_um)?,
            departure_um: scaled(
                &format!("{key}.departure_mm"),
                self.departure_mm,
                1e3,
                range::DEPARTURE_UM,
                default.departure_um,
            )?,
            departure_points: whole(
                &format!("{key}.departure_points"),
                self.departure_points,
                range::DEPARTURE_POINTS,
                default.departure_points,
            )?,
            onset_um: scaled(&format!("{key}.onset_mm"), self.onset_mm, 1e3, range::ONSET_UM, default.onset_um)?,
        })
    }
}

impl MeasuringTable {
    fn apply(self, default: Measuring) -> Result<Measuring, Invalid> {
        let key = "survey.measuring";
        Ok(Measuring {
            range_sigma_um: scaled(
                &format!("{key}.range_sigma_mm"),
                self.range_sigma_mm,
                1e3,
                range::RANGE_SIGMA_UM,
                default.range_sigma_um,
            )?,
            roughness_um: scaled(
                &format!("{key}.roughness_mm"),
                self.roughness_mm,
                1e3,
                range::ROUGHNESS_UM,
                default.roughness_um,
            )?,
        })
    }
}

/// Values that must agree with each other.
fn agree(config: &Config) -> Result<(), Invalid> {
    let Survey { limits, seed, .. } = config.survey;
    if seed.onset_um >= seed.departure_um {
        let expected =
            format!("less than survey.seed.departure_mm = {} (T3 < T1)", thousandths(i64::from(seed.departure_um)));
        return Err(Invalid::new("survey.seed.onset_mm", thousandths(i64::from(seed.onset_um)), expected));
    }
    if limits.min_length_um >= limits.max_length_um {
        let expected = format!("less than survey.limits.max_length_m = {}", millionths(limits.max_length_um));
        return Err(Invalid::new("survey.limits.min_length_m", millionths(limits.min_length_um), expected));
    }
    if limits.min_slope.0 >= limits.max_slope.0 {
        let expected = format!("less than survey.limits.max_slope_deg = {}", degrees(limits.max_slope));
        return Err(Invalid::new("survey.limits.min_slope_deg", degrees(limits.min_slope), expected));
    }
    config.check().map_err(refused)
}

/// What a board would answer to it: rates that a device lacks, and what the ranges of single keys leave open.
fn refused(error: ConfigError) -> Invalid {
    match error {
        ConfigError::NoSuchBaud { field, value } => Invalid::new(field, value, "a rate that the device has"),
        ConfigError::OutOfRange { field: "survey.limits.max_slope", value, max, .. } => {
            let expected = format!("at most {} by the method \"seed\"", max as f64 / 1e6);
            Invalid::new("survey.limits.max_slope_deg", value as f64 / 1e6, expected)
        }
        contradiction => Invalid::new("survey", "a contradiction", contradiction.to_string()),
    }
}

/// Rates of any line; which of them a device has is for the check of the whole.
const BAUD: Range = 9_600..=921_600;

/// A range of the wire in the user's unit, `scale` of the wire's in one.
fn bounds(range: &Range, scale: f64) -> (f64, f64) {
    (*range.start() as f64 / scale, *range.end() as f64 / scale)
}

/// A number in the user's unit as an integer of the wire, `scale` of which make one.
fn scaled<T: TryFrom<i64>>(key: &str, value: Option<f64>, scale: f64, range: Range, default: T) -> Result<T, Invalid> {
    let Some(value) = value else { return Ok(default) };
    let (low, high) = bounds(&range, scale);
    within(key, value, low, high)?;
    // Within bounds that fit every integer of the wire.
    T::try_from((value * scale).round() as i64)
        .map_err(|_| Invalid::new(key, value, format!("a number from {low} to {high}")))
}

fn whole<T: TryFrom<i64>>(key: &str, value: Option<i64>, range: Range, default: T) -> Result<T, Invalid> {
    let Some(value) = value else { return Ok(default) };
    let error = || Invalid::new(key, value, format!("a whole number from {} to {}", range.start(), range.end()));
    if !range.contains(&value) {
        return Err(error());
    }
    T::try_from(value).map_err(|_| error())
}

fn angle(key: &str, value: Option<f64>, range: Range, default: Angle) -> Result<Angle, Invalid> {
    let Some(value) = value else { return Ok(default) };
    let (low, high) = bounds(&range, 1e6);
    within(key, value, low, high)?;
    Ok(angle_of(value))
}

/// Degrees as short as they can be written without becoming another angle.
fn degrees(angle: Angle) -> String {
    let short = f64::from(angle.to_microdegrees()) / 1e6;
    let exact = if angle_of(short) == angle { short } else { units::degrees(angle) };
    format!("{exact:?}")
}

fn thousandths(value: i64) -> String {
    format!("{:?}", value as f64 / 1e3)
}

fn millionths(value: i32) -> String {
    format!("{:?}", f64::from(value) / 1e6)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn refuse(text: &str) -> String {
        let error = parse(Path::new("c.toml"), text).unwrap_err().to_string();
        assert!(!error.contains('\n'), "{error}");
        error
    }

    #[test]
    fn the_defaults_are_printed_and_read_back() {
        let text = to_toml(&Config::default());
        assert_eq!(parse(Path::new("c.toml"), &text).unwrap(), Config::default());
        assert_eq!(parse(Path::new("c.toml"), "").unwrap(), Config::default());
    }

    #[test]
    fn any_configuration_comes_back_the_same() {
        let mut config = Config::default();
        config.scanner.mounting_offset = Angle(-123_457);
        config.scanner.delay_us = -1_501;
        config.scanner.mirrored = true;
        config.ins.lever_arm_mm = [1_200, -35, 800];
        config.survey.method = Method::Seed;
        config.survey.limits.min_slope = Angle(40_000_001);
        assert_eq!(parse(Path::new("c.toml"), &to_toml(&config)).unwrap(), config);
    }

    #[test]
    fn a_part_overrides_the_defaults() {
        let config = parse(Path::new("c.toml"), "[survey.seed]\nspacing_mm = 50.0\n").unwrap();
        let mut expected = Config::default();
        expected.survey.seed.spacing_um = 50_000;
        assert_eq!(config, expected);
    }

    #[test]
    fn what_cannot_be_is_refused_with_key_value_and_expectation() {
        assert_eq!(
            refuse("[survey.seed]\ndeparture_mm = 50.0\nonset_mm = 50.0"),
            "c.toml: survey.seed.onset_mm = 50.0, expected less than survey.seed.departure_mm = 50.0 (T3 < T1)"
        );
        assert_eq!(
            refuse("[scanner]\nmounting_offset_deg = 200.0"),
            "c.toml: scanner.mounting_offset_deg = 200, expected a number from -90 to 90"
        );
        assert_eq!(
            refuse("[scanner]\nmeasuring_mode = 7"),
            "c.toml: scanner.measuring_mode = 7, expected a whole number from 0 to 6"
        );
        assert!(refuse("[scanner]\ndelay = 3").starts_with("c.toml:2: unknown field `delay`, expected one of"));
        assert!(refuse("[survey]\nmethod = \"best\"").ends_with("expected \"measuring\" or \"seed\""));
        assert!(refuse("[ins]\nbaud = 915200").contains("ins.baud = 915200, expected a rate that the device has"));
        assert!(refuse("[ins]\nlatency_ms = nan").contains("ins.latency_ms = NaN, expected"));
        // What is accepted is what is measured with: no value is cut down to what the core can do.
        assert_eq!(
            refuse("[survey.limits]\nobstruction_mm = 300"),
            "c.toml: survey.limits.obstruction_mm = 300, expected a number from 0.001 to 262"
        );
        assert_eq!(
            refuse("[survey.seed]\nspacing_mm = 20"),
            "c.toml: survey.seed.spacing_mm = 20, expected a number from 50 to 1000"
        );
        assert_eq!(
            refuse("[survey]\nmethod = \"seed\"\n[survey.limits]\nmax_slope_deg = 50"),
            "c.toml: survey.limits.max_slope_deg = 50, expected at most 45 by the method \"seed\""
        );
    }
}
