//! What a scene may say: bounds of every value, told by the key.

use std::path::Path;

use super::{Ins, Mode, Scene};
use crate::toml_file::{self, Invalid, within};

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
        within("drive.start_m", drive.start_m, 0.0, 1e6)?;
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
        for (name, list) in [("roll", &self.vehicle.roll), ("pitch", &self.vehicle.pitch), ("flex", &self.vehicle.flex)]
        {
            for (i, oscillation) in list.iter().enumerate() {
                within(&format!("vehicle.{name}[{i}].amplitude_deg"), oscillation.amplitude_deg, 0.0, 30.0)?;
                within(&format!("vehicle.{name}[{i}].frequency_hz"), oscillation.frequency_hz, 0.0, 20.0)?;
            }
        }
        for (i, wander) in self.vehicle.wander.iter().enumerate() {
            within(&format!("vehicle.wander[{i}].amplitude_m"), wander.amplitude_m, 0.0, 2.0)?;
            within(&format!("vehicle.wander[{i}].frequency_hz"), wander.frequency_hz, 0.0, 2.0)?;
        }
        let scanner = &self.scanner;
        within("scanner.mounting_offset_deg", scanner.mounting_offset_deg, -45.0, 45.0)?;
        within("scanner.delay_us", scanner.delay_us, -10_000.0, 100_000.0)?;
        within("scanner.range_noise_mm", scanner.range_noise_mm, 0.0, 1_000.0)?;
        within("scanner.max_range_m", scanner.max_range_m, 1.0, 32.0)?;
        within("scanner.dropout_share", scanner.dropout_share, 0.0, 1.0)?;
        within("scanner.motor_error_ppm", scanner.motor_error_ppm, -20_000.0, 20_000.0)?;
        check_ins("ins", &self.ins)?;
        if let Some(second) = &self.ins2 {
            check_ins("ins2", second)?;
        }
        within("clock.drift_ppm", self.clock.drift_ppm, -1_000.0, 1_000.0)?;
        within("clock.start_s", self.clock.start_s, 0.0, 1e6)?;
        self.check_sections()?;
        let vegetation = &self.vegetation;
        within("vegetation.share", vegetation.share, 0.0, 1.0)?;
        within("vegetation.mean_mm", vegetation.mean_mm, 0.0, 2_000.0)?;
        within("vegetation.max_mm", vegetation.max_mm, 0.0, 2_000.0)?;
        within("vegetation.stray_share", vegetation.stray_share, 0.0, 1.0)
    }

    fn check_sections(&self) -> Result<(), Invalid> {
        let sections = &self.sections;
        within("sections.spacing_m", sections.spacing_m, 1.0, 1e5)?;
        let surface = &sections.surface;
        within("sections.surface.roughness_mm", surface.roughness_mm, 0.0, 200.0)?;
        within("sections.surface.undulation_mm", surface.undulation_mm, 0.0, 200.0)?;
        let [shortest, longest] = surface.wavelength_m;
        if !(0.5 <= shortest && shortest <= longest && longest <= 1e4) {
            let expected = "two numbers from 0.5 to 10000, the lower first";
            return Err(Invalid::new("sections.surface.wavelength_m", format!("[{shortest}, {longest}]"), expected));
        }
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

fn check_ins(table: &str, ins: &Ins) -> Result<(), Invalid> {
    let key = |name: &str| format!("{table}.{name}");
    within(&key("rate_hz"), f64::from(ins.rate_hz), 1.0, 200.0)?;
    within(&key("baud"), f64::from(ins.baud), 9_600.0, 921_600.0)?;
    // A pose is 104 bytes and a TIME log 76, ten bits each.
    let needed = ins.rate_hz * 1_040 + if ins.time_log { 760 } else { 0 };
    if ins.baud < needed {
        return Err(Invalid::new(
            key("baud"),
            ins.baud,
            format!("at least {needed} for {} poses a second", ins.rate_hz),
        ));
    }
    within(&key("attitude_drift_deg"), ins.attitude_drift_deg, 0.0, 10.0)?;
    within(&key("attitude_drift_s"), ins.attitude_drift_s, 0.0, 1e5)?;
    within(&key("attitude_white_deg"), ins.attitude_white_deg, 0.0, 10.0)?;
    within(&key("roll_bias_deg"), ins.roll_bias_deg, -10.0, 10.0)?;
    within(&key("position_drift_m"), ins.position_drift_m, 0.0, 1e3)?;
    within(&key("position_drift_s"), ins.position_drift_s, 0.0, 1e5)?;
    within(&key("latency_min_ms"), ins.latency_min_ms, 0.0, 1_000.0)?;
    within(&key("latency_median_ms"), ins.latency_median_ms, 0.0, 1_000.0)?;
    within(&key("latency_p95_ms"), ins.latency_p95_ms, ins.latency_median_ms, 1_000.0)?;
    within(&key("latency_max_ms"), ins.latency_max_ms, ins.latency_min_ms, 2_000.0)?;
    within(&key("latency_spell_s"), ins.latency_spell_s, 0.0, 100.0)
}
