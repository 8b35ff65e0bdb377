//! The search for a slope: candidate lines through pairs of anchors, judged by their best contiguous run.
//!
//! Anchors are the lowest of every three samples, because vegetation only raises returns. A run is the stretch of samples
//! that scores highest (the maximum subarray): a sample on the line earns up to 288, one above it costs little, one
//! below it much, and three in a row beyond the obstruction distance end the run. So a run decides its own ends. All candidates
//! are scored on the anchors, the best few on all samples.

use core::hint::select_unpredictable;

use super::line::{Line, ratio, weigh};
use super::sample::{Noise, Sample, millimetres};
use crate::scan::MAX_BEAMS;

/// The first anchor lies within this of where the search starts.
const START_REACH: i32 = millimetres(4_500);

/// Distances between the two samples of a candidate: at least these, a factor of 1.5 apart, so that for a slope of any
/// length some pairs span half of it and more.
const BASES: [i32; 5] =
    [millimetres(1_100), millimetres(1_700), millimetres(2_500), millimetres(3_800), millimetres(5_700)];

/// Candidates that are scored on all samples.
const FINALISTS: usize = 3;

/// What a search may find.
#[derive(Clone, Copy, Debug)]
pub struct Wanted {
    /// Range of slopes, 14 fraction bits, inclusive.
    pub least_q14: i32,
    pub most_q14: i32,
    /// Shortest and longest run, in grains outward.
    pub shortest: i32,
    pub longest: i32,
    /// Distance from the line beyond which a sample obstructs it.
    pub obstruction: i32,
}

/// A stretch of samples, both ends included.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Run {
    pub first: usize,
    pub last: usize,
    pub score: i32,
}

/// The best line among the candidates, which begin at `start` or beyond, and its run over `samples`.
pub fn find(samples: &mut [Sample], start: i32, wanted: &Wanted, noise: &Noise) -> Option<Best> {
    let mut finalists = [Candidate::default(); FINALISTS];
    // Candidates are told apart with the variances of a typical slope: those of their own would cost more than they tell.
    let typical_q14 = (wanted.least_q14 + wanted.most_q14) / 2;
    let raised = Raised::among(samples, typical_q14);
    weigh(samples, 1, noise, typical_q14);
    // Where nothing grows every second start finds what all would; in vegetation every one may be the good one.
    let stride = if raised.count > 0 { 1 } else { 2 };
    // Starting within a good run would mostly find it again: past `settled` and `thinned` all and every third start counts.
    let (mut settled, mut thinned) = (0, 0);
    let mut next = 0;
    let mut ends = Ends { start: i32::MAX, places: [0; BASES.len()] };
    while let Some(along) = samples.get(next..) {
        let (i, Some(a)) = (next, along.first()) else { break };
        next = (next + stride).max(settled);
        // A stray may lie anywhere: it does not end the search.
        if (i < thinned && i % 3 != 0) || a.u < start || a.u > start + START_REACH || raised.holds(i) {
            continue;
        }
        ends.move_to(samples, i, a.u);
        // The widest first: the surest of its slope, it may make the others needless.
        for end in ends.places.into_iter().rev() {
            let Some(b) = samples.get(end) else { continue };
            let base = b.u - a.u;
            if base > wanted.longest || raised.holds(end) {
                continue;
            }
            // 14 fraction bits: 0.6 mm over 10 m. Within 2^17 units of 8 grains the dividend stays below 2^31.
            let rise = ((b.z - a.z) >> 3).clamp(-(1 << 16), 1 << 16);
            let slope_q14 = (rise << 14) / (base >> 3).max(1);
            if slope_q14 < wanted.least_q14 || slope_q14 > wanted.most_q14 {
                continue;
            }
            let line = Line { u: a.u, z: a.z, slope_q30: slope_q14 << 16 };
            if undercut(samples.get(i..end).unwrap_or_default(), &line) {
                continue;
            }
            let (span, score) = follow(along.iter(), &line, wanted.obstruction);
            admit(&mut finalists, Candidate { line, middle: i + span / 2, score }, b.u);
            if span >= 10 && score > span as i32 * THINNED_SCORE {
                thinned = thinned.max(i + span - 1);
                if score > span as i32 * SETTLED_SCORE {
                    settled = thinned;
                    next = next.max(settled);
                    break;
                }
            }
        }
    }
    let leading = finalists.first().map_or(0, |f| f.score);
    let mut followed = [(Line::default(), Run::default()); FINALISTS];
    for (known, candidate) in followed.iter_mut().zip(finalists).filter(|(_, c)| c.score > 0 && 2 * c.score >= leading)
    {
        *known = (candidate.line, run(samples, candidate.middle, &candidate.line, wanted.obstruction));
    }
    let (line, run) =
        followed.into_iter().reduce(|best, next| if next.1.score > best.1.score { next } else { best })?;
    let rivals = |(other, along): &(Line, Run)| {
        5 * along.score >= 4 * run.score && other.slope_q30.abs_diff(line.slope_q30) > RIVAL_TURN_Q30
    };
    (run.score > 0).then(|| Best { line, run, contested: followed.iter().any(rivals) })
}

