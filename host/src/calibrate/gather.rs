//! What of a log, or of a drive that is under way, a calibration rests on: scans of one boot of the board, and the poses near them.
//!
//! A board that boots begins its time again, so that scans and poses of two boots must never meet. Poses without a scan near them say
//! nothing here (where the vehicle stood before the scanner spoke, whether it drove on afterwards), and are let go as they come: memory
//! is bounded by the number of scans.

use std::collections::VecDeque;
use std::mem;

use crossfall_core::protocol::message::Pose;
use crossfall_core::protocol::{Config, DeviceTime};
use crossfall_core::scan::RawScan;

use super::Drive;

/// Poses further from a scan than this are of no use to it: the delays that are tried are a fifth of it at most. In microseconds.
const NEAR_US: i64 = 1_000_000;

/// Gathers the scans of one boot and the poses near them.
#[derive(Debug)]
pub struct Gatherer {
    drive: Drive,
    /// Poses since the last scan that are not near it; near the next one, perhaps.
    waiting: VecDeque<Pose>,
    most: usize,
    /// Whether there was a scan more than are taken.
    beyond: bool,
    /// Whether nothing that comes can be near a scan that is taken.
    full: bool,
}

impl Gatherer {
    /// Takes the first `most` scans. The configuration is the one in force so far.
    #[must_use]
    pub fn new(config: Config, most: usize) -> Self {
        let drive = Drive { config, ..Drive::default() };
        Self { drive, waiting: VecDeque::new(), most, beyond: false, full: false }
    }

    /// A configuration is in force.
    pub fn configure(&mut self, config: Config) {
        self.drive.config = config;
    }

    /// Scans so far.
    #[must_use]
    pub fn scans(&self) -> usize {
        self.drive.scans.len()
    }

    /// The next scan.
    pub fn scan(&mut self, scan: &RawScan) {
        if self.drive.scans.len() == self.most {
            self.beyond = true;
            self.full |= self.us_since_scan(scan.stx) > Some(NEAR_US);
            return;
        }
        self.drive.poses.extend(self.waiting.drain(..));
        self.drive.scans.push(scan.clone());
    }

    /// The next pose.
    pub fn pose(&mut self, pose: &Pose) {
        if self.us_since_scan(pose.time).is_some_and(|us| us <= NEAR_US) {
            self.drive.poses.push(*pose);
        } else if self.drive.scans.len() == self.most {
            self.full = true;
        } else {
            while self.waiting.front().is_some_and(|first| pose.time.since(first.time) > NEAR_US) {
                self.waiting.pop_front();
            }
            self.waiting.push_back(*pose);
        }
    }

    /// Whether nothing that comes can be of use any more, and something came that was not.
    #[must_use]
    pub fn is_full(&self) -> bool {
        self.beyond && self.full
    }

    /// Whether a time is one of another boot, because it lies before those of the scans.
    #[must_use]
    pub fn is_behind(&self, time: DeviceTime) -> bool {
        self.us_since_scan(time).is_some_and(|us| us < -NEAR_US)
    }

    fn us_since_scan(&self, time: DeviceTime) -> Option<i64> {
        self.drive.scans.last().map(|scan| time.since(scan.stx))
    }

    /// The board has booted: what there is so far, and this begins anew.
    pub fn restart(&mut self) -> Drive {
        let next = Self::new(self.drive.config, self.most);
        mem::replace(self, next).into_drive()
    }

    /// What has been gathered.
    #[must_use]
    pub fn into_drive(self) -> Drive {
        let mut drive = self.drive;
        if let (true, [first, .., last]) = (self.beyond, drive.scans.as_slice()) {
            let minutes = last.stx.since(first.stx) as f64 * 1e-6 / 60.0;
            drive.left_out.push(format!("only the first {} scans ({minutes:.0} minutes) were used", self.most));
        }
        drive
    }
}
