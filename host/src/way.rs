//! A drive's track, for places of other drives to be found on it: stations of the one for places of the other, whichever way it went.
//!
//! A flat map around the track's beginning: its scale errs far away, but by the same for both drives, and only places near each other are held
//! against each other. Points are found by a grid of squares, so that the cost does not grow with the track. A place belongs to the nearest
//! piece of the track; where the track crosses itself, that may be the other branch for the width of the crossing.

use std::collections::HashMap;

use crate::geodesy::{Geodetic, Plane};

/// The track keeps points at least so far apart, whatever the reach.
const LEAST_STEP_M: f64 = 0.1;

/// A place this far before or behind the track's ends still counts as at the end.
const OVERHANG_M: f64 = 1.0;

/// How far from a track a place is still on it.
#[derive(Clone, Copy, Debug)]
pub struct Reach {
    /// A place further off than this is not on the track, in metres.
    off_m: f64,
    /// The track keeps points at least so far apart, in metres.
    step_m: f64,
}

impl Reach {
    /// The same carriageway: two positions' errors and a lane.
    pub const LANE: Self = Self { off_m: 12.0, step_m: LEAST_STEP_M };

    /// Both carriageways of a road. Its points are further apart, because what positions err by turns a short piece, and with it what lies
    /// square to it a carriageway away.
    pub const ROAD: Self = Self { off_m: 30.0, step_m: 5.0 };

    /// Side of a grid square; a place is looked for in its own and the eight around it.
    fn square_m(self) -> f64 {
        1.25 * self.off_m
    }
}

#[derive(Clone, Copy, Debug)]
struct Point {
    east_m: f64,
    north_m: f64,
    station_m: f64,
}

/// A track.
#[derive(Clone, Debug)]
pub struct Way {
    reach: Reach,
    plane: Plane,
    points: Vec<Point>,
    squares: HashMap<(i64, i64), Vec<usize>>,
}

impl Way {
    /// The track through a drive's places and their stations, in order; `None` without a way travelled. Where positions fail for a while it
    /// goes straight on.
    #[must_use]
    pub fn through(places: impl Iterator<Item = (Geodetic, f64)>, reach: Reach) -> Option<Self> {
        let mut places = places.peekable();
        let origin = places.peek()?.0;
        let mut way = Self { reach, plane: Plane::at(origin), points: Vec::new(), squares: HashMap::new() };
        let mut last = None;
        for (place, station_m) in places {
            let [east_m, north_m] = way.plane.metres(place);
            let point = Point { east_m, north_m, station_m };
            way.extend(point, reach.step_m);
            last = Some(point);
        }
        // The track ends where the drive does.
        last.into_iter().for_each(|point| way.extend(point, LEAST_STEP_M));
        (way.points.len() > 1).then_some(way)
    }

    /// Goes on to a point that is far enough, in steps that the grid cannot miss.
    fn extend(&mut self, to: Point, step_m: f64) {
        let Some(from) = self.points.last().copied() else { return self.push(to) };
        let (east_m, north_m, station_m) =
            (to.east_m - from.east_m, to.north_m - from.north_m, to.station_m - from.station_m);
        let length_m = east_m.hypot(north_m);
        if length_m < step_m {
            return;
        }
        let steps = (length_m / (self.reach.square_m() - self.reach.off_m)).ceil().max(1.0);
        for step in 1..steps as usize {
            let part = step as f64 / steps;
            self.push(Point {
                east_m: from.east_m + part * east_m,
                north_m: from.north_m + part * north_m,
                station_m: from.station_m + part * station_m,
            });
        }
        self.push(to);
    }

    fn push(&mut self, point: Point) {
        let square = self.square(point.east_m, point.north_m);
        self.squares.entry(square).or_default().push(self.points.len());
        self.points.push(point);
    }

