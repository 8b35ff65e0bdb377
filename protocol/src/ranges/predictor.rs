//! What the next range will be, and how far off that may be.
//!
//! Seen at equal steps of angle, the reciprocal u = 1/r of the range to a straight line is a sinusoid of the angle: three
//! beams at steps s1 and s2 satisfy u' = c u - k p with c = sin(s1 + s2)/sin s1 and k = sin s2/sin s1, whatever the
//! line. So a tracker is a pair (u, p) of this beam and the last; a residual corrects both with the gains of a straight
//! fit with expanding memory (Kalata's alpha-beta recursions). One tracker remembers up to 24 beams, the other 3; the one
//! that has done better of late predicts. When both fail by more than three times what is usual, a new line begins.
//!
//! The prediction only steers the code: it may be as wrong as it likes, as long as both ends compute the same. So the
//! arithmetic is integer, wraps or saturates, and needs no proof of range beyond that its divisors are not zero.

/// u = NUMERATOR / r: reciprocals of ranges from 32 units up fit 31 bits.
const NUMERATOR_HIGH: u32 = 0xF000_0000;

/// Reciprocals of the ranges 65,535 and 32, the bounds of a tracker.
const FAR: i64 = 0xF_0000;
const NEAR: i64 = 0x7800_0000;

/// Longest memories of the two trackers, in beams.
const LONG: u8 = 24;
const SHORT: u8 = 3;

/// What a tracker of so many beams does with a miss, and how sure it is.
#[derive(Clone, Copy, Debug)]
struct Memory {
    /// Gains of the n-th beam of a line, n from 1: alpha = 2(2n-1)/(n(n+1)) and alpha - beta, beta = 6/(n(n+1)), both as
    /// 2^18/15 times the value; the 15 is that of [`NUMERATOR_HIGH`].
    level: i32,
    back: i32,
    /// How much larger a prediction's error is than the noise, from n beams, in 1/256: sqrt(1 + 2(2n+1)/(n(n-1))).
    /// The first is not a standard deviation but what a first step on a new line is worth.
    spread: u32,
    /// 65,536 / spread.
    inverse: u32,
}

/// Memories by beams. No tracker has more than [`LONG`]; a power of two, so that five bits of a count are an index.
const MEMORIES: [Memory; 32] = {
    const SPREADS: [u32; LONG as usize + 1] = [
        1024, 1024, 627, 467, 405, 371, 350, 336, 325, 317, 311, 306, 302, 298, 295, 293, 291, 289, 287, 285, 284, 283,
        282, 281, 280,
    ];
    let mut memories = [Memory { level: 0, back: 0, spread: SPREADS[0], inverse: 65_536 / SPREADS[0] }; 32];
    let mut n = 1;
    while n <= LONG as i32 {
        let alpha = 2 * (2 * n - 1) * 17_476 / (n * (n + 1));
        let beta = 6 * 17_476 / (n * (n + 1));
        let (level, back) = if n == 1 { (17_476, 0) } else { (alpha, alpha - beta) };
        let spread = SPREADS[n as usize];
        memories[n as usize] = Memory { level, back, spread, inverse: 65_536 / spread };
        n += 1;
    }
    memories
};

/// What is expected of a beam.
#[derive(Clone, Copy, Debug, Default)]
pub struct Forecast {
    /// The range.
    pub range: i32,
    /// Expected size of the error, in 1/256.
    pub error: u32,
}

/// The steps of angle of a scan as the trackers need them, for even and odd beams.
#[derive(Clone, Copy, Debug)]
pub struct Steps([(u32, u32); 2]);

impl Steps {
    /// Beams `step_cdeg` apart; odd ones lie `shift` further than the even ones say, in 2^-18 rad (at most
    /// 1535, and 0 unless the step is half a degree).
    pub fn new(step_cdeg: u16, shift: i32) -> Self {
        // In 2^-39 rad: a hundredth of a degree is 95,950,490 of them.
        let step = i64::from(step_cdeg) * 95_950_490;
        let shift = i64::from(shift) << 21;
        let both = sin39(2 * step);
        let pair = |before: i64, after: i64| {
            let before = sin39(before).max(1);
            // 2 degrees are 2^34.2 of the units: shifted by 28 they stay below 2^63.
            let times_2_28 = |sine: i64| ((sine << 28).unsigned_abs() / before.unsigned_abs()) as u32;
            (times_2_28(both), times_2_28(sin39(after)))
        };
        Self([pair(step + shift, step - shift), pair(step - shift, step + shift)])
    }
}

/// Sine of a small angle, both in 2^-39: x - x^3/6, good to 1e-9 of itself up to 2 degrees.
fn sin39(x: i64) -> i64 {
    let square = ((x >> 12) * (x >> 12)) >> 15;
    x - (((x >> 12) * (square >> 8)) >> 19) / 6
}

#[derive(Clone, Copy, Debug, Default)]
struct Tracker {
    /// Reciprocal of the range at this beam.
    here: u32,
    /// The same at the beam before.
    before: u32,
    /// Beams that it rests on.
    beams: u8,
    /// Running mean of its errors, in 1/256.
    error: u32,
    /// Reciprocal and range foreseen for the next beam.
    next: u32,
    range: i32,
}

impl Tracker {
    fn advance(&mut self, (c, k): (u32, u32)) {
        // c is below 6.2 * 2^28 (a shift is at most two thirds of a step), reciprocals below 2^31: products below 2^62.
        let ahead = u64::from(c) * u64::from(self.here);
        let behind = u64::from(k) * u64::from(self.before);
        let next = (ahead as i64 - behind as i64) >> 28;
        self.next = bounded(next);
        let divisor = (self.next >> 4) | 1;
        self.range = ((NUMERATOR_HIGH + divisor / 2) / divisor) as i32;
    }

