//! Where one line gives way to the next: as the intersection of the two, and as the point of departure.

use crossfall_protocol::message::{Hinge, flags};

use super::line::{Fit, Gate, Line, Precision, fit, ratio, weigh};
use super::magnitude::Magnitude;
use super::sample::{GRAIN_BITS, Noise, Outward, Sample, inward_of, millimetres};
use super::slope::Found;

/// Most samples through which level ground is tried.
const CANDIDATES: usize = 12;

/// Samples past a slope's end that are taken for what follows it.
const NEIGHBOURS: usize = 10;

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
    fn departing(self, departure: i32) -> Self {
        Self { departure, ..self }
    }

    pub fn message(&self, outward: Outward) -> Hinge {
        Hinge {
            y_um: outward.lateral_um(self.u),
            ci95_um: self.half.min(1 << 27) << GRAIN_BITS,
            departure_um: outward.lateral_um(self.departure),
        }
    }
}

/// What is wanted of the places of a section: on the way to the last fits nobody asks how sure they are, and that is the longer half of the work.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Want {
    Places,
    Intervals,
}

/// Half width of the interval of the place where two fits meet: the variance of a height there is the sum of both lines',
/// and the angle between them turns it into a distance.
fn half_width(a: &Fit, b: &Fit, u: i32) -> u32 {
    let turn = a.line.slope_q30.abs_diff(b.line.slope_q30);
    let height = a.variance_at(u).plus(b.variance_at(u)).root();
    height.over(Magnitude::new(u64::from(turn), -30)).times(Magnitude::new(251, -7)).scaled(0)
}

/// The road edge, `departed` being how far out the road's departure is.
pub fn edge(road: &Fit, departed: i32, adjacent: &Found, want: Want) -> Place {
    let met = road.line.meets(&adjacent.fit.line).filter(|u| *u < adjacent.fit.line.u);
    let half = match (met, want) {
        (Some(u), Want::Intervals) => half_width(road, &adjacent.fit, u),
        _ => 0,
    };
    Place { u: met.unwrap_or(departed), half, departure: departed, seen: true }
}

/// [`flags::HINGE_ROUNDED`] when the samples within 0.4 m of a convex hinge lie below both lines by more than noise does:
/// their weighted mean residual is beyond 3 sigma.
pub fn rounded(samples: &[Sample], place: &Place, inner: &Line, outer: &Line, noise: &Noise) -> u16 {
    let first = inward_of(samples, inner.place_at(place.u - ROUNDING_REACH));
    let past = inward_of(samples, outer.place_at(place.u + ROUNDING_REACH));
    let (mut sum, mut information) = (0i64, 0i64);
    for sample in samples.get(first..past).unwrap_or_default() {
        let line = if sample.u < place.u { inner } else { outer };
        let e = line.residual(sample).clamp(-(1 << 12), 1 << 12);
        // At most 2^30 / 2^10 each: a few hundred samples stay below 2^42, their square below 2^63.
        let weight = (1 << 30) / i64::from(noise.variance(sample, line.slope_q14()).max(1 << 10));
        sum += (weight * i64::from(e)) >> 15;
        information += weight;
    }
    // sum / 2^15 over the root of information / 2^30 is standard normal for a sharp hinge.
    if sum < 0 && sum.saturating_mul(sum) > 9 * information { flags::HINGE_ROUNDED } else { 0 }
}

/// How far from a hinge its rounding is looked for.
const ROUNDING_REACH: i32 = millimetres(400);

/// The ground beyond the outer end of a slope.
pub fn ground_beyond(samples: &mut [Sample], slope: &Found, noise: &Noise) -> Option<Ground> {
    let beyond = samples.get_mut(slope.run.last + 1..).unwrap_or_default();
    let near = beyond.len().min(NEIGHBOURS);
    level(beyond.get_mut(..near).unwrap_or_default(), noise)
}

/// The ground between two slopes.
pub fn ground_between(samples: &mut [Sample], inner: &Found, outer: &Found, noise: &Noise) -> Option<Ground> {
    level(samples.get_mut(inner.run.last + 1..outer.run.first).unwrap_or_default(), noise)
}

/// The outer end of a slope after which no other slope was found.
pub fn end(samples: &[Sample], slope: &Found, ground: &Option<Ground>, noise: &Noise, want: Want) -> Place {
    let Some(last) = samples.get(slope.run.last).copied() else { return Place::default() };
    let beyond = samples.get(slope.run.last + 1..).unwrap_or_default();
    let Some(next) = beyond.iter().map(|s| s.u).find(|u| *u > last.u) else {
        return Place { u: last.u, half: 0, departure: last.u, seen: false };
    };
    // Past the top of a rising slope vegetation on the level ground may pass for slope: up to two samples of it.
    let back = if slope.fit.line.slope_q30 > 0 { 2 } else { 0 };
    let inner = samples.get(slope.run.last.saturating_sub(back)).unwrap_or(&last);
    let met = ground.as_ref().and_then(|ground| between(&slope.fit, &ground.fit, noise, inner, ground.first, want));
    met.unwrap_or_else(|| gap(last.u, next)).departing(next)
}

