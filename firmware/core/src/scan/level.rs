//! From ranges to levelled points: every beam turned by the roll of its own instant and by the mounting offset.
//!
//! y = -r cos(theta + roll + offset), z = -r sin(theta + roll + offset), in micrometres with the sensor at the origin.
//! A scanner mounted the other way round looks at 180 degrees - theta instead of theta. Errors: the direction is good
//! to 3e-8 (`sweep`), the product is rounded to nearest: below 1.5 micrometres at 32 m.

use crossfall_protocol::config::Scanner;
use heapless::Vec;

use super::sweep::sweep;
use super::{MAX_BEAMS, RawScan, RollTrack};
use crate::trig::Direction;

/// A place in the levelled section: `y_um` to the left of the sensor, `z_um` above it.
///
/// Magnitudes stay below 2^29 (327.7 m, the largest 15-bit value in centimetres): sums and differences of two fit.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Point {
    /// Lateral distance from the sensor, left positive, in micrometres.
    pub y_um: i32,
    /// Height above the sensor, in micrometres.
    pub z_um: i32,
}

/// One levelled return and the direction from which it came.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Echo {
    /// Where it lies.
    pub point: Point,
    /// Number of the beam in its scan.
    pub beam: u16,
    /// Cosine of the levelled beam angle, 14 fraction bits: y = -r cos.
    pub cos_q14: i16,
    /// Sine of the levelled beam angle, 14 fraction bits: z = -r sin.
    pub sin_q14: i16,
}

/// The returns of one scan from the vehicle's right through straight down to its left, whichever way the scanner is
/// mounted; beams without one are left out.
pub type Points = Vec<Echo, MAX_BEAMS>;

/// Levels a scan. `points` is overwritten.
pub fn level(scan: &RawScan, track: &RollTrack, scanner: &Scanner, points: &mut Points) {
    points.clear();
    for_each_return(scan, track, scanner, i32::MAX, |echo| {
        // Never full: a scan has at most as many beams as `points` has places.
        let _ = points.push(echo);
    });
    if scanner.mirrored {
        points.reverse();
    }
}

/// Visits the returns of a scan that are nearer than `reach_um`, levelled, in the order of its beams: from the vehicle's right to its left, or
/// from left to right where the scanner is mounted the other way round.
#[inline(always)]
pub fn for_each_return(
    scan: &RawScan,
    track: &RollTrack,
    scanner: &Scanner,
    reach_um: i32,
    mut visit: impl FnMut(Echo),
) {
    let unit_um = scan.unit_um().max(1);
    let (mask, least, above) = window(scan);
    let window = (mask, least, above.min((reach_um / unit_um).clamp(0, i32::from(u16::MAX)) as u16));
    let mut beam = 0;
    sweep(scan, track, scanner, |value, direction| {
        if let Some(units) = range_units(window, value) {
            visit(Echo {
                point: place_at(i32::from(units) * unit_um, direction),
                beam,
                cos_q14: (direction.cos_q30 >> 16) as i16,
                sin_q14: (direction.sin_q30 >> 16) as i16,
            });
        }
        beam += 1;
    });
}

/// The point at a range (below 2^29) in a direction, rounded to the nearest micrometre: the upper half of a product is all that is needed.
#[inline(always)]
fn place_at(range_um: i32, direction: Direction) -> Point {
    let inward = i64::from(-range_um << 2);
    let scaled = |q30: i32| ((inward * i64::from(q30) + (1 << 31)) >> 32) as i32;
    Point { y_um: scaled(direction.cos_q30), z_um: scaled(direction.sin_q30) }
}

/// Which values are ranges: the bits of a value that hold it, the least range, and the first value above all ranges.
type Window = (u16, u16, u16);

/// The window of a scan.
///
/// An LMS 2xx has 13 to 15 bits, its special values at the top of each mode's scale (TL, measuring modes: no stop signal, dazzle, overflow, low signal,
/// channel error, beyond maximum), and zero is none. A scanner of one turn has 16, and its special values at the bottom (no echo 0, dazzle 1,
/// implausible 2, up to 15 for filters), below the 0.5 m that it sees.
fn window(scan: &RawScan) -> Window {
    if scan.one_turn_us().is_some() {
        return (0xffff, 16, 0xffff);
    }
    let mask = ((1u32 << scan.mode.value_bits()) - 1) as u16;
    (mask, 1, mask - 8)
}

/// The range in a value, in units of the scan, or nothing for a special value.
fn range_units((mask, least, above): Window, value: u16) -> Option<u16> {
    let range = value & mask;
    (range >= least && range < above).then_some(range)
}

#[cfg(test)]
mod tests {
    use crossfall_protocol::message::ScanMode;
    use crossfall_protocol::{Angle, DeviceTime};

    use super::*;
    use crate::trig;

    fn scan(values: impl Fn(usize) -> u16) -> RawScan {
        let mut scan = RawScan {
            index: 0,
            stx: DeviceTime(1_000_000),
            layout: 361 | 1 << 14,
            mode: ScanMode { span_deg: 180, step_cdeg: 50, measuring: 6 },
            status: 0x10,
            counters: None,
            values: [0; MAX_BEAMS],
        };
        for (i, value) in scan.values.iter_mut().take(361).enumerate() {
            *value = values(i);
        }
        scan
    }

