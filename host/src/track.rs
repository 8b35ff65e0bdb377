//! Where the vehicle was: positions, GPS time and station at any instant of the recent past.
//!
//! Station is the way travelled: the horizontal speed of the poses, integrated by the trapezoid rule. Speeds come from the unit's own filter and
//! are good to centimetres a second, while differences of positions would add up their noise. Below 0.05 m/s the vehicle stands.

use std::collections::VecDeque;

use crossfall_core::clock::GpsTime;
use crossfall_core::protocol::DeviceTime;
use crossfall_core::protocol::message::{ClockState, Fix, Pose};

/// Poses kept: more than the survey's longest wait at 200 Hz.
const KEPT: usize = 256;

/// Slower than this is standing still.
const STANDING_M_S: f64 = 0.05;

/// Longest interval that positions are interpolated over, and that station is integrated over, in seconds.
const LONGEST_S: f64 = 2.0;

/// A place on the drive.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Position {
    /// GPS week and seconds into it.
    pub gps: Option<(u16, f64)>,
    /// Latitude and longitude in degrees (WGS 84) and ellipsoid height in metres.
    pub geodetic: Option<[f64; 3]>,
    /// Metres along the track since the first pose with a velocity.
    pub station_m: Option<f64>,
}

#[derive(Clone, Copy, Debug)]
struct Knot {
    time: DeviceTime,
    gps: GpsTime,
    fix: Option<Fix>,
    speed_m_s: Option<f64>,
    station_m: f64,
}

/// The recent past.
#[derive(Clone, Debug, Default)]
pub struct Track {
    knots: VecDeque<Knot>,
    clock: Option<ClockState>,
}

impl Track {
    /// Takes in a pose. Those that do not advance time are left out.
    pub fn push(&mut self, pose: &Pose) {
        let speed_m_s = pose.fix.map(|fix| {
            let [north, east, _] = fix.velocity_mm_s.map(|mm| f64::from(mm) * 1e-3);
            let speed = north.hypot(east);
            if speed < STANDING_M_S { 0.0 } else { speed }
        });
        let mut station_m = 0.0;
        if let Some(last) = self.knots.back() {
            if pose.time <= last.time {
                return;
            }
            let seconds = pose.time.since(last.time) as f64 * 1e-6;
            let mean = match (last.speed_m_s, speed_m_s) {
                (Some(a), Some(b)) => (a + b) / 2.0,
                (Some(one), None) | (None, Some(one)) => one,
                (None, None) => 0.0,
            };
            station_m = last.station_m + if seconds <= LONGEST_S { mean * seconds } else { 0.0 };
        }
        if self.knots.len() == KEPT {
            self.knots.pop_front();
        }
        let gps = GpsTime::new(pose.gps_week, pose.gps_us);
        self.knots.push_back(Knot { time: pose.time, gps, fix: pose.fix, speed_m_s, station_m });
    }

    /// Takes in the clock's mapping.
    pub fn clock(&mut self, clock: &ClockState) {
        self.clock = Some(*clock);
    }

    /// The board has booted: its time begins again, the way travelled goes on.
    pub fn restart(&mut self) {
        if let Some(mut last) = self.knots.pop_back() {
            last.time = DeviceTime(0);
            (last.fix, last.speed_m_s) = (None, None);
            self.knots.clear();
            self.knots.push_back(last);
        }
        self.clock = None;
    }

