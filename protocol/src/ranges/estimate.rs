//! What the encoder finds out about a scan beforehand: how far its odd beams are turned, and how noisy it is.
//!
//! A scan in half degrees is two interleaved turns of the mirror; between them the vehicle rolls on, so that the odd
//! beams look a little further or less far than halfway between their neighbours. On a straight line the range
//! halfway is the harmonic mean H = 2ab/(a + b) of the neighbours a and b; turned by `shift` the beam sees
//! H - shift (a - b)/(2 step). Least squares over all odd beams, twice, each time without those that a line does
//! not explain, give the shift; what is left over gives the noise.

use super::MAX_VALUES;

/// What helps to code a scan.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Estimate {
    /// Turn of the odd beams in 2^-18 rad, within +/-[`MAX_SHIFT`].
    pub shift: i32,
    /// Mean deviation of a range, as an index of [`noise`].
    pub noise: u32,
}

/// Greatest shift: 25 degrees a second of roll, two thirds of a step.
pub const MAX_SHIFT: i32 = 1535;

/// Half a degree, twice, in 2^-18 rad.
const TWO_STEPS: i64 = 4575;

/// Noise of an index from 0 to 15, in 1/256 of a unit: half octaves from 0.35 up.
pub fn noise(index: u32) -> u32 {
    let base = if index & 1 == 0 { 91 } else { 128 };
    base << (index >> 1)
}

/// Estimate from the ranges, `is_range` telling which values are any; `interlaced` when the odd beams may be turned.
pub fn estimate(values: &[u16], interlaced: bool, is_range: impl Fn(u16) -> bool) -> Estimate {
    // Ranges are below 2^15, and so are a difference of two and one from their mean: 16 bits hold both, which halves the stack.
    let mut odd_beams = [(0_i16, 0_i16); MAX_VALUES / 2];
    let mut count = 0;
    for beams in values.windows(3).step_by(2) {
        let (&[a, beam, b], Some(place)) = (beams, odd_beams.get_mut(count)) else { continue };
        if !(is_range(a) && is_range(beam) && is_range(b)) {
            continue;
        }
        let (a, b) = (u32::from(a), u32::from(b));
        let slant = a as i32 - b as i32;
        if slant.unsigned_abs() * 5 <= a + b {
            // Both are ranges, below 2^15: the product is below 2^31.
            let mean = 2 * a * b / (a + b).max(1);
            *place = (slant as i16, (mean as i32 - i32::from(beam)) as i16);
            count += 1;
        }
    }
    let odd_beams = odd_beams.get(..count).unwrap_or_default();
    let mut turn = 0;
    if interlaced {
        turn = fit(odd_beams, |slant, miss| miss.abs() <= (slant.abs() >> 2) + 40);
        turn = fit(odd_beams, |slant, miss| left(slant, miss, turn) <= near(slant));
    }
    let shift = ((i64::from(turn) * TWO_STEPS) >> 16) as i32;
    let wide = odd_beams.iter().map(|&(slant, miss)| (i32::from(slant), i32::from(miss)));
    let rest = wide.map(|(slant, miss)| left(slant, miss, turn).min(near(slant)) as u32);
    // A deviation from the mean of two neighbours is 1.22 times one's own; 213/256 takes that off.
    let mean = rest.sum::<u32>() * 213 / (count as u32).max(1);
    let noise = (0..15).find(|&index| noise(index) + noise(index) / 5 >= mean).unwrap_or(15);
    Estimate { shift: shift.clamp(-MAX_SHIFT, MAX_SHIFT), noise }
}

/// Turn of the odd beams in 1/65,536 of two steps, from pairs of slant and miss, those that `keep` keeps.
fn fit(odd_beams: &[(i16, i16)], keep: impl Fn(i32, i32) -> bool) -> i32 {
    let (mut across, mut along) = (0_i64, 0_i64);
    for &(slant, miss) in odd_beams {
        let (slant, miss) = (i32::from(slant), i32::from(miss));
        if keep(slant, miss) {
            across += i64::from(slant) * i64::from(miss);
            along += i64::from(slant) * i64::from(slant);
        }
    }
    ((across << 16) / along.max(1)).clamp(-40_000, 40_000) as i32
}

/// What a turn leaves of a miss. A slant is below 2^15, a turn below 2^16: the product fits.
fn left(slant: i32, miss: i32, turn: i32) -> i32 {
    (miss - ((slant * turn) >> 16)).abs()
}

/// What may be left of it on a line.
fn near(slant: i32) -> i32 {
    (slant.abs() >> 5) + 30
}
