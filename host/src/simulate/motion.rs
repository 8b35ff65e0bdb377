//! Where the vehicle is and how it is turned, at any time of a simulated drive.
//!
//! The track is integrated in steps of a pose interval with the ellipsoid's radii of curvature at each place (WGS 84), exact to a
//! millimetre a kilometre. It is done here, and not by a geodesy library, because those use the platform's sine.

use core::f64::consts::TAU;

use super::noise::Noise;
use super::scene::{Drive, Oscillation, Piece, Vehicle, Wander};

/// Semi-major axis of WGS 84.
const SEMI_MAJOR_M: f64 = 6_378_137.0;
/// First eccentricity squared of WGS 84.
const ECCENTRICITY_2: f64 = 6.694_379_990_141_316e-3;

/// Oscillations with their phases.
#[derive(Clone, Debug)]
struct Swing(Vec<(f64, f64, f64)>);

impl Swing {
    fn new(oscillations: &[Oscillation], noise: &mut Noise) -> Self {
        Self(oscillations.iter().map(|o| (o.amplitude_deg, TAU * o.frequency_hz, TAU * noise.unit())).collect())
    }

    fn of_way(wander: &[Wander], noise: &mut Noise) -> Self {
        Self(wander.iter().map(|w| (w.amplitude_m, TAU * w.frequency_hz, TAU * noise.unit())).collect())
    }

    fn at(&self, t: f64) -> f64 {
        self.0.iter().map(|&(amplitude, omega, phase)| amplitude * libm::sin(omega * t + phase)).sum()
    }
}

/// How the vehicle moves about its place on the track, as functions of the drive's time in seconds.
#[derive(Clone, Debug)]
pub struct Attitude {
    roll: Swing,
    pitch: Swing,
    flex: Swing,
    wander: Swing,
}

impl Attitude {
    /// Draws the phases.
    #[must_use]
    pub fn new(vehicle: &Vehicle, noise: &mut Noise) -> Self {
        Self {
            roll: Swing::new(&vehicle.roll, noise),
            pitch: Swing::new(&vehicle.pitch, noise),
            flex: Swing::new(&vehicle.flex, noise),
            wander: Swing::of_way(&vehicle.wander, noise),
        }
    }

    /// Roll of the vehicle in degrees, positive = right side down.
    #[must_use]
    pub fn roll_deg(&self, t: f64) -> f64 {
        self.roll.at(t)
    }

    /// Roll of the scanner's frame in degrees: the vehicle's, and how the frame flexes against it.
    #[must_use]
    pub fn scanner_roll_deg(&self, t: f64) -> f64 {
        self.roll.at(t) + self.flex.at(t)
    }

    /// To the left of the track, in metres.
    #[must_use]
    pub fn lateral_m(&self, t: f64) -> f64 {
        self.wander.at(t)
    }

    /// Pitch beyond the road's grade in degrees, positive = nose up.
    #[must_use]
    pub fn pitch_deg(&self, t: f64) -> f64 {
        self.pitch.at(t)
    }
}

/// A place on the track.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Place {
    /// Along the track.
    pub station_m: f64,
    /// WGS 84.
    pub latitude_deg: f64,
    /// WGS 84.
    pub longitude_deg: f64,
    /// Above the ellipsoid.
    pub height_m: f64,
    /// Direction, clockwise from north, 0 to 360.
    pub azimuth_deg: f64,
    /// Climb of the road.
    pub grade_deg: f64,
    /// North, east, up.
    pub velocity_m_s: [f64; 3],
}

/// The vehicle's way, one step at a time.
#[derive(Clone, Debug)]
pub struct Track {
    pieces: Vec<(f64, Piece)>,
    speed_m_s: f64,
    place: Place,
}

impl Track {
    /// Starts at the drive's beginning.
    #[must_use]
    pub fn new(drive: &Drive) -> Self {
        let mut end = 0.0;
        let pieces = drive.track.iter().map(|piece| {
            end += piece.length_m;
            (end, piece.clone())
        });
        let mut track = Self {
            pieces: pieces.collect(),
            speed_m_s: drive.speed_m_s,
            place: Place {
                latitude_deg: drive.latitude_deg,
                longitude_deg: drive.longitude_deg,
                height_m: drive.height_m,
                azimuth_deg: drive.azimuth_deg,
                ..Place::default()
            },
        };
        track.aim();
        // In steps of a metre, as the ellipsoid's radii change along the way.
        let mut left_m = drive.start_m;
        while left_m > 0.0 {
            track.advance(left_m.min(1.0));
            left_m -= 1.0;
        }
        track
    }

