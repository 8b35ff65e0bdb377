//! The inertial unit of a simulated drive: INSPVASB poses and, once a second, TIMEB, with the latencies of a real line.
//!
//! Attitude carries an error of two parts, one that drifts slowly (Gauss-Markov) and one that is new with every pose. A frame arrives
//! after a latency whose jitter is lognormal and comes in spells; frames keep their order and the line its speed.

use crossfall_core::sensors::novatel::crc32;

use super::motion::{Attitude, Place, Track, wrapped_deg};
use super::noise::{Drift, Noise, Purpose};
use super::scene::{Ins, Scene};
use crate::calendar::{Date, WEEK_S, unix_of_gps};
use crate::leap;

/// One frame.
#[derive(Clone, Debug)]
pub struct Frame {
    /// When its first byte arrives, in seconds of the drive.
    pub arrival_s: f64,
    /// Its bytes.
    pub bytes: Vec<u8>,
}

/// Where a unit is mounted.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Mount {
    /// In the vehicle: the drive's own unit.
    Vehicle,
    /// On the scanner's frame: a second unit.
    Scanner,
}

/// The unit.
#[derive(Debug)]
pub struct Span<'a> {
    mount: Mount,
    ins: &'a Ins,
    attitude: &'a Attitude,
    track: Track,
    gps_week: u16,
    gps_seconds: u32,
    noise: Noise,
    roll_drift: Drift,
    pitch_drift: Drift,
    position: Noise,
    position_drift: [Drift; 2],
    line: Line,
    pose: u64,
    time_due: Option<f64>,
}

impl<'a> Span<'a> {
    /// A unit on a vehicle.
    #[must_use]
    pub fn new(scene: &'a Scene, ins: &'a Ins, mount: Mount, attitude: &'a Attitude) -> Self {
        let step_s = 1.0 / f64::from(ins.rate_hz);
        let [inertial, latency, position] = match mount {
            Mount::Vehicle => [Purpose::Inertial, Purpose::Latency, Purpose::Position],
            Mount::Scanner => [Purpose::SecondInertial, Purpose::SecondLatency, Purpose::SecondPosition],
        };
        let mut noise = Noise::new(scene.drive.seed, inertial);
        let mut position = Noise::new(scene.drive.seed, position);
        Self {
            mount,
            ins,
            attitude,
            track: Track::new(&scene.drive),
            gps_week: scene.drive.gps_week,
            gps_seconds: scene.drive.gps_seconds,
            roll_drift: Drift::new(ins.attitude_drift_s, step_s, &mut noise),
            pitch_drift: Drift::new(ins.attitude_drift_s, step_s, &mut noise),
            noise,
            position_drift: [(); 2].map(|()| Drift::new(ins.position_drift_s, step_s, &mut position)),
            position,
            line: Line::new(ins, Noise::new(scene.drive.seed, latency)),
            pose: 0,
            time_due: None,
        }
    }

    /// Time of validity of the next pose, in seconds of the drive.
    #[must_use]
    pub fn valid_s(&self) -> f64 {
        self.pose as f64 / f64::from(self.ins.rate_hz)
    }

    /// The next frame in the order of arrival.
    pub fn frame(&mut self) -> Frame {
        if let Some(second) = self.time_due.take() {
            let bytes = time_log(self.gps_week, u64::from(self.gps_seconds) + second as u64);
            return Frame { arrival_s: self.line.arrival(second, bytes.len()), bytes };
        }
        let t = self.valid_s();
        let bytes = self.inspvas(t);
        let arrival_s = self.line.arrival(t, bytes.len());
        if self.ins.time_log && self.pose.is_multiple_of(u64::from(self.ins.rate_hz)) {
            self.time_due = Some(t);
        }
        self.pose += 1;
        self.track.step(1.0 / f64::from(self.ins.rate_hz));
        Frame { arrival_s, bytes }
    }

    fn inspvas(&mut self, t: f64) -> Vec<u8> {
        let place = self.track.place();
        let white = self.ins.attitude_white_deg;
        let drift = self.ins.attitude_drift_deg;
        let roll_error = drift * self.roll_drift.step(&mut self.noise) + white * self.noise.normal();
        let pitch_error = drift * self.pitch_drift.step(&mut self.noise) + white * self.noise.normal();
        let roll = match self.mount {
            Mount::Vehicle => self.attitude.roll_deg(t),
            Mount::Scanner => self.attitude.scanner_roll_deg(t),
        };
        let roll = roll + self.ins.roll_bias_deg + roll_error;
        let pitch = place.grade_deg + self.attitude.pitch_deg(t) + pitch_error;

        let rate = u64::from(self.ins.rate_hz);
        let whole = u64::from(self.gps_seconds) + self.pose / rate;
        let part = (self.pose % rate) as f64 / rate as f64;
        let (week, second) = in_week(self.gps_week, whole);
        let seconds = second as f64 + part;

        let mut bytes = Vec::with_capacity(104);
        bytes.extend([0xaa, 0x44, 0x13, 88]);
        bytes.extend(508_u16.to_le_bytes());
        bytes.extend(week.to_le_bytes());
        bytes.extend((libm::round(seconds * 1_000.0) as u32).to_le_bytes());
        bytes.extend(u32::from(week).to_le_bytes());
        let [north, east, up] = place.velocity_m_s;
        let [latitude, longitude] = self.reported(&place, self.attitude.lateral_m(t));
        let numbers = [seconds, latitude, longitude, place.height_m, north, east, up, roll, pitch, place.azimuth_deg];
        bytes.extend(numbers.iter().flat_map(|number| number.to_le_bytes()));
        // INS status: solution good.
        bytes.extend(3_u32.to_le_bytes());
        bytes.extend(crc32(&bytes).to_le_bytes());
        bytes
    }