    /// The place at an instant, as far as it is known.
    #[must_use]
    pub fn at(&self, time: DeviceTime) -> Position {
        let after = self.knots.partition_point(|knot| knot.time <= time);
        let (before, next) = (after.checked_sub(1).and_then(|i| self.knots.get(i)), self.knots.get(after));
        let (Some(a), Some(b)) = (before, next) else {
            return Position { gps: self.gps_by_clock(time), ..Position::default() };
        };
        let gap_us = b.time.since(a.time);
        if gap_us as f64 * 1e-6 > LONGEST_S {
            return Position { gps: self.gps_by_clock(time), ..Position::default() };
        }
        let part = time.since(a.time) as f64 / gap_us as f64;
        let between = |from: f64, to: f64| from + (to - from) * part;
        let gps = GpsTime(a.gps.0 + ((b.gps.0 - a.gps.0) as f64 * part).round() as i64);
        let geodetic = a.fix.zip(b.fix).map(|(a, b)| {
            [
                between(a.latitude_ndeg as f64 * 1e-9, b.latitude_ndeg as f64 * 1e-9),
                longitude(a.longitude_ndeg, b.longitude_ndeg, part),
                between(f64::from(a.height_mm) * 1e-3, f64::from(b.height_mm) * 1e-3),
            ]
        });
        let station_m = (a.speed_m_s.is_some() && b.speed_m_s.is_some()).then(|| between(a.station_m, b.station_m));
        Position { gps: Some(seconds(gps)), geodetic, station_m }
    }

    fn gps_by_clock(&self, time: DeviceTime) -> Option<(u16, f64)> {
        let clock = self.clock?;
        let (week, week_us) = clock.gps?;
        let since_us = time.since(clock.anchor) as f64;
        let gps_us = since_us - since_us * f64::from(clock.drift) / 4_294_967_296.0;
        Some(seconds(GpsTime(GpsTime::new(week, week_us).0 + gps_us.round() as i64)))
    }
}

fn seconds(gps: GpsTime) -> (u16, f64) {
    let (week, week_us) = gps.split();
    (week, week_us as f64 * 1e-6)
}

/// Between two longitudes the short way round, in degrees from -180 to 180.
fn longitude(from_ndeg: i64, to_ndeg: i64, part: f64) -> f64 {
    const TURN: i64 = 360_000_000_000;
    let step = (to_ndeg - from_ndeg + TURN / 2).rem_euclid(TURN) - TURN / 2;
    let degrees = from_ndeg as f64 * 1e-9 + step as f64 * 1e-9 * part;
    if degrees >= 180.0 {
        degrees - 360.0
    } else if degrees < -180.0 {
        degrees + 360.0
    } else {
        degrees
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crossfall_core::protocol::Angle;

    fn pose(time_us: u64, longitude_ndeg: i64, north_mm_s: i32) -> Pose {
        let fix =
            Fix { latitude_ndeg: 52_000_000_000, longitude_ndeg, height_mm: 40_000, velocity_mm_s: [north_mm_s, 0, 0] };
        Pose {
            time: DeviceTime(time_us),
            latency_us: 0,
            timed_by_pulse: true,
            gps_week: 2_400,
            gps_us: 1_000_000 + time_us,
            roll: Angle::ZERO,
            pitch: Angle::ZERO,
            azimuth: Angle::ZERO,
            fix: Some(fix),
            status: 3,
        }
    }

    #[test]
    fn stations_are_the_way_travelled() {
        let mut track = Track::default();
        for i in 0..=100 {
            track.push(&pose(i * 10_000, 0, 20_000));
        }
        let place = track.at(DeviceTime(505_000));
        assert!((place.station_m.unwrap() - 10.1).abs() < 1e-9);
        assert_eq!(place.gps, Some((2_400, 1.505)));
    }

    #[test]
    fn a_parked_vehicle_travels_nowhere() {
        let mut track = Track::default();
        for i in 0..=100 {
            track.push(&pose(i * 10_000, 0, if i % 2 == 0 { 20 } else { -20 }));
        }
        assert_eq!(track.at(DeviceTime(995_000)).station_m, Some(0.0));
    }

    #[test]
    fn the_date_line_is_crossed_the_short_way() {
        let mut track = Track::default();
        track.push(&pose(0, 179_999_999_000, 0));
        track.push(&pose(10_000, -179_999_999_000, 0));
        let [_, longitude, _] = track.at(DeviceTime(7_500)).geodetic.unwrap();
        assert!((longitude - -179.999_999_5).abs() < 1e-12, "{longitude}");
    }

    #[test]
    fn beyond_the_poses_nothing_is_made_up() {
        let mut track = Track::default();
        track.push(&pose(1_000_000, 0, 0));
        assert_eq!(track.at(DeviceTime(2_000_000)), Position::default());
    }
}
