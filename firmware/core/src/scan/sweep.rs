//! The levelled direction of one beam after another.
//!
//! Beams of one mirror turn are equally far apart - a degree, of scans in a single turn also a half or a quarter - and roll is linear between
//! knots, so a beam looks where its neighbour in the same turn did, turned by an angle that is the same from knot to knot: four products instead of a sine and a cosine. The direction is found anew at each
//! knot. Errors: a turn of one beam is rounded to the unit of an angle and its products to 2^-30, which in the 13 beams of an interval at
//! most adds up to 3e-8: a micrometre at 32 m.

use crossfall_protocol::Angle;
use crossfall_protocol::config::Scanner;

use super::RawScan;
use super::roll_track::{MAX_TURNS, RollTrack};
use crate::trig::{self, Direction};

/// Where the mirror points in one turn.
#[derive(Clone, Copy)]
struct Pointer {
    direction: Direction,
    /// From one beam of the turn to the next.
    step: Direction,
}

const AHEAD: Direction = Direction { cos_q30: trig::ONE_Q30, sin_q30: 0 };

/// Visits the values of a scan in their order, each with the direction in which its beam looks.
///
/// A beam lies between the same two knots whichever the turn: all turns find their directions anew at the same place.
#[inline(always)]
pub fn sweep(scan: &RawScan, track: &RollTrack, scanner: &Scanner, mut visit: impl FnMut(u16, Direction)) {
    let mut pointers = [Pointer { direction: AHEAD, step: AHEAD }; MAX_TURNS];
    let Some(pointers) = pointers.get_mut(..scan.turns()) else { return };
    let mut values = scan.ranges().iter();
    let mut found_anew = 0;
    while !values.as_slice().is_empty() {
        let mut places = 1;
        for (beam, pointer) in (found_anew..).zip(pointers.iter_mut()) {
            (*pointer, places) = Pointer::at(beam, scan, track, scanner);
        }
        for _ in 0..places {
            for pointer in pointers.iter_mut() {
                let Some(value) = values.next() else { return };
                visit(*value, pointer.direction);
                pointer.direction = turned(pointer.direction, pointer.step);
            }
        }
        found_anew += places * pointers.len();
    }
}

impl Pointer {
    /// Found anew for one beam, good for so many beams of its turn, this one included: up to the next knot.
    #[inline(never)]
    fn at(beam: usize, scan: &RawScan, track: &RollTrack, scanner: &Scanner) -> (Self, usize) {
        let (roll, gain, places) = track.course(scan, beam);
        let apart = match scan.beams_a_degree() {
            4 => const { Angle::from_microdegrees(250_000) },
            2 => const { Angle::from_microdegrees(500_000) },
            _ => const { Angle::from_microdegrees(1_000_000) },
        };
        let (theta, apart) = match scanner.mirrored {
            false => (scan.beam_angle(beam), apart),
            true => (Angle(i32::MIN) - scan.beam_angle(beam), Angle::ZERO - apart),
        };
        let direction = trig::direction(theta + roll + scanner.mounting_offset);
        (Self { direction, step: trig::direction(apart + gain) }, places)
    }
}

/// A direction turned by another, each part rounded to the nearest 2^-30: products and their sums stay below 2^62.
#[inline(always)]
fn turned(direction: Direction, step: Direction) -> Direction {
    let (c, s) = (i64::from(direction.cos_q30), i64::from(direction.sin_q30));
    let (dc, ds) = (i64::from(step.cos_q30), i64::from(step.sin_q30));
    let rounded = |q60: i64| ((q60 + (1 << 29)) >> 30) as i32;
    Direction { cos_q30: rounded(c * dc - s * ds), sin_q30: rounded(s * dc + c * ds) }
}

#[cfg(test)]
mod tests {
    use crossfall_protocol::DeviceTime;
    use crossfall_protocol::message::ScanMode;

    use super::*;
    use crate::scan::{MAX_BEAMS, ONE_TURN};

    #[test]
    fn every_direction_is_that_of_its_beam_within_3e_8() {
        let mut track = RollTrack::constant(Angle::ZERO);
        // Rolls of up to 8 degrees that change by up to 100 degrees a second.
        for (k, knot) in track.knots.iter_mut().flatten().enumerate() {
            *knot = Angle::from_microdegrees(8_000_000 - (k as i32 * 7_919 % 40) * 41_000);
        }
        for (span_deg, step_cdeg, layout, measuring) in [
            (180u8, 50u8, 361u16, 6),
            (180, 100, 181, 6),
            (100, 25, 401, 6),
            (180, 50, 181 | 3 << 12, 6),
            (180, 50, 361, ONE_TURN + 2),
            (180, 100, 181, ONE_TURN),
            (100, 25, 401, ONE_TURN + 1),
        ] {
            let scan = RawScan {
                index: 0,
                stx: DeviceTime(0),
                layout,
                mode: ScanMode { span_deg, step_cdeg, measuring },
                status: 0,
                counters: None,
                values: [0; MAX_BEAMS],
            };
            for mirrored in [false, true] {
                let mounting_offset = Angle::from_microdegrees(-345_678);
                let scanner = Scanner { mounting_offset, mirrored, ..Scanner::default() };
                let mut beam = 0;
                sweep(&scan, &track, &scanner, |_, found| {
                    let theta = scan.beam_angle(beam);
                    let theta = if mirrored { Angle(i32::MIN) - theta } else { theta };
                    let exact = (theta + track.roll(&scan, beam) + mounting_offset).0;
                    let (sin, cos) = libm::sincos(f64::from(exact) / 4_294_967_296.0 * core::f64::consts::TAU);
                    let unit = f64::from(trig::ONE_Q30);
                    let error =
                        libm::hypot(f64::from(found.cos_q30) / unit - cos, f64::from(found.sin_q30) / unit - sin);
                    assert!(error < 3e-8, "beam {beam} of {} at {step_cdeg}: {error:e}", scan.beams());
                    beam += 1;
                });
                assert_eq!(beam, scan.beams());
            }
        }
    }
}
