//! How far two drives' positions are apart along the road, by the slopes themselves.
//!
//! The error of a position drifts over minutes, so one shift is found for each stretch of the road: the one for which the slopes of all
//! courses differ least in the mean. Of a few hundred slopes one number is taken; a stretch with fewer keeps its positions.

use super::matching::{Course, Sample, pairs};

/// Length of a stretch with one shift, in metres.
const STRETCH_M: f64 = 500.0;

/// The greatest shift and the steps in which it is looked for, in metres.
const MOST_M: f64 = 12.0;
const STEP_M: f64 = 0.25;

/// A stretch with fewer pairs of slopes than this is not shifted.
const LEAST_PAIRS: usize = 200;

/// The other drive with every sample moved by its stretch's shift, and the shifts that were found.
pub fn aligned(first: &[Course], other: &[Course], within_m: f64) -> (Vec<Course>, Vec<f64>) {
    let mut moved: Vec<Course> =
        other.iter().map(|course| Course { samples: Vec::new(), side: course.side, kind: course.kind }).collect();
    let mut shifts = Vec::new();
    let starts = first.iter().filter_map(|course| course.samples.first()).map(|sample| sample.station_m);
    let ends = first.iter().filter_map(|course| course.samples.last()).map(|sample| sample.station_m);
    let (start, end) = (starts.fold(f64::INFINITY, f64::min), ends.fold(f64::NEG_INFINITY, f64::max));
    // The last stretch takes in what would be too short for one of its own.
    let stretches = ((end - start) / STRETCH_M).max(1.0) as usize;
    for i in 0..stretches {
        let from = if i == 0 { f64::NEG_INFINITY } else { start + i as f64 * STRETCH_M };
        let to = if i + 1 == stretches { f64::INFINITY } else { start + (i + 1) as f64 * STRETCH_M };
        let here: Vec<(&[Sample], &[Sample])> = first
            .iter()
            .zip(other)
            .map(|(a, b)| (part(&a.samples, from, to), part(&b.samples, from - MOST_M, to + MOST_M)))
            .collect();
        let found = best_shift(&here, within_m);
        shifts.extend(found);
        for (course, source) in moved.iter_mut().zip(other) {
            let shift_m = found.unwrap_or(0.0);
            let of_stretch = part(&source.samples, from, to);
            course.samples.extend(of_stretch.iter().map(|s| Sample { station_m: s.station_m + shift_m, ..*s }));
        }
    }
    for course in &mut moved {
        course.samples.sort_by(|a, b| a.station_m.total_cmp(&b.station_m));
    }
    (moved, shifts)
}

/// Samples from one station up to another.
fn part(samples: &[Sample], from: f64, to: f64) -> &[Sample] {
    let first = samples.partition_point(|sample| sample.station_m < from);
    let last = samples.partition_point(|sample| sample.station_m < to);
    &samples[first..last.max(first)]
}

/// The shift with the least mean difference, refined by a parabola through its neighbours.
fn best_shift(courses: &[(&[Sample], &[Sample])], within_m: f64) -> Option<f64> {
    let cost = |shift_m: f64| {
        let (mut sum, mut count) = (0.0, 0);
        for (first, other) in courses {
            for (a, b) in pairs(first, other, shift_m, within_m) {
                sum += (b.slope_deg - a.slope_deg).abs();
                count += 1;
            }
        }
        (count >= LEAST_PAIRS).then(|| sum / f64::from(count as u32))
    };
    let steps = (2.0 * MOST_M / STEP_M) as i32;
    let costs: Vec<(f64, Option<f64>)> = (0..=steps)
        .map(|i| {
            let shift_m = f64::from(i) * STEP_M - MOST_M;
            (shift_m, cost(shift_m))
        })
        .collect();
    let known = costs.iter().enumerate().filter_map(|(i, (shift, cost))| Some((i, *shift, (*cost)?)));
    // Of equal ones the least: what the slopes do not tell is no shift.
    let (best, shift_m, least) = known.min_by(|a, b| a.2.total_cmp(&b.2).then(a.1.abs().total_cmp(&b.1.abs())))?;
    let around = |i: Option<usize>| i.and_then(|i| costs.get(i)?.1);
    let (Some(before), Some(after)) = (around(best.checked_sub(1)), around(Some(best + 1))) else {
        return Some(shift_m);
    };
    let curvature = before - 2.0 * least + after;
    Some(if curvature > 0.0 { shift_m + 0.5 * STEP_M * (before - after) / curvature } else { shift_m })
}
