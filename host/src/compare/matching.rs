//! Slopes along a track, and which of two drives' belong together.

use super::{Kind, Options};
use crate::profiles::Row;
use crate::side::Side;
use crate::statistics::upper_median;
use crate::way::Way;

/// A slope at a place of the road.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sample {
    pub station_m: f64,
    pub slope_deg: f64,
    pub ci95_deg: Option<f64>,
}

/// The slopes of one kind on one side, in the order of the road.
#[derive(Clone, Debug)]
pub struct Course {
    pub side: Side,
    pub kind: Kind,
    pub samples: Vec<Sample>,
}

/// A drive's slopes brought onto the stations of a track.
#[derive(Clone, Debug, Default)]
pub struct Placed {
    pub courses: Vec<Course>,
    /// Rows that lie nowhere on the track.
    pub off_track: usize,
    /// Rows that were left out because they say themselves unreliable.
    pub unreliable: usize,
    /// Whether it went along the track in the track's own direction.
    pub forward: bool,
}

/// Stations of rows on a track, or, without one, by their own way travelled.
pub fn place(rows: &[Row], way: Option<&Way>, options: &Options) -> Placed {
    let station = |row: &Row| match way {
        Some(way) => row.position.geodetic.and_then(|place| way.station_m(place)),
        None => row.position.station_m,
    };
    let mut placed = Placed { forward: true, ..Placed::default() };
    let sides = Side::BOTH.into_iter().filter(|side| options.sides.holds(*side));
    placed.courses = sides.flat_map(|side| Kind::BOTH.map(|kind| Course { side, kind, samples: Vec::new() })).collect();
    let (mut onward, mut back) = (0_usize, 0_usize);
    let mut last: Option<f64> = None;
    // The two sides of a scan are at the same place.
    let mut of_scan: Option<(u32, u64, Option<f64>)> = None;
    for row in rows.iter().filter(|row| options.sides.holds(row.side)) {
        let station_m = match of_scan {
            Some((scan, time, station_m)) if (scan, time) == (row.scan, row.time.0) => station_m,
            _ => station(row),
        };
        of_scan = Some((row.scan, row.time.0, station_m));
        let Some(station_m) = station_m else {
            placed.off_track += 1;
            continue;
        };
        if let Some(last) = last.replace(station_m) {
            onward += usize::from(station_m > last);
            back += usize::from(station_m < last);
        }
        if !row.is_reliable() {
            placed.unreliable += 1;
            continue;
        }
        for course in placed.courses.iter_mut().filter(|course| course.side == row.side) {
            if let Some(slope) = course.kind.of(row) {
                let (slope_deg, ci95_deg) = (slope.slope_deg, slope.ci95_deg);
                course.samples.push(Sample { station_m, slope_deg, ci95_deg });
            }
        }
    }
    placed.forward = onward >= back;
    for course in &mut placed.courses {
        course.samples.sort_by(|a, b| a.station_m.total_cmp(&b.station_m));
        if let Some(over_m) = options.over_m {
            course.samples = medians(&course.samples, over_m);
        }
    }
    placed
}

/// The median of each stretch of the road, at the stretch's middle. It has no interval: errors of neighbours are not independent.
fn medians(samples: &[Sample], over_m: f64) -> Vec<Sample> {
    let stretch = |sample: &Sample| (sample.station_m / over_m).floor();
    samples
        .chunk_by(|a, b| stretch(a) == stretch(b))
        .filter_map(|of_stretch| {
            let mut slopes: Vec<f64> = of_stretch.iter().map(|sample| sample.slope_deg).collect();
            let station_m = (stretch(&of_stretch[0]) + 0.5) * over_m;
            Some(Sample { station_m, slope_deg: upper_median(&mut slopes)?, ci95_deg: None })
        })
        .collect()
}

/// Each sample of the first with the nearest of the other, shifted along the road by `shift_m`, if it is within `within_m`.
pub fn pairs<'a>(
    first: &'a [Sample],
    other: &'a [Sample],
    shift_m: f64,
    within_m: f64,
) -> impl Iterator<Item = (&'a Sample, &'a Sample)> {
    let mut next = 0;
    first.iter().filter_map(move |sample| {
        let apart = |candidate: &Sample| (candidate.station_m + shift_m - sample.station_m).abs();
        while other.get(next + 1).is_some_and(|after| apart(after) <= apart(&other[next])) {
            next += 1;
        }
        let nearest = other.get(next)?;
        (apart(nearest) <= within_m).then_some((sample, nearest))
    })
}
