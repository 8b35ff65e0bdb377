//! What of a log, or of a drive that is under way, a calibration rests on: scans of one boot of the board, and the poses near them.
//!
//! A board that boots begins its time again, so that scans and poses of two boots must never meet. Poses without a scan near them say
//! nothing here (where the vehicle stood before the scanner spoke, whether it drove on afterwards), and are let go as they come: memory
//! is bounded by the number of scans. So are poses of a unit that says itself that it has no attitude: their direction is none.

use std::collections::VecDeque;
use std::mem;

use crossfall_core::protocol::message::Pose;
use crossfall_core::protocol::{Config, DeviceTime};
use crossfall_core::scan::RawScan;
use crossfall_core::sensors::novatel::Quality;

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
    /// Poses without an attitude.
    unusable: u64,
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
        Self { drive, waiting: VecDeque::new(), most, unusable: 0, beyond: false, full: false }
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
        if !Quality::of(pose.status).has_attitude() {
            self.unusable += 1;
            return;
        }
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
        if self.unusable > 0 {
            drive.left_out.push(format!("{} poses of the unit without an attitude were left out", self.unusable));
        }
        drive
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crossfall_core::protocol::Angle;

    fn scan(ms: u64) -> RawScan {
        RawScan { stx: DeviceTime(ms * 1_000), ..RawScan::EMPTY }
    }

    fn pose(ms: u64) -> Pose {
        Pose {
            time: DeviceTime(ms * 1_000),
            latency_us: 0,
            timed_by_pulse: true,
            gps_week: 0,
            gps_us: 0,
            roll: Angle::ZERO,
            pitch: Angle::ZERO,
            azimuth: Angle::ZERO,
            fix: None,
            status: 3,
        }
    }

    /// Poses every 10 ms, scans every 100 ms of these times.
    fn gather(gatherer: &mut Gatherer, scans: impl Fn(u64) -> bool, ms: std::ops::Range<u64>) {
        for now in ms.step_by(10) {
            gatherer.pose(&pose(now));
            if now.is_multiple_of(100) && scans(now) {
                gatherer.scan(&scan(now));
            }
        }
    }

    fn times(drive: &Drive) -> (u64, u64) {
        let at = |pose: Option<&Pose>| pose.unwrap().time.0 / 1_000;
        (at(drive.poses.first()), at(drive.poses.last()))
    }

    #[test]
    fn poses_far_from_every_scan_are_let_go() {
        let mut gatherer = Gatherer::new(Config::default(), 1_000);
        // The scanner speaks from 60 s on, is silent from 70 to 90 s, and ends at 100 s.
        gather(&mut gatherer, |ms| (60_000..70_000).contains(&ms) || (90_000..100_000).contains(&ms), 0..200_000);
        assert!(gatherer.waiting.len() <= 101 && !gatherer.is_full());
        let drive = gatherer.into_drive();
        assert_eq!((drive.scans.len(), times(&drive)), (200, (59_000, 100_900)));
        assert!(drive.poses.iter().all(|pose| !(71_000..89_000).contains(&(pose.time.0 / 1_000))));
        assert!(drive.poses.is_sorted_by_key(|pose| pose.time) && drive.left_out.is_empty());
    }

    #[test]
    fn no_more_is_taken_than_is_used_and_that_is_told() {
        let mut gatherer = Gatherer::new(Config::default(), 600);
        gather(&mut gatherer, |_| true, 0..60_500);
        assert!(!gatherer.is_full(), "poses behind the last scan are wanted still");
        gather(&mut gatherer, |_| true, 60_500..61_500);
        assert!(gatherer.is_full());
        let drive = gatherer.into_drive();
        assert_eq!((drive.scans.len(), times(&drive)), (600, (0, 60_900)));
        assert_eq!(drive.left_out, ["only the first 600 scans (1 minutes) were used"]);
        // As many as are wanted, and no more came: nothing is left out.
        let mut gatherer = Gatherer::new(Config::default(), 600);
        gather(&mut gatherer, |ms| ms < 60_000, 0..70_000);
        assert!(!gatherer.is_full() && gatherer.into_drive().left_out.is_empty());
    }

    #[test]
    fn a_unit_that_aligns_tells_neither_direction_nor_rest() {
        let mut gatherer = Gatherer::new(Config::default(), 1_000);
        for now in (0..30_000).step_by(10) {
            let status = if now < 25_000 { 1 } else { 3 };
            gatherer.pose(&Pose { status, ..pose(now) });
            if now.is_multiple_of(100) {
                gatherer.scan(&scan(now));
            }
        }
        let drive = gatherer.into_drive();
        assert_eq!((drive.scans.len(), times(&drive)), (300, (25_000, 29_990)));
        assert_eq!(drive.left_out, ["2500 poses of the unit without an attitude were left out"]);
    }

    #[test]
    fn a_boot_begins_anew_with_the_configuration_so_far() {
        let mut config = Config::default();
        config.scanner.delay_us = 7;
        let mut gatherer = Gatherer::new(Config::default(), 600);
        gatherer.configure(config);
        gather(&mut gatherer, |_| true, 0..5_000);
        assert!(!gatherer.is_behind(DeviceTime(4_500_000)) && gatherer.is_behind(DeviceTime(20_000)));
        assert_eq!(gatherer.restart().scans.len(), 50);
        assert!(gatherer.scans() == 0 && !gatherer.is_behind(DeviceTime(0)));
        assert_eq!(gatherer.into_drive().config, config);
    }
}
