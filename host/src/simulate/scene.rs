//! Scenes: what a simulated drive looks like, as TOML that a user writes.
//!
//! Every key has its unit in its name and a default, so that a scene holds only what differs; an unknown key is an error.
//! `host/scenes/` has examples, [`Scene::default`] is `host/scenes/default.toml`. Slopes are signed as in profiles: positive = rising
//! outward, away from the vehicle.

use std::path::Path;

use serde::{Deserialize, Serialize};

use super::section::{Section, Side};
use crate::toml_file::{self, Invalid, within};

/// A simulated drive.
#[derive(Clone, Debug, Default, PartialEq, Deserialize, Serialize)]
#[serde(default, deny_unknown_fields)]
pub struct Scene {
    /// How long, how fast, where.
    pub drive: Drive,
    /// How the vehicle moves on its springs.
    pub vehicle: Vehicle,
    /// The laser scanner.
    pub scanner: Scanner,
    /// The inertial unit.
    pub ins: Ins,
    /// The board's clock.
    pub clock: Clock,
    /// The ground beside the road.
    pub sections: Sections,
    /// What grows on it.
    pub vegetation: Vegetation,
}

/// How long, how fast, where.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize)]
#[serde(default, deny_unknown_fields)]
pub struct Drive {
    /// Time over which there are scans.
    pub seconds: f64,
    /// Seed of everything random.
    pub seed: u64,
    /// Speed over ground.
    pub speed_m_s: f64,
    /// Where the drive begins (WGS 84).
    pub latitude_deg: f64,
    /// Where the drive begins.
    pub longitude_deg: f64,
    /// Ellipsoid height at the beginning.
    pub height_m: f64,
    /// Direction of the drive at the beginning, clockwise from north.
    pub azimuth_deg: f64,
    /// GPS week of the first pose.
    pub gps_week: u16,
    /// Second of that week of the first pose; whole, as the first pulse comes with it.
    pub gps_seconds: u32,
    /// The road's pieces, one after the other, then straight on.
    pub track: Vec<Piece>,
}

/// A straight or a bend.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct Piece {
    /// Its length.
    pub length_m: f64,
    /// Radius of the bend, positive to the left; left out for a straight.
    pub radius_m: Option<f64>,
    /// Climb, in percent.
    #[serde(default)]
    pub grade_percent: f64,
}

/// How the vehicle moves on its springs: sums of oscillations.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize)]
#[serde(default, deny_unknown_fields)]
pub struct Vehicle {
    /// About the forward axis, positive = right side down.
    pub roll: Vec<Oscillation>,
    /// About the lateral axis, positive = nose up; added to the road's grade.
    pub pitch: Vec<Oscillation>,
}

/// One oscillation. Its phase is drawn from the seed.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct Oscillation {
    /// Amplitude.
    pub amplitude_deg: f64,
    /// Frequency.
    pub frequency_hz: f64,
}

/// The laser scanner: an LMS 291 at 180 degrees in steps of half a degree, in millimetres.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize)]
#[serde(default, deny_unknown_fields)]
pub struct Scanner {
    /// The scanner's own tilt about the forward axis.
    pub mounting_offset_deg: f64,
    /// Whether beam 0 looks to the left.
    pub mirrored: bool,
    /// How much later than documented a telegram arrives.
    pub delay_us: f64,
    /// Standard deviation of a range.
    pub range_noise_mm: f64,
    /// Beyond this nothing returns.
    pub max_range_m: f64,
    /// Share of beams that return nothing usable.
    pub dropout_share: f64,
    /// How fast the mirror runs against GPS, in parts per million.
    pub motor_error_ppm: f64,
    /// Whether telegrams end with the scan and telegram indices.
    pub index_bytes: bool,
}

