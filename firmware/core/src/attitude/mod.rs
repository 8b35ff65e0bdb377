//! Roll at any instant, from a bounded history of poses.
//!
//! Between two poses roll follows a cubic through the four nearest (its error for 0.5 degrees at 5 Hz from 100 Hz poses is 1.2e-4
//! degrees; a straight line's is 6e-3), or a straight line where four are not to be had. Beyond the newest pose, before the oldest and
//! inside a gap longer than `max_gap_us`, the nearest pose's roll is held for `hold_us` and flagged; further away there is no attitude:
//! roll 0, flagged. Nothing is ever dropped for want of attitude.

mod cubic;

use crossfall_protocol::config::Attitude as Limits;
use crossfall_protocol::message::{Pose, flags};
use crossfall_protocol::{Angle, DeviceTime};

use crate::scan::{KNOTS, RawScan, RollTrack};
use crate::sensors::novatel::Quality;
use cubic::Cubic;

/// Poses kept. A scan needs those from its first beam on: 41 ms before its telegram is complete at 500,000 baud, 0.8 s at 9,600 baud and a second with
/// the longest delay that a configuration may add. So these are enough for every line with poses at 100 Hz, and down to 19,200 baud at 200 Hz.
pub const HISTORY: usize = 128;

/// A pose out of order by less than this is ignored; by more, time itself has been set anew and the history begins again.
const REORDER_US: i64 = 500_000;

/// What the history keeps of a pose.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Sample {
    time: DeviceTime,
    roll: Angle,
    flags: u16,
}

/// The poses of the last moments.
#[derive(Clone, Debug, Default)]
pub struct History {
    samples: heapless::Deque<Sample, HISTORY>,
}

/// Roll over one scan, and how far it can be trusted.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ScanRoll {
    /// Roll at every beam, without the mounting offset.
    pub track: RollTrack,
    /// Roll at the beam that looks straight down.
    pub nadir: Angle,
    /// `NO_ATTITUDE`, `ATTITUDE_HELD`, `ATTITUDE_DEGRADED`, `TIME_BY_ARRIVAL` of [`flags`].
    pub flags: u16,
}

impl History {
    /// Takes in a pose. Those that say themselves unusable (inactive, aligning, waiting) are left out, as are repeated ones.
    pub fn push(&mut self, pose: &Pose) {
        let Some(mut flags) = usability(pose.status) else { return };
        if !pose.timed_by_pulse {
            flags |= flags::TIME_BY_ARRIVAL;
        }
        if let Some(newest) = self.samples.back() {
            let step = pose.time.since(newest.time);
            if step < -REORDER_US {
                self.samples.clear();
            } else if step <= 0 {
                return;
            }
        }
        if self.samples.is_full() {
            self.samples.pop_front();
        }
        let _ = self.samples.push_back(Sample { time: pose.time, roll: pose.roll, flags });
    }

    /// Forgets every pose.
    pub fn clear(&mut self) {
        self.samples.clear();
    }

    /// Whether `time` can be interpolated as well as it ever will be: two poses lie beyond it.
    #[must_use]
    pub fn covers(&self, time: DeviceTime) -> bool {
        self.samples.iter().rev().nth(1).is_some_and(|sample| sample.time >= time)
    }

    /// Roll at every beam of a scan that began at `start`.
    #[must_use]
    pub fn over_scan(&self, scan: &RawScan, start: DeviceTime, limits: &Limits) -> ScanRoll {
        let mut track = RollTrack::constant(Angle::ZERO);
        let mut union = 0;
        let mut cursor = Cursor::default();
        for (turn, knots) in track.knots.iter_mut().enumerate().take(scan.turns()) {
            for (knot, roll) in knots.iter_mut().enumerate() {
                // Nanoseconds round down to the microsecond: 1e-5 degrees at 10 degrees a second.
                let time = start.offset(i64::from(RollTrack::knot_ns(scan, turn, knot) / 1_000));
                let (value, flags) = self.roll_at(time, limits, &mut cursor);
                *roll = value;
                union |= flags;
            }
        }
        if union & flags::NO_ATTITUDE != 0 {
            // Half a scan with roll and half without would be worse than none.
            return ScanRoll { track: RollTrack::constant(Angle::ZERO), nadir: Angle::ZERO, flags: flags::NO_ATTITUDE };
        }
        // The middle knot of the first turn is straight down in every angular range, by symmetry.
        let nadir = track.knots[0][KNOTS / 2];
        ScanRoll { track, nadir, flags: union }
    }

