//! The road: a line under the sensor, followed outward to where the surface leaves it.

use super::line::{Fit, Gate, Line, Sums, fit, weigh, weigh_by};
use super::sample::{Noise, Sample, inward_of, millimetres};

/// How far on the other side of the sensor the road line still takes its points: short of a crown between lanes.
pub const INNER: i32 = millimetres(1_000);

/// The first piece of road reaches this far out; each further one twice as far as the one before, with its line.
const FIRST_REACH: i32 = millimetres(1_200);

/// Until the road's end is known, every fifth sample is enough to follow it.
const THINNING: usize = 5;

/// every second one tells where it ends and how noisy it is; all of them count once the edge is known.
const MEASURING: usize = 2;

/// A departure is this many samples in a row beyond the threshold.
const DEPARTURE_SAMPLES: u32 = 4;

/// The fit ends this far before a departure, whose onset the threshold hides.
const MARGIN: i32 = millimetres(350);

/// Whether the ground rises from the road is seen between so much beyond its end, where a slope that falls has done so, and so much, ...
const SILL: i32 = millimetres(500);
const VERGE: i32 = millimetres(2_000);
/// ... by samples so far above its line, which vegetation on level ground mostly is not, ...
const RISEN: i32 = millimetres(20);
/// ... and no further: rails are taller, slopes of 12 degrees are not.
const TALLEST: i32 = millimetres(400);

/// A road of which fewer samples than this are seen is none.
const MIN_SAMPLES: u32 = 12;

/// Pseudo-observations that the assumed range noise counts for against the road's own residuals.
const PRIOR: u32 = 24;

/// The road line of one side.
#[derive(Clone, Copy, Debug)]
pub struct Road {
    pub fit: Fit,
    /// Where it is left; nothing when it is not.
    pub departure: Option<Departure>,
    /// The noise with its range part brought up to date.
    pub noise: Noise,
}

/// Where the surface leaves the road's line.
#[derive(Clone, Copy, Debug, Default)]
pub struct Departure {
    /// Index of the first sample.
    pub index: usize,
    /// How far out.
    pub u: i32,
}

/// Finds the road line.
pub fn find(samples: &mut [Sample], noise: Noise) -> Option<Road> {
    let mut line = Line { u: 0, z: median_height(samples), slope_q30: 0 };
    let mut reach = FIRST_REACH;
    // Wide first: a cross slope of 5 degrees is 100 mm at the ends of the first piece.
    let wide = Noise { range: millimetres(30) as u32, ..noise };
    line = step(inside(samples, &line, reach), THINNING, &line, &wide)?.line;
    let mut noise = noise;
    let mut end = None;
    while reach < millimetres(30_000) {
        let fit = step(inside(samples, &line, reach), THINNING, &line, &noise)?;
        line = fit.line;
        noise = updated(&noise, &fit);
        // Beyond twice the reach the line is not to be trusted: the next piece comes first.
        let known = inward_of(samples, line.place_at(2 * reach)) + DEPARTURE_SAMPLES as usize;
        let seen = samples.get(..known).unwrap_or(samples);
        let departed = departure(seen, &line, &noise, inward_of(seen, line.place_at(reach - MARGIN)));
        end = departed.map(|departed| departed.u);
        if end.is_some_and(|end| end < 2 * reach) {
            break;
        }
        reach *= 2;
    }
    let end = end.unwrap_or(reach) - MARGIN;
    let road = inside(samples, &line, end.max(FIRST_REACH / 2));
    let size = road.len();
    let fit = step(road, MEASURING, &line, &noise)?;
    // Where less than half of the samples lie on the line, it is not the road.
    if fit.count < MIN_SAMPLES || 2 * MEASURING * (fit.count as usize) < size {
        return None;
    }
    let noise = updated(&noise, &fit);
    let from = inward_of(samples, fit.line.place_at(end - MARGIN));
    let departure = departure(samples, &fit.line, &noise, from);
    Some(Road { fit, departure, noise })
}

impl Road {
    /// Whether most of what follows a departure rises above the road: a cut, in which the slope beside it rises.
    pub fn is_below(&self, samples: &[Sample], departure: &Departure) -> bool {
        let next = samples.get(departure.index..).unwrap_or_default().iter();
        let (mut above, mut all) = (0, 0);
        for sample in next.take_while(|s| s.u < departure.u + VERGE).filter(|s| s.u > departure.u + SILL) {
            let e = self.fit.line.residual(sample);
            // A rail or a wall is no slope.
            if e < TALLEST {
                all += 1;
                above += u32::from(e > RISEN);
            }
        }
        2 * above > all
    }

