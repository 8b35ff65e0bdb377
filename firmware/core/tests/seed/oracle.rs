//! The seed's criterion written down as it reads, over all pairs of points, in 128 bits: slow and plain.

use crossfall_core::protocol::Angle;
use crossfall_core::protocol::config::Survey;
use crossfall_core::scan::Point;
use crossfall_core::trig;

/// A line by two of its points.
#[derive(Clone, Copy)]
pub struct Line(pub Point, pub Point);

/// What the search is to find.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Best {
    pub start: usize,
    pub through: usize,
    pub end: usize,
    pub end_seen: bool,
    pub points: u32,
}

/// The best of all lines, and how many points were looked at on the way.
pub struct Exhausted {
    pub best: Option<Best>,
    pub steps: u64,
}

impl Line {
    fn run(&self) -> i128 {
        i128::from(self.1.y_um) - i128::from(self.0.y_um)
    }

    fn rise(&self) -> i128 {
        i128::from(self.1.z_um) - i128::from(self.0.z_um)
    }

    /// Whether a point's perpendicular distance is more than a threshold: distance = cross product / length, squared.
    pub fn is_further(&self, p: Point, threshold_um: i32) -> bool {
        let y = i128::from(p.y_um) - i128::from(self.0.y_um);
        let z = i128::from(p.z_um) - i128::from(self.0.z_um);
        let cross = z * self.run() - y * self.rise();
        let length_squared = self.run().pow(2) + self.rise().pow(2);
        cross.pow(2) > i128::from(threshold_um).pow(2) * length_squared
    }

    fn inclination_within(&self, least: Angle, greatest: Angle) -> bool {
        let (least, greatest) = (trig::direction(least), trig::direction(greatest));
        let (run, rise) = (self.run().abs(), self.rise().abs());
        run != 0
            && rise * i128::from(least.cos_q30) >= run * i128::from(least.sin_q30)
            && rise * i128::from(greatest.cos_q30) <= run * i128::from(greatest.sin_q30)
    }
}

/// The point of significant departure of a line over points `from..`.
pub fn departure(points: &[Point], from: usize, line: Line, survey: &Survey) -> Option<usize> {
    let seed = &survey.seed;
    let wanted = usize::from(seed.departure_points).max(1);
    let onset_um = seed.onset_um.min(seed.departure_um);
    let k = (from..points.len()).find(|&k| {
        k + wanted <= points.len() && points[k..k + wanted].iter().all(|p| line.is_further(*p, seed.departure_um))
    })?;
    let mut d = k;
    while d > from && line.is_further(points[d - 1], onset_um) {
        d -= 1;
    }
    Some(d)
}

/// Tries every pair of points from the edge on.
pub fn exhaust(points: &[Point], edge: usize, survey: &Survey) -> Exhausted {
    let limits = &survey.limits;
    let mut found = Exhausted { best: None, steps: 0 };
    for start in edge..points.len() {
        for through in start + 1..points.len() {
            let line = Line(points[start], points[through]);
            if !line.inclination_within(limits.min_slope, limits.max_slope) {
                continue;
            }
            let departs = departure(points, start, line, survey);
            let stop = departs.unwrap_or(points.len());
            found.steps += (stop - edge) as u64;
            let end = departs.unwrap_or(points.len() - 1);
            let (y, z) = (
                i128::from(points[end].y_um) - i128::from(points[start].y_um),
                i128::from(points[end].z_um) - i128::from(points[start].z_um),
            );
            let length_squared = y.pow(2) + z.pow(2);
            let (shortest, longest) = (i128::from(limits.min_length_um), i128::from(limits.max_length_um));
            let long_enough = shortest.pow(2) <= length_squared && length_squared <= longest.pow(2);
            let obstructed = points[edge..stop].iter().any(|p| line.is_further(*p, limits.obstruction_um));
            if !long_enough || obstructed {
                continue;
            }
            let score =
                points[start..stop].iter().filter(|p| !line.is_further(**p, survey.seed.inlier_um)).count() as u32;
            if found.best.is_none_or(|best| score > best.points) {
                found.best = Some(Best { start, through, end, end_seen: departs.is_some(), points: score });
            }
        }
    }
    found
}
