//! The fan of all lines through one point: which of their slopes can still be a candidate's, and how many points each could
//! have. This is what makes the exhaustive search short; it decides nothing.
//!
//! A line of slope m through the anchor is within T of a point at (y, z) from the anchor only if |z - m y| <= T sqrt(1 + m^2),
//! hence only if m is in the interval (z -+ V) / y with V = T / cos(greatest inclination): the fan forgets nothing.
//! Points allow intervals of slopes; the fan sorts slopes into bins and adds an interval up as +1 at its first bin and -1 after
//! its last.
//!
//! Slopes have 28 fraction bits and lie within +/-1 (45 degrees). A reciprocal of 16 bits makes a computed slope err by less
//! than 2^-15 of itself (see [`Reach::of`]), 2^13 units; every interval is widened by [`SLACK`] = 2^15, more than twice that: if
//! the exact slope of a pair is in the exact interval of a point, the computed slope of the pair is in the computed interval.
//! Cost: one 32-bit division a point and one high multiplication for each end of an interval.

use crate::scan::Point;

use super::criterion::Criterion;

/// Fraction bits of a slope.
const SLOPE_BITS: u32 = 28;

/// By how much intervals are widened, in units of a slope.
const SLACK: i32 = 1 << 15;

/// Bins over the allowed slopes, at most. At the default limits of +/-18 degrees 167 are in use, each 0.0039 wide: 25 mm at 6.4 m.
const BINS: usize = 256;

/// Closer than this in y, two points say nothing of a slope within +/-1 that is worth a division.
const BESIDE_UM: u32 = 1 << 10;

/// An interval of slopes, both ends included; empty when `low > high`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Slopes {
    pub low: i32,
    pub high: i32,
}

impl Slopes {
    pub fn is_empty(self) -> bool {
        self.low > self.high
    }

    fn and(self, other: Self) -> Self {
        Self { low: self.low.max(other.low), high: self.high.min(other.high) }
    }
}

/// What the criterion asks of a fan, computed once a search.
#[derive(Clone, Copy, Debug)]
pub(super) struct Limits {
    /// Slopes of either sign up to the greatest inclination.
    pub allowed: Slopes,
    /// Slopes between these two are below the least inclination.
    flat: Slopes,
    /// Vertical half widths of the inlier band and of the obstruction band at the greatest inclination.
    inlier_um: i32,
    obstruction_um: i32,
    /// Slopes fall into bins of 2^`bin_bits` units.
    bin_bits: u32,
}

impl Limits {
    pub fn new(criterion: &Criterion) -> Self {
        let (sin, cos) = (i64::from(criterion.greatest.sin_q30), i64::from(criterion.greatest.cos_q30));
        // The cosine is 0.7 at least. Two units more than the quotient cover its rounding and the cosine's.
        let over_cos = |value: i64| value.checked_div(cos).unwrap_or(0).wrapping_add(2) as i32;
        let steepest = over_cos(sin << SLOPE_BITS).wrapping_add(SLACK);
        let (sin, cos) = (i64::from(criterion.least.sin_q30), i64::from(criterion.least.cos_q30));
        let flattest = (sin << SLOPE_BITS).checked_div(cos).unwrap_or(0).saturating_sub(SLACK.into()).max(0) as i32;
        let widened = |um: u32| over_cos(i64::from(um) << 30);
        let span = steepest.wrapping_mul(2).unsigned_abs();
        let bin_bits = (0..31).find(|bits| (span >> bits) < BINS as u32).unwrap_or(31);
        Self {
            allowed: Slopes { low: steepest.wrapping_neg(), high: steepest },
            flat: Slopes { low: flattest.wrapping_neg(), high: flattest },
            inlier_um: widened(criterion.inlier_um),
            obstruction_um: widened(criterion.obstruction_um),
            bin_bits,
        }
    }

    /// Those of the open slopes that the point does not obstruct.
    pub fn unobstructed(&self, open: Slopes, seen: Reach) -> Slopes {
        let Slopes { low, high } = open.and(seen.slopes_within(self.obstruction_um));
        Slopes {
            low: if low > self.flat.low { low.max(self.flat.high) } else { low },
            high: if high < self.flat.high { high.min(self.flat.low) } else { high },
        }
    }

    /// Those of the open slopes that have the point within the inlier distance.
    pub fn near(&self, open: Slopes, seen: Reach) -> Slopes {
        open.and(seen.slopes_within(self.inlier_um))
    }

    /// The bin of a slope within the allowed ones.
    fn bin(&self, slope: i32) -> usize {
        (slope.wrapping_sub(self.allowed.low).max(0) >> self.bin_bits) as usize
    }
}

/// A point as seen from the anchor.
#[derive(Clone, Copy, Debug)]
pub(super) struct Reach {
    /// Height above the anchor, turned with `run_um` so that the point lies outward.
    rise_um: i32,
    /// Distance from the anchor in y; 0 for a point straight above or below.
    run_um: i32,
    /// 2^60 / (`run_um` 2^`scale`), below 2^31.
    reciprocal: i32,
    scale: u32,
}

