//! A log walked profile by profile, each with the scan that it was made from and the vehicle's pose: what clouds, sections and exports need.
//!
//! Memory is bounded: the scans that may still wait for their profile ([`WAITING`]) and the recent poses. Scans are kept as they were sent, and
//! decoded when somebody wants the profile that was made from them: a report looks at one section in a thousand of a long drive.

use std::collections::VecDeque;
use std::path::Path;

use crossfall_core::attitude::History;
use crossfall_core::instrument::{Event, WAITING};
use crossfall_core::protocol::frame::Gap;
use crossfall_core::protocol::message::{Message, Profile, Scan, Session};
use crossfall_core::protocol::{Angle, Config};
use crossfall_core::scan::{Points, RawScan, RollTrack, level};

use crate::container::Error;
use crate::counters::Totals;
use crate::section::{Place, Section};
use crate::stream::{Item, Stream};
use crate::track::{Position, Track};
use crate::units::place;

/// Walks a log.
#[derive(Debug)]
pub struct Walk {
    stream: Stream,
    history: History,
    track: Track,
    config: Config,
    recent: VecDeque<Held>,
    room: RawScan,
    undecodable: u64,
    unmatched: u64,
    totals: Totals,
}

/// A scan as it was sent, its ranges still in their code.
#[derive(Debug)]
struct Held {
    header: Scan<'static>,
    code: Vec<u8>,
}

/// A profile and what it was made from.
#[derive(Clone, Copy, Debug)]
pub struct Step<'a> {
    /// The profile.
    pub profile: Profile,
    /// The scan.
    pub scan: &'a RawScan,
    /// Where the scanner was at the scan's first beam.
    pub position: Position,
    /// Where it was, and how turned, at any instant of the scan.
    pub track: &'a Track,
    history: &'a History,
    config: &'a Config,
}

impl Walk {
    /// Opens a log.
    ///
    /// # Errors
    /// As of [`Stream::open`].
    pub fn open(path: &Path) -> Result<Self, Error> {
        Ok(Self {
            stream: Stream::open(path)?,
            history: History::default(),
            track: Track::default(),
            config: Config::default(),
            recent: VecDeque::new(),
            room: RawScan::EMPTY,
            undecodable: 0,
            unmatched: 0,
            totals: Totals::default(),
        })
    }

    /// Damaged parts, broken frames and gaps passed so far, and scans that do not decode.
    #[must_use]
    pub fn damage(&self) -> u64 {
        self.stream.losses() + self.undecodable
    }

    /// Profiles whose scan is not in the log.
    #[must_use]
    pub fn unmatched(&self) -> u64 {
        self.unmatched
    }

    /// The board's counters so far, over all its boots.
    #[must_use]
    pub fn totals(&self) -> &Totals {
        &self.totals
    }

    /// How far the log has been read, in bytes of all its files.
    #[must_use]
    pub fn offset(&self) -> u64 {
        self.stream.reached()
    }

    /// The next profile that is wanted; none at the end, or when the user asks to stop (`interrupt::check` tells). `see` is shown every message on the way, the profile's own included, and says of a profile whether it is
    /// wanted; what it says of other messages does not matter.
    pub fn next(&mut self, mut see: impl FnMut(&Message<'_>, &Track) -> bool) -> Option<Step<'_>> {
        let profile = loop {
            let (_, item) = self.stream.next()?;
            let Item::Message { message, gap } = item else { continue };
            if gap == Gap::Restarted {
                self.totals.restart();
                self.track.restart();
                self.history.clear();
                self.recent.clear();
            }
            match message {
                Message::Config(config) => {
                    self.config = config;
                    self.track.configure(&config);
                }
                Message::Pose(pose) => {
                    self.history.push(&pose);
                    self.track.push(&pose);
                }
                Message::Clock(clock) => self.track.clock(&clock),
                Message::Session(Session::Started(_)) => self.history.clear(),
                Message::Status(status) => self.totals.status(&status),
                Message::Scan(scan) => hold(&mut self.recent, &scan),
                _ => {}
            }
            let wanted = see(&message, &self.track);
            if let Message::Profile(profile) = message {
                match self.recent.iter().find(|held| held.header.index == profile.scan) {
                    None => self.unmatched += 1,
                    Some(_) if !wanted => {}
                    Some(held) => {
                        let scan = Message::Scan(Scan { code: &held.code, ..held.header });
                        match Event::of(&scan, &mut self.room) {
                            Ok(_) => break profile,
                            Err(_) => self.undecodable += 1,
                        }
                    }
                }
            }
        };
        let position = self.track.at(profile.time);
        let (scan, track, history) = (&self.room, &self.track, &self.history);
        Some(Step { profile, scan, position, track, history, config: &self.config })
    }
}

/// Keeps a scan, in the room of one that no profile can be made from any more.
fn hold(recent: &mut VecDeque<Held>, scan: &Scan<'_>) {
    let mut code =
        if recent.len() > WAITING { recent.pop_front().map(|held| held.code) } else { None }.unwrap_or_default();
    code.clear();
    code.extend_from_slice(scan.code);
    let Scan { index, stx, layout, mode, status, counters, .. } = *scan;
    recent.push_back(Held { header: Scan { index, stx, layout, mode, status, counters, code: &[] }, code });
}

impl Step<'_> {
    /// The scan's returns, every beam turned by the roll of its own instant. Gives the flags of that roll: with `NO_ATTITUDE` it is none.
    pub fn level(&self, points: &mut Points) -> u16 {
        let roll = self.history.over_scan(self.scan, self.profile.time, &self.config.attitude);
        level(self.scan, &roll.track, &self.config.scanner, points);
        roll.flags
    }

    /// The configuration in force.
    #[must_use]
    pub fn config(&self) -> &Config {
        self.config
    }

    /// The section, as measured and levelled.
    #[must_use]
    pub fn section(&self) -> Section {
        let mut points = Points::new();
        self.level(&mut points);
        let levelled = places(&points);
        let mut untilted = self.config.scanner;
        untilted.mounting_offset = Angle::ZERO;
        level(self.scan, &RollTrack::constant(Angle::ZERO), &untilted, &mut points);
        Section { raw: places(&points), levelled, profile: self.profile }
    }
}

pub(crate) fn places(points: &Points) -> Vec<Place> {
    points.iter().map(place).collect()
}
