//! Sequence numbers: dealt out by the sender, turned into a count of missing frames by the receiver.
//!
//! Sixteen bits wrap every 65,536 frames, six minutes of a survey. So a step of the numbers says how many frames are missing only together with the
//! device time that has passed: scans, poses, pulses and most other messages carry one. Time that goes back is a board that has booted again. Of a
//! step of half a turn or more while time goes on, and of any step over more time than half a turn of frames takes at the
//! stream's own pace, nobody knows how many turns it hides: [`Gap::Unknown`]. Only where no time is known is a step of half a turn read as a
//! sender that began again.
//!
//! Two things are not seen: a loss of whole turns exactly, to a frame (once in 65,536 losses as long), and a board that boots again, with its first
//! words lost, and is heard next when its own time and numbers happen to go on where they were. Device time has 64 bits and does not wrap.

use super::NoRoom;
use crate::message::{Command, Message, Session};
use crate::units::DeviceTime;

/// Steps of so much and more may be steps back.
const HALF_TURN: u16 = 1 << 15;

/// Times of messages that follow each other may be so far apart either way, in microseconds. Half a turn of the shortest frames takes a link of 1 Mbaud
/// about as long.
const SAME_US: i64 = 3_000_000;

/// Half a turn of a survey's frames, in microseconds, until the stream has shown its pace.
const USUAL_US: i64 = 180_000_000;

/// The sender's side: every frame takes the next number, sent or not.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Sequencer {
    next: u16,
}

impl Sequencer {
    /// A sender that has sent nothing; its first frame is number 0.
    #[must_use]
    pub const fn new() -> Self {
        Self { next: 0 }
    }

    /// The number of the next frame. Also for a frame that will be dropped: the gap is how the receiver knows.
    pub fn take(&mut self) -> u16 {
        let sequence = self.next;
        self.next = sequence.wrapping_add(1);
        sequence
    }

    /// Encode a message under the next number, which is used up whether it fits or not.
    ///
    /// # Errors
    /// [`NoRoom`] as of [`Message::encode`].
    pub fn message(&mut self, message: &Message<'_>, out: &mut [u8]) -> Result<usize, NoRoom> {
        message.encode(self.take(), out)
    }

    /// Encode a command under the next number, which is used up whether it fits or not.
    ///
    /// # Errors
    /// [`NoRoom`] as of [`Command::encode`].
    pub fn command(&mut self, command: &Command, out: &mut [u8]) -> Result<usize, NoRoom> {
        command.encode(self.take(), out)
    }
}

/// What lies between a frame and the one before it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Gap {
    /// Nothing: the first frame of all, or the next one in order.
    None,
    /// So many frames were sent and not received.
    Missing(u16),
    /// Frames were sent and not received, and the numbers cannot say how many: the loss took longer than they count.
    Unknown,
    /// The sender began again: what was lost in between cannot be known.
    Restarted,
}

impl Gap {
    /// A step of less than half a turn.
    const fn of(ahead: u16) -> Self {
        if ahead == 0 { Self::None } else { Self::Missing(ahead) }
    }
}

/// What a frame without a time leaves open until one with a time has come.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
enum Doubt {
    #[default]
    None,
    /// It was told that some frames are missing: it may be whole turns more, or a restart.
    Missing,
    /// It was told that it is not known how many: it may be a restart.
    Unknown,
}

/// How fast the numbers go by.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
struct Pace {
    /// Where counting began, and the frames since.
    since: Option<DeviceTime>,
    frames: u64,
    /// What half a turn took at the fastest, in microseconds.
    half_turn_us: Option<i64>,
}

impl Pace {
    /// Time over which frames are counted, in microseconds, and the least that says anything.
    const WINDOW_US: i64 = 5_000_000;
    const LEAST_US: i64 = 1_000_000;

    fn frames(&mut self, frames: u64, time: Option<DeviceTime>) {
        self.frames = self.frames.saturating_add(frames);
        let Some(time) = time else { return };
        let Some(since) = self.since else {
            (self.since, self.frames) = (Some(time), 0);
            return;
        };
        if let Some(found) = Self::half_turn(time.since(since), self.frames, Self::WINDOW_US) {
            self.half_turn_us = Some(self.half_turn_us.map_or(found, |fastest| fastest.min(found)));
            (self.since, self.frames) = (Some(time), 0);
        }
    }

    /// Counting begins anew, behind a gap of which nothing is known.
    fn interrupt(&mut self) {
        (self.since, self.frames) = (None, 0);
    }

    /// What half a turn takes, up to `latest`.
    fn half_turn_us(&self, latest: DeviceTime) -> i64 {
        let so_far = || Self::half_turn(latest.since(self.since?), self.frames, Self::LEAST_US);
        self.half_turn_us.or_else(so_far).unwrap_or(USUAL_US)
    }

    fn half_turn(elapsed_us: i64, frames: u64, least_us: i64) -> Option<i64> {
        let frames = i64::try_from(frames).ok().filter(|&frames| frames > 0 && elapsed_us >= least_us)?;
        i64::from(HALF_TURN).saturating_mul(elapsed_us).checked_div(frames)
    }
}

/// The receiver's side.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Sequence {
    expected: Option<u16>,
    /// The latest device time of this boot.
    latest: Option<DeviceTime>,
    /// Number of this boot; 0 when it is not known.
    boot: u32,
    pace: Pace,
    doubt: Doubt,
    missing: u64,
    unknown: u64,
    restarts: u64,
}

