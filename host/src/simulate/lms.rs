//! The laser scanner of a simulated drive, half-degree scans in millimetres, every beam cast at its own instant.
//!
//! An LMS 291's scan is two turns of the mirror: whole degrees in the first, half degrees in the second (SENSORS: "Timing"; SICK telegram listing,
//! command B0h). An LMS 111's is one turn, see [`cola`](super::cola). While the mirror turns, the vehicle rolls and drives on.

use crossfall_core::sensors::lms2xx;

use super::cola;
use super::motion::Attitude;
use super::noise::{Noise, Purpose};
use super::scene::{Kind, Scanner, Scene, Vegetation};
use super::section::{Road, Section, cast};
use super::surface::Surface;

/// Values of a scan.
pub const BEAMS: usize = 361;

/// One turn of the mirror at its nominal speed.
pub const TURN_S: f64 = 0.013_32;

/// Nothing came back ("no stop signal", 15-bit values).
pub const NO_ECHO: u16 = 32_767;

/// Something came back, too little of it ("signal to noise too small").
pub const WEAK_ECHO: u16 = 32_763;

/// Count word: 361 values, in millimetres.
const LAYOUT: u16 = 0x4169;

/// Status of a healthy scanner: bits 3 and 4 are 10b, and nothing is wrong.
const STATUS: u8 = 0x10;

/// One telegram and the truth behind it.
#[derive(Clone, Debug)]
pub struct Telegram {
    /// When its first byte arrives, in seconds of the drive.
    pub arrival_s: f64,
    /// The instant of the scan's first beam.
    pub start_s: f64,
    /// Its bytes.
    pub bytes: Vec<u8>,
}

/// The scanner.
#[derive(Debug)]
pub struct Lms<'a> {
    scanner: &'a Scanner,
    vegetation: &'a Vegetation,
    start_m: f64,
    speed_m_s: f64,
    attitude: &'a Attitude,
    road: &'a Road,
    surface: &'a Surface,
    noise: Noise,
    roughness: Noise,
}

impl<'a> Lms<'a> {
    /// A scanner on a vehicle on a road.
    #[must_use]
    pub fn new(scene: &'a Scene, attitude: &'a Attitude, road: &'a Road, surface: &'a Surface) -> Self {
        Self {
            scanner: &scene.scanner,
            vegetation: &scene.vegetation,
            start_m: scene.drive.start_m,
            speed_m_s: scene.drive.speed_m_s,
            attitude,
            road,
            surface,
            noise: Noise::new(scene.drive.seed, Purpose::Ranges),
            roughness: Noise::new(scene.drive.seed, Purpose::Roughness),
        }
    }

    /// How long a turn takes with this scanner's motor.
    #[must_use]
    pub fn turn_s(scanner: &Scanner) -> f64 {
        let turn_s = match scanner.kind {
            Kind::Lms291 => TURN_S,
            Kind::Lms111 => cola::TURN_S,
        };
        turn_s / (1.0 + scanner.motor_error_ppm * 1e-6)
    }

    /// From one scan to the next.
    #[must_use]
    pub fn scan_s(scanner: &Scanner) -> f64 {
        Self::turns(scanner) * Self::turn_s(scanner)
    }

    /// From the first beam of a scan to the mean instant of all: half a turn is measured in each, and turns follow each other.
    #[must_use]
    pub fn middle_s(scanner: &Scanner) -> f64 {
        (0.25 + (Self::turns(scanner) - 1.0) / 2.0) * Self::turn_s(scanner)
    }

    fn turns(scanner: &Scanner) -> f64 {
        match scanner.kind {
            Kind::Lms291 => 2.0,
            Kind::Lms111 => 1.0,
        }
    }

    /// One scan that starts at a time of the drive.
    pub fn scan(&mut self, number: usize, start_s: f64) -> Telegram {
        match self.scanner.kind {
            Kind::Lms291 => self.two_turns(number, start_s),
            Kind::Lms111 => self.one_turn(number, start_s),
        }
    }

    fn one_turn(&mut self, number: usize, start_s: f64) -> Telegram {
        let turn_s = Self::turn_s(self.scanner);
        let mut values = [NO_ECHO; BEAMS];
        for (i, value) in values.iter_mut().enumerate() {
            let degrees = i as f64 / 2.0;
            *value = self.beam(number, degrees, start_s + degrees / 360.0 * turn_s);
        }
        let sent_s = start_s + turn_s;
        let bytes = cola::telegram(number, start_s, sent_s, turn_s, &values);
        Telegram { arrival_s: sent_s + self.scanner.delay_us * 1e-6, start_s, bytes }
    }

