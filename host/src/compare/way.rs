//! The track of the first drive, for places of other drives to be found on it.
//!
//! A flat map around the track's beginning: its scale errs far away, but by the same for both drives, and only places a few metres apart are
//! held against each other. Points are found by a grid of squares, so that the cost does not grow with the track.

use std::collections::HashMap;

use crate::profiles::Row;

/// A place this far from the track is not on it, in metres: two positions' errors and a lane.
const OFF_TRACK_M: f64 = 12.0;

/// Side of a grid square; a place is looked for in its own and the eight around it.
const SQUARE_M: f64 = 15.0;

/// The track keeps points at least so far apart.
const LEAST_STEP_M: f64 = 0.1;

/// A place this far before or behind the track's ends still counts as at the end.
const OVERHANG_M: f64 = 1.0;

/// Semi-major axis and first eccentricity squared of WGS 84.
const SEMI_MAJOR_M: f64 = 6_378_137.0;
const ECCENTRICITY_2: f64 = 6.694_379_990_141_316e-3;

#[derive(Clone, Copy, Debug)]
struct Point {
    east_m: f64,
    north_m: f64,
    station_m: f64,
}

/// A track.
#[derive(Clone, Debug)]
pub struct Way {
    latitude_deg: f64,
    longitude_deg: f64,
    east_m_per_deg: f64,
    north_m_per_deg: f64,
    points: Vec<Point>,
    squares: HashMap<(i64, i64), Vec<usize>>,
}

impl Way {
    /// The track of a drive; `None` without positions or without a way travelled.
    #[must_use]
    pub fn of(rows: &[Row]) -> Option<Self> {
        let placed = rows.iter().filter_map(|row| Some((row.position.geodetic?, row.position.station_m?)));
        let ([latitude_deg, longitude_deg, height_m], _) = placed.clone().next()?;
        let sin = latitude_deg.to_radians().sin();
        let w2 = 1.0 - ECCENTRICITY_2 * sin * sin;
        let east_radius = SEMI_MAJOR_M / w2.sqrt() + height_m;
        let north_radius = SEMI_MAJOR_M * (1.0 - ECCENTRICITY_2) / (w2 * w2.sqrt()) + height_m;
        let mut way = Self {
            latitude_deg,
            longitude_deg,
            east_m_per_deg: (east_radius * latitude_deg.to_radians().cos()).to_radians(),
            north_m_per_deg: north_radius.to_radians(),
            points: Vec::new(),
            squares: HashMap::new(),
        };
        for (geodetic, station_m) in placed {
            let (east_m, north_m) = way.flat(geodetic);
            let far = |last: &Point| (last.east_m - east_m).hypot(last.north_m - north_m) >= LEAST_STEP_M;
            if way.points.last().is_none_or(far) {
                way.squares.entry(square(east_m, north_m)).or_default().push(way.points.len());
                way.points.push(Point { east_m, north_m, station_m });
            }
        }
        (way.points.len() > 1).then_some(way)
    }

    /// Station on the track of a place (latitude and longitude in degrees, height), in metres; `None` when it is not on it.
    #[must_use]
    pub fn station_m(&self, geodetic: [f64; 3]) -> Option<f64> {
        let (east_m, north_m) = self.flat(geodetic);
        let (column, line) = square(east_m, north_m);
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
        (off <= OFF_TRACK_M).then_some(station_m)
    }

    fn flat(&self, [latitude_deg, longitude_deg, _]: [f64; 3]) -> (f64, f64) {
        let east_deg = (longitude_deg - self.longitude_deg + 180.0).rem_euclid(360.0) - 180.0;
        (east_deg * self.east_m_per_deg, (latitude_deg - self.latitude_deg) * self.north_m_per_deg)
    }
}

fn square(east_m: f64, north_m: f64) -> (i64, i64) {
    ((east_m / SQUARE_M).floor() as i64, (north_m / SQUARE_M).floor() as i64)
}
