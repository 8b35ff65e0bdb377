//! The rock test on the road: the vehicle stands on level ground and is rocked; from what comes meanwhile follow the scanner's mounting
//! offset and delay ([`calibrate`](crate::calibrate)).

use crossfall_core::protocol::Config;
use crossfall_core::protocol::message::Pose;
use crossfall_core::scan::RawScan;
use crossfall_core::sensors::novatel::Quality;
use serde::Serialize;

use crate::calibrate::{Drive, Estimate, Gatherer};
use crate::statistics::{deviation, rms};

/// The most that is kept: two minutes at 37.5 scans a second.
const MOST_SCANS: usize = 4_500;

/// Shortest test that is worth an estimate, in scans: ten seconds.
pub const LEAST_SCANS: usize = 375;

/// What viewers are told of it.
#[derive(Clone, Debug, Default, Serialize)]
pub struct RockTest {
    /// Whether it is under way.
    pub running: bool,
    /// Whether an estimate is being made.
    pub estimating: bool,
    /// Scans so far.
    pub scans: usize,
    /// Scans that are enough for an estimate.
    pub enough: usize,
    /// Roll rate by the unit, root mean square over the last seconds, in degrees a second: how well the vehicle is rocked.
    pub roll_rate_deg_s: f64,
    /// Tilt of the levelled road, its mean and its standard deviation over the last seconds, in degrees: what the test is to make small.
    pub residual_deg: Option<(f64, f64)>,
    /// The answer.
    pub estimate: Option<Estimate>,
    /// Why there is none.
    pub refusal: Option<String>,
}

/// What a test has gathered.
#[derive(Debug)]
pub struct Gathering {
    gatherer: Gatherer,
    residuals: Vec<f64>,
    rates: Vec<f64>,
    last_roll: Option<(f64, f64)>,
}

/// Scans that "the last seconds" are.
const LATELY: usize = 150;

impl Gathering {
    /// Begins with the configuration in force.
    #[must_use]
    pub fn new(config: Config) -> Self {
        Self { gatherer: Gatherer::new(config, MOST_SCANS), residuals: Vec::new(), rates: Vec::new(), last_roll: None }
    }

    /// The next scan.
    pub fn scan(&mut self, scan: &RawScan) {
        self.gatherer.scan(scan);
    }

    /// The next pose.
    pub fn pose(&mut self, pose: &Pose) {
        self.gatherer.pose(pose);
        if !Quality::of(pose.status).has_attitude() {
            self.last_roll = None;
            return;
        }
        let now = (pose.time.0 as f64 * 1e-6, crate::units::degrees(pose.roll));
        if let Some((time, roll)) = self.last_roll.replace(now)
            && now.0 > time
        {
            self.rates.push((now.1 - roll) / (now.0 - time));
            keep_last(&mut self.rates, 4 * LATELY);
        }
    }

    /// The tilt of the levelled road in the next profile, in degrees to the left.
    pub fn residual(&mut self, degrees: f64) {
        self.residuals.push(degrees);
        keep_last(&mut self.residuals, LATELY);
    }

    /// What to tell.
    #[must_use]
    pub fn told(&self) -> RockTest {
        let count = self.residuals.len() as f64;
        let mean = self.residuals.iter().sum::<f64>() / count;
        RockTest {
            running: true,
            scans: self.gatherer.scans(),
            enough: LEAST_SCANS,
            roll_rate_deg_s: rms(self.rates.iter().copied()),
            residual_deg: (count > 0.0).then(|| (mean, deviation(self.residuals.iter().copied()))),
            ..RockTest::default()
        }
    }

    /// What has been gathered.
    #[must_use]
    pub fn into_drive(self) -> Drive {
        self.gatherer.into_drive()
    }
}

fn keep_last(values: &mut Vec<f64>, most: usize) {
    if values.len() >= 2 * most {
        values.drain(..values.len() - most);
    }
}