    fn correct(&mut self, miss: i32, longest: u8) {
        self.beams = self.beams.saturating_add(1).min(longest);
        let Memory { level, back, .. } = self.memory();
        // du = -dr u^2 / NUMERATOR, the 15 of which is in the gains.
        // Products of a miss beyond 2^15 may wrap: such a miss begins a new line anyway.
        let square = ((u64::from(self.next) * u64::from(self.next)) >> 32) as u32;
        let moved =
            |from: u32, gain: i32| i64::from(from) - ((i64::from(miss.wrapping_mul(gain)) * i64::from(square)) >> 18);
        let (here, before) = (moved(self.next, level), moved(self.here, back));
        (self.here, self.before) = (bounded(here), bounded(before));
    }

    fn coast(&mut self) {
        (self.before, self.here) = (self.here, self.next);
    }

    fn note(&mut self, miss: i32, most: u32) {
        let miss = (miss.unsigned_abs() << 8).min(most);
        self.error = self.error.wrapping_add_signed((miss as i32).wrapping_sub(self.error as i32).wrapping_mul(5) >> 5);
    }

    #[inline(always)]
    fn memory(&self) -> Memory {
        MEMORIES[usize::from(self.beams % MEMORIES.len() as u8)]
    }
}

fn bounded(reciprocal: i64) -> u32 {
    reciprocal.clamp(FAR, NEAR) as u32
}

/// Reciprocal of a range.
fn reciprocal(range: u16) -> u32 {
    (NUMERATOR_HIGH / u32::from(range.max(32))) << 4
}

/// The predictor of one scan.
#[derive(Clone, Debug)]
pub struct Predictor {
    steps: Steps,
    long: Tracker,
    short: Tracker,
    /// Running mean of the errors, less what the spread explains: the noise, in 1/256.
    noise: u32,
    /// What the first step on a new line may miss by, in 1/256, beyond noise.
    first_step: u32,
}

impl Predictor {
    /// A predictor that knows the steps of the scan and about how noisy it is (1/256 of a unit).
    pub fn new(steps: Steps, noise: u32) -> Self {
        Self { steps, long: Tracker::default(), short: Tracker::default(), noise, first_step: 0 }
    }

    /// Begin a line at a range of which nothing was known.
    pub fn begin(&mut self, range: u16) {
        let here = reciprocal(range);
        self.restart(here, here);
        self.first_step = u32::from(range) << 3;
    }

    /// Look ahead to beam `i`.
    #[inline(always)]
    pub fn forecast(&mut self, i: usize) -> Forecast {
        let [even, odd] = self.steps.0;
        let step = if i & 1 == 0 { even } else { odd };
        self.long.advance(step);
        self.short.advance(step);
        let best = self.best();
        let error = (self.noise * best.memory().spread) >> 8;
        let error = if best.beams <= 1 { error.max(self.first_step) } else { error };
        Forecast { range: best.range, error }
    }

    /// Beam `i` of the last forecast has no range: go on along the line.
    pub fn coast(&mut self) {
        self.long.coast();
        self.short.coast();
    }

    /// Learn the range of the last forecast's beam.
    #[inline(always)]
    pub fn correct(&mut self, range: u16) {
        let value = i32::from(range);
        let short_best = self.short_is_best();
        let best = self.best();
        if best.beams > 1 {
            let miss = (value - best.range).unsigned_abs() * best.memory().inverse;
            let change = (miss.min(3 * self.noise) as i32 - self.noise as i32) >> 3;
            self.noise = self.noise.wrapping_add_signed(change).clamp(MIN_NOISE, MAX_NOISE);
        }
        let (miss_long, miss_short) = (value - self.long.range, value - self.short.range);
        let usual = 3 * self.noise;
        let fails = |miss: i32, tracker: &Tracker| miss.unsigned_abs() > (usual * tracker.memory().spread) >> 16;
        if fails(miss_long, &self.long) && fails(miss_short, &self.short) {
            let here = reciprocal(range);
            // Up to an eighth of the range it is a bend in one surface: the secant leads on. Beyond, it is another one.
            let jump = miss_long.unsigned_abs();
            let bend = jump < u32::from(range >> 3);
            self.restart(here, if bend { self.long.here } else { here });
            self.first_step = if bend { jump << 7 } else { u32::from(range) << 3 };
            return;
        }
        self.long.note(miss_long, 8 * self.noise);
        self.short.note(miss_short, 8 * self.noise);
        self.long.correct(miss_long, LONG);
        self.short.correct(miss_short, SHORT);
        let weighed = self.short.error + self.short.error / 8;
        if short_best && 4 * weighed < 3 * self.long.error {
            // A gentle bend: the long memory starts over from the short one.
            self.long = Tracker { beams: self.short.beams.min(2), error: weighed, ..self.short };
        }
    }

    fn restart(&mut self, here: u32, before: u32) {
        let tracker = Tracker { here, before, beams: 1, error: self.noise, ..Tracker::default() };
        (self.long, self.short) = (tracker, tracker);
    }

    fn short_is_best(&self) -> bool {
        self.short.error + self.short.error / 8 < self.long.error
    }

    fn best(&self) -> &Tracker {
        if self.short_is_best() { &self.short } else { &self.long }
    }
}

/// Bounds of the noise in 1/256: a tenth of a unit, and so much that no product above leaves 32 bits.
const MIN_NOISE: u32 = 24;
const MAX_NOISE: u32 = 1 << 19;
