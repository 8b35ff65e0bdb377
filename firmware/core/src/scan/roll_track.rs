//! The roll of every beam of one scan, from a few knots a mirror turn.
//!
//! Attitude is interpolated once a knot and linearly between knots. With 16 intervals over 180 degrees (0.42 ms each)
//! a roll of 0.5 degrees at 5 Hz errs by at most h^2/8 * max|roll''| = 1.1e-5 degrees.

use crossfall_protocol::Angle;

use super::RawScan;

/// Knots a turn.
pub const KNOTS: usize = 17;

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
        let span_ns = i32::from(scan.mode.span_deg) * 37_000;
        first + (span_ns / (KNOTS as i32 - 1)) * knot as i32
    }

    /// Roll at value `i` of the scan: linear between knots, rounded down (at most one unit, 8e-8 degrees).
    #[must_use]
    pub fn roll(&self, scan: &RawScan, i: usize) -> Angle {
        let turns = scan.turns();
        let (turn, place) = (i % turns, i / turns);
        // Beams of one turn are a degree apart. In units of 1/16 of the span: 16 * place / span.
        let span = usize::from(scan.mode.span_deg).max(1);
        let scaled = place * (KNOTS - 1);
        let knot = (scaled / span).min(KNOTS - 2);
        let rest = (scaled - knot * span) as i64;
        let (a, b) = (self.knots[turn & (MAX_TURNS - 1)][knot], self.knots[turn & (MAX_TURNS - 1)][knot + 1]);
        let step = i64::from((b - a).0) * rest;
        Angle(a.0.wrapping_add(step.div_euclid(span as i64) as i32))
    }
}
