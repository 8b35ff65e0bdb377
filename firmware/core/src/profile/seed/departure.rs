//! The point of significant departure of a line (median-slope paper, step 2), found in one pass going outward.
//!
//! The smallest k such that the T2 points from k on are each further than T1 from the line; from there back to the smallest d
//! with all of d..=k further than T3. As T3 <= T1, the points since one was last within T3 - a *stray* run - are d..=k when
//! the T2 points are complete: no way back is walked. What is known of the stray run's points is kept apart until it is clear
//! whether the line departed with them or came back.

use crate::scan::Point;

use super::criterion::Criterion;
use super::line::Line;

/// Half widths of the bands about one line: thresholds times the line's length, comparable with [`Line::offset`].
#[derive(Clone, Copy, Debug)]
struct Bands {
    inlier: i64,
    onset: i64,
    departure: i64,
    obstruction: i64,
}

/// What a point says of a line.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Verdict {
    /// The line goes on, possibly.
    Onward,
    /// The line departed; the point of significant departure.
    Departed(usize),
    /// A point before any departure is further than the obstruction limit.
    Obstructed,
}

/// A walk outward along a line.
#[derive(Clone, Copy, Debug)]
pub(super) struct Walk {
    line: Line,
    bands: Bands,
    departure_points: u32,
    /// Points within the inlier distance before the stray run.
    settled: u32,
    /// The first point of the stray run, when there is one.
    stray: Option<usize>,
    /// Points of the stray run within the inlier distance.
    stray_points: u32,
    /// Whether the stray run has a point beyond the obstruction limit.
    stray_obstructs: bool,
    /// Consecutive points further than T1, up to the last point.
    far: u32,
}

impl Walk {
    pub(super) fn new(line: Line, criterion: &Criterion) -> Self {
        let length = line.length();
        Self {
            line,
            bands: Bands {
                inlier: length.times(criterion.inlier_um),
                onset: length.times(criterion.onset_um),
                departure: length.times(criterion.departure_um),
                obstruction: length.times(criterion.obstruction_um),
            },
            departure_points: criterion.departure_points,
            settled: 0,
            stray: None,
            stray_points: 0,
            stray_obstructs: false,
            far: 0,
        }
    }

    /// Whether a point is further from the line than the obstruction limit.
    pub(super) fn obstructs(&self, p: Point) -> bool {
        self.line.offset(p).wrapping_abs() > self.bands.obstruction
    }

    /// Looks at point `k`. Points must come in order.
    pub(super) fn step(&mut self, k: usize, p: Point) -> Verdict {
        let offset = self.line.offset(p).wrapping_abs();
        let counts = u32::from(offset <= self.bands.inlier);
        let obstructs = offset > self.bands.obstruction;
        if offset <= self.bands.onset {
            if self.stray.take().is_some() {
                if self.stray_obstructs {
                    return Verdict::Obstructed;
                }
                self.settled = self.settled.wrapping_add(self.stray_points);
                self.stray_points = 0;
                self.far = 0;
            }
            self.settled = self.settled.wrapping_add(counts);
            return if obstructs { Verdict::Obstructed } else { Verdict::Onward };
        }
        let since = *self.stray.get_or_insert(k);
        self.stray_points = self.stray_points.wrapping_add(counts);
        self.stray_obstructs |= obstructs;
        self.far = if offset > self.bands.departure { self.far.wrapping_add(1) } else { 0 };
        if self.far >= self.departure_points { Verdict::Departed(since) } else { Verdict::Onward }
    }

    /// Points counted before the departure, after [`Verdict::Departed`].
    pub(super) fn points(&self) -> u32 {
        self.settled
    }

    /// Points counted so far, the stray run included: the score when the points end here, None when the run obstructs.
    pub(super) fn points_at_end(&self) -> Option<u32> {
        (!self.stray_obstructs).then_some(self.settled.wrapping_add(self.stray_points))
    }

    /// The most that the score can still become when `ahead` points are left.
    pub(super) fn potential(&self, ahead: usize) -> usize {
        (self.settled.wrapping_add(self.stray_points) as usize).saturating_add(ahead)
    }

    /// Whether the line is within T3 again, so that it cannot have departed yet.
    pub(super) fn holds(&self) -> bool {
        self.stray.is_none()
    }
}

/// The point of significant departure of a line over points going outward, whatever the line's inclination: for the
/// road line, the road's edge.
#[must_use]
pub fn departure(points: &[Point], line: Line, criterion: &Criterion) -> Option<usize> {
    let mut walk = Walk::new(line, criterion);
    walk.bands.obstruction = i64::MAX;
    points.iter().enumerate().find_map(|(k, p)| match walk.step(k, *p) {
        Verdict::Departed(at) => Some(at),
        Verdict::Onward | Verdict::Obstructed => None,
    })
}