    fn roll_at(&self, time: DeviceTime, limits: &Limits, cursor: &mut Cursor) -> (Angle, u16) {
        if !cursor.holds(time) {
            *cursor = self.bracket(time, limits);
        }
        cursor.roll(time, limits)
    }

    /// The interval of the history in which `time` lies.
    fn bracket(&self, time: DeviceTime, limits: &Limits) -> Cursor {
        // Newest first, as a scan lies near the end of the history.
        let (mut next, mut after): (Option<Sample>, Option<Sample>) = (None, None);
        let mut older = self.samples.iter().rev();
        for &sample in older.by_ref() {
            if sample.time <= time {
                let (Some(right), left) = (next, sample) else {
                    return Cursor { from: sample.time, to: None, curve: Curve::Edge(sample) };
                };
                let outer = older.next().copied().zip(after);
                return Cursor { from: left.time, to: Some(right.time), curve: interval(left, right, outer, limits) };
            }
            after = next.replace(sample);
        }
        match next {
            Some(oldest) => Cursor { from: DeviceTime(0), to: Some(oldest.time), curve: Curve::Edge(oldest) },
            None => Cursor::default(),
        }
    }
}

fn interval(left: Sample, right: Sample, outer: Option<(Sample, Sample)>, limits: &Limits) -> Curve {
    if right.time.since(left.time) > i64::from(limits.max_gap_us) {
        return Curve::Gap(left, right);
    }
    let flags = left.flags | right.flags;
    if let Some((before, after)) = outer {
        let nodes = [before, left, right, after].map(|sample| (sample.time, sample.roll));
        if let Some(cubic) = Cubic::through(&nodes) {
            return Curve::Cubic(cubic, flags);
        }
    }
    Curve::Line(left, right, flags)
}

/// Roll over the interval that was asked for last: 34 knots of a scan fall into three or four of them.
#[derive(Clone, Copy, Debug, Default)]
struct Cursor {
    from: DeviceTime,
    to: Option<DeviceTime>,
    curve: Curve,
}

#[derive(Clone, Copy, Debug, Default)]
enum Curve {
    #[default]
    Nothing,
    Edge(Sample),
    Gap(Sample, Sample),
    Line(Sample, Sample, u16),
    Cubic(Cubic, u16),
}

impl Cursor {
    fn holds(&self, time: DeviceTime) -> bool {
        !matches!(self.curve, Curve::Nothing) && time >= self.from && self.to.is_none_or(|to| time < to)
    }

    fn roll(&self, time: DeviceTime, limits: &Limits) -> (Angle, u16) {
        match self.curve {
            Curve::Nothing => (Angle::ZERO, flags::NO_ATTITUDE),
            Curve::Edge(sample) => held(&sample, time, limits),
            Curve::Gap(left, right) => {
                let nearest = if time.since(left.time) <= right.time.since(time) { left } else { right };
                held(&nearest, time, limits)
            }
            Curve::Line(left, right, flags) => (line(&left, &right, time), flags),
            Curve::Cubic(cubic, flags) => (cubic.at(time), flags),
        }
    }
}

fn held(sample: &Sample, time: DeviceTime, limits: &Limits) -> (Angle, u16) {
    let distance = time.since(sample.time);
    if distance == 0 {
        (sample.roll, sample.flags)
    } else if distance.unsigned_abs() <= u64::from(limits.hold_us) {
        (sample.roll, sample.flags | flags::ATTITUDE_HELD)
    } else {
        (Angle::ZERO, flags::NO_ATTITUDE)
    }
}

/// Linear interpolation, rounded down: |difference| < 2^31 and the gap is below 2^32 us, so the product fits 64 bits.
fn line(left: &Sample, right: &Sample, time: DeviceTime) -> Angle {
    let gap = right.time.since(left.time).max(1);
    let difference = i64::from((right.roll - left.roll).0);
    Angle(left.roll.0.wrapping_add((difference * time.since(left.time)).div_euclid(gap) as i32))
}

/// The flags of a pose by its INS status, or `None` where it must not be used.
fn usability(status: u8) -> Option<u16> {
    match Quality::of(status) {
        Quality::Good => Some(0),
        Quality::Degraded => Some(flags::ATTITUDE_DEGRADED),
        Quality::Aligning | Quality::Unusable => None,
    }
}

#[cfg(test)]
mod tests;
