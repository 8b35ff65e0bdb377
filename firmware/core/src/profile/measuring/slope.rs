//! One slope: found, fitted on its own run of samples, and told how sure it is.

use crossfall_protocol::Angle;
use crossfall_protocol::message::{Slope, flags};

use super::hinge::Place;
use super::line::{Fit, Gate, Line, Precision, fit, weigh};
use super::magnitude::Magnitude;
use super::sample::{GRAIN_BITS, Noise, Outward, Sample, inward_of, millimetres};
use super::search::{self, Best, Run, Wanted};
use crate::trig;

/// A run must earn what this many samples on the line would: fewer can be chance.
const LEAST_SCORE: i32 = 1_100;

/// Fewest samples within the gate.
const LEAST_SAMPLES: u32 = 5;

/// Pseudo-observations of the assumed noise against the slope's own residuals: in the roughness, and in the interval.
const ROUGHNESS_PRIOR: u32 = 3;
const INTERVAL_PRIOR: u32 = 4;

/// A slope with what its neighbours need to know.
#[derive(Clone, Copy, Debug)]
pub struct Found {
    pub fit: Fit,
    /// Its samples, as indices among all of the side.
    pub run: Run,
    /// What its residuals say of the noise.
    pub noise: Noise,
    /// Whether its ground undulates by more than noise and roughness do.
    pub undulates: bool,
    /// Whether its ground goes on beyond its outer end and could not be followed.
    unclear: bool,
    /// Whether something grows on it.
    grown: bool,
    /// Whether another line fits its surroundings almost as well.
    contested: bool,
    /// The sample that it was sought from, and its run counted from there.
    from: usize,
    part: Run,
    /// Half width of its 95 % interval, 30 fraction bits, once it has settled.
    half_q30: u32,
}

/// Finds and measures the slope that is `wanted`, from sample `from` on, which is `start` outward; keeps what its residuals say about the noise. `inner` is the
/// slope before it.
pub fn measure(
    samples: &mut [Sample],
    (from, start): (usize, i32),
    inner: Option<&Found>,
    wanted: &Wanted,
    noise: &mut Noise,
) -> Option<Found> {
    let beyond = samples.get_mut(from..)?;
    let Best { line, mut run, contested } = search::find(beyond, start, wanted, noise)?;
    if run.score < LEAST_SCORE {
        return None;
    }
    let part = beyond.get_mut(run.first..=run.last)?;
    let found = refit(part, &line, noise, Gate::GROWN)?;
    // What the residuals say of the roughness decides which of them count: once more on the run that results.
    *noise = roughened(noise, &found, part);
    let shift = weigh(beyond, 1, noise, found.line.slope_q14());
    run = search::run(beyond, (run.first + run.last) / 2, &found.line, wanted.obstruction);
    let part = beyond.get_mut(run.first..=run.last)?;
    let mut fit = fit(part, 1, &found.line, shift, Gate::GROWN)?;
    *noise = roughened(noise, &fit, part);
    let (mut undulates, mut unclear) = (false, false);
    let (inward, outward) = search::goes_on(beyond, start, &fit.line, &run);
    // Ground is not followed past what stands before it.
    let open = |found: (&Fit, &Run), from: usize| {
        samples.get(from..).is_some_and(|part| clear(search::up_to(part, found.1), &found.0.line, wanted.obstruction))
    };
    if (inward || outward)
        && open((&fit, &run), from)
        && inner.is_none_or(|inner| open((&inner.fit, &inner.part), inner.from))
    {
        let beyond = samples.get_mut(from..)?;
        if !is_straight(beyond, (&fit, &run), wanted, noise) {
            match further(beyond, start, &run, wanted, noise) {
                Some((longer, along, rougher)) => {
                    undulates = true;
                    (fit, run, *noise) = (uneven(longer, &rougher), along, rougher);
                }
                None => unclear = outward,
            }
        }
    }
    let part = run;
    // Outside the gate, which is wide below, there is what grows.
    let grown = fit.count as usize <= run.last - run.first;
    let run = Run { first: run.first + from, last: run.last + from, score: run.score };
    Some(Found { fit, run, noise: *noise, undulates, unclear, grown, contested, from, part, half_q30: u32::MAX })
}

/// The gate in which undulating ground is followed.
fn wide(noise: &Noise) -> Noise {
    Noise { rough2: UNDULATION * UNDULATION, ..*noise }
}

