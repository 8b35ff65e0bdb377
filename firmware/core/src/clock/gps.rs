//! Device time to GPS time and back: pulses mark the seconds, poses name them.
//!
//! A pose that is valid at GPS time g arrives between 10 and 170 ms later (measured on recordings). If its first byte arrives
//! e after a pulse, that pulse's second is the smallest whole second not before g - e: right for every latency from -2 ms to 998 ms.
//! Three poses that agree name the train; eight in a row that disagree rename it.

use crossfall_protocol::DeviceTime;
use crossfall_protocol::message::{ClockState, PulseVerdict};

use super::SECOND_US;
use super::gps_time::GpsTime;
use super::pulses::PulseTrain;

/// A pose may seem to arrive this much before it is valid (rounding of stamps, a clock whose rate is not yet known).
const EARLY_US: i64 = 2_000;

/// Agreeing poses that first name the train, and that rename it.
const NAMING: u8 = 3;
const RENAMING: u8 = 8;

/// How long the mapping is used after its last pulse: a rate that wanders by 1 ppm errs by 0.6 ms then.
const HOLDOVER_US: i64 = 600 * SECOND_US;

/// The mapping.
#[derive(Clone, Debug, Default)]
pub struct GpsClock {
    train: PulseTrain,
    /// GPS time of the train's second 0, in microseconds since its epoch.
    origin_us: Option<i64>,
    rival_us: Option<i64>,
    votes: u8,
}

impl GpsClock {
    /// One edge of the pulse per second.
    pub fn pulse(&mut self, time: DeviceTime) -> PulseVerdict {
        let verdict = self.train.edge(time);
        if verdict == PulseVerdict::Restarted {
            (self.origin_us, self.rival_us, self.votes) = (None, None, 0);
        }
        verdict
    }

    /// A pose that names a GPS time, and when its first byte arrived. True when the train's name has changed by it.
    pub fn name(&mut self, gps: GpsTime, arrival: DeviceTime) -> bool {
        let Some((pulse, second)) = self.train.newest() else { return false };
        let elapsed_us = self.to_gps_interval(arrival.since(pulse));
        if !(-SECOND_US..HOLDOVER_US).contains(&elapsed_us) {
            return false;
        }
        let lower = gps.count_us() - elapsed_us - EARLY_US;
        let pulse_gps = (lower + SECOND_US - 1).div_euclid(SECOND_US) * SECOND_US;
        let origin_us = pulse_gps - second * SECOND_US;
        if self.origin_us == Some(origin_us) {
            (self.rival_us, self.votes) = (None, 0);
            return false;
        }
        self.votes = if self.rival_us == Some(origin_us) { self.votes.saturating_add(1) } else { 1 };
        self.rival_us = Some(origin_us);
        if self.votes < if self.origin_us.is_some() { RENAMING } else { NAMING } {
            return false;
        }
        (self.origin_us, self.rival_us, self.votes) = (Some(origin_us), None, 0);
        true
    }

    /// Device time of a GPS time; `None` while the train has no name or its last pulse is ten minutes past.
    #[must_use]
    pub fn device_time(&self, gps: GpsTime) -> Option<DeviceTime> {
        let (pulse, second) = self.train.newest()?;
        let since_us = gps.count_us().saturating_sub(self.origin_us? + second * SECOND_US);
        if since_us.abs() > HOLDOVER_US {
            return None;
        }
        // |since| < 2^30 and |drift| <= 2^26: exact in 64 bits, rounded down.
        Some(pulse.offset(since_us + ((since_us * i64::from(self.train.drift())) >> 32)))
    }

    /// The mapping as it is streamed; `None` before the first pulse.
    #[must_use]
    pub fn state(&self) -> Option<ClockState> {
        let (anchor, second) = self.train.newest()?;
        Some(ClockState {
            anchor,
            gps: self
                .origin_us
                .map(|origin_us| GpsTime::of_count(origin_us + second * SECOND_US))
                .map(|gps| (gps.week, gps.us)),
            drift: self.train.drift(),
            pulses: self.train.len() as u8,
        })
    }

    /// A device interval in GPS microseconds, to first order in the drift (its square is below 0.25 ms/s).
    fn to_gps_interval(&self, device_us: i64) -> i64 {
        let bounded = device_us.clamp(-(1 << 36), 1 << 36);
        bounded - ((bounded * i64::from(self.train.drift())) >> 32)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const START: GpsTime = GpsTime { week: 2_400, us: 345_600_000_000 };

    /// Device time of a GPS time for a clock that is `ppm` fast and read 1 s at `START`.
    fn device(gps: GpsTime, ppm: f64) -> DeviceTime {
        let since = gps.since(START) as f64;
        DeviceTime((1e6 + since * (1.0 + ppm * 1e-6)).round() as u64)
    }

    #[test]
    fn unnamed_until_three_poses_agree() {
        let mut clock = GpsClock::default();
        clock.pulse(device(START, 0.0));
        for i in 1..=3 {
            let gps = START.offset(i * 10_000).unwrap();
            assert_eq!(clock.device_time(gps), None);
            assert_eq!(clock.name(gps, device(gps, 0.0).offset(20_000)), i == 3);
        }
        assert_eq!(clock.device_time(START), Some(device(START, 0.0)));
    }

    proptest! {
        /// Whatever the drift, the latencies and the pulses that are missing or too many: poses get the time they are valid at.
        #[test]
        fn poses_are_timed_by_pulses(
            ppm in -80.0..80.0f64,
            faults in prop::collection::vec(0u8..8, 40),
            latencies in prop::collection::vec(1_000i64..400_000, 400),
        ) {
            let mut clock = GpsClock::default();
            for (second, &fault) in faults.iter().enumerate() {
                let whole = START.offset(second as i64 * SECOND_US).unwrap();
                // The first two are good; later ones may be missing, doubled, or joined by a stray edge.
                let fault = if second < 2 { 7 } else { fault };
                if fault != 0 {
                    clock.pulse(device(whole, ppm));
                }
                if fault == 1 {
                    clock.pulse(device(whole, ppm).offset(300));
                }
                if fault == 2 {
                    clock.pulse(device(whole, ppm).offset(437_000));
                }
                for tenth in 0..10i64 {
                    let gps = whole.offset(450_000 + tenth * 10_000).unwrap();
                    let latency = latencies[(second * 10 + tenth as usize) % latencies.len()];
                    clock.name(gps, device(gps, ppm).offset(latency));
                    if second >= 2 {
                        let mapped = clock.device_time(gps).expect("named");
                        let error = mapped.since(device(gps, ppm));
                        prop_assert!(error.abs() <= 4, "off by {error} us in second {second}");
                    }
                }
            }
        }

        #[test]
        fn any_order_of_calls_is_survived(
            calls in prop::collection::vec((any::<bool>(), any::<u64>(), any::<u16>(), any::<u64>()), 0..200),
        ) {
            let mut clock = GpsClock::default();
            for (pulse, time, week, us) in calls {
                if pulse {
                    clock.pulse(DeviceTime(time));
                } else {
                    clock.name(GpsTime { week, us }, DeviceTime(time));
                }
                let _ = (clock.device_time(GpsTime { week, us }), clock.state());
            }
        }
    }
}