    /// Station on the track of a place, in metres; `None` when it is not on it. Its height does not matter.
    #[must_use]
    pub fn station_m(&self, place: Geodetic) -> Option<f64> {
        let [east_m, north_m] = self.plane.metres(place);
        let (column, line) = self.square(east_m, north_m);
        let around = (-1..=1).flat_map(|i| (-1..=1).map(move |j| (column + i, line + j)));
        let distance = |i: &usize| {
            let point = self.points[*i];
            (point.east_m - east_m).hypot(point.north_m - north_m)
        };
        let near = around.filter_map(|square| self.squares.get(&square)).flatten().copied();
        let nearest = near.min_by(|a, b| distance(a).total_cmp(&distance(b)))?;
        // The foot of the perpendicular lies on the piece before the nearest point or on the one after it.
        let pieces = [nearest.checked_sub(1).map(|before| (before, nearest)), Some((nearest, nearest + 1))];
        let feet = pieces.into_iter().flatten().filter_map(|(a, b)| {
            let (from, to) = (self.points.get(a)?, self.points.get(b)?);
            let (dx, dy) = (to.east_m - from.east_m, to.north_m - from.north_m);
            let length = dx.hypot(dy);
            let along = ((east_m - from.east_m) * dx + (north_m - from.north_m) * dy) / length;
            let is_end = (a == 0 && along < 0.0) || (b + 1 == self.points.len() && along > length);
            if is_end && (along < -OVERHANG_M || along > length + OVERHANG_M) {
                return None;
            }
            let part = (along / length).clamp(0.0, 1.0);
            let off = (from.east_m + part * dx - east_m).hypot(from.north_m + part * dy - north_m);
            Some((off, from.station_m + part * (to.station_m - from.station_m)))
        });
        let (off, station_m) = feet.min_by(|a, b| a.0.total_cmp(&b.0))?;
        (off <= self.reach.off_m).then_some(station_m)
    }

    fn square(&self, east_m: f64, north_m: f64) -> (i64, i64) {
        let side = self.reach.square_m();
        ((east_m / side).floor() as i64, (north_m / side).floor() as i64)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geodesy::shifted;

    const START: Geodetic = [40.8, -77.86, 350.0];

    fn at(east_m: f64, north_m: f64) -> Geodetic {
        shifted(START, [east_m, north_m, 0.0])
    }

    /// A kilometre to the east, its positions lost for a while.
    fn eastward(reach: Reach) -> Way {
        let east = (0..1_250).map(|i| f64::from(i) * 0.8).filter(|east| !(400.0..700.0).contains(east));
        Way::through(east.map(|east| (at(east, 0.0), 100.0 + east)), reach).unwrap()
    }

    #[test]
    fn places_have_stations_as_far_as_the_reach() {
        for (reach, near, far) in [(Reach::LANE, 11.9, 12.1), (Reach::ROAD, 29.9, 30.1)] {
            let way = eastward(reach);
            // The middle of what was lost lies on the track as well.
            for east in [0.0, 12.3, 399.9, 512.5, 555.0, 999.0] {
                for side in [-1.0, 1.0] {
                    let found = way.station_m(at(east, side * near)).unwrap();
                    assert!((found - 100.0 - east).abs() < 0.05, "{reach:?} {east} {found}");
                    assert_eq!(way.station_m(at(east, side * far)), None, "{reach:?} {east}");
                }
            }
            // What lies before it or behind it is not put at its ends.
            assert_eq!(way.station_m(at(-1.2, 0.0)), None);
            assert_eq!(way.station_m(at(1_000.5, 5.0)), None);
            assert_eq!(way.station_m([f64::NAN; 3]), None);
        }
    }

    #[test]
    fn a_way_needs_one_travelled() {
        assert!(Way::through(std::iter::empty(), Reach::LANE).is_none());
        assert!(Way::through((0..9).map(|_| (START, 0.0)), Reach::ROAD).is_none());
        // Shorter than a step all the same.
        assert!(Way::through([(START, 0.0), (at(3.0, 0.0), 3.0)].into_iter(), Reach::ROAD).is_some());
    }
}
