//! Two attitude sources on one drive: does a unit inside the vehicle measure what one on the scanner does? (The median-slope paper's figure 2.)
//!
//! Both units' bytes go through the board's own decoder and are timed by the same pulses. The second unit's angles are brought to
//! the instants of the first one's poses by a cubic through the four around each.

use std::path::Path;

use crossfall_core::instrument::{Decode, Event, Identity, Line};
use crossfall_core::protocol::message::{Message, Pose};
use crossfall_core::protocol::{Config, DeviceTime};
use crossfall_core::sensors::novatel::Quality;
use serde::Serialize;

use crate::calibrate::statistics::{HighPass, Residual, regress};
use crate::capture::{Channel, Reader};
use crate::container::Error;
use crate::geodesy::turned_deg;
use crate::plot::{self, Courses, Theme};
use crate::statistics::deviation;
use crate::track::{Order, Sequence};
use crate::units::degrees;

/// Poses further apart than this are not interpolated between, in microseconds.
const LONGEST_GAP_US: i64 = 110_000;

/// How two units agree in one angle.
#[derive(Clone, Copy, Debug, Default, Serialize)]
pub struct Difference {
    /// Mean of the second less the first, in degrees: how differently they are mounted.
    pub mean_deg: f64,
    /// Root mean square about that mean.
    pub rms_deg: f64,
    /// The greatest distance from that mean.
    pub most_deg: f64,
}

/// Two units on one drive.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Comparison {
    /// Instants that were compared.
    pub poses: usize,
    /// Roll.
    pub roll: Difference,
    /// Pitch.
    pub pitch: Difference,
    /// How much later the second unit's roll follows, in microseconds, and its standard error; absent when the vehicle hardly rolled.
    pub lag_us: Option<f64>,
    /// See `lag_us`.
    pub lag_se_us: Option<f64>,
    /// Poses of either unit that no pulse has timed; they are left out.
    pub untimed: usize,
    /// Poses of either unit that say themselves that they have no attitude, as of a unit that aligns; they are left out.
    pub unusable: usize,
    /// Damage of the capture, in words.
    pub damage: Vec<String>,
    /// The course of the drive, for the picture.
    #[serde(skip)]
    pub samples: Vec<Sample>,
}

/// One instant.
#[derive(Clone, Copy, Debug)]
pub struct Sample {
    /// Seconds since the first.
    pub seconds: f64,
    /// Roll by the first unit, in degrees.
    pub first_deg: f64,
    /// Roll by the second.
    pub second_deg: f64,
}

impl Comparison {
    /// How both units agree in roll, in words.
    #[must_use]
    pub fn said(&self) -> String {
        let Difference { mean_deg, rms_deg, .. } = self.roll;
        format!("difference: mean {mean_deg:.3}\u{b0}, RMS about it {rms_deg:.3}\u{b0}")
    }

    /// Draws both units' roll and their difference as SVG, under a title and a line of the caller's.
    ///
    /// # Errors
    /// When the drawing library fails.
    pub fn picture(&self, title: &str, note: &str, theme: Theme) -> Result<String, plot::Error> {
        let first: Vec<_> = self.samples.iter().map(|s| (s.seconds, s.first_deg)).collect();
        let second: Vec<_> = self.samples.iter().step_by(10).map(|s| (s.seconds, s.second_deg)).collect();
        let left: Vec<_> = self.samples.iter().map(|s| (s.seconds, s.second_deg - s.first_deg)).collect();
        let courses = Courses {
            title,
            note: &note.replace('-', "\u{2212}"),
            first: ("unit in the vehicle", &first),
            second: ("unit on the scanner", &second),
            shown_s: (0.0, left.last().map_or(1.0, |at| at.0).min(SHOWN_S)),
            before: None,
            left: ("second less first, the whole drive", &left),
            left_axis: "difference, \u{b0}",
        };
        plot::courses(&courses, theme)
    }
}

/// The most of the courses that is shown, in seconds.
const SHOWN_S: f64 = 20.0;

