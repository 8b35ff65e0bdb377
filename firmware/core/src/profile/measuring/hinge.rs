//! Where one line gives way to the next: as the intersection of the two, and as the point of departure.

use crossfall_protocol::message::Hinge;

use super::line::{Fit, Gate, Line, fit, weigh};
use super::magnitude::Magnitude;
use super::sample::{GRAIN_BITS, Noise, Outward, Sample, millimetres};
use super::slope::Found;

/// Samples past a slope's end that are taken for what follows it, and how far out they may lie.
const NEIGHBOURS: usize = 10;
const NEIGHBOUR_REACH: i32 = millimetres(8_000);

/// How far an intersection may lie outside of the gap between the two runs.
const TOLERANCE: i32 = millimetres(300);

/// A place on the section with its uncertainty, in grains outward.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Place {
    pub u: i32,
    /// Half width of the 95 % interval; 0 when unknown.
    pub half: u32,
    /// The point of departure.
    pub departure: i32,
    /// False when the section was not seen beyond it.
    pub seen: bool,
}

impl Place {
    pub fn message(&self, outward: Outward) -> Hinge {
        Hinge {
            y_um: outward.lateral_um(self.u),
            ci95_um: self.half.min(1 << 27) << GRAIN_BITS,
            departure_um: outward.lateral_um(self.departure),
        }
    }
}

/// Where two fits meet, with the half width of its interval: the variance of a height there is the sum of both lines',
/// and the angle between them turns it into a distance.
pub fn meeting(a: &Fit, b: &Fit) -> Option<(i32, u32)> {
    let u = a.line.meets(&b.line)?;
    let turn = a.line.slope_q30.abs_diff(b.line.slope_q30);
    let height = a.variance_at(u).plus(b.variance_at(u)).root();
    let half = height.over(Magnitude::new(u64::from(turn), -30)).times(Magnitude::new(251, -7));
    Some((u, half.scaled(0)))
}

/// The road edge.
pub fn edge(samples: &[Sample], road: &Fit, departure: usize, adjacent: &Found) -> Place {
    let departed = samples.get(departure).map_or(adjacent.fit.line.u, |s| s.u);
    match meeting(road, &adjacent.fit) {
        Some((u, half)) if u < adjacent.fit.line.u => Place { u, half, departure: departed, seen: true },
        _ => Place { u: departed, half: 0, departure: departed, seen: true },
    }
}

/// The outer end of a slope after which no other slope was found.
pub fn end(samples: &mut [Sample], slope: &Found, noise: &Noise) -> Place {
    let last = samples.get(slope.run.last).map_or(0, |s| s.u);
    let beyond = samples.get_mut(slope.run.last + 1..).unwrap_or_default();
    let beyond_count = beyond.len();
    let near = beyond.partition_point(|s| s.u < last + NEIGHBOUR_REACH).min(NEIGHBOURS);
    let beyond = beyond.get_mut(..near).unwrap_or_default();
    let Some(next) = beyond.first().map(|s| s.u) else {
        return Place { u: last, half: 0, departure: last, seen: beyond_count > 0 };
    };
    let neighbour = level(beyond, noise);
    bounded(neighbour.and_then(|n| meeting(&slope.fit, &n)), last, next)
}

/// The ends of two slopes that face each other across a ditch: the foot of the first and of the second.
pub fn across(samples: &mut [Sample], inner: &Found, outer: &Found, noise: &Noise) -> (Place, Place) {
    let last = samples.get(inner.run.last).map_or(0, |s| s.u);
    let first = samples.get(outer.run.first).map_or(last, |s| s.u);
    let floor = samples.get_mut(inner.run.last + 1..outer.run.first).unwrap_or_default();
    let (Some(next), Some(previous)) = (floor.first().map(|s| s.u), floor.last().map(|s| s.u)) else {
        let v = meeting(&inner.fit, &outer.fit);
        let place = bounded(v, last, first);
        return (place, Place { departure: last, ..place });
    };
    let floor = level(floor, noise);
    let foot = bounded(floor.and_then(|f| meeting(&inner.fit, &f)), last, next);
    let start = bounded(floor.and_then(|f| meeting(&f, &outer.fit)), previous, first);
    (foot, Place { departure: previous, ..start })
}

/// An intersection, if it lies where the samples say that the change is; else the middle of the gap.
fn bounded(meeting: Option<(i32, u32)>, last: i32, next: i32) -> Place {
    match meeting {
        Some((u, half)) if u > last - TOLERANCE && u < next + TOLERANCE => {
            Place { u, half, departure: next, seen: true }
        }
        _ => Place { u: (last + next) / 2, half: (next - last).unsigned_abs(), departure: next, seen: true },
    }
}

/// The ground beside a slope: level through the samples that agree best, then fitted where there are enough.
fn level(samples: &mut [Sample], noise: &Noise) -> Option<Fit> {
    // Ground that falls or rises by 2 degrees is still taken for level over the few samples that there are.
    let shift = weigh(samples, noise, 0);
    let mut best: Option<(u32, Line)> = None;
    for candidate in samples.iter() {
        let line = Line { u: candidate.u, z: candidate.z, slope_q30: 0 };
        let mut near = 0;
        for sample in samples.iter() {
            let e = line.residual(sample).unsigned_abs();
            if e < 1 << 15
                && e * e < 9 * noise.variance(sample, 0) + (sample.u.abs_diff(line.u) >> 5).pow(2).min(1 << 20)
            {
                near += 1;
            }
        }
        if best.is_none_or(|(count, lowest)| near > count || near == count && line.z < lowest.z) {
            best = Some((near, line));
        }
    }
    let (near, mut line) = best?;
    line.u = samples.get(samples.len() / 2).map_or(line.u, |s| s.u);
    let mut found = None;
    if near >= 4 {
        for _ in 0..3 {
            let fitted = fit(samples, &line, shift, Gate::TUKEY)?;
            line = fitted.line;
            found = Some(fitted);
        }
        if line.slope_q30.abs() < 1 << 26 {
            return found;
        }
    }
    // Too few to tell a slope: level, with 1.5 degrees of doubt about it.
    let (_, line) = best?;
    let variance = samples.first().map_or(0, |s| noise.variance(s, 0));
    Some(Fit {
        line,
        count: near,
        slope_variance: Magnitude::new(7, -13),
        height_variance: Magnitude::new(u64::from(variance), 0).over(Magnitude::new(u64::from(near.max(1)), 0)),
        chi2_q8: near << 8,
        effective_q8: near << 8,
    })
}
