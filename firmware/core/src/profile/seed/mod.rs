//! The median-slope paper's own profile algorithm, with the optimum where the paper stops after some number of lines.
//!
//! Road line by regression ([`road`]), its point of significant departure is the edge ([`departure`]); the adjacent slope is
//! the best line beyond the edge that satisfies the paper's criterion ([`criterion`], [`search`]), its departure is the edge
//! from which the opposing slope is found in the same way. A slope is that of the selected line through two points, as in
//! the paper, and has no interval. Everything is in integers and exact; what is rounded is the road line (to a micrometre) and the
//! results.
//!
//! The criterion is a poor selector in vegetation: a single spike of more than 250 mm vetoes every line past it, and two
//! points make a noisy slope. This mode is kept as the paper's method; `Method::Measuring` is the better instrument.
//! Figures, and how far they are from trying all pairs: `docs/seed-search.md`.

pub mod criterion;
pub mod departure;
mod fan;
pub mod line;
pub mod road;
pub mod search;

use crossfall_protocol::config;
use crossfall_protocol::message::{Hinge, Side, Slope, flags};

pub use criterion::{Criterion, Segment};
pub use search::{Work, search};

use crate::scan::Point;
use crate::trig;
use line::{HORIZON_UM, Line, distance_squared};

/// Surveys one side. The points go outward, with `y_um` counting outward from the sensor on either side, levelled, resampled as
/// in the paper or raw; hinges of the result count outward too.
///
/// Points from the first one on that is not below 537 m in both coordinates are not looked at: no levelled point is.
#[must_use]
pub fn survey_side(points: &[Point], survey: &config::Survey, work: &mut Work) -> Side {
    let mut side = Side::default();
    let below = |p: &Point| p.y_um.unsigned_abs().max(p.z_um.unsigned_abs()) < HORIZON_UM.unsigned_abs();
    let points = points.split(|p| !below(p)).next().unwrap_or(&[]);
    let criterion = Criterion::new(&survey.limits, &survey.seed);
    let Some(road) = road::road_line(points) else {
        side.flags |= flags::NO_ROAD;
        return side;
    };
    side.road = Some(trig::atan2(road.dz_um().into(), road.dy_um().into()));
    let Some(edge) = departure::departure(points, road, &criterion) else { return side };
    side.edge = hinge(points, edge);
    let Some(adjacent) = search(points, edge, &criterion, work) else { return side };
    side.adjacent = slope(points, &adjacent);
    if !adjacent.end_seen {
        side.flags |= flags::END_UNSEEN;
        return side;
    }
    let Some(opposing) = search(points, adjacent.end, &criterion, work) else { return side };
    side.opposing = slope(points, &opposing);
    if !opposing.end_seen {
        side.flags |= flags::END_UNSEEN;
    }
    side
}

/// The hinge at a point. The paper knows no other than the departure, and no interval.
fn hinge(points: &[Point], at: usize) -> Option<Hinge> {
    points.get(at).map(|p| Hinge { y_um: p.y_um, ci95_um: 0, departure_um: p.y_um })
}

/// The slope of a segment: the inclination of its line, from its first point to its departure.
fn slope(points: &[Point], segment: &Segment) -> Option<Slope> {
    let first = *points.get(segment.start)?;
    let line = Line::through(first, *points.get(segment.through)?);
    // Below 2^31: the criterion's greatest length is the horizon.
    let length_um = distance_squared(first, *points.get(segment.end)?).isqrt() as i32;
    Some(Slope {
        angle: trig::atan2(line.dz_um().into(), line.dy_um().into()),
        length_um,
        points: u16::try_from(segment.points).unwrap_or(u16::MAX),
        start: hinge(points, segment.start)?,
        end: hinge(points, segment.end)?,
        ..Slope::default()
    })
}