/// The inertial unit: a SPAN with the logs INSPVASB and TIMEB.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize)]
#[serde(default, deny_unknown_fields)]
pub struct Ins {
    /// Poses a second.
    pub rate_hz: u32,
    /// Baud rate of its line.
    pub baud: u32,
    /// Standard deviation of what drifts slowly in roll and pitch.
    pub attitude_drift_deg: f64,
    /// Time constant of that.
    pub attitude_drift_s: f64,
    /// Standard deviation of what is new with every pose in roll and pitch.
    pub attitude_white_deg: f64,
    /// The least latency of a frame.
    pub latency_min_ms: f64,
    /// Median of what comes on top, before frames wait for each other on the line.
    pub latency_median_ms: f64,
    /// Its 95th percentile.
    pub latency_p95_ms: f64,
    /// The greatest latency.
    pub latency_max_ms: f64,
    /// How long a slow spell lasts: time constant of the latency.
    pub latency_spell_s: f64,
    /// Whether TIME is logged once a second.
    pub time_log: bool,
}

/// The board's clock.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize)]
#[serde(default, deny_unknown_fields)]
pub struct Clock {
    /// How fast it runs against GPS, in parts per million.
    pub drift_ppm: f64,
    /// What it shows at the first pose. 4294.0 makes its 32-bit counter of microseconds wrap within a second.
    pub start_s: f64,
}

/// The ground beside the road.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize)]
#[serde(default, deny_unknown_fields)]
pub struct Sections {
    /// Where sections come from.
    pub mode: Mode,
    /// How one passes into the next between stations.
    pub interpolation: Interpolation,
    /// Distance of random stations.
    pub spacing_m: f64,
    /// Bounds of random sections.
    pub random: Random,
    /// Sections at places of the road, for the mode `stations`.
    pub station: Vec<Station>,
}

/// Where sections come from.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Mode {
    /// A random section every `spacing_m`.
    RandomStations,
    /// A new random section for every scan: no drive, but a set of independent sections.
    RandomPerScan,
    /// The listed ones.
    Stations,
}

/// How one section passes into the next.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Interpolation {
    /// In a straight line.
    Linear,
    /// Level at both stations.
    Cosine,
}

/// Bounds, low and high, of random sections.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize)]
#[serde(default, deny_unknown_fields)]
pub struct Random {
    /// Height of the sensor above the road.
    pub height_m: [f64; 2],
    /// Slope of the road, positive = rising to the left.
    pub cross_slope_deg: [f64; 2],
    /// From the sensor to the left edge.
    pub left_edge_m: [f64; 2],
    /// From the left to the right edge.
    pub road_width_m: [f64; 2],
    /// Slope beside the road.
    pub adjacent_slope_deg: [f64; 2],
    /// Its horizontal length.
    pub adjacent_length_m: [f64; 2],
    /// Flat between the slopes.
    pub ditch_m: [f64; 2],
    /// Slope beyond the ditch.
    pub opposing_slope_deg: [f64; 2],
    /// Its horizontal length.
    pub opposing_length_m: [f64; 2],
}

/// A section at a place of the road.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct Station {
    /// Where, along the road.
    pub at_m: f64,
    /// Height of the sensor above the road.
    pub height_m: f64,
    /// Slope of the road, positive = rising to the left.
    pub cross_slope_deg: f64,
    /// To the left of the vehicle.
    pub left: StationSide,
    /// To the right of it.
    pub right: StationSide,
}

/// One side of a listed section; the keys are those of [`Random`].
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
#[expect(missing_docs, reason = "the keys mean what they mean in `Random`")]
pub struct StationSide {
    pub edge_m: f64,
    pub adjacent_slope_deg: f64,
    pub adjacent_length_m: f64,
    pub ditch_m: f64,
    pub opposing_slope_deg: f64,
    pub opposing_length_m: f64,
}

/// What grows beyond the road's edges.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize)]
#[serde(default, deny_unknown_fields)]
pub struct Vegetation {
    /// Share of off-road points that lie above the ground.
    pub share: f64,
    /// Their mean height.
    pub mean_mm: f64,
    /// Their greatest height.
    pub max_mm: f64,
    /// Share of off-road points that lie anywhere between the sensor and the ground.
    pub stray_share: f64,
}

