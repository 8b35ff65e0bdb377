//! Where the scanner was: pose, GPS time and station at any instant of the recent past.
//!
//! Station is the way travelled: the horizontal speed of the poses, integrated by the trapezoid rule. Speeds come from the unit's own filter and
//! are good to centimetres a second, while differences of positions would add up their noise. Below 0.05 m/s the vehicle stands. Where poses or
//! their speeds are missing, the last speed is held for at most a minute and the station is marked as estimated; positions are never made up.
//!
//! A position is the scanner's: the unit's own, moved by the lever arm of the configuration, turned by the pose.

use std::collections::VecDeque;

use crossfall_core::clock::GpsTime;
use crossfall_core::protocol::message::{ClockState, Fix, Pose};
use crossfall_core::protocol::{Angle, Config, DeviceTime};

use crate::geodesy::{Geodetic, shifted};
use crate::profiles::degrees;

/// Poses kept: more than the survey's longest wait at 200 Hz.
const KEPT: usize = 256;

/// Slower than this is standing still.
const STANDING_M_S: f64 = 0.05;

/// Longest interval that positions are interpolated over, in seconds.
const LONGEST_S: f64 = 2.0;

/// Longest time for which the last speed is held where there is none.
const HELD_S: f64 = 60.0;

/// A place on the drive.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Position {
    /// GPS week and seconds into it.
    pub gps: Option<(u16, f64)>,
    /// The scanner's latitude and longitude in degrees (WGS 84) and ellipsoid height in metres.
    pub geodetic: Option<Geodetic>,
    /// How the vehicle is turned.
    pub turn: Option<Turn>,
    /// Metres along the track since the first pose with a velocity.
    pub station_m: Option<f64>,
    /// Whether `station_m` rests on a speed that was held and not measured.
    pub station_estimated: bool,
}

/// How the vehicle is turned, in radians by SPAN's signs.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Turn {
    /// Positive = right side down.
    pub roll: f64,
    /// Positive = nose up.
    pub pitch: f64,
    /// Clockwise from north.
    pub azimuth: f64,
}

impl Turn {
    /// East, north and up of a place that is known by its distances forward, to the left and up in the vehicle.
    #[must_use]
    pub fn of_vehicle(&self, [forward, left, up]: [f64; 3]) -> [f64; 3] {
        let (sin, cos) = self.roll.sin_cos();
        self.of_level([forward, left * cos - up * sin, up * cos + left * sin])
    }

    /// The same for a place whose roll has been taken out: a levelled section's.
    #[must_use]
    pub fn of_level(&self, [forward, left, up]: [f64; 3]) -> [f64; 3] {
        let (sin, cos) = self.pitch.sin_cos();
        let (ahead, up) = (forward * cos - up * sin, up * cos + forward * sin);
        let (sin, cos) = self.azimuth.sin_cos();
        [ahead * sin - left * cos, ahead * cos + left * sin, up]
    }
}

#[derive(Clone, Copy, Debug)]
struct Knot {
    time: DeviceTime,
    gps: GpsTime,
    roll: Angle,
    pitch: Angle,
    azimuth: Angle,
    fix: Option<Fix>,
    /// Where the vehicle is along its way; nothing before the first speed.
    station_m: Option<f64>,
    /// Whether its own speed is known, and that before it within [`LONGEST_S`].
    measured: bool,
    /// The last speed known, and for how long it has been held.
    speed_m_s: f64,
    held_s: f64,
}

/// The recent past.
#[derive(Clone, Debug, Default)]
pub struct Track {
    knots: VecDeque<Knot>,
    clock: Option<ClockState>,
    lever_arm_m: [f64; 3],
}

