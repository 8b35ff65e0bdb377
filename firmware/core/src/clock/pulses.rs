//! Which edges are pulses per second, how many seconds lie between them, and how fast the device clock runs.
//!
//! A pulse belongs to the train when it lies a whole number of seconds after the last one. Until a rate is known the device clock
//! may be off by [`MAX_DRIFT`] (an RC oscillator); afterwards by 20 us and 20 ppm against what the train predicts.
//! A missing pulse only makes the number of seconds larger. A doubled or spurious one is not used. When the train itself turns out
//! to be wrong (it began with a spurious edge, or the receiver moved its second), edges that agree with each other but not with
//! the train take over: two of them against a train of one, three otherwise, with no accepted pulse in between.

use crossfall_protocol::DeviceTime;
use crossfall_protocol::message::PulseVerdict;

use super::SECOND_US;

/// Pulses that the rate is taken over.
pub const WINDOW: usize = 16;

/// The fastest or slowest device clock that is believed: one part in 64 (an RC oscillator is good to one in 100).
pub const MAX_DRIFT: i64 = 64;

/// What remains of a pulse's jitter and the rounding of its stamp.
const JITTER_US: i64 = 20;

/// How far the rate may have wandered since it was taken, in parts per million.
const WANDER_PPM: i64 = 20;

/// A pulse and the number of its second within the train.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
struct Tick {
    time: DeviceTime,
    second: i64,
}

/// The train of accepted pulses.
#[derive(Clone, Debug, Default)]
pub struct PulseTrain {
    ticks: heapless::Deque<Tick, WINDOW>,
    rivals: heapless::Vec<DeviceTime, 3>,
}

impl PulseTrain {
    /// Judges one edge. [`PulseVerdict::Restarted`] means that seconds are counted anew from this edge.
    pub fn edge(&mut self, time: DeviceTime) -> PulseVerdict {
        let Some(&last) = self.ticks.back() else {
            self.restart(&[time]);
            return PulseVerdict::Restarted;
        };
        if let Some(seconds) = self.seconds_between(last.time, time) {
            self.append(Tick { time, second: last.second.saturating_add(seconds) });
            self.rivals.clear();
            return PulseVerdict::Accepted;
        }
        if self.rivals.last().is_some_and(|&rival| whole_seconds(time.since(rival), None).is_none()) {
            self.rivals.clear();
        }
        // Never full: at most two rivals remain after the check below.
        let _ = self.rivals.push(time);
        let enough = if self.ticks.len() == 1 { 2 } else { 3 };
        if self.rivals.len() < enough {
            return PulseVerdict::Spurious;
        }
        let rivals = core::mem::take(&mut self.rivals);
        self.restart(&rivals);
        PulseVerdict::Restarted
    }

    /// Device time of the newest pulse and the number of its second in the train.
    #[must_use]
    pub fn newest(&self) -> Option<(DeviceTime, i64)> {
        self.ticks.back().map(|tick| (tick.time, tick.second))
    }

    /// Pulses that the rate rests on.
    #[must_use]
    pub fn len(&self) -> usize {
        self.ticks.len()
    }

    /// Whether there has been no pulse yet.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.ticks.is_empty()
    }

    /// How fast the device clock runs against the pulses, in parts per 2^32 (positive = fast), rounded to nearest; 0 before
    /// there are two. Within +/-2^26 by [`MAX_DRIFT`].
    #[must_use]
    pub fn drift(&self) -> i32 {
        let (Some(first), Some(last)) = (self.ticks.front(), self.ticks.back()) else { return 0 };
        let true_us = last.second.saturating_sub(first.second).saturating_mul(SECOND_US);
        if true_us <= 0 {
            return 0;
        }
        // The window spans at most an hour and every pulse in it lies within 1/64 of its second: the excess is below 2^26 us,
        // the clamp never acts, and the shifted sum stays below 2^59.
        let excess = (last.time.since(first.time).saturating_sub(true_us)).clamp(-(1 << 26), 1 << 26);
        (((excess << 32) + true_us / 2 * excess.signum()) / true_us) as i32
    }

    fn seconds_between(&self, earlier: DeviceTime, later: DeviceTime) -> Option<i64> {
        whole_seconds(later.since(earlier), (self.ticks.len() > 1).then(|| i64::from(self.drift())))
    }

    fn append(&mut self, tick: Tick) {
        // After an hour without pulses the old ones say nothing about the rate of today.
        while self.ticks.front().is_some_and(|oldest| tick.second - oldest.second > 3_600) || self.ticks.is_full() {
            self.ticks.pop_front();
        }
        let _ = self.ticks.push_back(tick);
    }

    fn restart(&mut self, times: &[DeviceTime]) {
        self.ticks.clear();
        self.rivals.clear();
        let mut second = 0i64;
        let mut previous = None;
        for &time in times {
            if let Some(before) = previous {
                second += whole_seconds(time.since(before), None).unwrap_or(1);
            }
            self.append(Tick { time, second });
            previous = Some(time);
        }
    }
}

