//! What the encoder finds out about a scan beforehand: how far its odd beams are turned, and how noisy it is.
//!
//! A scan in half degrees is two interleaved turns of the mirror; between them the vehicle rolls on, so that the odd
//! beams look a little further or less far than halfway between their neighbours. On a straight line the range
//! halfway is the harmonic mean H = 2ab/(a + b) of the neighbours a and b; turned by `shift` the beam sees
//! H - shift (a - b)/(2 step). Least squares over all odd beams, twice, each time without those that a line does
//! not explain, give the shift; what is left over gives the noise.

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
    let odd_beams = || {
        values.windows(3).step_by(2).filter_map(|beams| {
            let &[a, beam, b] = beams else { return None };
            if ![a, beam, b].into_iter().all(&is_range) {
                return None;
            }
            let (a, b) = (u32::from(a), u32::from(b));
            // Both are ranges, below 2^15: the product is below 2^31.
            let mean = 2 * a * b / (a + b).max(1);
            let slant = a as i32 - b as i32;
            (slant.unsigned_abs() * 5 <= a + b).then_some((slant, mean as i32 - i32::from(beam)))
        })
    };
    let fit = |keep: &dyn Fn(i32, i32) -> bool| {
        let (mut across, mut along) = (0_i64, 0_i64);
        for (slant, miss) in odd_beams().filter(|&(slant, miss)| keep(slant, miss)) {
            across += i64::from(slant) * i64::from(miss);
            along += i64::from(slant) * i64::from(slant);
        }
        // In 1/65,536 of two steps.
        (((across << 16) / along.max(1)).clamp(-40_000, 40_000)) as i32
    };
    let mut turn = 0;
    if interlaced {
        turn = fit(&|slant, miss| miss.abs() <= (slant.abs() >> 2) + 40);
    }
    let left = |slant: i32, miss: i32| miss - ((i64::from(slant) * i64::from(turn)) >> 16) as i32;
    let near = |slant: i32, miss: i32| left(slant, miss).abs() <= (slant.abs() >> 5) + 30;
    if interlaced {
        turn = fit(&near);
    }
    let shift = ((i64::from(turn) * TWO_STEPS) >> 16) as i32;
    let (mut sum, mut count) = (0_u32, 1_u32);
    for (slant, miss) in odd_beams() {
        let rest = miss - ((i64::from(slant) * i64::from(turn)) >> 16) as i32;
        sum += rest.unsigned_abs().min((slant.unsigned_abs() >> 5) + 30);
        count += 1;
    }
    // A deviation from the mean of two neighbours is 1.22 times one's own; 213/256 takes that off.
    let mean = sum * 213 / count;
    let noise = (0..15).find(|&index| noise(index) + noise(index) / 5 >= mean).unwrap_or(15);
    Estimate { shift: shift.clamp(-MAX_SHIFT, MAX_SHIFT), noise }
}
