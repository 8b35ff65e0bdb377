//! The roll of every beam of one scan, from a few knots a mirror turn.
//!
//! Attitude is interpolated once a knot and linearly between knots. With 16 intervals over 180 degrees (0.42 ms each)
//! a roll of 0.5 degrees at 5 Hz errs by at most h^2/8 * max|roll''| = 1.1e-5 degrees.

use crossfall_protocol::Angle;

use super::RawScan;

/// Knots a turn.
pub const KNOTS: usize = 17;

/// Intervals between the knots of a turn.
const INTERVALS: usize = KNOTS - 1;

/// Turns of the longest scan.
pub const MAX_TURNS: usize = 4;

/// Roll over one scan. Turn `t` has its knots at equal distances over the turn's own beams.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RollTrack {
    /// Roll at each knot of each turn.
    pub knots: [[Angle; KNOTS]; MAX_TURNS],
}

impl RollTrack {
    /// The same roll at every beam.
    #[must_use]
    pub const fn constant(roll: Angle) -> Self {
        Self { knots: [[roll; KNOTS]; MAX_TURNS] }
    }

    /// Nanoseconds from the scan's start to a knot.
    #[must_use]
    pub fn knot_ns(scan: &RawScan, turn: usize, knot: usize) -> i32 {
        let first = scan.beam_ns(turn);
        let span_ns = scan.sweep_ns(u32::from(scan.mode.span_deg) * 100);
        first + (span_ns / (KNOTS as i32 - 1)) * knot as i32
    }

    /// Roll at value `i` of the scan: linear between knots, rounded down (at most one unit, 8e-8 degrees).
    #[must_use]
    pub fn roll(&self, scan: &RawScan, i: usize) -> Angle {
        self.course(scan, i).0
    }

    /// Roll at value `i` of the scan, rounded down; what it gains from there to the next value of the same turn, to the nearest unit;
    /// and how many values of that turn, this one included, lie before the next knot (beyond the last knot: all).
    #[must_use]
    pub fn course(&self, scan: &RawScan, i: usize) -> (Angle, Angle, usize) {
        let turns = scan.turns();
        let (turn, place) = (i % turns, i / turns);
        // In units of 1/16 of the span, which is so many beams of the turn: a degree each, or a part of one. 16 * place / span.
        let span = (usize::from(scan.mode.span_deg) * scan.beams_a_degree()).clamp(1, 1_020);
        let scaled = place * INTERVALS;
        let knot = (scaled / span).min(INTERVALS - 1);
        let rest = (scaled - knot * span) as i32;
        let (a, b) = (self.knots[turn & (MAX_TURNS - 1)][knot], self.knots[turn & (MAX_TURNS - 1)][knot + 1]);
        // floor(step * rest / span) from quotient and remainder of step: no product exceeds 32 bits, as rest <= span <= 1,020
        // within the scan (and 401 * 16 for a malformed one, whose quotient may wrap as angles do).
        let (step, places) = ((b - a).0, span as i32);
        let (quotient, remainder) = (step.div_euclid(places), step.rem_euclid(places));
        let over = |rest: i32, rounding: i32| {
            Angle(quotient.wrapping_mul(rest).wrapping_add((remainder * rest + rounding) / places))
        };
        let left = if knot == INTERVALS - 1 { usize::MAX } else { ((knot + 1) * span - scaled).div_ceil(INTERVALS) };
        (a + over(rest, 0), over(INTERVALS as i32, places / 2), left)
    }
}

#[cfg(test)]
mod tests {
    use crossfall_protocol::DeviceTime;
    use crossfall_protocol::message::ScanMode;

    use super::*;
    use crate::scan::MAX_BEAMS;

    #[test]
    fn roll_between_knots_is_the_exact_interpolation_rounded_down() {
        let mut track = RollTrack::constant(Angle::ZERO);
        for (k, knot) in track.knots.iter_mut().flatten().enumerate() {
            *knot = Angle((k as u32).wrapping_mul(2_654_435_769) as i32);
        }
        for (span_deg, step_cdeg, beams) in [(180u8, 50u8, 361u16), (180, 100, 181), (100, 25, 401)] {
            let scan = RawScan {
                index: 0,
                stx: DeviceTime(0),
                layout: beams,
                mode: ScanMode { span_deg, step_cdeg, measuring: 6 },
                status: 0,
                counters: None,
                values: [0; MAX_BEAMS],
            };
            for beam in 0..scan.beams() {
                let (turn, place) = (beam % scan.turns(), beam / scan.turns());
                let scaled = place as i64 * 16;
                let knot = (scaled / i64::from(span_deg)).min(15);
                let (a, b) = (track.knots[turn][knot as usize], track.knots[turn][knot as usize + 1]);
                let rest = scaled - knot * i64::from(span_deg);
                let exact = i64::from(a.0) + (i64::from((b - a).0) * rest).div_euclid(i64::from(span_deg));
                assert_eq!(track.roll(&scan, beam), Angle(exact as i32), "beam {beam} of {beams}");
            }
        }
    }
}
