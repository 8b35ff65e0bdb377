//! Scenes: what a simulated drive looks like, as TOML that a user writes.
//!
//! Every key has its unit in its name and a default, so that a scene holds only what differs; an unknown key is an error.
//! `host/scenes/` has examples, [`Scene::default`] is `host/scenes/default.toml`. Slopes are signed as in profiles: positive = rising
//! outward, away from the vehicle.

mod check;

use serde::{Deserialize, Serialize};

use super::section::{Section, Side};

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
    /// A second unit, mounted on the scanner: it feels the flexing of the scanner's frame, the first one does not.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub ins2: Option<Ins>,
    /// The board's clock.
    pub clock: Clock,
    /// The ground beside the road.
    pub sections: Sections,
    /// What grows on it.
    pub vegetation: Vegetation,
}

impl Scene {
    /// A rock test: the vehicle is rocked by two degrees once a second while it stands on ground that is level as far as the calibration looks;
    /// its scanner is mounted and delayed by so much.
    #[must_use]
    pub fn rock_test(mounting_offset_deg: f64, delay_us: f64) -> Self {
        let mut scene = Self::default();
        scene.drive.speed_m_s = 0.0;
        scene.vehicle.roll = vec![Oscillation { amplitude_deg: 2.0, frequency_hz: 1.0 }];
        scene.vehicle.pitch = Vec::new();
        scene.scanner.mounting_offset_deg = mounting_offset_deg;
        scene.scanner.delay_us = delay_us;
        scene.sections.random.cross_slope_deg = [0.0; 2];
        scene.sections.random.left_edge_m = [4.0; 2];
        scene.sections.random.road_width_m = [8.0; 2];
        scene
    }
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
    /// Where on the road the drive begins: drives with the same road are repeats of each other.
    pub start_m: f64,
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
    /// Roll of the scanner's frame against the vehicle, which a unit inside the vehicle does not feel.
    pub flex: Vec<Oscillation>,
    /// To the left of the lane's middle, which the sections are measured from.
    pub wander: Vec<Wander>,
}

/// One part of the vehicle's way within its lane. Its phase is drawn from the seed.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct Wander {
    /// Amplitude.
    pub amplitude_m: f64,
    /// Frequency; 0 for a way that is off by a constant.
    pub frequency_hz: f64,
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

/// A kind of scanner.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Kind {
    /// An LMS 291 at 180 degrees in steps of half a degree.
    #[default]
    Lms291,
    /// An LMS 111 at 270 degrees in steps of half a degree, 50 scans a second, in CoLa B.
    Lms111,
}

/// The laser scanner, in millimetres.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize)]
#[serde(default, deny_unknown_fields)]
pub struct Scanner {
    /// What it is.
    pub kind: Kind,
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
    /// What its roll is off by from beginning to end: how it is mounted.
    pub roll_bias_deg: f64,
    /// Standard deviation of the slowly drifting error of its position, north and east each.
    pub position_drift_m: f64,
    /// Time constant of that.
    pub position_drift_s: f64,
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
    /// Seed of the random sections alone, instead of the drive's: the same road on another drive.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub seed: Option<u64>,
    /// What lies on the slopes' straight lines beyond the road.
    pub surface: Surface,
    /// Bounds of random sections.
    pub random: Random,
    /// Sections at places of the road, for the mode `stations`.
    pub station: Vec<Station>,
}

/// How far the ground beyond the road is from the straight lines of its section.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize, Serialize)]
#[serde(default, deny_unknown_fields)]
pub struct Surface {
    /// Standard deviation of a height that is new for every beam: stones, tufts.
    pub roughness_mm: f64,
    /// Standard deviation of the height of undulations.
    pub undulation_mm: f64,
    /// Their shortest and longest wavelength.
    pub wavelength_m: [f64; 2],
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
            start_m: 0.0,
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
            flex: Vec::new(),
            wander: Vec::new(),
        }
    }
}

impl Default for Scanner {
    fn default() -> Self {
        Self {
            kind: Kind::default(),
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
            roll_bias_deg: 0.0,
            position_drift_m: 0.0,
            position_drift_s: 600.0,
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
            seed: None,
            surface: Surface::default(),
            random: Random::default(),
            station: Vec::new(),
        }
    }
}

impl Default for Surface {
    fn default() -> Self {
        Self { roughness_mm: 0.0, undulation_mm: 0.0, wavelength_m: [2.0, 12.0] }
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