/// Whether the ground that goes on beyond a run lies on its line as the run does: straight, with something growing on it that has ended the run.
fn is_straight(samples: &mut [Sample], (known, run): (&Fit, &Run), wanted: &Wanted, noise: &Noise) -> bool {
    let wide = wide(noise);
    weigh(samples, 1, &wide, known.line.slope_q14());
    let along = search::run(samples, (run.first + run.last) / 2, &known.line, wanted.obstruction);
    let part = samples.get(along.first..=along.last).unwrap_or_default();
    part.len() > run.last - run.first + 1 && roughness_below(part, &known.line, &wide).rough2 <= UNDULATES
}

/// A slope whose ground goes on beyond the ends of its run, further off its line than noise is, undulates: runs end where noise does. It is
/// sought anew in a gate as wide as undulations are high, and followed in one that is as wide as what lies below its line, where nothing grows, says.
fn further(
    samples: &mut [Sample],
    start: i32,
    known: &Run,
    wanted: &Wanted,
    noise: &Noise,
) -> Option<(Fit, Run, Noise)> {
    let wide = wide(noise);
    let Best { mut line, mut run, .. } = search::find(samples, start, wanted, &wide)?;
    let (mut noise, mut gate, mut found) = (wide, wide, None);
    for _ in 0..PASSES {
        let shift = weigh(samples, 1, &gate, line.slope_q14());
        run = search::run(samples, (run.first + run.last) / 2, &line, wanted.obstruction);
        let part = samples.get_mut(run.first..=run.last)?;
        let fitted = fit(part, 1, &line, shift, Gate::GROWN)?;
        line = fitted.line;
        noise = roughness_below(part, &line, &noise);
        // Half as wide again as what is in it: undulations have their neighbours on the same side.
        gate = Noise { rough2: (noise.rough2 / 4 * 9).min(wide.rough2), ..noise };
        found = Some(fitted);
    }
    let ground = run.score > GROUND_SCORE * (run.last - run.first + 1) as i32;
    let one = noise.rough2 > UNDULATES && noise.rough2 <= HILLS;
    let at = |index: usize| samples.get(index).map_or(0, |s| s.u);
    let outward = at(run.last) - at(known.last);
    let inward = at(known.first) - at(run.first).max(start + search::SHOULDER);
    let longer = outward.max(inward) > GAINED;
    found.filter(|_| ground && one && longer).map(|fitted| (fitted, run, noise))
}

/// How often a gate is narrowed to what is found in it.
const PASSES: u32 = 2;

/// The noise with the least of [`ROUGHNESSES`] that, with the noise of ranges, explains two thirds of the samples below a line as within one sigma. A share, as
/// its ends may take in a few samples of what comes next.
fn roughness_below(part: &[Sample], line: &Line, noise: &Noise) -> Noise {
    let ranges = Noise { rough2: 0, ..*noise };
    let (mut within, mut all) = ([0u32; ROUGHNESSES.len()], 0u32);
    for sample in part {
        let e = line.residual(sample);
        if e < 0 && e > -(1 << 15) {
            all += 1;
            let rest = ((e * e) as u32).saturating_sub(ranges.variance(sample, line.slope_q14()));
            for (count, rough2) in within.iter_mut().zip(ROUGHNESSES) {
                *count += u32::from(rest <= rough2);
            }
        }
    }
    let found = within.iter().zip(ROUGHNESSES).find(|(count, _)| 3 * **count >= 2 * all);
    Noise { rough2: found.map_or(Noise::MAX_ROUGH2, |(_, rough2)| rough2), ..*noise }
}

/// Squares of 1, 2, 3, 4, 5, 6, 8, 10, 12, 14, 17 and 20 mm.
const ROUGHNESSES: [u32; 12] = {
    const fn square(mm: i32) -> u32 {
        (millimetres(mm) * millimetres(mm)) as u32
    }
    [
        square(1),
        square(2),
        square(3),
        square(4),
        square(5),
        square(6),
        square(8),
        square(10),
        square(12),
        square(14),
        square(17),
        square(20),
    ]
};

/// The fit of a slope whose residuals are undulations, which neighbours share. Most of what they do to the line is in the slope of the whole ground too; what
/// is not, as samples lie closer near the sensor, made the errors of simulated slopes one and a half times those of independent residuals. At
/// its ends the ground is off the line by the undulations themselves.
fn uneven(fitted: Fit, noise: &Noise) -> Fit {
    let slope = fitted.slope_variance().times(Magnitude::new(9, -2));
    let height = fitted.height_variance().plus(Magnitude::new(u64::from(noise.rough2), 0));
    Fit { precision: Precision::Variances { slope, height }, ..fitted }
}