impl Track {
    /// Takes in a pose. Those that do not advance time are left out.
    pub fn push(&mut self, pose: &Pose) {
        let speed_m_s = pose.fix.map(|fix| {
            let [north, east, _] = fix.velocity_mm_s.map(|mm| f64::from(mm) * 1e-3);
            let speed = north.hypot(east);
            if speed < STANDING_M_S { 0.0 } else { speed }
        });
        let mut knot = Knot {
            time: pose.time,
            gps: GpsTime { week: pose.gps_week, us: pose.gps_us },
            roll: pose.roll,
            pitch: pose.pitch,
            azimuth: pose.azimuth,
            fix: pose.fix,
            station_m: speed_m_s.map(|_| 0.0),
            measured: speed_m_s.is_some(),
            speed_m_s: speed_m_s.unwrap_or_default(),
            held_s: 0.0,
        };
        if let Some(last) = self.knots.back() {
            if pose.time <= last.time {
                return;
            }
            let seconds = pose.time.since(last.time) as f64 * 1e-6;
            if let Some(station_m) = last.station_m {
                let way = match speed_m_s {
                    Some(speed) if seconds <= LONGEST_S => (last.speed_m_s + speed) / 2.0 * seconds,
                    // Never back behind what was said meanwhile.
                    Some(speed) => last.held(seconds).max((last.speed_m_s + speed) / 2.0 * seconds.min(HELD_S)),
                    None => last.held(seconds),
                };
                knot.station_m = Some(station_m + way);
                knot.measured &= seconds <= LONGEST_S;
            }
            if speed_m_s.is_none() {
                (knot.speed_m_s, knot.held_s) = (last.speed_m_s, last.held_s + seconds);
            }
        }
        if self.knots.len() == KEPT {
            self.knots.pop_front();
        }
        self.knots.push_back(knot);
    }

    /// Takes in the configuration: where the scanner is, seen from the unit.
    pub fn configure(&mut self, config: &Config) {
        self.lever_arm_m = config.ins.lever_arm_mm.map(|mm| f64::from(mm) * 1e-3);
    }

    /// Takes in the clock's mapping.
    pub fn clock(&mut self, clock: &ClockState) {
        self.clock = Some(*clock);
    }

