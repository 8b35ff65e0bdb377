//! The best slope beyond an edge: the optimum over all lines through two points, found without trying them all.
//!
//! For each anchor i, going outward: the slopes that pass every point from the edge to i without obstruction; then, point by
//! point, the slopes that come within the inlier distance of it, as long as any slope is left that passes unobstructed. The
//! fan then bounds the score of every line through i. Only pairs whose bound can beat the best line so far are judged.
//! Every bound errs on the side of judging too much, so that the result is that of trying all pairs, bit for bit; the property
//! tests compare it with a search that does.
//!
//! Time: with n points beyond the edge at most n^2 looks for the fans and, in theory, n^3 / 6 for judging; memory: one fan.

use crate::scan::Point;

use super::criterion::{Criterion, Segment, Standing};
use super::fan::{Fan, Limits, Reach};

/// Of the points before an anchor every fourth bounds the open slopes nearly as well as all of them do: the others are asked
/// only when the fan has something to offer.
const BEFORE_STRIDE: usize = 4;

/// The memory of a search.
#[derive(Clone, Debug)]
pub struct Work {
    fan: Fan,
    steps: u32,
}

impl Work {
    /// Ready for use.
    #[must_use]
    pub const fn new() -> Self {
        Self { fan: Fan::new(), steps: 0 }
    }

    /// How many times a point was compared with a line or a fan since the count was reset: the cost of a search,
    /// the same on every machine.
    #[must_use]
    pub fn steps(&self) -> u32 {
        self.steps
    }

    /// Starts counting afresh.
    pub fn reset_steps(&mut self) {
        self.steps = 0;
    }
}

impl Default for Work {
    fn default() -> Self {
        Self::new()
    }
}

/// The part of the points that matters to an anchor.
#[derive(Clone, Copy)]
struct Span {
    edge: usize,
    /// The anchor.
    start: usize,
    /// The first point that is too far from it, and all after it.
    reach: usize,
}

/// Finds the best segment among the lines through all pairs of points from `edge` on, as [`super::criterion`] defines it.
///
/// Coordinates must be below the horizon of [`super::line`]; the points may be in any order and coincide.
#[must_use]
pub fn search(points: &[Point], edge: usize, criterion: &Criterion, work: &mut Work) -> Option<Segment> {
    let limits = Limits::new(criterion);
    let beyond = points.get(edge..)?;
    // When y never goes back, what is too far from an anchor in y stays too far.
    let ordered = beyond.is_sorted_by_key(|p| p.y_um);
    let mut best: Option<Segment> = None;
    let mut reach = if ordered { edge } else { points.len() };
    for start in edge..points.len() {
        let Some(anchor) = points.get(start).copied() else { break };
        while points.get(reach).is_some_and(|p| p.y_um.wrapping_sub(anchor.y_um) <= criterion.max_length_um) {
            reach += 1;
        }
        let to_beat = best.map_or(0, |b| b.points as usize);
        let Some(bound) = work.spread(points, Span { edge, start, reach }, &limits, to_beat) else { continue };
        // First the pairs whose bound is the highest, so that few others are left to be judged.
        for promising in [true, false] {
            for (through, p) in points.iter().enumerate().skip(start + 1) {
                let possible = 1 + work.fan.points(&limits, Reach::of(anchor, *p));
                if promising != (possible >= bound) {
                    continue;
                }
                // An equal score wins only over a later pair of the same anchor.
                let least_score =
                    best.map_or(1, |b| b.points as usize + usize::from((b.start, b.through) < (start, through)));
                if possible < least_score {
                    continue;
                }
                let standing = Standing { edge, reach, least_score };
                best = criterion.judge(points, (start, through), &standing, &mut work.steps).or(best);
            }
        }
    }
    best
}

impl Work {
    /// Fills the fan of the anchor `start`. The result is the highest score that any candidate through the anchor could have;
    /// None when it is no higher than `to_beat`.
    fn spread(
        &mut self,
        points: &[Point],
        Span { edge, start, reach }: Span,
        limits: &Limits,
        to_beat: usize,
    ) -> Option<usize> {
        let anchor = *points.get(start)?;
        let (before, after) = (points.get(edge..start)?, points.get(start + 1..reach)?);
        if after.len() < to_beat {
            return None;
        }
        let mut open = limits.allowed;
        for p in before.iter().step_by(BEFORE_STRIDE) {
            self.steps = self.steps.wrapping_add(1);
            open = limits.unobstructed(open, Reach::of(anchor, *p));
            if open.is_empty() {
                return None;
            }
        }
        self.fan.clear(limits, open);
        // Points without an allowed slope may be as many as leave enough others.
        let mut spare = after.len() - to_beat;
        for (k, p) in after.iter().enumerate() {
            self.steps = self.steps.wrapping_add(1);
            let seen = Reach::of(anchor, *p);
            open = limits.unobstructed(open, seen);
            if open.is_empty() {
                // No line gets here: this point and all that follow are lost.
                spare.checked_sub(after.len() - k)?;
                break;
            }
            let near = limits.near(open, seen);
            if near.is_empty() {
                spare = spare.checked_sub(1)?;
            } else {
                self.fan.add(limits, near);
            }
        }
        if self.fan.sum() < to_beat {
            return None;
        }
        // The anchor is worth a closer look.
        let mut open = limits.allowed;
        for p in before {
            self.steps = self.steps.wrapping_add(1);
            open = limits.unobstructed(open, Reach::of(anchor, *p));
        }
        if open.is_empty() {
            return None;
        }
        let most = self.fan.narrow(limits, open);
        (most >= to_beat).then_some(1 + most)
    }
}
