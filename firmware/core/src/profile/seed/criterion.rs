//! When a line through two points is a slope (median-slope paper, step 3), and how good a one: the definition.
//!
//! Points are numbered outward. For the line through points i < j, looked at from the edge e <= i:
//!
//! - **Inclination.** Between the least and the greatest, rising or falling: the paper's adjacent slope normally falls and
//!   its opposing slope rises, yet both steps are the same. Tested as |dz| cos(limit) against |dy| sin(limit), in integers.
//! - **Departure.** The smallest k >= i such that the T2 points from k on are each further than T1 from the line; from there
//!   back to the smallest d with all of d..=k further than T3. The segment is [i, d). Where there is no such k, the points end
//!   before the slope does: the segment is everything from i on, d stands for the last point, and `end_seen` is false.
//! - **Length.** The distance from point i to point d, between the least and the greatest, both included.
//! - **Obstruction.** No point of [e, d) further from the line than the limit, above or below.
//! - **Score.** The number of points of [i, d) at most the inlier distance from the line. More is better; of equals the
//!   smaller i, then the smaller j.
//!
//! A distance equal to a threshold is not further than it. All comparisons are exact, see [`super::line`].

use core::cmp::Reverse;

use crossfall_protocol::Angle;
use crossfall_protocol::config::{Limits, Seed};

use crate::scan::Point;
use crate::trig::{self, Direction};

use super::departure::{Verdict, Walk};
use super::line::{HORIZON_UM, Line, MAX_THRESHOLD_UM, distance_squared};

/// The criterion, its limits in the form in which they are compared.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Criterion {
    pub(super) inlier_um: u32,
    pub(super) obstruction_um: u32,
    pub(super) departure_um: u32,
    pub(super) onset_um: u32,
    pub(super) departure_points: u32,
    pub(super) max_length_um: i32,
    pub(super) greatest: Direction,
    pub(super) least: Direction,
    min_length_squared: u64,
    max_length_squared: u64,
}

/// A line that satisfies the criterion.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Segment {
    /// The first point of the line and of the segment: i.
    pub start: usize,
    /// The second point of the line: j. It need not lie in the segment.
    pub through: usize,
    /// The point of significant departure: d; the last point when the departure is not seen.
    pub end: usize,
    /// Whether the line departs before the points end.
    pub end_seen: bool,
    /// The score: points of the segment within the inlier distance.
    pub points: u32,
}

impl Segment {
    /// Orders segments from the best on: most points, then the smaller first point, then the smaller second.
    #[must_use]
    pub fn rank(&self) -> (Reverse<u32>, usize, usize) {
        (Reverse(self.points), self.start, self.through)
    }
}

/// Where a search stands: what a candidate is looked at from, and what it must beat.
#[derive(Clone, Copy, Debug)]
pub(super) struct Standing {
    /// The edge: e.
    pub edge: usize,
    /// No point from here on can be in a segment of the candidate: it is too far away from the candidate's start.
    pub reach: usize,
    /// Scores below this are of no interest.
    pub least_score: usize,
}

impl Criterion {
    /// Takes the limits over. Distances are brought into 0 to 4.2 m, lengths into 0 to 537 m and inclinations into 0 to 45
    /// degrees of either sign (nothing steeper is called a slope); T3 above T1 is taken as T1, T2 = 0 as 1.
    #[must_use]
    pub fn new(limits: &Limits, seed: &Seed) -> Self {
        let threshold = |um: i32| um.max(0).unsigned_abs().min(MAX_THRESHOLD_UM);
        let length = |um: i32| um.clamp(0, HORIZON_UM);
        let squared = |um: i32| u64::from(length(um).unsigned_abs()).pow(2);
        let steepest = Angle::from_microdegrees(45_000_000);
        let inclination = |angle: Angle| trig::direction(Angle(angle.0.saturating_abs()).min(steepest));
        let departure_um = threshold(seed.departure_um);
        Self {
            inlier_um: threshold(seed.inlier_um),
            obstruction_um: threshold(limits.obstruction_um),
            departure_um,
            onset_um: threshold(seed.onset_um).min(departure_um),
            departure_points: u32::from(seed.departure_points).max(1),
            max_length_um: length(limits.max_length_um),
            greatest: inclination(limits.max_slope),
            least: inclination(limits.min_slope),
            min_length_squared: squared(limits.min_length_um),
            max_length_squared: squared(limits.max_length_um),
        }
    }

    /// Whether a line's inclination is within the limits.
    #[must_use]
    pub fn inclination_allowed(&self, line: &Line) -> bool {
        // Differences below 2^30 times at most 2^30.
        let rise = i64::from(line.dz_um()).wrapping_abs();
        let run = i64::from(line.dy_um());
        let scaled = |length: i64, factor: i32| length.wrapping_mul(i64::from(factor));
        run > 0
            && scaled(rise, self.least.cos_q30) >= scaled(run, self.least.sin_q30)
            && scaled(rise, self.greatest.cos_q30) <= scaled(run, self.greatest.sin_q30)
    }

    /// Judges the line through points `start` < `through`: its segment, if it satisfies the criterion and its score is
    /// not below the least of interest. Adds the points that it looks at to `steps`.
    pub(super) fn judge(
        &self,
        points: &[Point],
        (start, through): (usize, usize),
        standing: &Standing,
        steps: &mut u32,
    ) -> Option<Segment> {
        let first = *points.get(start)?;
        let line = Line::through(first, *points.get(through)?);
        if !self.inclination_allowed(&line) {
            return None;
        }
        let mut walk = Walk::new(line, self);
        let mut departure = None;
        for (k, p) in points.iter().enumerate().skip(start) {
            *steps = steps.wrapping_add(1);
            match walk.step(k, *p) {
                Verdict::Obstructed => return None,
                Verdict::Departed(at) => {
                    departure = Some(at);
                    break;
                }
                Verdict::Onward => {}
            }
            let hopeless = walk.potential(standing.reach.saturating_sub(k + 1)) < standing.least_score;
            if hopeless || (k >= standing.reach && walk.holds()) {
                return None;
            }
        }
        let (end, score) = match departure {
            Some(at) => (at, walk.points()),
            None => (points.len().saturating_sub(1), walk.points_at_end()?),
        };
        let length_squared = distance_squared(first, *points.get(end)?);
        if (score as usize) < standing.least_score
            || length_squared < self.min_length_squared
            || length_squared > self.max_length_squared
        {
            return None;
        }
        let before = points.get(standing.edge..start)?;
        *steps = steps.wrapping_add(before.len() as u32);
        let clear = !before.iter().any(|p| walk.obstructs(*p));
        clear.then_some(Segment { start, through, end, end_seen: departure.is_some(), points: score })
    }
}