    fn points_of(scan: &RawScan, track: &RollTrack, scanner: &Scanner) -> Points {
        let mut points = Points::new();
        level(scan, track, scanner, &mut points);
        points
    }

    #[test]
    fn the_first_beam_looks_right_the_middle_one_down_the_last_left() {
        let points = points_of(&scan(|_| 2_000), &RollTrack::constant(Angle::ZERO), &Scanner::default());
        assert_eq!(points.first().map(|e| e.point), Some(Point { y_um: -2_000_000, z_um: 0 }));
        assert_eq!(points.get(180).map(|e| e.point), Some(Point { y_um: 0, z_um: -2_000_000 }));
        assert_eq!(points.last().map(|e| e.point), Some(Point { y_um: 2_000_000, z_um: 0 }));
    }

    #[test]
    fn every_beam_agrees_with_double_precision_under_roll_and_offset() {
        let mut track = RollTrack::constant(Angle::ZERO);
        for (turn, knots) in track.knots.iter_mut().enumerate() {
            for (k, knot) in knots.iter_mut().enumerate() {
                *knot = Angle::from_microdegrees(4_000_000 - 400_000 * turn as i32 - 25_000 * k as i32);
            }
        }
        let offset = Angle::from_microdegrees(-1_234_567);
        let scan = scan(|i| 1_000 + 80 * i as u16);
        for mirrored in [false, true] {
            let scanner = Scanner { mounting_offset: offset, mirrored, ..Scanner::default() };
            for echo in &points_of(&scan, &track, &scanner) {
                let beam = usize::from(echo.beam);
                let radians = |angle: Angle| f64::from(angle.0) / 4_294_967_296.0 * core::f64::consts::TAU;
                let theta = 0.5 * beam as f64;
                let theta = (if mirrored { 180.0 - theta } else { theta }) / 180.0 * core::f64::consts::PI;
                let (sin, cos) = libm::sincos(theta + radians(track.roll(&scan, beam)) + radians(offset));
                let range_um = (1_000.0 + 80.0 * beam as f64) * 1e3;
                assert!((f64::from(echo.point.y_um) + range_um * cos).abs() < 1.5, "y of beam {beam}");
                assert!((f64::from(echo.point.z_um) + range_um * sin).abs() < 1.5, "z of beam {beam}");
                assert!((f64::from(echo.cos_q14) - cos * 16_384.0).abs() < 1.1, "cosine of beam {beam}");
            }
        }
    }

    #[test]
    fn beam_angles_are_those_of_the_scan() {
        let mut scan = scan(|_| 1_000);
        let track = RollTrack::constant(Angle::ZERO);
        for (span_deg, step_cdeg, layout) in [(180, 50, 361), (180, 100, 181), (100, 25, 401), (180, 50, 181 | 3 << 12)]
        {
            scan.mode.span_deg = span_deg;
            scan.mode.step_cdeg = step_cdeg;
            scan.layout = layout;
            scan.values = [1_000; MAX_BEAMS];
            let points = points_of(&scan, &track, &Scanner::default());
            assert_eq!(points.len(), scan.beams());
            for echo in &points {
                let direction = trig::direction(scan.beam_angle(usize::from(echo.beam)));
                let exact = place_at(scan.unit_um() * 1_000, direction);
                let apart = (echo.point.y_um - exact.y_um).abs().max((echo.point.z_um - exact.z_um).abs());
                assert!(apart <= 1, "beam {} of {step_cdeg}", echo.beam);
            }
        }
    }

    #[test]
    fn a_mirrored_scanner_yields_the_same_points_in_the_same_order() {
        let points = points_of(&scan(|i| 1_000 + i as u16), &RollTrack::constant(Angle::ZERO), &Scanner::default());
        let scanner = Scanner { mirrored: true, ..Scanner::default() };
        let mirrored = points_of(&scan(|i| 1_360 - i as u16), &RollTrack::constant(Angle::ZERO), &scanner);
        assert_eq!(points.len(), mirrored.len());
        for (a, b) in points.iter().zip(&mirrored) {
            let apart = a.point.y_um.abs_diff(b.point.y_um).max(a.point.z_um.abs_diff(b.point.z_um));
            assert!(apart <= 1, "{a:?} and {b:?}");
        }
    }

    #[test]
    fn special_values_are_left_out_in_every_measuring_mode() {
        for (measuring, top) in [(0u8, 0x1fffu16), (2, 0x1fff), (3, 0x3fff), (6, 0x7fff)] {
            let mut scan = scan(|i| if i < 10 { top - i as u16 } else { 0 });
            scan.mode.measuring = measuring;
            let points = points_of(&scan, &RollTrack::constant(Angle::ZERO), &Scanner::default());
            assert_eq!(points.iter().map(|e| e.beam).collect::<Vec<_, 4>>(), [9], "mode {measuring}");
        }
    }

    #[test]
    fn field_flags_above_the_range_are_masked() {
        let mut scan = scan(|_| 0xe000 | 1_500);
        scan.mode.measuring = 0;
        let points = points_of(&scan, &RollTrack::constant(Angle::ZERO), &Scanner::default());
        assert_eq!(points.get(180).map(|e| e.point.z_um), Some(-1_500_000));
    }
}
