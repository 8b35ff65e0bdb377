//! The survey layer: scans, poses and configurations in, profiles out.
//!
//! Its input is exactly what is streamed and logged, in the same order, and nothing else enters: no clock, no counter, no sensor byte.
//! So a host that feeds a log to a [`Survey`] of its own gets every profile back bit for bit.
//!
//! A scan waits until two poses lie beyond its last beam, which is what the attitude's cubic needs and all that it needs. Up to
//! [`WAITING`] scans wait: 213 ms at 37.5 scans a second, more than any latency that SPAN units have shown; 160 and 80 ms at the 50 and 100 a second of other
//! scanners, less than the worst. When another comes, or the survey stops, the oldest is measured with the attitude there is and flagged accordingly.

use crossfall_protocol::Config;
use crossfall_protocol::message::{Message, Profile, Session};

use super::Event;
use super::waiting::Waiting;
use crate::attitude::History;
use crate::profile;
use crate::scan::{KNOTS, RollTrack};

/// Scans that may wait for their attitude.
pub const WAITING: usize = 8;

/// The survey layer of one instrument. Its size is constant and holds no references.
#[derive(Debug)]
pub struct Survey {
    config: Config,
    running: bool,
    history: History,
    waiting: Waiting,
    work: profile::Workspace,
}

impl Default for Survey {
    fn default() -> Self {
        Self::new()
    }
}

impl Survey {
    /// A survey that waits for [`Session::Started`].
    #[must_use]
    pub fn new() -> Self {
        Self {
            config: Config::default(),
            running: false,
            history: History::default(),
            waiting: Waiting::new(),
            work: profile::Workspace::new(),
        }
    }

    /// Takes one event in the order of the stream; those that are no input of the survey change nothing.
    pub fn take(&mut self, event: &Event<'_>, out: &mut impl FnMut(Profile)) {
        if let Some(profile) = self.accept(event) {
            out(profile);
        }
        while let Some(profile) = self.next_profile() {
            out(profile);
        }
    }

    /// The same for one who takes profiles singly: the profile that the event pushes out, if it does. [`Survey::next_profile`] is then to be called
    /// until it has no more, before the next event.
    #[must_use]
    pub fn accept(&mut self, event: &Event<'_>) -> Option<Profile> {
        match event {
            Event::Scan(scan) if self.running => {
                let pushed_out = if self.waiting.is_full() { self.measure_oldest() } else { None };
                self.waiting.push(scan);
                return pushed_out;
            }
            Event::Message(Message::Pose(pose)) => self.history.push(pose),
            Event::Message(Message::Config(config)) => self.config = *config,
            Event::Message(Message::Session(Session::Started(_))) => {
                self.history.clear();
                self.waiting.clear();
                self.running = true;
            }
            Event::Message(Message::Session(Session::Stopped(_))) => self.running = false,
            Event::Scan(_) | Event::Message(_) => {}
        }
        None
    }

    /// The profile of the oldest scan, if its attitude is there or nothing more is to come.
    #[must_use]
    pub fn next_profile(&mut self) -> Option<Profile> {
        let scan = self.waiting.oldest()?;
        if self.running {
            let start = scan.start(self.config.scanner.delay_us);
            let last_knot_us = RollTrack::knot_ns(scan, scan.turns() - 1, KNOTS - 1) / 1_000;
            if !self.history.covers(start.offset(i64::from(last_knot_us))) {
                return None;
            }
        }
        self.measure_oldest()
    }

    /// Whether it is between a start and a stop.
    #[must_use]
    pub fn is_running(&self) -> bool {
        self.running
    }

    /// Scans that wait for their attitude.
    #[must_use]
    pub fn waiting(&self) -> usize {
        self.waiting.len()
    }

    fn measure_oldest(&mut self) -> Option<Profile> {
        let scan = self.waiting.oldest()?;
        let time = scan.start(self.config.scanner.delay_us);
        let roll = self.history.over_scan(scan, time, &self.config.attitude);
        let (left, right, mut flags) = profile::measure(scan, &roll.track, &self.config, &mut self.work);
        flags |= roll.flags;
        let (scan, method) = (scan.index, self.config.survey.method);
        self.waiting.drop_oldest();
        Some(Profile { scan, time, method, flags, roll: roll.nadir, left, right })
    }
}