/// What is more than undulation: beyond 20 mm squared about the best line it is two slopes.
const HILLS: u32 = UNDULATION * UNDULATION;

/// So much further than its run the ground must be followed: less is a hinge taken in.
const GAINED: i32 = millimetres(600);

/// What a sample of the ground earns in the mean: less is vegetation.
const GROUND_SCORE: i32 = 130;

/// Height of undulations that still make one slope, one sigma, in grains.
const UNDULATION: u32 = millimetres(20) as u32;

/// A roughness below a line that is undulation: 3 mm squared.
const UNDULATES: u32 = (millimetres(3) * millimetres(3)) as u32;

impl Found {
    /// Fits again over the samples between two places: the ends of a run lean on its own residuals, those of the hinges
    /// do not, so that no sample is chosen for lying where the line wants it. Whether the line has moved, so that its hinges have.
    pub fn settle(&mut self, samples: &mut [Sample], start: &Place, end: &Place, noise: &Noise) -> bool {
        let slope_q30 = self.fit.line.slope_q30;
        let first = inward_of(samples, self.fit.line.place_at(start.u));
        let past = inward_of(samples, self.fit.line.place_at(end.u));
        let gate = if self.grown { Gate::GROWN } else { Gate::BARE };
        if let Some(part) = samples.get_mut(first..past)
            && let Some(fit) = refit(part, &self.fit.line, noise, gate)
            && fit.count >= LEAST_SAMPLES.min(self.fit.count)
        {
            self.fit = if self.undulates { uneven(fit, noise) } else { fit };
        }
        // Twice as wide for each reason to think that another line is the ground: among what lies off this one, one that fits almost as well; and
        // most samples not on this one.
        let (on, all) = (self.fit.count as usize, past.saturating_sub(first));
        let doubts = u32::from(self.contested && 8 * on < 7 * all) + u32::from(2 * on < all);
        let share_q8 = samples.get((first + past) / 2).map_or(0, |middle| {
            ((u64::from(noise.rough2) << 8) / u64::from(noise.variance(middle, self.fit.line.slope_q14()).max(1)))
                as u32
        });
        self.half_q30 = interval(&self.fit, share_q8).saturating_mul(1 << doubts);
        slope_q30.abs_diff(self.fit.line.slope_q30) > MOVED_Q30
    }
}

/// A slope that has turned by more than this, about 0.06 degrees, has moved.
const MOVED_Q30: u32 = 1 << 20;

/// A step with weights of the present noise.
fn refit(part: &mut [Sample], line: &Line, noise: &Noise, gate: Gate) -> Option<Fit> {
    let shift = weigh(part, 1, noise, line.slope_q14());
    fit(part, 1, line, shift, gate)
}

/// The noise with a roughness that explains the residuals of a fit.
fn roughened(noise: &Noise, fitted: &Fit, part: &[Sample]) -> Noise {
    let Some(middle) = part.get(part.len() / 2) else { return *noise };
    let ratio_q10 = fitted.ratio_q10(ROUGHNESS_PRIOR);
    let assumed = noise.variance(middle, fitted.line.slope_q14());
    let explained = (u64::from(assumed) * u64::from(ratio_q10)) >> 10;
    let rough2 = (u64::from(noise.rough2) + explained).saturating_sub(u64::from(assumed));
    let rough2 = rough2.clamp(u64::from(Noise::MIN_ROUGH2), u64::from(Noise::MAX_ROUGH2)) as u32;
    Noise { rough2, ..*noise }
}

/// Half width of the 95 % interval of a slope, 30 fraction bits, of a fit whose samples owe `share_q8` of their variance to roughness.
fn interval(fitted: &Fit, share_q8: u32) -> u32 {
    // The residuals that tell a roughness have chosen the hinges too: where all is roughness the variance is a sixth more than they say
    // (simulated slopes on surfaces rough by 2 and 5 mm).
    let scale = u64::from(fitted.ratio_q10(INTERVAL_PRIOR)) * u64::from(6 * 256 + share_q8) / 6;
    let scale = Magnitude::new(scale, -18);
    // Student's t at 97.5 %: 1.96 + 2.37 / n + 2.8 / n^2, good to 1 % from 5 degrees of freedom on.
    let freedom = u64::from((fitted.effective_q8 >> 8).saturating_sub(2) + INTERVAL_PRIOR).max(1);
    let t_q10 = 2007 + 2427 / freedom + 2867 / (freedom * freedom);
    let half = fitted.slope_variance().times(scale).root().times(Magnitude::new(t_q10, -10));
    half.scaled(30)
}

