//! The core once more over what the log holds.

use std::collections::VecDeque;

use crossfall_core::attitude::HISTORY;
use crossfall_core::clock::WINDOW;
use crossfall_core::instrument::{ClockReplay, Event, Survey, WAITING};
use crossfall_core::protocol::message::{Message, Pose, Profile, Pulse, Session, Skip};
use crossfall_core::protocol::{Config, DeviceTime};
use crossfall_core::scan::RawScan;

/// How much must have come since a gap before answers count again.
#[derive(Clone, Copy, Debug, Default)]
struct Unsure {
    poses: usize,
    scans: usize,
    pulses: usize,
    /// Until a configuration has come: nothing says which was in force.
    config: bool,
}

/// The survey layer and the clock of a second instrument.
pub struct Replay {
    survey: Survey,
    clock: ClockReplay,
    expected: VecDeque<Profile>,
    skip: Option<Skip>,
    unsure: Unsure,
    /// Whether it is known that the survey runs or does not run.
    session_known: bool,
    /// Unsure because the log begins in the middle of a session.
    joining: bool,
    /// Profiles that came out the same.
    pub reproduced: u64,
    /// Profiles that could not be recomputed for want of what was lost or came before the log began.
    pub unverifiable: u64,
    /// How many of these came right after a beginning in the middle of a session: nothing was lost then.
    pub joined: u64,
}

impl Default for Replay {
    fn default() -> Self {
        Self {
            survey: Survey::new(),
            clock: ClockReplay::default(),
            expected: VecDeque::new(),
            skip: None,
            unsure: Unsure::default(),
            session_known: false,
            joining: false,
            reproduced: 0,
            unverifiable: 0,
            joined: 0,
        }
    }
}

impl Replay {
    /// Something was lost here.
    pub fn gap(&mut self) {
        // A history of poses: more than the half second after which those that follow count again whatever clock frame was lost. Scans that
        // had begun before the gap come within as many as may wait, over a slow line as well.
        self.unsure = Unsure { poses: HISTORY, scans: 2 * WAITING, pulses: WINDOW + 4, ..self.unsure };
    }

    /// The log begins while the board is at work. What it says of the configuration is all that is known.
    pub fn begin_midway(&mut self, config: Option<&Config>) {
        self.unsure.config = config.is_none();
        self.gap();
        if let Some(config) = config {
            self.survey(&Event::Message(Message::Config(*config)));
        }
    }

    /// The board has booted.
    pub fn restart(&mut self) {
        let Self { reproduced, unverifiable, joined, .. } = *self;
        *self = Self { reproduced, unverifiable, joined, ..Self::default() };
    }

    /// The next scan of the log, or the number of one whose ranges do not decode.
    pub fn scan(&mut self, scan: Result<&RawScan, (u32, DeviceTime)>, problems: &mut Vec<String>) {
        let (index, stx) = scan.map_or_else(|named| named, |scan| (scan.index, scan.stx));
        if !self.session_known || !self.survey.is_running() {
            self.join_at(stx);
        }
        self.unsure.scans = self.unsure.scans.saturating_sub(1);
        if self.skip.take() == Some(Skip::Scan(index)) {
            return;
        }
        match scan {
            Ok(scan) => self.survey(&Event::Scan(scan)),
            Err(_) => {
                problems.push(format!("the ranges of scan {index} do not decode"));
                self.gap();
            }
        }
    }