/// Where the bases of a candidate end, shortest first: for each the first sample past the one before that is at least so far out.
struct Ends {
    /// Where they start, outward.
    start: i32,
    places: [usize; BASES.len()],
}

impl Ends {
    /// For bases that start at `start` with sample `first`, further on than before: unless that is nearer, none of them ends earlier.
    fn move_to(&mut self, samples: &[Sample], first: usize, start: i32) {
        let nearer = start < self.start;
        self.start = start;
        let mut least = first;
        for (place, base) in self.places.iter_mut().zip(BASES) {
            let mut at = if nearer { least } else { least.max(*place) };
            while samples.get(at).is_some_and(|s| s.u - start < base) {
                at += 1;
            }
            *place = at;
            least = at + 1;
        }
    }
}

/// What a search finds.
#[derive(Clone, Copy, Debug)]
pub struct Best {
    pub line: Line,
    pub run: Run,
    /// Whether a line that differs by more than [`RIVAL_TURN_Q30`] earns four fifths of it: which of them is the ground is not known for sure.
    pub contested: bool,
}

/// One degree.
const RIVAL_TURN_Q30: u32 = 18_740_000;

/// A line through two samples, the middle of the run that begins with the first of them, and what that run scores.
#[derive(Clone, Copy, Default)]
struct Candidate {
    line: Line,
    middle: usize,
    score: i32,
}

/// The samples that stand above both of their neighbours: vegetation, no part of a candidate.
struct Raised {
    marks: [u32; MAX_BEAMS.div_ceil(32)],
    count: usize,
}

impl Raised {
    /// Heights count from a line that slopes as what is wanted, so that on any line each sample lies between its neighbours.
    fn among(samples: &[Sample], typical_q14: i32) -> Self {
        let mut raised = Self { marks: [0; MAX_BEAMS.div_ceil(32)], count: 0 };
        // |u| < 2^22 grains and the slope below 2^15: a shift of 6 keeps the product in 32 bits.
        let height = |s: &Sample| s.z - (((s.u >> 6) * typical_q14) >> 8);
        let (mut before, mut here) = (i32::MAX >> 1, i32::MAX >> 1);
        for (next, sample) in samples.iter().enumerate() {
            let after = height(sample);
            // The first round has nothing before it: its `here` is a border that never stands out.
            if here > before.max(after) + PROTRUSION && next > 0 {
                let index = next - 1;
                if let Some(word) = raised.marks.get_mut(index / 32) {
                    *word |= 1 << (index % 32);
                    raised.count += 1;
                }
            }
            (before, here) = (here, after);
        }
        raised
    }

    fn holds(&self, index: usize) -> bool {
        self.marks.get(index / 32).is_some_and(|word| word >> (index % 32) & 1 == 1)
    }
}

/// How far above its neighbours a sample must stand to be taken for raised.
const PROTRUSION: i32 = millimetres(12);

/// Puts a candidate, whose outer anchor lies at `outer`, among the finalists if it is good enough. Of candidates that tell the
/// same story - within 15 mm at both anchors - only the best stays, so that the others can be different ones.
fn admit(finalists: &mut [Candidate; FINALISTS], candidate: Candidate, outer: i32) {
    let same = |other: &Line| {
        let apart = |u: i32| (other.height_at(u) - candidate.line.height_at(u)).abs();
        apart(candidate.line.u) < millimetres(15) && apart(outer) < millimetres(15)
    };
    let weakest = FINALISTS - 1;
    if finalists.last().is_some_and(|held| candidate.score <= held.score) {
        return;
    }
    let place = finalists.iter().position(|other| other.score > 0 && same(&other.line)).unwrap_or(weakest);
    let Some(held) = finalists.get_mut(place) else { return };
    if candidate.score <= held.score {
        return;
    }
    *held = candidate;
    // Best first; equal scores keep their order.
    for k in (1..=place).rev() {
        if let Some([upper, lower]) = finalists.get_mut(k - 1..=k)
            && lower.score > upper.score
        {
            core::mem::swap(upper, lower);
        }
    }
}

/// A run that earns this much a sample is what there is to find along its line ...
const SETTLED_SCORE: i32 = 204;
/// ... and one that earns this much may still be a mixture of slope and vegetation.
const THINNED_SCORE: i32 = 130;

/// A run is over when it has lost this much: three samples in a row beyond the obstruction distance, or as much otherwise.
const DROP: i32 = 430;

/// What a sample earns on a line: 288 less 32 a variance.
const EARNED: u32 = 288;
const ABOVE_COSTS: i32 = 43;
const BELOW_COSTS: i32 = 288;
/// What a sample beyond the obstruction distance costs.
const ASTRAY_COSTS: i32 = 144;