/// Whether beams are missing among samples, as behind a rail.
fn shaded(samples: &[Sample]) -> bool {
    samples.windows(2).any(|pair| matches!(pair, [a, b] if b.beam.abs_diff(a.beam) > SHADOW_BEAMS))
}

/// Whether nothing stands on samples or hides them: fewer than three are beyond the obstruction distance, and no beams are missing.
fn clear(samples: &[Sample], line: &Line, obstruction: i32) -> bool {
    samples.iter().filter(|s| line.residual(s).abs() > obstruction).count() < 3 && !shaded(samples)
}

/// Flags from the samples between the ends of a slope.
fn marks(part: &[Sample], found: &Found, noise: &Noise, obstruction: i32) -> u16 {
    let line = &found.fit.line;
    let (mut above, mut on) = (0u32, 0u32);
    for sample in part {
        let e = line.residual(sample);
        if e.abs() > obstruction {
            continue;
        }
        if (e * e) as u32 / 12 < noise.variance(sample, line.slope_q14()) {
            on += 1;
        } else if e > 0 {
            above += 1;
        }
    }
    let count = part.len() as u32;
    let mut marks = 0;
    if 8 * above > count {
        marks |= flags::VEGETATION;
    }
    if !clear(part, line, obstruction) {
        marks |= flags::OBSTRUCTED;
    }
    // Too few of what is there agrees, or too little is there to tell a slope from chance.
    if 20 * on < 11 * count || found.unclear || found.fit.count < 6 || found.half_q30 > DOUBTFUL_HALF_Q30 {
        marks |= flags::DOUBTFUL;
    }
    marks
}

/// This many beams in a row without a return on a slope are a shadow rather than chance.
const SHADOW_BEAMS: u16 = 6;

/// An interval wider than +/-0.5 degrees, ...
const DOUBTFUL_HALF_Q30: u32 = 9_370_000;

/// ... and one wider than +/-0.7 degrees.
const UNTOLD_HALF_Q30: u32 = 13_118_000;

impl Found {
    /// The slope as it is reported.
    pub fn message(&self, outward: Outward, start: &Place, end: &Place) -> Slope {
        let slope_q30 = self.fit.line.slope_q30;
        let angle = trig::slope_angle(slope_q30);
        let cosine = trig::direction(angle).cos_q30.max(1);
        // d(angle) = d(slope) cos^2, and 2^30 units of slope are 2^32 / (2 pi) units of angle: 4 / (2 pi).
        const UNITS_Q32: u64 = 2_734_261_102;
        let cos2_q30 = (i64::from(cosine) * i64::from(cosine)) as u64 >> 30;
        let flat = (u64::from(self.half_q30) * UNITS_Q32) >> 32;
        let ci95 = ((flat * cos2_q30) >> 30).min(1 << 30) as i32;
        let run_um = i64::from(end.u.abs_diff(start.u)) << GRAIN_BITS;
        Slope {
            angle,
            ci95: Angle(ci95),
            length_um: ((run_um << 30) / i64::from(cosine)).min(i64::from(i32::MAX)) as i32,
            points: self.fit.count as u16,
            start: start.message(outward),
            end: end.message(outward),
        }
    }

    /// Whether its samples tell the slope: by an interval that leaves of slopes of 4 to 10 degrees more than which way they fall.
    pub fn is_told(&self) -> bool {
        self.half_q30 <= UNTOLD_HALF_Q30
    }

    /// Whether slope and length, from hinge to hinge, are within the limits: by their best estimates, give or take their intervals.
    pub fn within(&self, start: &Place, end: &Place, wanted: &Wanted) -> bool {
        let slope_q14 = self.fit.line.slope_q14();
        let half_q14 = (self.half_q30.min(1 << 28) >> 16) as i32;
        let run = end.u - start.u;
        let doubt = (start.half.max(end.half)).min(1 << 15) as i32;
        let least = wanted.least_q14 + super::SLACK_Q14 - half_q14;
        let most = wanted.most_q14 - super::SLACK_Q14 + half_q14;
        (least..=most).contains(&slope_q14) && (wanted.shortest - doubt..=wanted.longest + doubt).contains(&run)
    }

    /// Flags that concern this slope between its ends.
    pub fn marks(&self, samples: &[Sample], start: &Place, end: &Place, noise: &Noise, obstruction: i32) -> u16 {
        let first = inward_of(samples, self.fit.line.place_at(start.u));
        let past = inward_of(samples, self.fit.line.place_at(end.u));
        marks(samples.get(first..past).unwrap_or_default(), self, noise, obstruction)
    }
}