/// The ends of two slopes that face each other across a ditch: the foot of the first and of the second.
pub fn across(
    samples: &[Sample],
    inner: &Found,
    outer: &Found,
    ground: &Option<Ground>,
    noise: &Noise,
    want: Want,
) -> (Place, Place) {
    let (Some(last), Some(first)) = (samples.get(inner.run.last).copied(), samples.get(outer.run.first).copied())
    else {
        return Default::default();
    };
    let floor = samples.get(inner.run.last + 1..outer.run.first).unwrap_or_default();
    let inside = |u: &i32| (last.u + 1..first.u).contains(u);
    let next = floor.iter().map(|s| s.u).find(inside).unwrap_or(first.u);
    let previous = floor.iter().rev().map(|s| s.u).find(inside).unwrap_or(last.u);
    if let Some(ground) = ground {
        let foot = between(&inner.fit, &ground.fit, noise, &last, ground.first, want);
        let start = between(&outer.fit, &ground.fit, noise, &last, first.u, want);
        if let (Some(foot), Some(start)) = (foot, start)
            && foot.u <= start.u
        {
            return (foot.departing(next), start.departing(previous));
        }
    }
    // No floor to be seen: the slopes meet, or there is one between the beams. Every floor from none to the widest
    // that no beam would have met explains the scan equally well: the middle is reported, with all of them in its interval.
    let met = between(&inner.fit, &outer.fit, noise, &last, first.u, want).unwrap_or_else(|| gap(last.u, first.u));
    let height = inner.fit.line.height_at(last.u).min(outer.fit.line.height_at(first.u));
    let level = Line { u: met.u, z: height, slope_q30: 0 };
    let widest = |slope: &Fit| slope.line.meets(&level).unwrap_or(met.u).clamp(last.u.min(met.u), first.u.max(met.u));
    let middle = |reach: i32| Place { u: (met.u + reach) / 2, half: met.half + reach.abs_diff(met.u) / 2, ..met };
    (middle(widest(&inner.fit)).departing(next), middle(widest(&outer.fit)).departing(previous))
}

/// An intersection, if it lies between two samples, give or take what noise can shift it by.
fn between(slope: &Fit, other: &Fit, noise: &Noise, last: &Sample, next: i32, want: Want) -> Option<Place> {
    let u = slope.line.meets(&other.line)?;
    let near = |shift: i32| u > last.u - shift && u < next + shift;
    if !near(MOST_SHIFT) {
        return None;
    }
    let half = if want == Want::Intervals || !near(LEAST_SHIFT) { half_width(slope, other, u) } else { 0 };
    if !near(LEAST_SHIFT) {
        let turn_q14 = (slope.line.slope_q30.abs_diff(other.line.slope_q30) >> 16).max(1);
        let shift = ((4 * noise.variance(last, slope.line.slope_q14()).isqrt()) << 14) / turn_q14;
        if !near((shift + 2 * half.min(1 << 20)).min(MOST_SHIFT as u32) as i32) {
            return None;
        }
    }
    Some(Place { u, half, departure: next, seen: true })
}

/// Noise shifts an intersection by so much at least, and by no more than so much.
const LEAST_SHIFT: i32 = millimetres(60);
const MOST_SHIFT: i32 = millimetres(500);

/// The middle of a gap, when nothing better is known.
fn gap(last: i32, next: i32) -> Place {
    Place { u: (last + next) / 2, half: (next - last).unsigned_abs(), departure: next, seen: true }
}

/// Level ground beside a slope.
pub struct Ground {
    fit: Fit,
    /// Distance of the innermost sample on it.
    first: i32,
}

/// What a candidate earns a sample when the others cannot make much of a difference: the line is fitted yet.
const AGREED: usize = 200;

/// How well a weighed sample fits level ground at a place: 288 on it, nothing from 3 sigma beyond a quarter of a degree of tilt on.
#[inline(always)]
fn on_level((u, z): (i32, i32), sample: &Sample) -> Option<u32> {
    let tilt = (sample.u.abs_diff(u) >> 8).min(1 << 10);
    let e = sample.z.abs_diff(z).min((1 << 15) - 1);
    // At most 9 variances beyond the tilt's square: the rest of a residual whose square is less the tilt's.
    let rest = (e * e).saturating_sub(tilt * tilt);
    288u32.checked_sub(ratio::<5>(sample, rest)).filter(|score| *score > 0)
}

/// The ground beside a slope: level through the samples that agree best, then fitted where there are enough.
fn level(samples: &mut [Sample], noise: &Noise) -> Option<Ground> {
    let shift = weigh(samples, 1, noise, 0);
    let mut best: Option<(u32, (i32, i32))> = None;
    // Of a wide floor's samples some are candidates, all have their say.
    for candidate in samples.iter().step_by(samples.len().div_ceil(CANDIDATES).max(1)) {
        let place = (candidate.u, candidate.z);
        let score = samples.iter().filter_map(|s| on_level(place, s)).sum();
        if best.is_none_or(|(most, (_, lowest))| score > most || score == most && place.1 < lowest) {
            best = Some((score, place));
        }
        if score as usize > samples.len() * AGREED {
            break;
        }
    }
    let (_, place) = best?;
    let mut on = samples.iter().filter(|s| on_level(place, s).is_some());
    let first = on.next()?.u;
    let near = 1 + on.count();
    let line = Line { u: place.0, z: place.1, slope_q30: 0 };
    if near >= 4 {
        let mut fitted = fit(samples, 1, &line, shift, Gate::GROWN)?;
        fitted = fit(samples, 1, &fitted.line, shift, Gate::GROWN)?;
        if fitted.line.slope_q30.abs() < 1 << 26 {
            return Some(Ground { fit: fitted, first });
        }
    }
    // Too few to tell a slope: level, with 1.5 degrees of doubt about it.
    let variance = samples.first().map_or(0, |s| noise.variance(s, 0));
    let fit = Fit {
        line,
        count: near as u32,
        precision: Precision::Variances {
            slope: Magnitude::new(7, -13),
            height: Magnitude::new(u64::from(variance), 0).over(Magnitude::new(near.max(1) as u64, 0)),
        },
        chi2_q8: 0,
        effective_q8: 0,
        gate: Gate::GROWN,
    };
    Some(Ground { fit, first })
}