/// What a weighed sample earns for a line; the obstruction distance is below 2^15 grains.
///
/// Whether a sample lies on the line, and on which side of it, cannot be predicted in vegetation: no branch depends on it.
#[inline(always)]
fn earned(sample: &Sample, line: &Line, obstruction: i32) -> i32 {
    let e = line.residual(sample);
    // The square of a residual beyond the obstruction distance may wrap: it is not looked at.
    let spent = ratio::<5>(sample, e.wrapping_mul(e) as u32);
    let lost = BELOW_COSTS - ((-e >> 31) & (BELOW_COSTS - ABOVE_COSTS));
    let near = select_unpredictable(spent < EARNED, EARNED.wrapping_sub(spent) as i32, -lost);
    // As one comparison: a residual below -obstruction wraps.
    select_unpredictable(e.wrapping_add(obstruction) as u32 > 2 * obstruction as u32, -ASTRAY_COSTS, near)
}

/// Whether one of three samples, spread evenly over those between the two of a candidate, lies well below the line: nothing grows downward, so
/// the line does not follow the ground there.
#[inline(always)]
fn undercut(between: &[Sample], line: &Line) -> bool {
    let quarter = between.len() / 4;
    [quarter, 2 * quarter, 3 * quarter].iter().filter_map(|k| between.get(*k)).any(|sample| {
        let e = line.residual(sample);
        e < 0 && (e < -(1 << 15) || ratio::<5>(sample, (e * e) as u32) > UNDERCUT)
    })
}

/// How many variances, times 32, a sample must lie below a candidate to rule it out.
const UNDERCUT: u32 = 32 * 12;

/// How many samples the best run has that begins with the first of these, and what it earns.
///
/// Not inlined: among the variables of a search its own would not stay in registers.
#[inline(never)]
fn follow<'a>(samples: impl Iterator<Item = &'a Sample>, line: &Line, obstruction: i32) -> (usize, i32) {
    let (mut span, mut best, mut score) = (0, 0, 0);
    for (before, sample) in samples.enumerate() {
        score += earned(sample, line, obstruction);
        let better = score > best;
        span = select_unpredictable(better, before + 1, span);
        best = select_unpredictable(better, score, best);
        if score < best - DROP {
            break;
        }
    }
    (span, best)
}

/// The best run that holds the sample `middle`, along a line by whose slope [`weigh`] has weighed the samples.
pub fn run(samples: &[Sample], middle: usize, line: &Line, obstruction: i32) -> Run {
    let Some((inner, outer)) = samples.split_at_checked(middle) else { return Run::default() };
    let (out, outward) = follow(outer.iter(), line, obstruction);
    let (back, inward) = follow(inner.iter().rev(), line, obstruction);
    Run { first: middle - back, last: (middle + out).saturating_sub(1), score: outward + inward }
}

/// Whether the ground goes on along a line beyond the inner and beyond the outer end of its run, and outward of `start`: most of the samples from so far
/// past it on are nearer to the line than level ground would be, had it begun there.
pub fn goes_on(samples: &[Sample], start: i32, line: &Line, run: &Run) -> (bool, bool) {
    let (inner, outer) =
        (samples.get(..run.first).unwrap_or_default(), samples.get(run.last + 1..).unwrap_or_default());
    let (from, to) = (samples.get(run.first).map_or(0, |s| s.u), samples.get(run.last).map_or(0, |s| s.u));
    let fall_q14 = line.slope_q14().abs();
    let near = |sample: &&Sample, end: i32| {
        // Below 2^15 x 2^11.
        let level = (((sample.u - end).abs() >> 4).min(1 << 15) * (fall_q14 >> 4)) >> 6;
        line.residual(sample).abs() < NEARBY + level / 3
    };
    let inward = inner.iter().rev().skip_while(|s| s.u > from - PAST).take_while(|s| s.u > start + SHOULDER);
    let outward = outer.iter().skip_while(|s| s.u < to + PAST);
    (
        inward.take(LOOKED_AT).filter(|s| near(s, from)).count() >= MOST,
        outward.take(LOOKED_AT).filter(|s| near(s, to)).count() >= MOST,
    )
}

/// The samples up to a run's outer end and those past it that [`goes_on`] looks at.
pub fn up_to<'a>(samples: &'a [Sample], run: &Run) -> &'a [Sample] {
    let to = samples.get(run.last).map_or(0, |s| s.u) + PAST;
    let past = samples.iter().skip(run.last).take_while(|s| s.u < to).count();
    samples.get(..(run.last + past + LOOKED_AT).min(samples.len())).unwrap_or_default()
}

/// So far past an end, ...
const PAST: i32 = millimetres(1_000);
/// ... so near the line and a third of what level ground would be off it, ...
const NEARBY: i32 = millimetres(40);
/// ... lie so many of so many samples.
const MOST: usize = 4;
const LOOKED_AT: usize = 6;
/// What precedes may reach so far beyond where a search starts.
pub const SHOULDER: i32 = millimetres(400);