    /// The next message of the log that is no scan.
    pub fn take(&mut self, message: &Message<'_>, problems: &mut Vec<String>) {
        self.join(message);
        match message {
            Message::Profile(profile) => self.compare(profile, problems),
            Message::Config(_) => {
                self.unsure.config = false;
                self.survey(&Event::Message(*message));
            }
            Message::Skip(skip) => self.skip = Some(*skip),
            // A mapping that no pulse of this log has made: the log begins within a drive.
            Message::Clock(_) if self.clock.state().is_none() => self.unsure.pulses = WINDOW + 4,
            Message::Pulse(pulse) => {
                self.unsure.pulses = self.unsure.pulses.saturating_sub(1);
                let verdict = self.clock.pulse(pulse);
                if verdict != pulse.verdict && self.unsure.pulses == 0 {
                    problems.push(format!("pulse judged {:?}, recomputed {verdict:?}", pulse.verdict));
                }
            }
            Message::Clock(clock) => {
                if self.unsure.pulses == 0 && self.clock.state() != Some(*clock) {
                    problems.push("the clock's mapping does not recompute".to_owned());
                }
            }
            Message::Pose(pose) => {
                self.unsure.poses = self.unsure.poses.saturating_sub(1);
                let mapped = self.clock.pose(pose);
                let same = if pose.timed_by_pulse { mapped == Some(pose.time) } else { mapped.is_none() };
                if !same && self.unsure.pulses == 0 {
                    let ours = mapped.map_or("none".to_owned(), |time| format!("{} us", time.0));
                    problems.push(format!("pose timed {} us, recomputed {ours}", pose.time.0));
                }
                if self.skip.take() != Some(Skip::Pose(pose.time)) {
                    self.survey(&Event::Message(*message));
                }
            }
            _ => self.survey(&Event::Message(*message)),
        }
    }

    /// Boards say when the survey starts and stops. A recording of one that has been running for a while lacks that, and
    /// so does one that lost it: scans are streamed by a running survey only.
    fn join(&mut self, message: &Message<'_>) {
        let time = match message {
            Message::Session(_) => {
                self.session_known = true;
                return;
            }
            Message::Pose(Pose { time, .. }) | Message::Pulse(Pulse { time, .. }) if !self.session_known => *time,
            Message::Profile(Profile { time, .. }) if !self.session_known => *time,
            Message::Clock(_) if !self.session_known => DeviceTime(0),
            _ => return,
        };
        self.join_at(time);
    }

    fn join_at(&mut self, time: DeviceTime) {
        self.joining = !self.session_known;
        self.session_known = true;
        self.gap();
        self.survey(&Event::Message(Message::Session(Session::Started(time))));
    }

    /// The log has ended: profiles that should have followed.
    pub fn finish(&mut self) -> Option<String> {
        // The last profiles may have been under way when the log was cut; that cut shows as damage of the file or as a missing end of
        // the session, neither of which is a fault of the profiles there are.
        let left = self.expected.len();
        let stopped = !self.survey.is_running();
        (left > 0 && stopped && !self.is_unsure()).then(|| format!("{left} profiles are missing at the end"))
    }

    fn survey(&mut self, event: &Event<'_>) {
        let expected = &mut self.expected;
        self.survey.take(event, &mut |profile| expected.push_back(profile));
    }

    fn is_unsure(&self) -> bool {
        self.unsure.poses > 0 || self.unsure.scans > 0 || self.unsure.config
    }

    fn compare(&mut self, profile: &Profile, problems: &mut Vec<String>) {
        let unsure = self.is_unsure();
        self.joining &= unsure;
        let mut missing = 0;
        while self.expected.front().is_some_and(|ours| ours.scan < profile.scan) {
            self.expected.pop_front();
            missing += 1;
        }
        if missing > 0 && !unsure {
            problems.push(format!("{missing} profiles are missing before that of scan {}", profile.scan));
        }
        let ours = self.expected.pop_front_if(|ours| ours.scan == profile.scan);
        match ours {
            Some(ours) if ours == *profile => self.reproduced += 1,
            _ if unsure => {
                self.unverifiable += 1;
                self.joined += u64::from(self.joining);
            }
            Some(ours) => problems.push(difference(profile, &ours)),
            None => problems.push(format!("a profile of scan {} that nothing in the log gives", profile.scan)),
        }
    }
}

fn difference(theirs: &Profile, ours: &Profile) -> String {
    let what = if theirs.time != ours.time {
        "its time"
    } else if theirs.roll != ours.roll {
        "its roll"
    } else if theirs.method != ours.method {
        "its method"
    } else if theirs.left != ours.left {
        "its left side"
    } else if theirs.right != ours.right {
        "its right side"
    } else {
        "its flags"
    };
    format!("the profile of scan {} does not recompute: {what} differs", theirs.scan)
}