impl Sequence {
    /// A receiver that has seen nothing. Frames before the first one that it sees do not count as missing.
    #[must_use]
    pub const fn new() -> Self {
        let pace = Pace { since: None, frames: 0, half_turn_us: None };
        Self { expected: None, latest: None, boot: 0, pace, doubt: Doubt::None, missing: 0, unknown: 0, restarts: 0 }
    }

    /// Take note of a frame that carries a command, or nothing known.
    pub fn observe(&mut self, sequence: u16) -> Gap {
        let gap = self.judge(sequence, None);
        self.note(sequence, None, gap)
    }

    /// Take note of a message's frame. A hello numbered 0 out of turn is the first word of a board that has rebooted:
    /// its count starts again and nothing is missing. (A hello that answers a command goes on with the count.) So is any that
    /// names another boot.
    pub fn observe_message(&mut self, sequence: u16, message: &Message<'_>) -> Gap {
        let time = self.time(message);
        let gap = match message {
            Message::Hello(hello) if self.is_other_boot(sequence, hello.boot) => Gap::Restarted,
            _ => self.judge(sequence, time),
        };
        let gap = self.note(sequence, time, gap);
        if let Message::Hello(hello) = message {
            self.boot = hello.boot;
        }
        gap
    }

    /// Frames known to be missing so far. Those of the gaps that nobody can count are not among them.
    #[must_use]
    pub const fn missing(&self) -> u64 {
        self.missing
    }

    /// Gaps so far of which it is not known how many frames they cost.
    #[must_use]
    pub const fn unknown(&self) -> u64 {
        self.unknown
    }

    /// How often the sender began again.
    #[must_use]
    pub const fn restarts(&self) -> u64 {
        self.restarts
    }

    /// What time it was, at least, when the board made a message. None where it says nothing of it.
    fn time(&self, message: &Message<'_>) -> Option<DeviceTime> {
        match message {
            Message::Scan(scan) => Some(scan.stx),
            // When it arrived; what it is valid for is by the unit's clock. A latency at the end of its range is no latency.
            Message::Pose(pose) if pose.latency_us != i32::MAX && pose.latency_us != i32::MIN => {
                Some(pose.time.offset(i64::from(pose.latency_us)))
            }
            Message::Pulse(pulse) => Some(pulse.time),
            Message::Status(status) => Some(status.time),
            Message::Log(line) => Some(line.time),
            Message::Marker(marker) => Some(marker.time),
            Message::Session(Session::Started(time) | Session::Stopped(time)) => Some(*time),
            // A scan may have waited for long.
            Message::Profile(profile) => Some(profile.time).filter(|&time| Some(time) >= self.latest),
            _ => None,
        }
    }

    fn is_other_boot(&self, sequence: u16, boot: u32) -> bool {
        let out_of_turn = self.expected.is_some_and(|expected| expected != sequence);
        (out_of_turn && sequence == 0) || (self.boot != 0 && boot != 0 && self.boot != boot)
    }

    /// What a frame's number and time say.
    fn judge(&self, sequence: u16, time: Option<DeviceTime>) -> Gap {
        let Some(ahead) = self.expected.map(|expected| sequence.wrapping_sub(expected)) else { return Gap::None };
        if ahead == 0 && self.doubt == Doubt::None {
            return Gap::None;
        }
        let half_turn = ahead >= HALF_TURN;
        let Some((time, latest)) = time.zip(self.latest) else {
            return match self.latest {
                None if half_turn => Gap::Restarted,
                Some(_) if half_turn => Gap::Unknown,
                _ => Gap::of(ahead),
            };
        };
        let elapsed_us = time.since(latest);
        let doubtful = half_turn || self.doubt == Doubt::Unknown;
        if elapsed_us < -SAME_US || (doubtful && elapsed_us <= SAME_US) {
            Gap::Restarted
        } else if half_turn || (!doubtful && elapsed_us > self.pace.half_turn_us(latest)) {
            Gap::Unknown
        } else {
            Gap::of(ahead)
        }
    }

    fn note(&mut self, sequence: u16, time: Option<DeviceTime>, gap: Gap) -> Gap {
        self.expected = Some(sequence.wrapping_add(1));
        let latest = self.latest;
        self.latest = latest.max(time);
        if time.is_some() {
            self.doubt = Doubt::None;
        }
        // Without a time before there is nothing that one behind could be held against.
        let open = time.is_none() && latest.is_some();
        match gap {
            Gap::None => self.pace.frames(1, time),
            Gap::Missing(count) => {
                self.missing = self.missing.saturating_add(u64::from(count));
                self.pace.frames(u64::from(count).saturating_add(1), time);
                if open && self.doubt == Doubt::None {
                    self.doubt = Doubt::Missing;
                }
            }
            Gap::Unknown => {
                self.unknown = self.unknown.saturating_add(1);
                self.pace.interrupt();
                if open {
                    self.doubt = Doubt::Unknown;
                }
            }
            Gap::Restarted => {
                self.restarts = self.restarts.saturating_add(1);
                (self.latest, self.boot, self.doubt) = (time, 0, Doubt::None);
                self.pace = Pace::default();
            }
        }
        gap
    }
}