/// The number of whole seconds that an interval of the device clock stands for, if it stands for any.
fn whole_seconds(interval_us: i64, drift: Option<i64>) -> Option<i64> {
    // Past a day the tolerance would swallow half a second: no interval is whole any more.
    if !(SECOND_US / 2..86_400 * SECOND_US).contains(&interval_us) {
        return None;
    }
    let (period_us, tolerance_ppm) = match drift {
        Some(drift) => (SECOND_US + ((SECOND_US * drift) >> 32), WANDER_PPM),
        None => (SECOND_US, 1_000_000 / MAX_DRIFT),
    };
    // Never below 984,375 by `MAX_DRIFT`; said so that no division by zero is left for the compiler to see.
    let period_us = period_us.max(1);
    let seconds = (interval_us + period_us / 2) / period_us;
    let expected_us = match drift {
        Some(drift) => seconds * SECOND_US + ((seconds * SECOND_US * drift) >> 32),
        None => seconds * SECOND_US,
    };
    let tolerance_us = JITTER_US + seconds * tolerance_ppm;
    let plain = tolerance_us < SECOND_US / 4 && (interval_us - expected_us).abs() <= tolerance_us;
    (seconds > 0 && plain).then_some(seconds)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A device clock 23 ppm fast that boots 0.4 s before the first pulse.
    fn at(second: i64) -> DeviceTime {
        DeviceTime((400_000 + second * 1_000_023) as u64)
    }

    fn train(edges: impl IntoIterator<Item = DeviceTime>) -> (PulseTrain, heapless::Vec<PulseVerdict, 64>) {
        let mut train = PulseTrain::default();
        let verdicts = edges.into_iter().map(|edge| train.edge(edge)).collect();
        (train, verdicts)
    }

    fn drift_ppm(train: &PulseTrain) -> f64 {
        f64::from(train.drift()) / 4294.967296
    }

    #[test]
    fn learns_the_rate_of_the_device_clock() {
        let (train, verdicts) = train((0..30).map(at));
        assert_eq!(verdicts[0], PulseVerdict::Restarted);
        assert!(verdicts[1..].iter().all(|&v| v == PulseVerdict::Accepted));
        assert!((drift_ppm(&train) - 23.0).abs() < 0.001, "{}", drift_ppm(&train));
        assert_eq!(train.newest(), Some((at(29), 29)));
    }

    #[test]
    fn counts_seconds_across_missing_pulses() {
        let (train, verdicts) = train([0, 1, 2, 5, 6, 66].map(at));
        assert_eq!(verdicts.last(), Some(&PulseVerdict::Accepted));
        assert_eq!(train.newest(), Some((at(66), 66)));
    }

    #[test]
    fn a_doubled_pulse_is_spurious_every_time() {
        let edges = (0..20).flat_map(|s| [at(s), at(s).offset(1_000)]);
        let (train, verdicts) = train(edges);
        for pair in verdicts[2..].chunks(2) {
            assert_eq!(pair, [PulseVerdict::Accepted, PulseVerdict::Spurious]);
        }
        assert_eq!(train.newest(), Some((at(19), 19)));
    }

    #[test]
    fn a_spurious_first_edge_is_outvoted_by_two_good_ones() {
        let edges = [at(0).offset(-300_000), at(0), at(1), at(2), at(3)];
        let (train, verdicts) = train(edges);
        use PulseVerdict::{Accepted, Restarted, Spurious};
        assert_eq!(verdicts, [Restarted, Spurious, Restarted, Accepted, Accepted]);
        assert_eq!(train.newest(), Some((at(3), 3)));
        assert!((drift_ppm(&train) - 23.0).abs() < 1.0);
    }

    #[test]
    fn three_agreeing_edges_move_an_established_train() {
        let shift = 250_000;
        let edges = (0..10).map(at).chain((10..15).map(|s| at(s).offset(shift)));
        let (train, verdicts) = train(edges);
        use PulseVerdict::{Accepted, Restarted, Spurious};
        assert_eq!(verdicts[10..], [Spurious, Spurious, Restarted, Accepted, Accepted]);
        assert_eq!(train.newest().map(|(time, _)| time), Some(at(14).offset(shift)));
    }

    #[test]
    fn an_rc_oscillator_one_percent_off_is_followed() {
        let (train, verdicts) = train((0..20).map(|s| DeviceTime((500_000 + s * 1_010_000) as u64)));
        assert!(verdicts[1..].iter().all(|&v| v == PulseVerdict::Accepted));
        assert!((drift_ppm(&train) - 10_000.0).abs() < 0.01);
    }

    #[test]
    fn noise_alone_makes_no_train() {
        let mut state = 7u64;
        let mut time = 0u64;
        let mut train = PulseTrain::default();
        for _ in 0..2_000 {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            time += 1_000 + (state >> 33) % 400_000;
            train.edge(DeviceTime(time));
        }
        // Chance pairs may restart it, but nothing that looks like an established rate survives.
        assert!(train.len() < WINDOW, "{}", train.len());
    }
}