    /// Where the vehicle is now.
    #[must_use]
    pub fn place(&self) -> Place {
        self.place
    }

    fn piece(&self) -> (f64, f64) {
        let piece = self.pieces.iter().find(|(end, _)| self.place.station_m < *end).map(|(_, piece)| piece);
        let curvature = piece.and_then(|piece| piece.radius_m).map_or(0.0, |radius| 1.0 / radius);
        (curvature, piece.map_or(0.0, |piece| piece.grade_percent / 100.0))
    }

    fn aim(&mut self) {
        let (_, grade) = self.piece();
        let azimuth = self.place.azimuth_deg.to_radians();
        let climb = libm::atan(grade);
        let level = self.speed_m_s * libm::cos(climb);
        self.place.grade_deg = climb.to_degrees();
        self.place.velocity_m_s =
            [level * libm::cos(azimuth), level * libm::sin(azimuth), self.speed_m_s * libm::sin(climb)];
    }

    /// Drives on for a time.
    pub fn step(&mut self, seconds: f64) {
        self.advance(self.speed_m_s * seconds);
    }

    fn advance(&mut self, length: f64) {
        let (curvature, grade) = self.piece();
        let turned_deg = (length * curvature).to_degrees();
        // The chord of an arc points half way between the directions at its ends.
        let middle = (self.place.azimuth_deg - turned_deg / 2.0).to_radians();
        let latitude = self.place.latitude_deg.to_radians();
        let sin = libm::sin(latitude);
        let w2 = 1.0 - ECCENTRICITY_2 * sin * sin;
        let east_radius = SEMI_MAJOR_M / libm::sqrt(w2) + self.place.height_m;
        let north_radius = SEMI_MAJOR_M * (1.0 - ECCENTRICITY_2) / (w2 * libm::sqrt(w2)) + self.place.height_m;
        let climb = libm::atan(grade);
        let level = length * libm::cos(climb);
        self.place.latitude_deg += (level * libm::cos(middle) / north_radius).to_degrees();
        let east_deg = (level * libm::sin(middle) / (east_radius * libm::cos(latitude))).to_degrees();
        self.place.longitude_deg = wrapped_deg(self.place.longitude_deg + east_deg);
        self.place.height_m += length * libm::sin(climb);
        self.place.station_m += length;
        let azimuth = self.place.azimuth_deg - turned_deg;
        self.place.azimuth_deg = azimuth - 360.0 * libm::floor(azimuth / 360.0);
        self.aim();
    }
}

/// A longitude from -180 to 180 degrees, of one that is off by a turn at most. One that is within keeps its bits.
#[must_use]
pub fn wrapped_deg(longitude_deg: f64) -> f64 {
    if longitude_deg > 180.0 {
        longitude_deg - 360.0
    } else if longitude_deg < -180.0 {
        longitude_deg + 360.0
    } else {
        longitude_deg
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_degree_of_latitude_is_as_long_as_the_ellipsoid_has_it() {
        // Meridian arc from 40.5 to 41.5 degrees: 111,053.9 m, by summing the radius of curvature.
        let drive = Drive {
            latitude_deg: 40.5,
            height_m: 0.0,
            azimuth_deg: 0.0,
            speed_m_s: 100.0,
            track: Vec::new(),
            ..Drive::default()
        };
        let mut track = Track::new(&drive);
        while track.place().latitude_deg < 41.5 {
            track.step(0.01);
        }
        assert!((track.place().station_m - 111_053.9).abs() < 2.0, "{}", track.place().station_m);
    }

    #[test]
    fn a_full_circle_to_the_left_comes_back() {
        let circle = Piece { length_m: TAU * 200.0, radius_m: Some(200.0), grade_percent: 0.0 };
        let drive = Drive { track: vec![circle], speed_m_s: TAU, ..Drive::default() };
        let start = Track::new(&drive).place();
        let mut track = Track::new(&drive);
        let mut west_most = start.longitude_deg;
        for _ in 0..20_000 {
            track.step(0.01);
            west_most = west_most.min(track.place().longitude_deg);
        }
        let end = track.place();
        assert!((end.latitude_deg - start.latitude_deg).abs() * 111e3 < 0.05);
        assert!((end.longitude_deg - start.longitude_deg).abs() * 85e3 < 0.05);
        assert!(west_most < start.longitude_deg - 0.003, "to the left of north-east is west");
    }
}