    /// Fits again up to the edge that the adjacent slope makes with the road, and once more up to the edge that comes of that:
    /// the few samples between the two are added to the sums or taken out of them.
    pub fn settle(&mut self, samples: &mut [Sample], edge: impl Fn(&Fit) -> i32) {
        let line = self.fit.line;
        let end = |fit: &Fit, samples: &[Sample]| inward_of(samples, fit.line.place_at(edge(fit).max(FIRST_REACH / 2)));
        // Even numbers of samples, so that the same ones count on both sides of an end.
        let end = |fit: &Fit, samples: &[Sample]| end(fit, samples) & !(MEASURING - 1);
        let first = end(&self.fit, samples);
        let part = samples.get_mut(..first).unwrap_or_default();
        let shift = weigh(part, MEASURING, &self.noise, line.slope_q14());
        let sums = Sums::over(part, MEASURING, &line, shift, Gate::BARE);
        let Some(fit) = sums.solve(&line, shift, Gate::BARE) else { return };
        let last = end(&fit, samples);
        let between = samples.get_mut(first.min(last)..first.max(last)).unwrap_or_default();
        weigh_by(between, MEASURING, &self.noise, line.slope_q14(), shift);
        let change = Sums::over(between, MEASURING, &line, shift, Gate::BARE);
        let sums = if last < first { sums.minus(&change) } else { sums.plus(&change) };
        self.fit = sums.solve(&line, shift, Gate::BARE).unwrap_or(fit);
    }
}

/// The samples up to a distance outward on a line.
fn inside<'a>(samples: &'a mut [Sample], line: &Line, reach: i32) -> &'a mut [Sample] {
    let end = inward_of(samples, line.place_at(reach));
    samples.get_mut(..end).unwrap_or_default()
}

fn step(samples: &mut [Sample], stride: usize, line: &Line, noise: &Noise) -> Option<Fit> {
    let shift = weigh(samples, stride, noise, line.slope_q14());
    fit(samples, stride, line, shift, Gate::BARE)
}

/// The point of significant departure, from sample `from` on: the first of [`DEPARTURE_SAMPLES`] further from the line than 4 sigma of the range noise
/// and 3 mm, and than 12 mm. Vegetation brings returns back to the line: each that does takes half a sample from the row. How far out is told by
/// the least far off of the row's first three, as one may be a stray.
fn departure(samples: &[Sample], line: &Line, noise: &Noise, from: usize) -> Option<Departure> {
    let (mut row, mut first, mut least) = (0u32, Departure::default(), i32::MAX);
    for (index, sample) in samples.iter().enumerate().skip(from) {
        let g_q14 = i32::from(sample.down_q14) + ((line.slope_q14() * i32::from(sample.out_q14)) >> 14);
        let sigma = (noise.range as i32 * g_q14.abs()) >> 14;
        let threshold = (4 * sigma + millimetres(3)).max(millimetres(12));
        let off = line.residual(sample).abs();
        if off <= threshold {
            row = row.saturating_sub(1);
            continue;
        }
        if row == 0 {
            (first.index, least) = (index, i32::MAX);
        }
        if off < least && row <= 4 {
            (first.u, least) = (sample.u, off);
        }
        row += 2;
        if row >= 2 * DEPARTURE_SAMPLES {
            return Some(first);
        }
    }
    None
}

/// The range noise that explains the residuals of a fit, with the assumed one as a prior.
fn updated(noise: &Noise, found: &Fit) -> Noise {
    // At the road the beam is nearly square to the surface: g is about 0.9, and the surface's part is taken off.
    let assumed = u64::from(noise.range * noise.range) + u64::from(noise.rough2);
    let total = (assumed * u64::from(found.ratio_q10(PRIOR))) >> 10;
    // Its root is clamped to less than what 32 bits have.
    let range = total.saturating_sub(u64::from(noise.rough2)).min(u64::from(u32::MAX)) as u32;
    let range = range.isqrt();
    Noise { range: range.clamp(millimetres(1) as u32 / 2, Noise::MAX_RANGE), ..*noise }
}

/// Median height of the nine samples nearest to straight down.
fn median_height(samples: &[Sample]) -> i32 {
    let middle = inward_of(samples, (0, -1));
    let from = middle.saturating_sub(4);
    let near = samples.get(from..).unwrap_or_default();
    let near = near.get(..near.len().min(9)).unwrap_or_default();
    // The median is the one with as many lower ones as higher ones; equal heights are told apart by their order.
    let rank = |i: usize, z: i32| near.iter().enumerate().filter(|(k, s)| (s.z, *k) < (z, i)).count();
    near.iter().enumerate().find(|(i, s)| rank(*i, s.z) == near.len() / 2).map_or(0, |(_, s)| s.z)
}