impl Default for Drive {
    fn default() -> Self {
        Self {
            seconds: 60.0,
            seed: 1,
            speed_m_s: 22.0,
            latitude_deg: 40.8,
            longitude_deg: -77.86,
            height_m: 350.0,
            azimuth_deg: 30.0,
            gps_week: 2400,
            gps_seconds: 259_200,
            track: vec![
                Piece { length_m: 300.0, radius_m: None, grade_percent: 0.0 },
                Piece { length_m: 350.0, radius_m: Some(600.0), grade_percent: 1.5 },
                Piece { length_m: 250.0, radius_m: None, grade_percent: 0.0 },
                Piece { length_m: 300.0, radius_m: Some(-450.0), grade_percent: -1.0 },
            ],
        }
    }
}

impl Default for Vehicle {
    fn default() -> Self {
        Self {
            roll: vec![
                Oscillation { amplitude_deg: 1.2, frequency_hz: 0.8 },
                Oscillation { amplitude_deg: 0.25, frequency_hz: 1.9 },
            ],
            pitch: vec![Oscillation { amplitude_deg: 0.5, frequency_hz: 1.1 }],
        }
    }
}

impl Default for Scanner {
    fn default() -> Self {
        Self {
            mounting_offset_deg: 0.0,
            mirrored: false,
            delay_us: 0.0,
            range_noise_mm: 5.0,
            max_range_m: 30.0,
            dropout_share: 0.002,
            motor_error_ppm: 0.0,
            index_bytes: true,
        }
    }
}

impl Default for Ins {
    fn default() -> Self {
        Self {
            rate_hz: 100,
            baud: 115_200,
            attitude_drift_deg: 0.0168,
            attitude_drift_s: 30.0,
            attitude_white_deg: 0.0025,
            latency_min_ms: 10.0,
            latency_median_ms: 17.0,
            latency_p95_ms: 90.0,
            latency_max_ms: 170.0,
            latency_spell_s: 3.0,
            time_log: true,
        }
    }
}

impl Default for Clock {
    fn default() -> Self {
        Self { drift_ppm: 23.0, start_s: 1.0 }
    }
}

impl Default for Sections {
    fn default() -> Self {
        Self {
            mode: Mode::RandomStations,
            interpolation: Interpolation::Cosine,
            spacing_m: 60.0,
            random: Random::default(),
            station: Vec::new(),
        }
    }
}

impl Default for Random {
    fn default() -> Self {
        Self {
            height_m: [2.4, 2.6],
            cross_slope_deg: [-1.8, 1.8],
            left_edge_m: [2.5, 4.5],
            road_width_m: [7.0, 8.0],
            adjacent_slope_deg: [-10.0, -6.0],
            adjacent_length_m: [2.5, 6.0],
            ditch_m: [0.0, 1.5],
            opposing_slope_deg: [6.0, 10.0],
            opposing_length_m: [3.0, 8.0],
        }
    }
}

impl Default for Vegetation {
    fn default() -> Self {
        Self { share: 0.0, mean_mm: 50.0, max_mm: 200.0, stray_share: 0.0 }
    }
}

impl Station {
    pub(super) fn section(&self) -> Section {
        let side = |side: &StationSide| Side {
            edge_m: side.edge_m,
            adjacent_slope_deg: side.adjacent_slope_deg,
            adjacent_length_m: side.adjacent_length_m,
            ditch_m: side.ditch_m,
            opposing_slope_deg: side.opposing_slope_deg,
            opposing_length_m: side.opposing_length_m,
        };
        Section {
            height_m: self.height_m,
            cross_slope_deg: self.cross_slope_deg,
            left: side(&self.left),
            right: side(&self.right),
        }
    }
}

impl Scene {
    /// Reads and checks a scene.
    ///
    /// # Errors
    /// When the file cannot be read, has an unknown key, or a value out of range.
    pub fn read(path: &Path) -> Result<Self, toml_file::Error> {
        let scene: Self = toml_file::read(path)?;
        scene.check().map_err(|source| toml_file::Error::Value { path: path.to_path_buf(), source })?;
        Ok(scene)
    }

