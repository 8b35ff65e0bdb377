//! The cubic through four samples of roll, in Newton's form and in integers.
//!
//! With gaps of 2^11 to 2^17 us and steps below 2^25 units (2.1 degrees) between samples, the divided differences have these scales and bounds:
//!
//! | order | unit | bound |
//! |---|---|---|
//! | 1 | 2^-20 units/us | 2^25+20-11 = 2^34 |
//! | 2 | 2^-36 units/us^2 | 2^(35+16-12) = 2^39 |
//! | 3 | 2^-52 units/us^3 | 2^(40+16-12) = 2^44 |
//!
//! Every product in [`Cubic::at`] is one of these times a time below 2^18 us (all nodes lie within 3 x 2^17), so below 2^63. Rounding: each divided
//! difference is off by less than 2 of its own units, which is below 0.01 units of roll over one interval; the value is rounded down.

use crossfall_protocol::{Angle, DeviceTime};

const MIN_GAP_US: i64 = 1 << 11;
const MAX_GAP_US: i64 = 1 << 17;
const MAX_STEP: i64 = 1 << 25;

/// A cubic, valid between its two inner nodes.
#[derive(Clone, Copy, Debug)]
pub struct Cubic {
    first: DeviceTime,
    /// Second and third node, as microseconds after the first.
    inner: [i64; 2],
    roll: Angle,
    differences: [i64; 3],
}

impl Cubic {
    /// `None` where the samples are too close, too far apart or too different for the bounds above: take a line then.
    pub fn through(nodes: &[(DeviceTime, Angle); 4]) -> Option<Self> {
        let [a, b, c, d] = *nodes;
        let (ab, bc, cd) = (slope(a, b)?, slope(b, c)?, slope(c, d)?);
        let (t1, t2, t3) = (b.0.since(a.0), c.0.since(a.0), d.0.since(a.0));
        // Spans of two and three gaps, none below 2^12.
        let abc = ((bc - ab) << 16).div_euclid(t2.max(MIN_GAP_US));
        let bcd = ((cd - bc) << 16).div_euclid((t3 - t1).max(MIN_GAP_US));
        let abcd = ((bcd - abc) << 16).div_euclid(t3.max(MIN_GAP_US));
        Some(Self { first: a.0, inner: [t1, t2], roll: a.1, differences: [ab, abc, abcd] })
    }

    /// Roll at an instant between the inner nodes.
    pub fn at(&self, time: DeviceTime) -> Angle {
        let [t1, t2] = self.inner;
        // Not `clamp`, which would panic if the nodes were out of order.
        let t = time.since(self.first).max(t1).min(t2);
        let [first, second, third] = self.differences;
        let second = second + ((third * (t - t2)) >> 16);
        let first = first + ((second * (t - t1)) >> 16);
        Angle(self.roll.0.wrapping_add(((first * t) >> 20) as i32))
    }
}

/// The first divided difference of two neighbours, in 2^-20 units a microsecond.
fn slope(from: (DeviceTime, Angle), to: (DeviceTime, Angle)) -> Option<i64> {
    let gap = to.0.since(from.0);
    let step = i64::from((to.1 - from.1).0);
    ((MIN_GAP_US..=MAX_GAP_US).contains(&gap) && step.abs() < MAX_STEP).then(|| (step << 20).div_euclid(gap.max(1)))
}
