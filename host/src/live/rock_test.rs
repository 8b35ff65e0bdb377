//! The rock test on the road: the vehicle stands on level ground and is rocked; from what comes meanwhile follow the scanner's mounting
//! offset and delay ([`calibrate`](crate::calibrate)).

use std::sync::mpsc::{Receiver, TryRecvError, channel};
use std::thread;

use crossfall_core::protocol::Config;
use crossfall_core::protocol::message::Pose;
use crossfall_core::scan::RawScan;
use crossfall_core::sensors::novatel::Quality;
use serde::Serialize;

use super::session::RockOrder;
use crate::calibrate::{self, Estimate, Gatherer, Surface};
use crate::statistics::{deviation, rms};

/// The most that is kept: two minutes at 37.5 scans a second.
const MOST_SCANS: usize = 4_500;

/// Shortest test that is worth an estimate, in scans: ten seconds.
const LEAST_SCANS: usize = 375;

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

/// The test under way, or the one before.
#[derive(Default)]
pub struct RockTests(Stage);

#[derive(Default)]
enum Stage {
    #[default]
    None,
    Gathering(Box<Gathering>),
    /// With so many scans.
    Estimating(usize, Receiver<Result<Estimate, String>>),
    Done(Box<RockTest>),
}

impl RockTests {
    /// Does what the operator asks; a test begins with the configuration in force.
    pub fn order(&mut self, order: RockOrder, config: Config) {
        self.0 = match (order, std::mem::take(&mut self.0)) {
            (RockOrder::Begin, _) => Stage::Gathering(Box::new(Gathering::new(config))),
            (RockOrder::End, Stage::Gathering(gathering)) => {
                let scans = gathering.told().scans;
                let (tell, told) = channel();
                // Seconds of work: not here. What cannot be told shows as an estimate that never came.
                let spawned = thread::Builder::new().name("rock test".to_owned()).spawn(move || {
                    let found = calibrate::estimate(&gathering.gatherer.into_drive(), Surface::Assumed);
                    let found = found.map(|(estimate, _)| estimate).map_err(|refusal| refusal.to_string());
                    let _gone = tell.send(found);
                });
                drop(spawned);
                Stage::Estimating(scans, told)
            }
            (RockOrder::End, other) => other,
            (RockOrder::Cancel, _) => Stage::None,
        };
    }

    /// The next scan.
    pub fn scan(&mut self, scan: &RawScan) {
        if let Stage::Gathering(gathering) = &mut self.0 {
            gathering.gatherer.scan(scan);
        }
    }

    /// The next pose.
    pub fn pose(&mut self, pose: &Pose) {
        if let Stage::Gathering(gathering) = &mut self.0 {
            gathering.pose(pose);
        }
    }

    /// The tilt of the levelled road in the next profile, in degrees to the left.
    pub fn residual(&mut self, degrees: f64) {
        if let Stage::Gathering(gathering) = &mut self.0 {
            gathering.residual(degrees);
        }
    }

    /// Time has jumped: no test goes on over that.
    pub fn break_off(&mut self) {
        if matches!(self.0, Stage::Gathering(_)) {
            let refusal = Some("time has jumped, and what came before is of no use: begin the test again".to_owned());
            self.0 = Stage::Done(Box::new(RockTest { refusal, ..RockTest::default() }));
        }
    }

    /// What to tell.
    pub fn told(&mut self) -> Option<RockTest> {
        match &self.0 {
            Stage::None => None,
            Stage::Gathering(gathering) => Some(gathering.told()),
            Stage::Done(test) => Some((**test).clone()),
            Stage::Estimating(scans, told) => {
                let test = RockTest { scans: *scans, ..RockTest::default() };
                let found = match told.try_recv() {
                    Ok(found) => found,
                    Err(TryRecvError::Empty) => return Some(RockTest { estimating: true, ..test }),
                    Err(TryRecvError::Disconnected) => Err("the estimate failed".to_owned()),
                };
                let done = match found {
                    Ok(estimate) => RockTest { estimate: Some(estimate), ..test },
                    Err(refusal) => RockTest { refusal: Some(refusal), ..test },
                };
                self.0 = Stage::Done(Box::new(done.clone()));
                Some(done)
            }
        }
    }
}

/// What a test has gathered.
#[derive(Debug)]
struct Gathering {
    gatherer: Gatherer,
    residuals: Vec<f64>,
    rates: Vec<f64>,
    last_roll: Option<(f64, f64)>,
}

/// Scans that "the last seconds" are.
const LATELY: usize = 150;

impl Gathering {
    fn new(config: Config) -> Self {
        Self { gatherer: Gatherer::new(config, MOST_SCANS), residuals: Vec::new(), rates: Vec::new(), last_roll: None }
    }

    fn pose(&mut self, pose: &Pose) {
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

    fn residual(&mut self, degrees: f64) {
        self.residuals.push(degrees);
        keep_last(&mut self.residuals, LATELY);
    }

    fn told(&self) -> RockTest {
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
}

fn keep_last(values: &mut Vec<f64>, most: usize) {
    if values.len() >= 2 * most {
        values.drain(..values.len() - most);
    }
}