/// A lag with a greater standard error is not told, in microseconds.
const MAX_LAG_SE_US: f64 = 5_000.0;

/// Compares the units of the channels `ins` and `ins2`.
///
/// # Errors
/// When the capture cannot be read or has no second unit.
pub fn compare(path: &Path) -> Result<Comparison, Error> {
    let capture = Reader::open(path)?;
    capture.require(Channel::Ins)?;
    capture.require(Channel::Ins2)?;
    let mut units = [Unit::default(), Unit::default()];
    let mut damage = Vec::new();
    for chunk in capture {
        match chunk {
            Ok(chunk) => {
                let at_ns = chunk.device_time_ns;
                match chunk.channel {
                    Channel::Ins => units[0].bytes(at_ns, &chunk.data),
                    Channel::Ins2 => units[1].bytes(at_ns, &chunk.data),
                    Channel::Pps => units.iter_mut().for_each(|unit| unit.pulse(at_ns)),
                    Channel::Lidar => {}
                }
            }
            Err(Error::Interrupted) => return Err(Error::Interrupted),
            Err(error) => damage.push(error.to_string()),
        }
    }
    let [first, second] = &units;
    Ok(Comparison { damage, ..hold(first, second) })
}

/// A unit's line and what came of it.
struct Unit {
    decode: Decode,
    line: Line,
    poses: Poses,
}

/// The poses of a unit that can be held against another's.
#[derive(Default)]
struct Poses {
    /// In the order of their times.
    kept: Vec<Pose>,
    sequence: Sequence,
    untimed: usize,
    unusable: usize,
}

impl Default for Unit {
    fn default() -> Self {
        let config = Config::default();
        let decode = Decode::new(config, Identity::default());
        Self { decode, line: Line::new(config.ins.baud), poses: Poses::default() }
    }
}

impl Unit {
    fn bytes(&mut self, at_ns: u64, bytes: &[u8]) {
        let Self { decode, line, poses } = self;
        for &byte in bytes {
            let arrival = DeviceTime(line.take(at_ns) / 1_000);
            decode.ins_byte(byte, arrival, &mut |event| poses.take(&event));
        }
    }

    fn pulse(&mut self, at_ns: u64) {
        self.decode.pulse(DeviceTime(at_ns / 1_000), &mut |_| ());
    }
}

impl Poses {
    /// Keeps poses that a pulse has timed, that have an attitude and that go on in time.
    fn take(&mut self, event: &Event<'_>) {
        let Event::Message(Message::Pose(pose)) = event else { return };
        if !pose.timed_by_pulse {
            self.untimed += 1;
        } else if !Quality::of(pose.status).has_attitude() {
            self.unusable += 1;
        } else {
            match self.sequence.order(self.kept.last().map(|last| last.time), pose.time) {
                Order::Next => {}
                Order::Late => return,
                Order::FallenBack => self.kept.truncate(self.kept.partition_point(|kept| kept.time < pose.time)),
            }
            self.kept.push(*pose);
        }
    }
}

