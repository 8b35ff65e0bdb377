//! Proves a log: frames whole, none missing, time sane, the clock's mapping and every profile recomputed bit for bit.
//!
//! The survey layer and the clock of the core run over the log's own scans, poses, pulses and configurations, in the order of the stream,
//! and must say again what the board said. After a gap they lack what was lost, so until their histories are full of what came after it a
//! different answer proves nothing: such profiles count as unverifiable, not as wrong. The memory used does not grow with the log.

mod replay;
mod times;

use std::path::Path;

use crossfall_core::protocol::frame::Gap;
use crossfall_core::protocol::message::Message;
use crossfall_core::protocol::schema;
use serde::Serialize;

use crate::container::Error;
use crate::stream::{Item, Place, Stream};
use replay::Replay;
use times::Times;

/// Problems kept in words; the rest are counted.
const KEPT: usize = 1_000;

/// What is wrong, and where.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Problem {
    /// 0-based number of the frame in the log.
    pub frame: u64,
    /// Where its record is in the file.
    pub offset: u64,
    /// What is wrong.
    pub what: String,
}

/// The verdict on a log.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Report {
    /// Whether nothing at all is wrong.
    pub ok: bool,
    /// Frames in the log, good or bad.
    pub frames: u64,
    /// Frames that do not decode.
    pub bad_frames: u64,
    /// Frames that the sequence numbers prove missing.
    pub missing_frames: u64,
    /// Profiles in the log.
    pub profiles: u64,
    /// Profiles that were recomputed bit for bit.
    pub profiles_reproduced: u64,
    /// Profiles that could not be recomputed because what they were made from is lost.
    pub profiles_unverifiable: u64,
    /// Scans in the log.
    pub scans: u64,
    /// Times that the board booted within the log (1 for an unbroken drive).
    pub boots: u64,
    /// Seconds of device time from the first to the last scan or pose.
    pub seconds: f64,
    /// What is wrong, in the order of the log, at most the first thousand.
    pub problems: Vec<Problem>,
    /// How many problems there are in all.
    pub problem_count: u64,
}

impl Report {
    fn note(&mut self, place: Place, what: String) {
        self.problem_count += 1;
        if self.problems.len() < KEPT {
            self.problems.push(Problem { frame: place.frame, offset: place.offset, what });
        }
    }
}

/// Verifies a log. `progress` is told the offset reached in the file.
///
/// # Errors
/// When the file cannot be opened or is no log at all; damage within it is part of the report.
pub fn verify(path: &Path, mut progress: impl FnMut(u64)) -> Result<Report, Error> {
    let mut stream = Stream::open(path)?;
    let mut report = Report::default();
    let mut replay = Replay::default();
    let mut times = Times::default();
    let mut unknown_schema = false;
    let mut last = Place::default();
    while let Some((place, item)) = stream.next() {
        progress(place.offset);
        last = place;
        let mut problems = Vec::new();
        match item {
            Item::Damage(error) => {
                problems.push(error.what());
                replay.gap();
            }
            Item::Rejected { fault, bytes } => {
                report.bad_frames += 1;
                problems.push(format!("broken frame of {bytes} bytes: {fault}"));
                replay.gap();
            }
            Item::Message { message, gap } => {
                match gap {
                    Gap::None => {}
                    Gap::Missing(count) => {
                        report.missing_frames += u64::from(count);
                        problems.push(format!("{count} frame{} missing before this one", plural(count)));
                        replay.gap();
                    }
                    Gap::Restarted => {
                        times.restart();
                        replay.restart();
                        if !matches!(message, Message::Hello(_)) {
                            problems.push("the sequence begins again without a hello".to_owned());
                        }
                    }
                }
                times.check(place.receive_ns, &message, &mut problems);
                match message {
                    Message::Hello(hello) => {
                        report.boots += u64::from(report.boots == 0 || gap == Gap::Restarted);
                        unknown_schema = hello.schema != schema::HASH;
                        if unknown_schema {
                            let (theirs, ours) = (hello.schema, schema::HASH);
                            problems.push(format!("message schema {theirs:016x}, this program knows {ours:016x}"));
                        }
                    }
                    Message::Scan(_) => report.scans += 1,
                    Message::Profile(_) => report.profiles += 1,
                    _ => {}
                }
                if !unknown_schema {
                    replay.take(&message, &mut problems);
                }
            }
        }
        for what in problems {
            report.note(place, what);
        }
    }
    if let Some(what) = replay.finish() {
        report.note(last, what);
    }
    report.frames = stream.frames();
    report.profiles_reproduced = replay.reproduced;
    report.profiles_unverifiable = replay.unverifiable;
    report.seconds = times.seconds();
    if report.frames == 0 {
        report.note(last, "the log holds no frame".to_owned());
    }
    report.ok = report.problem_count == 0 && report.profiles_reproduced + replay.joined == report.profiles;
    Ok(report)
}

fn plural(count: u16) -> &'static str {
    if count == 1 { "" } else { "s" }
}
