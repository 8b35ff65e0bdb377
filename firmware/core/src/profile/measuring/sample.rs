//! The returns of one side as the fits want them, and what the noise of a range does to them.
//!
//! Lengths are counted in grains of 8 micrometres: 33.5 m are 2^22 grains, squares of what a line is judged by
//! (up to 250 mm) fit 32 bits, and rounding to a grain is far below a scanner's millimetre.

use heapless::Vec;

use crate::scan::{Echo, MAX_BEAMS};

/// log2 of the micrometres in a grain.
pub const GRAIN_BITS: u32 = 3;

/// Returns from so far away on are left out: 33.5 m, beyond the scanner's reach in millimetres.
pub const REACH_UM: i32 = 1 << (22 + GRAIN_BITS);

/// Grains in a number of millimetres.
pub const fn millimetres(mm: i32) -> i32 {
    mm * 125
}

/// One return, going outward from the sensor.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Sample {
    /// Distance outward, in grains.
    pub u: i32,
    /// Height, in grains.
    pub z: i32,
    /// Outward part of the beam's direction, 14 fraction bits.
    pub out_q14: i16,
    /// Downward part of the beam's direction, 14 fraction bits.
    pub down_q14: i16,
    /// Number of the beam.
    pub beam: u16,
    /// Weight in the fit under way: 2^37 over the variance.
    pub weight: u32,
}

/// The samples of a scan, in the order of its beams.
pub type Samples = Vec<Sample, MAX_BEAMS>;

/// Which way is outward.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Outward {
    /// To the left of the vehicle.
    Left,
    /// To the right.
    Right,
}

impl Outward {
    /// A distance outward, in grains, as a lateral distance in micrometres (left positive).
    pub fn lateral_um(self, u: i32) -> i32 {
        let um = u.clamp(-(1 << 27), 1 << 27) << GRAIN_BITS;
        if self == Self::Left { um } else { -um }
    }
}

/// How a range errs and how rough the surface is: one sigma each, squared where that is what is needed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Noise {
    /// Of a range, in grains; at most 2^13 (65 mm).
    pub range: u32,
    /// Square of the roughness, in square grains; at most 2^24 (33 mm squared).
    pub rough2: u32,
}

impl Noise {
    pub const MAX_RANGE: u32 = 1 << 13;
    pub const MAX_ROUGH2: u32 = 1 << 24;
    /// 0.3 mm: rounding, the scanner's digits and the beam angle leave at least this.
    pub const MIN_ROUGH2: u32 = 38 * 38;

    /// Variance, in square grains, of a sample's vertical distance from a line: the range error enters with
    /// g = down + slope x out. At most 2^13 x 1.5 squared + 2^24 < 2^28.
    pub fn variance(&self, sample: &Sample, slope_q14: i32) -> u32 {
        let g_q14 = i32::from(sample.down_q14) + ((slope_q14 * i32::from(sample.out_q14)) >> 14);
        // Rounded down, so that of two beams alike but for the side of the surface that they meet one has a grain more.
        let part = (self.range as i32 * g_q14) >> 14;
        (part * part) as u32 + self.rough2
    }
}

/// How many samples were seen under a direction inward of a place. Beams turn outward one after the other, whatever they
/// hit: the order holds for strays and vegetation too, whose distance outward does not tell where they belong.
pub fn inward_of(samples: &[Sample], (u, z): (i32, i32)) -> usize {
    // The cross product of the beam and the place: at most 2^14 x 2^25 each.
    samples.partition_point(|s| i64::from(s.out_q14) * i64::from(z) + i64::from(s.down_q14) * i64::from(u) > 0)
}

/// Takes a return of a scan from nearer than [`REACH_UM`], which come from the right to the left, as a sample that counts outward to the left.
///
/// Rounding to grains is towards the sensor, so that a mirrored scan gives mirrored samples.
#[inline(always)]
pub fn take(echo: &Echo, samples: &mut Samples) {
    let sample = Sample {
        u: echo.point.y_um / (1 << GRAIN_BITS),
        z: echo.point.z_um >> GRAIN_BITS,
        out_q14: -echo.cos_q14,
        down_q14: echo.sin_q14,
        beam: echo.beam,
        weight: 0,
    };
    // Never full: a scan has no more echoes than there are places.
    let _ = samples.push(sample);
}

/// Turns the samples of a scan round: from those that count outward to the left to those that count outward to the right, or back.
pub fn turn_round(samples: &mut Samples) {
    let turned = |sample: &Sample| Sample { u: -sample.u, out_q14: -sample.out_q14, ..*sample };
    let (middle, odd) = (samples.len() / 2, samples.len() % 2 == 1);
    let Some((front, back)) = samples.split_at_mut_checked(middle) else { return };
    for (a, b) in front.iter_mut().zip(back.iter_mut().rev()) {
        (*a, *b) = (turned(b), turned(a));
    }
    // An odd one between the halves is the first of the back.
    if let [first, ..] = back
        && odd
    {
        *first = turned(first);
    }
}

/// One side's samples: from `inner` grains on the other side of straight down outward.
pub fn side(samples: &mut Samples, inner: i32) -> &mut [Sample] {
    // Strays on the other side may seem near: the side begins where the ground nearest to straight down passes the border.
    let down = samples.partition_point(|s| s.out_q14 < 0);
    let before = samples.iter().take(down).rposition(|s| s.u < -inner);
    samples.get_mut(before.map_or(0, |last| last + 1)..).unwrap_or_default()
}
