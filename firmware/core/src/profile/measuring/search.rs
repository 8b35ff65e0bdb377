//! The search for a slope: candidate lines through pairs of anchors, judged by their best contiguous run.
//!
//! Anchors are the lowest of every three samples, because vegetation only raises returns. A run is the stretch of samples
//! that scores highest (the maximum subarray): a sample on the line earns up to 288, one above it costs little, one
//! below it much, and three in a row beyond the obstruction distance end the run. So a run decides its own ends. All candidates
//! are scored on the anchors, the best few on all samples.

use super::line::{Line, fit, weigh};
use super::sample::{Noise, Sample, millimetres};

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
pub fn find(samples: &mut [Sample], start: i32, wanted: &Wanted, noise: &Noise) -> Option<(Line, Run)> {
    let mut finalists = [(Line::default(), 0i32); FINALISTS];
    // Where nothing grows every second start finds what all would; in vegetation every one may be the good one.
    let overgrown = 16 * mark_raised(samples, wanted) > samples.len();
    let stride = if overgrown { 1 } else { 2 };
    // Starting within a good run would mostly find it again: past `settled` and `thinned` all and every third start counts.
    let (mut settled, mut thinned) = (0, 0);
    for (i, a) in samples.iter().enumerate() {
        // A stray may lie anywhere: it does not end the search.
        let skipped = i < settled || (i < thinned && i % 3 != 0) || i % stride != 0;
        if skipped || a.u < start || a.u > start + START_REACH || a.weight == RAISED {
            continue;
        }
        let along = samples.get(i..).unwrap_or_default();
        let mut outer = along.iter();
        for base in BASES {
            let Some(b) = outer.find(|b| b.u - a.u >= base) else { break };
            let base = b.u - a.u;
            if base > wanted.longest {
                break;
            }
            if b.weight == RAISED {
                continue;
            }
            // 14 fraction bits: 0.6 mm over 10 m. Within 2^17 units of 8 grains the dividend stays below 2^31.
            let rise = ((b.z - a.z) >> 3).clamp(-(1 << 16), 1 << 16);
            let slope_q14 = (rise << 14) / (base >> 3).max(1);
            if slope_q14 < wanted.least_q14 || slope_q14 > wanted.most_q14 {
                continue;
            }
            let line = Line { u: a.u, z: a.z, slope_q30: slope_q14 << 16 };
            // Less than half of the best is not worth following to the end.
            let weakest = finalists.last().map_or(0, |f| f.1).max(finalists.first().map_or(0, |f| f.1) / 2);
            let found = run_from(along, &line, wanted, noise, weakest);
            let span = (found.last - found.first) as i32 + 1;
            if span >= 10 && found.score > span * THINNED_SCORE {
                thinned = thinned.max(i + found.last);
                if found.score > span * SETTLED_SCORE {
                    settled = thinned;
                }
            }
            admit(&mut finalists, line, b.u, found.score);
        }
    }
    let mut best: Option<(Line, Run)> = None;
    for (line, score) in finalists {
        if score > 0 {
            let Some((line, run)) = grow(samples, &line, wanted, noise) else { continue };
            if best.is_none_or(|(_, known)| run.score > known.score) {
                best = Some((line, run));
            }
        }
    }
    best
}

/// Marks the samples that stand above both of their neighbours: vegetation, no part of a candidate. Heights count from a
/// line that slopes as what is wanted, so that on any line each sample lies between its neighbours. Says how many there are.
fn mark_raised(samples: &mut [Sample], wanted: &Wanted) -> usize {
    let typical_q14 = (wanted.least_q14 + wanted.most_q14) / 2;
    // |u| < 2^22 grains and the slope below 2^15: a shift of 6 keeps the product in 32 bits.
    let height = |s: &Sample| s.z - (((s.u >> 6) * typical_q14) >> 8);
    let (mut before, mut here) = (i32::MAX >> 1, i32::MAX >> 1);
    let mut last: Option<&mut Sample> = None;
    let mut count = 0;
    for sample in samples {
        let after = height(sample);
        sample.weight = 0;
        if let Some(last) = last
            && here > before.max(after) + PROTRUSION
        {
            last.weight = RAISED;
            count += 1;
        }
        (before, here) = (here, after);
        last = Some(sample);
    }
    count
}

/// Mark of a raised sample, in the place of a weight that no fit has set yet.
const RAISED: u16 = u16::MAX;

