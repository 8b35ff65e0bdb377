//! Proves a log: frames whole, none missing, time sane, the clock's mapping and every profile recomputed bit for bit.
//!
//! The survey layer and the clock of the core run over the log's own scans, poses, pulses and configurations, in the order of the stream,
//! and must say again what the board said. After a gap they lack what was lost, so until their histories are full of what came after it a
//! different answer proves nothing: such profiles count as unverifiable, not as wrong. A log that begins with anything but the hello of a boot begins
//! with a gap: the board was at work before. The memory used does not grow with the log.
//!
//! Reading and decoding ([`reading`]) run beside the survey, each on a thread of its own ([`beside`]).

mod beside;
mod reading;
mod replay;
mod times;

use std::path::{Path, PathBuf};

use serde::Serialize;

use crate::container::Error;
use crate::interrupt;
use crate::log::metadata;
use crate::stream::{Place, Stream};
use beside::Beside;
use reading::Reading;

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
pub fn verify_all(first: &Path, others: &[PathBuf], progress: impl FnMut(usize, u64)) -> Result<Report, Error> {
    let mut stream = Stream::open_all(first, others)?;
    let name = |file: usize| match file.checked_sub(1) {
        _ if others.is_empty() => None,
        None => Some(first.to_path_buf()),
        Some(other) => others.get(other).cloned(),
    };
    let known = stream.metadata().get(metadata::CONFIG).and_then(|entries| entries.get("toml"));
    let known = known.and_then(|toml| crate::config::parse(first, toml).ok());
    let mut report = std::thread::scope(|scope| {
        let mut reading = Reading::beside(Beside::start(scope));
        reading.read(&mut stream, known.as_ref(), progress);
        reading.finish(&stream, name)
    });
    interrupt::check()?;
    report.files = std::iter::once(first).chain(others.iter().map(PathBuf::as_path)).map(Path::to_path_buf).collect();
    Ok(report)
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
    /// Takes in what was told of the stream itself and by the second survey, each in the order of the log and of each the first thousand: so the first
    /// thousand of both are there.
    fn tell(&mut self, stream: Told, survey: Told, name: impl Fn(usize) -> Option<PathBuf>) {
        self.problem_count = stream.count + survey.count;
        let all = stream.problems.into_iter().chain(survey.problems);
        let problem = |(place, what): (Place, String)| Problem {
            file: name(place.file),
            frame: place.frame,
            offset: place.offset,
            what,
        };
        self.problems = all.map(problem).collect();
        // Stable: what is wrong with a frame itself stands before what follows from it.
        self.problems.sort_by_key(|problem| problem.frame);
        self.problems.truncate(KEPT);
    }
}

/// Problems as they are found, in the order of the log.
#[derive(Debug, Default)]
struct Told {
    /// What is wrong and where, at most the first thousand.
    problems: Vec<(Place, String)>,
    /// How many problems there are.
    count: u64,
}

impl Told {
    fn note(&mut self, place: Place, problems: impl IntoIterator<Item = String>) {
        for what in problems {
            self.count += 1;
            if self.problems.len() < KEPT {
                self.problems.push((place, what));
            }
        }
    }
}