fn hold(first: &Unit, second: &Unit) -> Comparison {
    let (mut roll, mut pitch, mut samples) = (Vec::new(), Vec::new(), Vec::new());
    let mut residuals = Vec::new();
    let (own, others) = (&first.poses.kept, &second.poses.kept);
    let start = own.first().map_or(0.0, seconds);
    for (i, pose) in own.iter().enumerate() {
        let Some(other_roll) = at(others, pose.time, |pose| degrees(pose.roll)) else { continue };
        let Some(other_pitch) = at(others, pose.time, |pose| degrees(pose.pitch)) else { continue };
        let own_roll = degrees(pose.roll);
        roll.push(turned_deg(own_roll, other_roll));
        pitch.push(turned_deg(degrees(pose.pitch), other_pitch));
        let seconds = seconds(pose) - start;
        samples.push(Sample { seconds, first_deg: own_roll, second_deg: own_roll + turned_deg(own_roll, other_roll) });
        // What a later second unit does to the difference: minus the roll rate for every microsecond.
        let neighbours = i.checked_sub(1).and_then(|before| Some((own.get(before)?, own.get(i + 1)?)));
        if let Some((before, after)) = neighbours {
            let step_us = after.time.since(before.time) as f64;
            let rate_deg_us = turned_deg(degrees(before.roll), degrees(after.roll)) / step_us;
            let slope_deg = turned_deg(own_roll, other_roll);
            residuals.push(Residual { seconds, slope_deg, rate_deg_us, ..Residual::default() });
        }
    }
    let lag = regress(&residuals, HighPass::GENTLE);
    let told = !residuals.is_empty() && lag.slope_se <= MAX_LAG_SE_US;
    Comparison {
        poses: roll.len(),
        roll: Difference::of(&roll),
        pitch: Difference::of(&pitch),
        lag_us: told.then_some(lag.slope),
        lag_se_us: told.then_some(lag.slope_se),
        untimed: first.poses.untimed + second.poses.untimed,
        unusable: first.poses.unusable + second.poses.unusable,
        damage: Vec::new(),
        samples,
    }
}

impl Difference {
    fn of(values: &[f64]) -> Self {
        let count = values.len().max(1) as f64;
        let mean_deg = values.iter().sum::<f64>() / count;
        Self {
            mean_deg,
            rms_deg: deviation(values.iter().copied()),
            most_deg: values.iter().map(|value| (value - mean_deg).abs()).fold(0.0, f64::max),
        }
    }
}

fn seconds(pose: &Pose) -> f64 {
    pose.time.0 as f64 * 1e-6
}

/// An angle of a unit at an instant, by Lagrange's cubic through the four poses around it.
fn at(poses: &[Pose], time: DeviceTime, angle: fn(&Pose) -> f64) -> Option<f64> {
    let after = poses.partition_point(|pose| pose.time < time);
    let around = poses.get(after.checked_sub(2)?..after + 2)?;
    if around.windows(2).any(|pair| pair[1].time.since(pair[0].time) > LONGEST_GAP_US) {
        return None;
    }
    let nodes: Vec<(f64, f64)> =
        around.iter().map(|pose| (pose.time.since(time) as f64, turned_deg(angle(&around[1]), angle(pose)))).collect();
    let sum: f64 = nodes
        .iter()
        .enumerate()
        .map(|(i, (at, value))| {
            let others = nodes.iter().enumerate().filter(|(j, _)| *j != i);
            value * others.map(|(_, (other, _))| -other / (at - other)).product::<f64>()
        })
        .sum();
    Some(angle(&around[1]) + sum)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crossfall_core::protocol::Angle;

    fn pose(ms: u64, status: u8) -> Pose {
        let roll = if status == 1 { Angle::ZERO } else { crate::units::angle_of(1.5) };
        Pose {
            time: DeviceTime(ms * 1_000),
            latency_us: 0,
            timed_by_pulse: true,
            gps_week: 2_400,
            gps_us: ms * 1_000,
            roll,
            pitch: Angle::ZERO,
            azimuth: Angle::ZERO,
            fix: None,
            status,
        }
    }

    #[test]
    fn neither_a_unit_that_aligns_nor_a_stray_time_is_compared() {
        let mut units = [Unit::default(), Unit::default()];
        for ms in (0..10_000).step_by(10) {
            for (number, unit) in units.iter_mut().enumerate() {
                let status = if number == 1 && ms < 2_000 { 1 } else { 3 };
                let stray = if number == 1 && ms == 5_000 { 100_000 } else { 0 };
                unit.poses.take(&Event::Message(Message::Pose(pose(ms + stray, status))));
            }
        }
        let found = hold(&units[0], &units[1]);
        assert_eq!((found.unusable, found.untimed), (200, 0));
        assert!((780..800).contains(&found.poses), "{}", found.poses);
        assert!(found.roll.most_deg < 1e-6 && found.roll.mean_deg.abs() < 1e-6, "{:?}", found.roll);
    }
}