impl Reach {
    pub fn of(anchor: Point, p: Point) -> Self {
        let run = p.y_um.wrapping_sub(anchor.y_um);
        let rise = p.z_um.wrapping_sub(anchor.z_um);
        let rise_um = if run < 0 { rise.wrapping_neg() } else { rise };
        let run_um = run.unsigned_abs();
        if run_um < BESIDE_UM {
            return Self { rise_um, run_um: 0, reciprocal: 0, scale: 0 };
        }
        // The run cut to its 16 leading bits and the quotient cut to 16: each less than 2^-15 of its value too small, and in
        // opposite senses. The run is below 2^30, so that there are two zeros at least.
        let zeros = run_um.leading_zeros();
        let leading = (run_um << (zeros & 31)) >> 16;
        let reciprocal = u32::MAX.checked_div(leading).unwrap_or(0) << 14;
        Self { rise_um, run_um: run_um as i32, reciprocal: reciprocal as i32, scale: zeros.wrapping_sub(2) & 31 }
    }

    /// The slope of the line from the anchor to the point, or the nearest of +/-2; None straight above or below.
    fn slope(&self) -> Option<i32> {
        (self.run_um != 0).then(|| self.over_run(self.rise_um))
    }

    /// The slopes of lines through the anchor that pass within `half_um`, measured vertically; at least those within +/-1.
    fn slopes_within(&self, half_um: i32) -> Slopes {
        if self.run_um == 0 {
            let beside = self.rise_um.unsigned_abs() <= half_um.unsigned_abs().saturating_add(BESIDE_UM);
            return if beside { Slopes { low: i32::MIN, high: i32::MAX } } else { Slopes { low: 1, high: 0 } };
        }
        // |rise| < 2^30 and half < 2^23.
        Slopes {
            low: self.over_run(self.rise_um.wrapping_sub(half_um)).wrapping_sub(SLACK),
            high: self.over_run(self.rise_um.wrapping_add(half_um)).wrapping_add(SLACK),
        }
    }

    /// A height over the run, as a slope; beyond +/-2 as +/-2.
    fn over_run(&self, um: i32) -> i32 {
        let steepest = self.run_um.wrapping_mul(2);
        // Not `clamp`, which asserts that its limits are in order. Below 2^(31 - scale): the shift keeps all bits.
        let scaled = um.max(steepest.wrapping_neg()).min(steepest) << self.scale;
        // um 2^scale times 2^60 / (run 2^scale), less 32 bits: 28 fraction bits.
        (i64::from(scaled).wrapping_mul(self.reciprocal.into()) >> 32) as i32
    }
}

/// How many points each slope could have.
#[derive(Clone, Debug)]
pub(super) struct Fan {
    /// Before [`Fan::sum`] what changes at each bin, afterwards the number of points.
    bins: [i32; BINS + 1],
    /// The bins in use, both included; the others are stale.
    first: usize,
    last: usize,
    /// The largest number of points of any bin in use.
    most: usize,
}

impl Fan {
    pub const fn new() -> Self {
        Self { bins: [0; BINS + 1], first: 0, last: 0, most: 0 }
    }

    /// Empties the fan for slopes within the open ones.
    pub fn clear(&mut self, limits: &Limits, open: Slopes) {
        self.first = limits.bin(open.low);
        self.last = limits.bin(open.high);
        // One more: the change after the last.
        if let Some(used) = self.bins.get_mut(self.first..=self.last.wrapping_add(1)) {
            used.fill(0);
        }
    }

    /// A point allows these slopes of the open ones; there must be one.
    pub fn add(&mut self, limits: &Limits, slopes: Slopes) {
        if let Some(bin) = self.bins.get_mut(limits.bin(slopes.low)) {
            *bin = bin.wrapping_add(1);
        }
        if let Some(bin) = self.bins.get_mut(limits.bin(slopes.high).wrapping_add(1)) {
            *bin = bin.wrapping_sub(1);
        }
    }

    /// Adds the changes up, and gives the largest number of points of any slope.
    pub fn sum(&mut self) -> usize {
        let (mut sum, mut most) = (0_i32, 0);
        for bin in self.bins.get_mut(self.first..=self.last).into_iter().flatten() {
            sum = sum.wrapping_add(*bin);
            *bin = sum;
            most = most.max(sum);
        }
        self.most = most.unsigned_abs() as usize;
        self.most
    }

    /// Leaves only the open slopes, and gives the largest number of points among them.
    pub fn narrow(&mut self, limits: &Limits, open: Slopes) -> usize {
        self.first = self.first.max(limits.bin(open.low));
        self.last = self.last.min(limits.bin(open.high));
        let used = self.bins.get(self.first..=self.last).unwrap_or(&[]);
        self.most = used.iter().max().map_or(0, |points| points.unsigned_abs() as usize);
        self.most
    }

    /// The number of points that the line through the anchor and this point could have, after [`Fan::sum`].
    pub fn points(&self, limits: &Limits, through: Reach) -> usize {
        let Some(bin) = through.slope().map(|slope| limits.bin(slope)) else { return self.most };
        let used = self.first <= bin && bin <= self.last;
        self.bins.get(bin).filter(|_| used).map_or(0, |points| points.unsigned_abs() as usize)
    }
}
