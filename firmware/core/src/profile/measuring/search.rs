//! The search for a slope: candidate lines through pairs of anchors, judged by their best contiguous run.
//!
//! Anchors are the lowest of every three samples, because vegetation only raises returns. A run is the stretch of samples
//! that scores highest (the maximum subarray): a sample on the line earns up to 288, one above it costs little, one
//! below it much, and three in a row beyond the obstruction distance end the run. So a run decides its own ends. All candidates
//! are scored on the anchors, the best few on all samples.

use heapless::Vec;

use super::line::Line;
use super::sample::{Noise, Sample, millimetres};
use crate::scan::MAX_BEAMS;

/// Samples an anchor stands for.
const GROUP: usize = 3;

/// Anchors of one side.
pub type Anchors = Vec<Sample, { MAX_BEAMS / GROUP + 1 }>;

/// The first anchor lies within this of where the search starts.
const START_REACH: i32 = millimetres(4_500);

/// Shortest distance between the two anchors of a candidate.
const MIN_BASE: i32 = millimetres(1_200);

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

/// Fills `anchors` with the lowest of each group of samples above a line that slopes as what is wanted: on a slope seen
/// from far, neighbours differ more in height than vegetation raises them.
fn choose(samples: &[Sample], wanted: &Wanted, anchors: &mut Anchors) {
    anchors.clear();
    let typical_q14 = (wanted.least_q14 + wanted.most_q14) / 2;
    for group in samples.chunks(GROUP) {
        // |u| < 2^22 grains and the slope is below 2^15: 64 bits are needed.
        let height = |s: &&Sample| s.z - ((i64::from(s.u) * i64::from(typical_q14)) >> 14) as i32;
        if let Some(lowest) = group.iter().min_by_key(height) {
            let _ = anchors.push(*lowest);
        }
    }
}

/// The best line among the candidates and its run over `samples`, of which the first is where the search starts.
pub fn find(samples: &[Sample], anchors: &mut Anchors, wanted: &Wanted, noise: &Noise) -> Option<(Line, Run)> {
    choose(samples, wanted, anchors);
    let start = anchors.first()?.u;
    let mut finalists = [(Line::default(), 0i32); FINALISTS];
    // The last anchor of a run so good that starting within it would only find it again.
    let mut settled = 0;
    for (i, a) in anchors.iter().enumerate() {
        if a.u > start + START_REACH {
            break;
        }
        if i < settled {
            continue;
        }
        let along = anchors.get(i..).unwrap_or_default();
        for b in along.iter().skip(1) {
            let base = b.u - a.u;
            if base < MIN_BASE {
                continue;
            }
            if base > wanted.longest {
                break;
            }
            // 14 fraction bits: 0.6 mm over 10 m. Within 2^17 units of 8 grains the dividend stays below 2^31.
            let rise = ((b.z - a.z) >> 3).clamp(-(1 << 16), 1 << 16);
            let slope_q14 = (rise << 14) / (base >> 3).max(1);
            if slope_q14 < wanted.least_q14 || slope_q14 > wanted.most_q14 {
                continue;
            }
            let line = Line { u: a.u, z: a.z, slope_q30: slope_q14 << 16 };
            let found = run(along, &line, wanted, noise, true);
            let score = found.score;
            let span = (found.last - found.first) as i32 + 1;
            if span >= 5 && score > span * SETTLED_SCORE {
                settled = settled.max(i + found.last);
            }
            let Some(last) = finalists.last_mut() else { continue };
            if score > last.1 {
                *last = (line, score);
                // Insertion into the short list, best first; equal scores keep their order.
                for k in (1..FINALISTS).rev() {
                    if let Some([upper, lower]) = finalists.get_mut(k - 1..=k) {
                        if lower.1 > upper.1 {
                            core::mem::swap(upper, lower);
                        }
                    }
                }
            }
        }
    }
    let mut best: Option<(Line, Run)> = None;
    for (line, score) in finalists {
        if score > 0 {
            let run = run(samples, &line, wanted, noise, false);
            if best.is_none_or(|(_, known)| run.score > known.score) {
                best = Some((line, run));
            }
        }
    }
    best
}

/// A run that earns this much a sample is what there is to find along its line.
const SETTLED_SCORE: i32 = 230;

/// An anchored run begins with the first sample, and is over when it has lost this much.
const DROP: i32 = 600;

/// The best contiguous run of samples along a line.
pub fn run(samples: &[Sample], line: &Line, wanted: &Wanted, noise: &Noise, anchored: bool) -> Run {
    let slope_q14 = line.slope_q14();
    let (mut best, mut current) = (Run::default(), Run::default());
    let mut astray = 0;
    for (index, sample) in samples.iter().enumerate() {
        let e = line.residual(sample);
        let earned = if e.abs() > wanted.obstruction {
            astray += 1;
            if astray == 3 && best.score > 0 {
                break;
            }
            -144
        } else {
            astray = 0;
            let variance = noise.variance(sample, slope_q14);
            // The obstruction distance is below 2^15 grains: the square fits.
            let square = (e * e) as u32;
            if square < 9 * variance {
                288 - (square / (variance >> 5).max(1)) as i32
            } else if e > 0 {
                -43
            } else {
                -173
            }
        };
        if anchored {
            if current.score < best.score - DROP {
                break;
            }
        } else if current.score <= 0 {
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
