//! Where the scanner was: pose, GPS time and station at any instant of the recent past.
//!
//! Station is the way travelled: the horizontal speed of the poses, integrated by the trapezoid rule. Speeds come from the unit's own filter and
//! are good to centimetres a second, while differences of positions would add up their noise. Below 0.05 m/s the vehicle stands. Where poses or
//! their speeds are missing, the last speed is held for at most a minute and the station is marked as estimated; positions are never made up.
//!
//! A position is the scanner's: the unit's own, moved by the lever arm of the configuration, turned by the pose.
//!
//! What the unit says itself not to know is not known: a unit that aligns has a position by its satellites and no attitude, one that is inactive or
//! waits has neither ([`Quality`]).

use std::collections::VecDeque;

use crossfall_core::clock::GpsTime;
use crossfall_core::protocol::message::{ClockState, Fix, Pose};
use crossfall_core::protocol::{Angle, Config, DeviceTime};
use crossfall_core::sensors::novatel::Quality;

use crate::geodesy::{Geodetic, shifted};
use crate::units::{degrees, drift};

/// Poses kept: more than the survey's longest wait at 200 Hz.
const KEPT: usize = 256;

/// Slower than this is standing still.
const STANDING_M_S: f64 = 0.05;

/// Longest interval that positions are interpolated over, in seconds.
const LONGEST_S: f64 = 2.0;

/// Longest time for which the last speed is held where there is none.
const HELD_S: f64 = 60.0;

/// A pose out of order by less than this is left out, in microseconds: the core's rule for its history of roll.
const REORDER_US: i64 = 500_000;

/// Where the unit is and how fast, unless it says itself that it does not know.
#[must_use]
pub fn fix(pose: &Pose) -> Option<Fix> {
    pose.fix.filter(|_| Quality::of(pose.status).has_position())
}

/// What the time of a pose is after that of the one before.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Order {
    /// Later.
    Next,
    /// The pose has no place in the order.
    Late,
    /// Time has fallen back to it: poses before it were ahead of time, or time was set anew.
    FallenBack,
}

/// Tells the order of poses. Time falls back when two poses say so that go on from each other; one alone is a stray.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Sequence {
    behind: Option<DeviceTime>,
}

impl Sequence {
    /// That of the next pose.
    pub(crate) fn order(&mut self, last: Option<DeviceTime>, time: DeviceTime) -> Order {
        let step_us = last.map_or(1, |last| time.since(last));
        if step_us >= -REORDER_US {
            self.behind = None;
            return if step_us > 0 { Order::Next } else { Order::Late };
        }
        let goes_on = |before: DeviceTime| time > before && time.since(before) as f64 * 1e-6 <= LONGEST_S;
        if self.behind.replace(time).is_some_and(goes_on) {
            self.behind = None;
            Order::FallenBack
        } else {
            Order::Late
        }
    }
}

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
    /// Nothing where the knot has only carried the way over from another time.
    gps: Option<GpsTime>,
    /// Roll, pitch and azimuth, where the unit has them.
    turn: Option<[Angle; 3]>,
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
    sequence: Sequence,
    clock: Option<ClockState>,
    lever_arm_m: [f64; 3],
}

