//! Proves a log: frames whole, none missing, time sane, the clock's mapping and every profile recomputed bit for bit.
//!
//! The survey layer and the clock of the core run over the log's own scans, poses, pulses and configurations, in the order of the stream,
//! and must say again what the board said. After a gap they lack what was lost, so until their histories are full of what came after it a
//! different answer proves nothing: such profiles count as unverifiable, not as wrong. A log that begins with anything but the hello of a boot begins
//! with a gap: the board was at work before. The memory used does not grow with the log.
//!
//! Reading and decoding run beside the survey, each on a thread of its own ([`beside`]).

mod beside;
mod replay;
mod times;

use std::path::{Path, PathBuf};

use crossfall_core::instrument::FIRMWARE;
use crossfall_core::protocol::frame::Gap;
use crossfall_core::protocol::message::Message;
use crossfall_core::protocol::{Config, schema};
use serde::Serialize;

use crate::container::Error;
use crate::interrupt;
use crate::log::metadata;
use crate::stream::{Item, Place, Stream};
use beside::{Beside, Verdict};
use times::Times;

/// Problems kept in words; the rest are counted.
const KEPT: usize = 1_000;

/// What is wrong, and where.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Problem {
    /// The file, in a recording of several.
    #[serde(skip_serializing_if = "Option::is_none", serialize_with = "shown")]
    pub file: Option<PathBuf>,
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
    /// Whether nothing at all is wrong and every profile was recomputed.
    pub ok: bool,
    /// The files that were read, in their order.
    #[serde(serialize_with = "all_shown")]
    pub files: Vec<PathBuf>,
    /// Frames in the log, good or bad.
    pub frames: u64,
    /// Frames that do not decode.
    pub bad_frames: u64,
    /// Frames that the sequence numbers prove missing.
    pub missing_frames: u64,
    /// Gaps of which it is not known how many frames they cost: they took longer than the numbers count.
    pub unknown_gaps: u64,
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

/// Verifies a log: this file alone, whatever follows it. `progress` is told the offset reached in it.
///
/// # Errors
/// When the file cannot be opened or is no log at all, or the user asks to stop; damage within it is part of the report.
pub fn verify(path: &Path, mut progress: impl FnMut(u64)) -> Result<Report, Error> {
    verify_all(path, &[], |_, offset| progress(offset))
}

/// Verifies the files of one recording, in their order, as the one stream that they are. `progress` is told the 0-based number of the file and the
/// offset reached in it.
///
/// # Errors
/// When the first file cannot be opened or is no log at all, or the user asks to stop.
pub fn verify_all(first: &Path, others: &[PathBuf], mut progress: impl FnMut(usize, u64)) -> Result<Report, Error> {
    let mut stream = Stream::open_all(first, others)?;
    let name = |file: usize| match file.checked_sub(1) {
        _ if others.is_empty() => None,
        None => Some(first.to_path_buf()),
        Some(other) => others.get(other).cloned(),
    };
    let known = stream.metadata().get(metadata::CONFIG).and_then(|entries| entries.get("toml"));
    let known = known.and_then(|toml| crate::config::parse(first, toml).ok());
    let mut report = Report::default();
    std::thread::scope(|scope| {
        let mut replay = Beside::start(scope);
        let stranger = read(&mut stream, &mut replay, known.as_ref(), &name, &mut progress, &mut report);
        let (told, verdict) = replay.finish();
        if let Some((place, firmware)) = stranger.filter(|_| told.count > 0) {
            let what =
                format!("made by {firmware:?}, this is {FIRMWARE:?}: profiles of another survey need not recompute");
            report.note(name(place.file), place, what);
        }
        report.join(told, &name);
        let Verdict { reproduced, unverifiable, joined } = verdict;
        (report.profiles_reproduced, report.profiles_unverifiable) = (reproduced, unverifiable);
        report.ok = report.problem_count == 0 && reproduced + joined == report.profiles;
    });
    interrupt::check()?;
    report.files = std::iter::once(first).chain(others.iter().map(PathBuf::as_path)).map(Path::to_path_buf).collect();
    Ok(report)
}

/// Reads the whole stream: what is wrong with its frames and times goes to the report, all else to the second survey. Returns the first firmware of
/// another build, if there is one.
fn read(
    stream: &mut Stream,
    replay: &mut Beside<'_>,
    known: Option<&Config>,
    name: &impl Fn(usize) -> Option<PathBuf>,
    progress: &mut impl FnMut(usize, u64),
    report: &mut Report,
) -> Option<(Place, String)> {
    let mut stranger = None;
    let mut times = Times::default();
    let mut unknown_schema = false;
    let mut beginning = true;
    let mut last = Place::default();
    while let Some((place, item)) = stream.next() {
        progress(place.file, place.offset);
        if std::mem::take(&mut beginning) && !is_boot(place, &item) {
            replay.begin_midway(known);
        }
        last = place;
        replay.at(place);
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
                        problems.push(format!("{count} frame{} missing before this one", plural(count)));
                        replay.gap();
                    }
                    Gap::Unknown => {
                        problems.push("frames missing before this one, too many for their numbers to count".to_owned());
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
                        if hello.firmware != FIRMWARE {
                            stranger.get_or_insert_with(|| (place, hello.firmware.to_owned()));
                        }
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
                    replay.take(&message);
                }
            }
        }
        for what in problems {
            report.note(name(place.file), place, what);
        }
    }
    replay.at(last);
    report.frames = stream.frames();
    report.missing_frames = stream.missing();
    report.unknown_gaps = stream.unknown_gaps();
    report.seconds = times.seconds();
    if report.frames == 0 {
        report.note(name(last.file), last, "the log holds no frame".to_owned());
    }
    stranger
}

/// A path as it is told: serde itself fails on one that is not UTF-8.
fn shown<S: serde::Serializer>(file: &Option<PathBuf>, serializer: S) -> Result<S::Ok, S::Error> {
    match file {
        Some(file) => serializer.collect_str(&file.display()),
        None => serializer.serialize_none(),
    }
}

fn all_shown<S: serde::Serializer>(paths: &[PathBuf], to: S) -> Result<S::Ok, S::Error> {
    to.collect_seq(paths.iter().map(|path| path.display().to_string()))
}

impl Report {
    fn note(&mut self, file: Option<PathBuf>, place: Place, what: String) {
        self.problem_count += 1;
        if self.problems.len() < KEPT {
            self.problems.push(Problem { file, frame: place.frame, offset: place.offset, what });
        }
    }

    /// Takes in what the second survey told, in the order of the log. Of either list the first thousand are there, and so they are of both.
    fn join(&mut self, told: beside::Told, name: &impl Fn(usize) -> Option<PathBuf>) {
        self.problem_count += told.count;
        let ours = std::mem::take(&mut self.problems).into_iter();
        let theirs = told.problems.into_iter().map(|(place, what)| Problem {
            file: name(place.file),
            frame: place.frame,
            offset: place.offset,
            what,
        });
        self.problems = ours.chain(theirs).collect();
        // Stable: what is wrong with a frame itself stands before what follows from it.
        self.problems.sort_by_key(|problem| problem.frame);
        self.problems.truncate(KEPT);
    }
}

/// Whether a stream that begins with this begins with the board: its first word has the number 0.
fn is_boot(place: Place, item: &Item<'_>) -> bool {
    place.sequence == Some(0) && matches!(item, Item::Message { message: Message::Hello(_), .. })
}

fn plural(count: u16) -> &'static str {
    if count == 1 { "" } else { "s" }
}