    /// The board has booted: its time begins again, the way travelled goes on.
    pub fn restart(&mut self) {
        if let Some(mut last) = self.knots.pop_back() {
            last.time = DeviceTime(0);
            (last.fix, last.measured) = (None, false);
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
        let unknown = Position { gps: self.gps_by_clock(time), ..Position::default() };
        let Some(a) = before else { return unknown };
        let since_s = time.since(a.time) as f64 * 1e-6;
        let between_poses = next.filter(|b| b.time.since(a.time) as f64 * 1e-6 <= LONGEST_S);
        let Some(b) = between_poses else {
            // Within a gap, or behind the last pose.
            let station_m = a.station_m.map(|station| station + a.held(since_s));
            return Position { station_m, station_estimated: station_m.is_some(), ..unknown };
        };
        let part = since_s / (b.time.since(a.time) as f64 * 1e-6);
        let between = |from: f64, to: f64| from + (to - from) * part;
        let angle = |from: Angle, to: Angle| (degrees(from) + degrees(to - from) * part).to_radians();
        let turn =
            Turn { roll: angle(a.roll, b.roll), pitch: angle(a.pitch, b.pitch), azimuth: angle(a.azimuth, b.azimuth) };
        let gps = GpsTime::of_count(a.gps.count_us() + (b.gps.since(a.gps) as f64 * part).round() as i64);
        let geodetic = a.fix.zip(b.fix).map(|(a, b)| {
            let unit = [
                between(a.latitude_ndeg as f64 * 1e-9, b.latitude_ndeg as f64 * 1e-9),
                longitude(a.longitude_ndeg, b.longitude_ndeg, part),
                between(f64::from(a.height_mm) * 1e-3, f64::from(b.height_mm) * 1e-3),
            ];
            if self.lever_arm_m == [0.0; 3] { unit } else { shifted(unit, turn.of_vehicle(self.lever_arm_m)) }
        });
        let station_m = a.station_m.zip(b.station_m).map(|(a, b)| between(a, b));
        Position {
            gps: Some(seconds(gps)),
            geodetic,
            turn: Some(turn),
            station_m,
            station_estimated: station_m.is_some() && !(a.measured && b.measured),
        }
    }

    fn gps_by_clock(&self, time: DeviceTime) -> Option<(u16, f64)> {
        let clock = self.clock?;
        let (week, week_us) = clock.gps?;
        let since_us = time.since(clock.anchor) as f64;
        let gps_us = since_us - since_us * f64::from(clock.drift) / 4_294_967_296.0;
        let named = GpsTime { week, us: week_us };
        Some(seconds(GpsTime::of_count(named.count_us() + gps_us.round() as i64)))
    }
}

impl Knot {
    /// The way in some seconds after the knot at the last speed, which is held for [`HELD_S`] in all.
    fn held(&self, seconds: f64) -> f64 {
        self.speed_m_s * seconds.min(HELD_S - self.held_s).max(0.0)
    }
}

fn seconds(gps: GpsTime) -> (u16, f64) {
    (gps.week, gps.us as f64 * 1e-6)
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
    fn beyond_the_poses_no_position_is_made_up() {
        let mut track = Track::default();
        track.push(&pose(1_000_000, 0, 20_000));
        let place = track.at(DeviceTime(2_000_000));
        assert_eq!((place.geodetic, place.turn, place.gps), (None, None, None));
        assert_eq!((place.station_m, place.station_estimated), (Some(20.0), true));
        assert_eq!(track.at(DeviceTime(500_000)), Position::default());
    }

    #[test]
    fn without_satellites_the_last_speed_is_held_for_a_minute() {
        let mut track = Track::default();
        track.push(&pose(0, 0, 10_000));
        track.push(&pose(1_000_000, 0, 10_000));
        for second in 2..=100 {
            track.push(&Pose { fix: None, ..pose(second * 1_000_000, 0, 0) });
        }
        let place = track.at(DeviceTime(31_500_000));
        assert!((place.station_m.unwrap() - 315.0).abs() < 1e-6 && place.station_estimated, "{place:?}");
        assert!(place.geodetic.is_none() && place.turn.is_some());
        assert!((track.at(DeviceTime(99_500_000)).station_m.unwrap() - 610.0).abs() < 1e-6);
        // With the satellites back, what follows is measured again.
        track.push(&pose(101_000_000, 0, 20_000));
        track.push(&pose(102_000_000, 0, 20_000));
        let place = track.at(DeviceTime(101_500_000));
        assert!(!place.station_estimated && place.geodetic.is_some());
    }

    #[test]
    fn a_drive_without_any_speed_has_no_stations() {
        let mut track = Track::default();
        for i in 0..3 {
            track.push(&Pose { fix: None, ..pose(i * 1_000_000, 0, 0) });
        }
        let place = track.at(DeviceTime(1_500_000));
        assert_eq!((place.station_m, place.station_estimated), (None, false));
    }

    #[test]
    fn the_lever_arm_turns_with_the_vehicle() {
        let mut track = Track::default();
        let mut config = Config::default();
        config.ins.lever_arm_mm = [2_000, 500, 1_000];
        track.configure(&config);
        // Heading east, right side down by ten degrees: left is north, and what is above leans to the south.
        let turned =
            |time| Pose { azimuth: Angle(1 << 30), roll: Angle::from_microdegrees(10_000_000), ..pose(time, 0, 0) };
        track.push(&turned(0));
        track.push(&turned(10_000));
        let place = track.at(DeviceTime(5_000)).geodetic.unwrap();
        let [east, north] = crate::geodesy::between([52.0, 0.0, 40.0], place);
        let (sin, cos) = 10_f64.to_radians().sin_cos();
        assert!((east - 2.0).abs() < 1e-4, "{east}");
        assert!((north - (0.5 * cos - sin)).abs() < 1e-4, "{north}");
        assert!((place[2] - 40.0 - (cos + 0.5 * sin)).abs() < 1e-6, "{place:?}");
    }
}
