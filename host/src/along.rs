//! Other drives on the same road, told by where they were: stations of one drive for places of another, whichever way it went.
//!
//! The reference is a line through the drive's own places, at least five metres apart. A place belongs to the nearest segment within 30 m, looked for
//! first near the last one found, then everywhere.

use crate::drive::Drive;
use crate::geodesy::{Geodetic, between};

/// Vertices of the line are at least so far apart.
const SPACING_M: f64 = 5.0;

/// Further from the line than this is another road.
const REACH_M: f64 = 30.0;

/// Segments to both sides of the last one found that are looked at first.
const NEAR: usize = 40;

/// A drive's line.
#[derive(Clone, Debug)]
pub struct Along {
    vertices: Vec<(f64, Geodetic)>,
    last: usize,
}

/// A place on it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OnLine {
    /// Station of the reference drive, in metres.
    pub station_m: f64,
    /// How far to the left of its way the place lies.
    pub left_m: f64,
}

impl Along {
    /// The line of a drive; nothing for one without positions and stations.
    #[must_use]
    pub fn new(drive: &Drive) -> Option<Self> {
        let mut vertices: Vec<(f64, Geodetic)> = Vec::new();
        for scan in drive.scans.iter().filter(|scan| scan.place[0].is_finite() && scan.station_m.is_finite()) {
            if vertices.last().is_none_or(|(station, _)| scan.station_m - station >= SPACING_M) {
                vertices.push((scan.station_m, scan.place));
            }
        }
        (vertices.len() >= 2).then_some(Self { vertices, last: 0 })
    }

    /// Where a place lies on the line.
    pub fn find(&mut self, place: Geodetic) -> Option<OnLine> {
        let around = self.last.saturating_sub(NEAR)..(self.last + NEAR).min(self.vertices.len() - 1);
        let near = self.nearest(place, around);
        let (segment, found, _) = near.filter(|(_, _, distance)| *distance <= REACH_M).or_else(|| {
            self.nearest(place, 0..self.vertices.len() - 1).filter(|(_, _, distance)| *distance <= REACH_M)
        })?;
        self.last = segment;
        Some(found)
    }

    fn nearest(&self, place: Geodetic, segments: std::ops::Range<usize>) -> Option<(usize, OnLine, f64)> {
        let mut best: Option<(usize, OnLine, f64)> = None;
        for segment in segments {
            let ((from_m, from), (to_m, to)) = (self.vertices[segment], self.vertices[segment + 1]);
            let (way, there) = (between(from, to), between(from, place));
            let length2 = way[0] * way[0] + way[1] * way[1];
            if length2 <= 0.0 {
                continue;
            }
            let part = ((way[0] * there[0] + way[1] * there[1]) / length2).clamp(0.0, 1.0);
            let off = [there[0] - part * way[0], there[1] - part * way[1]];
            let distance = off[0].hypot(off[1]);
            if best.as_ref().is_none_or(|(_, _, least)| distance < *least) {
                let left = (way[0] * off[1] - way[1] * off[0]).signum() * distance;
                best = Some((segment, OnLine { station_m: from_m + part * (to_m - from_m), left_m: left }, distance));
            }
        }
        best
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geodesy::shifted;

    const START: Geodetic = [40.8, -77.86, 350.0];

    fn eastward() -> Along {
        let vertices = (0..200).map(|i| (f64::from(i) * 5.0, shifted(START, [f64::from(i) * 5.0, 0.0, 0.0]))).collect();
        Along { vertices, last: 0 }
    }

    #[test]
    fn places_have_stations_and_sides() {
        let mut along = eastward();
        let found = along.find(shifted(START, [512.5, 7.0, 0.0])).unwrap();
        assert!((found.station_m - 512.5).abs() < 0.05 && (found.left_m - 7.0).abs() < 0.05, "{found:?}");
        let found = along.find(shifted(START, [12.0, -3.0, 0.0])).unwrap();
        assert!((found.station_m - 12.0).abs() < 0.05 && (found.left_m + 3.0).abs() < 0.05, "{found:?}");
        assert_eq!(along.find(shifted(START, [500.0, 100.0, 0.0])), None);
    }
}