/// How far above its neighbours a sample must stand to be taken for raised.
const PROTRUSION: i32 = millimetres(12);

/// Puts a candidate among the finalists if it is good enough. Of candidates that tell the same story - within 15 mm at
/// both anchors - only the best stays, so that the others can be different ones.
fn admit(finalists: &mut [(Line, i32); FINALISTS], line: Line, outer: i32, score: i32) {
    let same = |other: &Line| {
        let apart = |u: i32| (other.height_at(u) - line.height_at(u)).abs();
        apart(line.u) < millimetres(15) && apart(outer) < millimetres(15)
    };
    let weakest = FINALISTS - 1;
    let place = finalists.iter().position(|(other, known)| *known > 0 && same(other)).unwrap_or(weakest);
    let Some(held) = finalists.get_mut(place) else { return };
    if score <= held.1 {
        return;
    }
    *held = (line, score);
    // Best first; equal scores keep their order.
    for k in (1..=place).rev() {
        if let Some([upper, lower]) = finalists.get_mut(k - 1..=k)
            && lower.1 > upper.1
        {
            core::mem::swap(upper, lower);
        }
    }
}

/// A candidate's run on all samples, a fit to it, and the run of that.
fn grow(samples: &mut [Sample], line: &Line, wanted: &Wanted, noise: &Noise) -> Option<(Line, Run)> {
    let first = run(samples, line, wanted, noise);
    let part = samples.get_mut(first.first..=first.last)?;
    let shift = weigh(part, 1, noise, line.slope_q14());
    let once = fit(part, 1, line, shift)?.line;
    let grown = run(samples, &once, wanted, noise);
    Some(if grown.score > first.score { (once, grown) } else { (*line, first) })
}

/// A run that earns this much a sample is what there is to find along its line ...
const SETTLED_SCORE: i32 = 230;
/// ... and one that earns this much may still be a mixture of slope and vegetation.
const THINNED_SCORE: i32 = 130;

/// A run that begins with the first sample is over when it has lost this much.
const DROP: i32 = 450;

/// What a sample earns for a line; nothing when it lies beyond the obstruction distance.
#[inline(always)]
fn earned(sample: &Sample, line: &Line, slope_q14: i32, wanted: &Wanted, noise: &Noise) -> Option<i32> {
    let e = line.residual(sample);
    if e.abs() > wanted.obstruction {
        return None;
    }
    let variance = noise.variance(sample, slope_q14);
    // The obstruction distance is below 2^15 grains: the square fits.
    let square = (e * e) as u32;
    Some(if square < 9 * variance {
        288 - (square / (variance >> 5).max(1)) as i32
    } else if e > 0 {
        -43
    } else {
        -173
    })
}

/// The best run that begins with the first sample. Given up once it can no longer score more than `least`.
fn run_from(samples: &[Sample], line: &Line, wanted: &Wanted, noise: &Noise, least: i32) -> Run {
    let slope_q14 = line.slope_q14();
    let (mut best, mut score, mut astray) = (Run::default(), 0, 0);
    let mut remaining = samples.len() as i32;
    for (index, sample) in samples.iter().enumerate() {
        match earned(sample, line, slope_q14, wanted, noise) {
            Some(earned) => {
                astray = 0;
                score += earned;
            }
            None => {
                astray += 1;
                score -= 144;
            }
        }
        remaining -= 1;
        if score > best.score {
            best = Run { first: 0, last: index, score };
        } else if astray == 3 || score < best.score - DROP || score + 288 * remaining <= least {
            break;
        }
    }
    best
}

/// The best contiguous run of samples along a line.
pub fn run(samples: &[Sample], line: &Line, wanted: &Wanted, noise: &Noise) -> Run {
    let slope_q14 = line.slope_q14();
    let (mut best, mut current) = (Run::default(), Run::default());
    let mut astray = 0;
    for (index, sample) in samples.iter().enumerate() {
        let earned = match earned(sample, line, slope_q14, wanted, noise) {
            Some(earned) => {
                astray = 0;
                earned
            }
            None => {
                astray += 1;
                if astray == 3 && best.score > 0 {
                    break;
                }
                -144
            }
        };
        if current.score <= 0 {
            current = Run { first: index, last: index, score: 0 };
        }
        current.score += earned;
        if current.score > best.score {
            current.last = index;
            best = current;
        }
    }
    best
}