    /// Latitude and longitude as the unit has them: beside the track, and with the error of its position.
    fn reported(&mut self, place: &Place, left_m: f64) -> [f64; 2] {
        let azimuth = place.azimuth_deg.to_radians();
        let drift = self.ins.position_drift_m;
        let [north, east] = &mut self.position_drift;
        let north_m = left_m * libm::sin(azimuth) + drift * north.step(&mut self.position);
        let east_m = -left_m * libm::cos(azimuth) + drift * east.step(&mut self.position);
        let per_degree = LATITUDE_DEGREE_M * libm::cos(place.latitude_deg.to_radians());
        [place.latitude_deg + north_m / LATITUDE_DEGREE_M, wrapped_deg(place.longitude_deg + east_m / per_degree)]
    }
}

/// A degree of latitude, good to 1 %: it turns errors of a few metres into degrees.
const LATITUDE_DEGREE_M: f64 = 111_200.0;

/// The serial line: latency, order, speed.
#[derive(Debug)]
struct Line {
    min_s: f64,
    median_s: f64,
    /// Standard deviation of the logarithm of what comes on top of the least latency.
    spread: f64,
    max_s: f64,
    byte_s: f64,
    spells: Drift,
    noise: Noise,
    free_at: f64,
}

impl Line {
    fn new(ins: &Ins, mut noise: Noise) -> Self {
        // The 95th percentile of a normal distribution lies 1.6449 deviations above its median.
        let ratio = if ins.latency_median_ms > 0.0 { ins.latency_p95_ms / ins.latency_median_ms } else { 1.0 };
        Self {
            min_s: ins.latency_min_ms * 1e-3,
            median_s: ins.latency_median_ms * 1e-3,
            spread: libm::log(ratio) / 1.644_853_626_951_472_7,
            max_s: ins.latency_max_ms * 1e-3,
            byte_s: 10.0 / f64::from(ins.baud),
            spells: Drift::new(ins.latency_spell_s, 1.0 / f64::from(ins.rate_hz), &mut noise),
            noise,
            free_at: f64::NEG_INFINITY,
        }
    }

    /// When a frame that is valid at a time arrives: its first byte.
    fn arrival(&mut self, valid_s: f64, length: usize) -> f64 {
        let jitter = self.median_s * libm::exp(self.spread * self.spells.step(&mut self.noise));
        let arrival = (valid_s + (self.min_s + jitter).min(self.max_s)).max(self.free_at);
        self.free_at = arrival + length as f64 * self.byte_s;
        arrival
    }
}

/// The week and second of a second counted from the beginning of a week.
fn in_week(week: u16, seconds: u64) -> (u16, u64) {
    (week.wrapping_add((seconds / WEEK_S) as u16), seconds % WEEK_S)
}

/// A TIME log (101) with its long header, valid at a whole second.
fn time_log(week: u16, seconds: u64) -> Vec<u8> {
    let (week, second) = in_week(week, seconds);
    let mut bytes = vec![0xaa, 0x44, 0x12, 28];
    bytes.extend(101_u16.to_le_bytes());
    // Binary, from COM1, 44 bytes of body, no sequence, idle time 90 %, FINESTEERING.
    bytes.extend([0, 0x20, 44, 0, 0, 0, 180, 180]);
    bytes.extend(week.to_le_bytes());
    bytes.extend((second as u32 * 1_000).to_le_bytes());
    bytes.extend([0; 8]);
    // Clock status: valid; offset and its deviation; UTC offset.
    bytes.extend(0_u32.to_le_bytes());
    let ahead = leap::seconds(week, second);
    for number in [1.0e-9, 2.0e-9, -(ahead as f64)] {
        bytes.extend(f64::to_le_bytes(number));
    }
    let utc = unix_of_gps(week, second);
    let Date { year, month, day } = Date::of_unix(utc);
    bytes.extend(year.to_le_bytes());
    bytes.extend([month, day, (utc % 86_400 / 3_600) as u8, (utc % 3_600 / 60) as u8]);
    bytes.extend((utc % 60 * 1_000).to_le_bytes()[..4].iter());
    // UTC status: valid.
    bytes.extend(1_u32.to_le_bytes());
    bytes.extend(crc32(&bytes).to_le_bytes());
    bytes
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn latencies_are_as_the_scene_says_and_keep_the_order() {
        let ins = Ins::default();
        let mut line = Line::new(&ins, Noise::new(3, Purpose::Latency));
        let mut last = 0.0;
        let mut latencies: Vec<f64> = (0..200_000)
            .map(|i| {
                let valid = f64::from(i) * 0.01;
                let arrival = line.arrival(valid, 104);
                assert!(arrival >= last + 104.0 * 10.0 / 115_200.0 - 1e-9);
                last = arrival;
                (arrival - valid) * 1e3
            })
            .collect();
        latencies.sort_by(f64::total_cmp);
        let at = |share: f64| latencies[(share * 199_999.0) as usize];
        assert!(at(0.0) >= 10.0);
        // As measured: 20 ms (median) and 117 ms (95 %) above the least latency of 10 ms.
        assert!((25.0..37.0).contains(&at(0.5)), "{}", at(0.5));
        assert!((110.0..145.0).contains(&at(0.95)), "{}", at(0.95));
        // Only the line's speed may push a frame beyond the greatest latency.
        assert!(at(1.0) < 180.0, "{}", at(1.0));
    }
}