    /// Checks every value.
    ///
    /// # Errors
    /// Names the first value out of range.
    pub fn check(&self) -> Result<(), Invalid> {
        let drive = &self.drive;
        within("drive.seconds", drive.seconds, 0.1, 86_400.0)?;
        within("drive.speed_m_s", drive.speed_m_s, 0.0, 100.0)?;
        within("drive.latitude_deg", drive.latitude_deg, -85.0, 85.0)?;
        within("drive.longitude_deg", drive.longitude_deg, -180.0, 180.0)?;
        within("drive.height_m", drive.height_m, -1_000.0, 10_000.0)?;
        within("drive.azimuth_deg", drive.azimuth_deg, 0.0, 360.0)?;
        within("drive.gps_seconds", f64::from(drive.gps_seconds), 0.0, 604_799.0)?;
        for (i, piece) in drive.track.iter().enumerate() {
            let key = |name: &str| format!("drive.track[{i}].{name}");
            within(&key("length_m"), piece.length_m, 1.0, 1e6)?;
            within(&key("grade_percent"), piece.grade_percent, -30.0, 30.0)?;
            if let Some(radius) = piece.radius_m {
                within(&key("radius_m"), radius, -1e6, 1e6)?;
                if radius.abs() < 10.0 {
                    return Err(Invalid::new(key("radius_m"), radius, "at least 10 to the left or -10 to the right"));
                }
            }
        }
        for (name, list) in [("roll", &self.vehicle.roll), ("pitch", &self.vehicle.pitch)] {
            for (i, oscillation) in list.iter().enumerate() {
                within(&format!("vehicle.{name}[{i}].amplitude_deg"), oscillation.amplitude_deg, 0.0, 30.0)?;
                within(&format!("vehicle.{name}[{i}].frequency_hz"), oscillation.frequency_hz, 0.0, 20.0)?;
            }
        }
        let scanner = &self.scanner;
        within("scanner.mounting_offset_deg", scanner.mounting_offset_deg, -45.0, 45.0)?;
        within("scanner.delay_us", scanner.delay_us, -10_000.0, 100_000.0)?;
        within("scanner.range_noise_mm", scanner.range_noise_mm, 0.0, 1_000.0)?;
        within("scanner.max_range_m", scanner.max_range_m, 1.0, 32.0)?;
        within("scanner.dropout_share", scanner.dropout_share, 0.0, 1.0)?;
        within("scanner.motor_error_ppm", scanner.motor_error_ppm, -20_000.0, 20_000.0)?;
        self.check_ins()?;
        within("clock.drift_ppm", self.clock.drift_ppm, -1_000.0, 1_000.0)?;
        within("clock.start_s", self.clock.start_s, 0.0, 1e6)?;
        self.check_sections()?;
        let vegetation = &self.vegetation;
        within("vegetation.share", vegetation.share, 0.0, 1.0)?;
        within("vegetation.mean_mm", vegetation.mean_mm, 0.0, 2_000.0)?;
        within("vegetation.max_mm", vegetation.max_mm, 0.0, 2_000.0)?;
        within("vegetation.stray_share", vegetation.stray_share, 0.0, 1.0)
    }