impl Track {
    /// Takes in a pose. Those that do not advance time are left out, unless time itself has fallen back.
    pub fn push(&mut self, pose: &Pose) {
        match self.sequence.order(self.knots.back().map(|last| last.time), pose.time) {
            Order::Next => {}
            Order::Late => return,
            Order::FallenBack => self.fall_back(pose.time),
        }
        let fix = fix(pose);
        let speed_m_s = fix.map(|fix| {
            let [north, east, _] = fix.velocity_mm_s.map(|mm| f64::from(mm) * 1e-3);
            let speed = north.hypot(east);
            if speed < STANDING_M_S { 0.0 } else { speed }
        });
        let mut knot = Knot {
            time: pose.time,
            gps: Some(GpsTime { week: pose.gps_week, us: pose.gps_us }),
            turn: Quality::of(pose.status).has_attitude().then_some([pose.roll, pose.pitch, pose.azimuth]),
            fix,
            station_m: speed_m_s.map(|_| 0.0),
            measured: speed_m_s.is_some(),
            speed_m_s: speed_m_s.unwrap_or_default(),
            held_s: 0.0,
        };
        if let Some(last) = self.knots.back() {
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
        self.set_anew(DeviceTime(0));
        self.sequence = Sequence::default();
        self.clock = None;
    }

    /// Time has fallen back. Where it falls into a gap, the poses beyond were ahead of time, and what they added to the way is taken off again;
    /// where it falls among poses, or before all of them, it was set anew.
    fn fall_back(&mut self, time: DeviceTime) {
        let behind = self.knots.partition_point(|knot| knot.time < time);
        let around = behind.checked_sub(1).and_then(|last| self.knots.get(last)).zip(self.knots.get(behind));
        if around.is_some_and(|(last, ahead)| ahead.time.since(last.time) > REORDER_US) {
            self.knots.truncate(behind);
        } else {
            self.set_anew(time);
        }
    }

    /// Only the way travelled goes on, from this time.
    fn set_anew(&mut self, time: DeviceTime) {
        let last = self.knots.pop_back();
        self.knots.clear();
        self.knots.extend(last.map(|last| Knot { time, gps: None, turn: None, fix: None, measured: false, ..last }));
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
        let turn = a.turn.zip(b.turn).map(|(a, b)| Turn {
            roll: angle(a[0], b[0]),
            pitch: angle(a[1], b[1]),
            azimuth: angle(a[2], b[2]),
        });
        let gps = a.gps.zip(b.gps);
        let gps = gps.map(|(a, b)| GpsTime::of_count(a.count_us() + (b.since(a) as f64 * part).round() as i64));
        let geodetic = a.fix.zip(b.fix).and_then(|(a, b)| {
            let unit = [
                between(a.latitude_ndeg as f64 * 1e-9, b.latitude_ndeg as f64 * 1e-9),
                longitude(a.longitude_ndeg, b.longitude_ndeg, part),
                between(f64::from(a.height_mm) * 1e-3, f64::from(b.height_mm) * 1e-3),
            ];
            match turn {
                _ if self.lever_arm_m == [0.0; 3] => Some(unit),
                Some(turn) => Some(shifted(unit, turn.of_vehicle(self.lever_arm_m))),
                None => None,
            }
        });
        let station_m = a.station_m.zip(b.station_m).map(|(a, b)| between(a, b));
        Position {
            gps: gps.map(seconds).or(unknown.gps),
            geodetic,
            turn,
            station_m,
            station_estimated: station_m.is_some() && !(a.measured && b.measured),
        }
    }

    fn gps_by_clock(&self, time: DeviceTime) -> Option<(u16, f64)> {
        let clock = self.clock?;
        let (week, week_us) = clock.gps?;
        let since_us = time.since(clock.anchor) as f64;
        let gps_us = since_us - since_us * drift(&clock);
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
    fn what_the_unit_does_not_know_is_not_known() {
        for (status, position, turn) in [(0, false, false), (1, true, false), (2, true, true), (8, false, false)] {
            let mut track = Track::default();
            track.push(&pose(0, 0, 20_000));
            track.push(&pose(10_000, 0, 20_000));
            for i in 2..=100 {
                let fix = Fix { latitude_ndeg: 0, longitude_ndeg: 0, height_mm: 0, velocity_mm_s: [0; 3] };
                let known = pose(i * 10_000, 0, 20_000);
                track.push(&Pose { status, fix: if position { known.fix } else { Some(fix) }, ..known });
            }
            let place = track.at(DeviceTime(505_000));
            assert_eq!((place.geodetic.is_some(), place.turn.is_some()), (position, turn), "{status}: {place:?}");
            // The way goes on, measured or by the last speed; the time of a pose is none of the filter's.
            assert!((place.station_m.unwrap() - 10.1).abs() < 1e-9 && place.station_estimated != position);
            assert_eq!(place.gps, Some((2_400, 1.505)));
            // From a pose that knows to one that does not, nothing is made up.
            let between = track.at(DeviceTime(15_000));
            assert_eq!((between.geodetic.is_some(), between.turn.is_some()), (position, turn), "{status}");
        }
    }

    #[test]
    fn without_attitude_a_lever_arm_leads_nowhere() {
        let mut track = Track::default();
        track.push(&Pose { status: 1, ..pose(0, 0, 0) });
        track.push(&Pose { status: 1, ..pose(10_000, 0, 0) });
        assert!(track.at(DeviceTime(5_000)).geodetic.is_some());
        let mut config = Config::default();
        config.ins.lever_arm_mm = [2_000, 500, 1_000];
        track.configure(&config);
        assert_eq!(track.at(DeviceTime(5_000)).geodetic, None);
    }

    #[test]
    fn a_pose_far_ahead_or_behind_costs_nothing_but_itself() {
        for stray_us in [-400_000_i64, 700_000, 100_000_000, -900_000, -100_000_000] {
            let (mut track, mut whole) = (Track::default(), Track::default());
            for i in 0..=20_000_u64 {
                let time_us = 200_000_000 + i * 10_000;
                whole.push(&pose(time_us, 0, 20_000));
                track.push(&match i {
                    9_000 => pose(time_us.saturating_add_signed(stray_us), 0, 20_000),
                    _ => pose(time_us, 0, 20_000),
                });
                let lately = DeviceTime(time_us - 25_000);
                let (found, expected) = (track.at(lately), whole.at(lately));
                if !(9_000..9_010).contains(&i) && i > 2 {
                    assert_eq!((found.geodetic, found.turn), (expected.geodetic, expected.turn), "{stray_us} {i}");
                    let off_m = found.station_m.unwrap() - expected.station_m.unwrap();
                    assert!(off_m.abs() < 1e-6 && !found.station_estimated, "{stray_us} {i}: {off_m}");
                }
            }
        }
    }

    #[test]
    fn when_time_is_set_back_the_way_goes_on() {
        for back_us in [1_000_000, 100_000_000] {
            let mut track = Track::default();
            for i in 0..=1_000 {
                track.push(&pose(200_000_000 + i * 10_000, 0, 20_000));
            }
            for i in 1..=100 {
                track.push(&pose(210_000_000 - back_us + i * 10_000, 0, 20_000));
            }
            let place = track.at(DeviceTime(210_000_000 - back_us + 905_000));
            assert!(place.geodetic.is_some() && place.gps.is_some() && !place.station_estimated, "{place:?}");
            // Two poses tell, the way between them and the last one before is not known.
            let way_m = place.station_m.unwrap();
            assert!((way_m - 218.1).abs() < 0.5, "{way_m}");
        }
    }

    #[test]
    fn behind_a_boot_nothing_is_joined_to_what_was_before() {
        let mut track = Track::default();
        for i in 0..=100 {
            track.push(&pose(5_000_000 + i * 10_000, 0, 20_000));
        }
        track.restart();
        track.push(&Pose { gps_us: 90_000_000, ..pose(1_000_000, 0, 20_000) });
        let place = track.at(DeviceTime(500_000));
        assert_eq!((place.gps, place.geodetic, place.turn), (None, None, None));
        assert!(place.station_m.is_some_and(|station_m| (station_m - 30.0).abs() < 1e-6) && place.station_estimated);
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