    fn two_turns(&mut self, number: usize, start_s: f64) -> Telegram {
        let turn_s = Self::turn_s(self.scanner);
        let mut values = [NO_ECHO; BEAMS];
        for odd in 0..2 {
            for i in (odd..BEAMS).step_by(2) {
                let degrees = i as f64 / 2.0;
                let t = start_s + odd as f64 * turn_s + degrees / 360.0 * turn_s;
                values[i] = self.beam(number, degrees, t);
            }
        }
        let mut bytes = Vec::with_capacity(lms2xx::LONGEST);
        let indices = if self.scanner.index_bytes { 2 } else { 0 };
        let length = 3 + 2 * BEAMS as u16 + indices + 1;
        bytes.extend([0x02, 0x80]);
        bytes.extend(length.to_le_bytes());
        bytes.push(0xb0);
        bytes.extend(LAYOUT.to_le_bytes());
        bytes.extend(values.iter().flat_map(|value| value.to_le_bytes()));
        if self.scanner.index_bytes {
            // The scan index counts turns, the telegram index telegrams, both modulo 256.
            bytes.extend([(2 * number) as u8, number as u8]);
        }
        bytes.push(STATUS);
        bytes.extend(lms2xx::crc(&bytes).to_le_bytes());
        Telegram { arrival_s: start_s + 2.0 * turn_s + self.scanner.delay_us * 1e-6, start_s, bytes }
    }

    /// The value of one beam.
    fn beam(&mut self, scan: usize, degrees: f64, t: f64) -> u16 {
        let theta = if self.scanner.mirrored { 180.0 - degrees } else { degrees };
        let phi = (theta + self.attitude.scanner_roll_deg(t) + self.scanner.mounting_offset_deg).to_radians();
        // y = -r cos(phi), z = -r sin(phi), left and up positive.
        let (left, up) = (-libm::cos(phi), -libm::sin(phi));
        let station_m = self.start_m + self.speed_m_s * t;
        let lateral_m = self.attitude.lateral_m(t);
        let section = self.road.at(station_m, scan).from_further_left(lateral_m);
        let ground = section.ground(left >= 0.0);
        // Drawn for every beam, whatever becomes of it, so that one beam's fate leaves the others theirs.
        let (plant, stray) = (self.noise.chance(self.vegetation.share), self.noise.chance(self.vegetation.stray_share));
        let height_m = self.noise.exponential(self.vegetation.mean_mm).min(self.vegetation.max_mm) * 1e-3;
        let (fraction, dropped) = (self.noise.unit(), self.noise.chance(self.scanner.dropout_share));
        let error_mm = self.noise.normal() * self.scanner.range_noise_mm;

        let Some(bare) = cast(&ground, left.abs(), up, 0.0) else { return NO_ECHO };
        let edge_m = edge_m(&section, left);
        let off_road = bare * left.abs() > edge_m;
        let range = if !off_road {
            bare
        } else if stray && !plant {
            bare * fraction
        } else {
            let mut raised_m = if plant { height_m } else { 0.0 };
            if self.surface.is_rough() {
                raised_m += self.surface.roughness_m * self.roughness.normal();
                // Where the ray meets the undulating ground, by iteration: each step closes in by the ratio of the undulation's slope to
                // the angle between ray and ground, a third or less.
                let mut range = bare;
                for _ in 0..6 {
                    let out_m = range * left.abs();
                    let height_m = self.surface.height_m(station_m, lateral_m + range * left, out_m - edge_m);
                    range = cast(&ground, left.abs(), up, raised_m + height_m).unwrap_or(range);
                }
                range
            } else if plant {
                cast(&ground, left.abs(), up, raised_m).unwrap_or(bare)
            } else {
                bare
            }
        };
        if range > self.scanner.max_range_m {
            return NO_ECHO;
        }
        if dropped {
            return WEAK_ECHO;
        }
        // At most 32 m by the scene's check, so that no range runs into the special values.
        (range * 1_000.0 + error_mm).round().clamp(0.0, 32_700.0) as u16
    }
}

fn edge_m(section: &Section, left: f64) -> f64 {
    if left >= 0.0 { section.left.edge_m } else { section.right.edge_m }
}