    fn check_ins(&self) -> Result<(), Invalid> {
        let ins = &self.ins;
        within("ins.rate_hz", f64::from(ins.rate_hz), 1.0, 200.0)?;
        within("ins.baud", f64::from(ins.baud), 9_600.0, 921_600.0)?;
        // A pose is 104 bytes and a TIME log 76, ten bits each.
        let needed = ins.rate_hz * 1_040 + if ins.time_log { 760 } else { 0 };
        if ins.baud < needed {
            return Err(Invalid::new(
                "ins.baud",
                ins.baud,
                format!("at least {needed} for {} poses a second", ins.rate_hz),
            ));
        }
        within("ins.attitude_drift_deg", ins.attitude_drift_deg, 0.0, 10.0)?;
        within("ins.attitude_drift_s", ins.attitude_drift_s, 0.0, 1e5)?;
        within("ins.attitude_white_deg", ins.attitude_white_deg, 0.0, 10.0)?;
        within("ins.latency_min_ms", ins.latency_min_ms, 0.0, 1_000.0)?;
        within("ins.latency_median_ms", ins.latency_median_ms, 0.0, 1_000.0)?;
        within("ins.latency_p95_ms", ins.latency_p95_ms, ins.latency_median_ms, 1_000.0)?;
        within("ins.latency_max_ms", ins.latency_max_ms, ins.latency_min_ms, 2_000.0)?;
        within("ins.latency_spell_s", ins.latency_spell_s, 0.0, 100.0)
    }

    fn check_sections(&self) -> Result<(), Invalid> {
        let sections = &self.sections;
        within("sections.spacing_m", sections.spacing_m, 1.0, 1e5)?;
        let random = &sections.random;
        let bounds = [
            ("height_m", random.height_m, 0.5, 10.0),
            ("cross_slope_deg", random.cross_slope_deg, -20.0, 20.0),
            ("left_edge_m", random.left_edge_m, 0.5, 20.0),
            ("road_width_m", random.road_width_m, 1.0, 40.0),
            ("adjacent_slope_deg", random.adjacent_slope_deg, -60.0, 60.0),
            ("adjacent_length_m", random.adjacent_length_m, 0.01, 50.0),
            ("ditch_m", random.ditch_m, 0.0, 50.0),
            ("opposing_slope_deg", random.opposing_slope_deg, -60.0, 60.0),
            ("opposing_length_m", random.opposing_length_m, 0.01, 50.0),
        ];
        for (name, [a, b], low, high) in bounds {
            let key = format!("sections.random.{name}");
            if !(low <= a && a <= b && b <= high) {
                let expected = format!("two numbers from {low} to {high}, the lower first");
                return Err(Invalid::new(key, format!("[{a}, {b}]"), expected));
            }
        }
        if random.road_width_m[0] <= random.left_edge_m[1] {
            let expected = format!("more than sections.random.left_edge_m = {}", random.left_edge_m[1]);
            return Err(Invalid::new("sections.random.road_width_m", random.road_width_m[0], expected));
        }
        if sections.mode == Mode::Stations && sections.station.is_empty() {
            return Err(Invalid::new("sections.station", "none", "at least one with the mode \"stations\""));
        }
        if sections.mode != Mode::Stations && !sections.station.is_empty() {
            return Err(Invalid::new("sections.mode", "random", "\"stations\", as stations are listed"));
        }
        let mut last = f64::NEG_INFINITY;
        for (i, station) in sections.station.iter().enumerate() {
            let key = |name: &str| format!("sections.station[{i}].{name}");
            within(&key("at_m"), station.at_m, 0.0, 1e7)?;
            if station.at_m <= last {
                return Err(Invalid::new(key("at_m"), station.at_m, format!("more than {last}, the station before")));
            }
            last = station.at_m;
            within(&key("height_m"), station.height_m, 0.5, 10.0)?;
            within(&key("cross_slope_deg"), station.cross_slope_deg, -20.0, 20.0)?;
            for (name, side) in [("left", &station.left), ("right", &station.right)] {
                let key = |field: &str| key(&format!("{name}.{field}"));
                within(&key("edge_m"), side.edge_m, 0.5, 40.0)?;
                within(&key("adjacent_slope_deg"), side.adjacent_slope_deg, -60.0, 60.0)?;
                within(&key("adjacent_length_m"), side.adjacent_length_m, 0.01, 50.0)?;
                within(&key("ditch_m"), side.ditch_m, 0.0, 50.0)?;
                within(&key("opposing_slope_deg"), side.opposing_slope_deg, -60.0, 60.0)?;
                within(&key("opposing_length_m"), side.opposing_length_m, 0.01, 50.0)?;
            }
        }
        Ok(())
    }
}
