//! Recovery: a whole, indexed log from any damage, and an exact account of what is lost.
//!
//! Every frame that can be read from the file, or found in its damaged places (see [`log::Reader`]), goes into a new log with its receive time.
//! The account rests on three proofs: the frames' own numbers say how many are missing and where; the receive times around a hole say how long it is at
//! most; and every byte of a damaged place that belongs to no recovered frame is counted. What no number can tell is said to be unknown: the end of
//! a file that was not closed, a file that another one names and that is gone, and what a board had under way when it restarted.
//!
//! The new log is then read again from the disk: it must hold every frame, bit for bit, without damage, and verify as the account says. Only then is
//! it done. The old files are only read. Several files of one recording become one log, which says before its first frame which they are: it may take the
//! place of the first of them, with the others still there.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use crossfall_core::protocol::frame::{Event, Gap, HostDecoder, Sequence};
use serde::Serialize;

use crate::container::Error as Damage;
use crate::log::metadata::{self, Entries};
use crate::verify::{self, verify};
use crate::{container, log, output};

/// Losses kept in words; all are counted.
const KEPT: usize = 1_000;

/// Metadata that say which file of which recording a log is, and what it is made of: the new log's own come first, or last.
const SAID: [&str; 4] = [metadata::RECORDING, metadata::PART, metadata::NEXT, metadata::RECOVERED];

/// Why a recovery failed.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// The log cannot be read, or holds nothing of one.
    #[error(transparent)]
    Log(#[from] Damage),
    /// The new log cannot be written.
    #[error(transparent)]
    Output(#[from] output::Error),
    /// The new log does not read back as it was written: the disk, or this program, is not to be trusted.
    #[error("{}: does not read back as it was written: {what}; it is not to be used", path.display())]
    Unproved {
        /// The new log.
        path: PathBuf,
        /// What is different.
        what: String,
    },
    /// The user asked to stop.
    #[error("interrupted, nothing was written")]
    Interrupted,
}

/// One hole.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Loss {
    /// The file.
    #[serde(serialize_with = "shown")]
    pub file: PathBuf,
    /// Where in it, in bytes.
    pub offset: u64,
    /// Bytes of the file that gave no frame; 0 where the frames never reached the file.
    pub bytes: u64,
    /// Frames that are missing here, as their numbers say; none when they cannot say it.
    pub frames: Option<u64>,
    /// From the frame before to the frame behind, in receive time: what is lost is no more than this. None at the end of a file.
    pub seconds: Option<f64>,
    /// What was found.
    pub what: String,
}

/// A path as it is told: serde itself fails on one that is not UTF-8.
fn shown<S: serde::Serializer>(file: &Path, serializer: S) -> Result<S::Ok, S::Error> {
    serializer.collect_str(&file.display())
}

/// The account.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Report {
    /// Whether anything is lost, or may be.
    pub lost: bool,
    /// Frames in the new log.
    pub frames: u64,
    /// Of these, frames that do not decode: as they came over the link, or hit within the file.
    pub bad_frames: u64,
    /// Seconds of receive time from the first to the last.
    pub seconds: f64,
    /// Frames that stood in the files a second time; each is in the new log once.
    pub frames_twice: u64,
    /// Frames that the numbers prove missing.
    pub frames_lost: u64,
    /// Of these, frames missing where the file is damaged; the others never reached it.
    pub frames_lost_in_file: u64,
    /// Gaps of which it is not known how many frames they cost: they took longer than the numbers count.
    pub unknown_gaps: u64,
    /// Seconds of receive time across all holes with two ends. An upper bound of what is lost where there are no others: unknown gaps, open ends, missing
    /// files, restarts.
    pub seconds_lost: f64,
    /// Bytes of damaged places that gave no frame.
    pub bytes_lost: u64,
    /// Files that do not end as a closed one does: what came after their last frame, at most one second, is unknown.
    pub open_ends: u64,
    /// Files of the recording that others name and that are not there, or cannot be read at all: what was in them is unknown.
    pub files_missing: u64,
    /// Times that the board booted again: what was under way is unknown.
    pub restarts: u64,
    /// Places of the files that were damaged, with or without a loss.
    pub damages: u64,
    /// The holes, at most the first thousand.
    pub losses: Vec<Loss>,
    /// How many there are in all.
    pub loss_count: u64,
    /// Profiles in the new log, and of these recomputed bit for bit.
    pub profiles: u64,
    /// See `profiles`.
    pub profiles_reproduced: u64,
}

impl Report {
    fn note(&mut self, loss: Loss) {
        self.loss_count += 1;
        self.bytes_lost += loss.bytes;
        self.seconds_lost += loss.seconds.unwrap_or_default();
        if self.losses.len() < KEPT {
            self.losses.push(loss);
        }
    }
}

/// Recovers the files of one recording, in their order, into a new log. `progress` is told the number of the file and the offset reached in it.
///
/// # Errors
/// When nothing can be read at all, the new log cannot be written, or does not prove itself.
pub fn recover(files: &[PathBuf], to: &Path, progress: impl FnMut(usize, u64)) -> Result<Report, Error> {
    recover_with(files, to, log::Reader::open, progress)
}

fn recover_with(
    files: &[PathBuf],
    to: &Path,
    open: impl Fn(&Path) -> Result<log::Reader, Damage>,
    mut progress: impl FnMut(usize, u64),
) -> Result<Report, Error> {
    let mut recovery = Recovery {
        log: log::Writer::create(to)?,
        report: Report::default(),
        decoder: HostDecoder::new(),
        sequence: Sequence::new(),
        hash: Hash::default(),
        hole: None,
        bad: 0,
        span: None,
        described: BTreeMap::new(),
        next: None,
        is_piece: false,
    };
    let from = log::names_of(files);
    for (number, file) in files.iter().enumerate() {
        match open(file) {
            Ok(reader) => recovery.file(files, number, &from, reader, |offset| progress(number, offset))?,
            // Nothing can be told of a recording whose first file is none.
            Err(error) if number == 0 => return Err(error.into()),
            Err(Damage::Interrupted) => return Err(Error::Interrupted),
            Err(error) => recovery.unopened(file, &error),
        }
    }
    // Nothing behind a last file that cannot be opened says what it held.
    if let Some(hole) = &mut recovery.hole {
        hole.frames = None;
        recovery.close(0);
    }
    let Recovery { mut log, mut report, hash, described, bad, sequence, next, .. } = recovery;
    // Broken frames behind which none follows: no number says that they are missing.
    report.frames_lost = sequence.missing() + bad;
    report.unknown_gaps = sequence.unknown();
    report.lost = report.frames_lost > 0
        || report.unknown_gaps > 0
        || report.files_missing > 0
        || report.bytes_lost > 0
        || report.open_ends > 0
        || report.restarts > 0;
    report.lost |= report.frames == 0;
    for (name, entries) in described {
        log.metadata(&name, entries)?;
    }
    if let Some(next) = next {
        log.metadata(metadata::NEXT, next)?;
    }
    log.metadata(metadata::RECOVERED, provenance(from, &report))?;
    log.finish()?;
    let proved = prove(to, report.frames, sequence.missing(), &hash)?;
    (report.profiles, report.profiles_reproduced) = (proved.profiles, proved.profiles_reproduced);
    Ok(report)
}

/// A hole under way: until a frame has come from behind it, and one whose time is not copied from before it.
struct Hole {
    file: PathBuf,
    offset: u64,
    /// Frames from before this place lie within it.
    until: u64,
    /// Whether the file is damaged here; else the frames never reached it.
    in_file: bool,
    /// Whether the file ends here, unclosed.
    open_end: bool,
    /// Frames that are missing, unless nobody can know.
    frames: Option<u64>,
    /// Receive time of the frame before the latest missing ones, while the time of the frame behind is not known.
    since_ns: Option<u64>,
    seconds: Option<f64>,
    /// Bytes of the file that had given no frame before.
    unread: u64,
    /// Bytes of files that cannot be opened.
    closed_bytes: u64,
    what: String,
}

impl Hole {
    /// One that begins at a place, where so many bytes of the file had given no frame.
    fn at(file: &Path, offset: u64, unread: u64, what: String) -> Self {
        Self {
            file: file.to_path_buf(),
            offset,
            until: 0,
            in_file: false,
            open_end: false,
            frames: Some(0),
            since_ns: None,
            seconds: None,
            unread,
            closed_bytes: 0,
            what,
        }
    }
}

struct Recovery {
    log: log::Writer,
    report: Report,
    decoder: HostDecoder,
    sequence: Sequence,
    hash: Hash,
    hole: Option<Hole>,
    /// Broken frames since the last good one.
    bad: u64,
    /// Receive time of the first and of the latest frame.
    span: Option<(u64, u64)>,
    /// Metadata of the old files that frames do not say, by name.
    described: BTreeMap<String, Entries>,
    /// What the file before says of the one that follows it.
    next: Option<Entries>,
    /// Whether the first file is a later one of a recording.
    is_piece: bool,
}

impl Recovery {
    fn file(
        &mut self,
        files: &[PathBuf],
        number: usize,
        from: &str,
        mut reader: log::Reader,
        mut progress: impl FnMut(u64),
    ) -> Result<(), Error> {
        let file = &files[number];
        if number == 0 {
            self.begin(&reader, from)?;
        }
        let mut given_up = false;
        while let Some(item) = reader.next() {
            match item {
                Ok(frame) => {
                    progress(frame.offset);
                    self.frame(file, &frame, reader.unread())?;
                }
                Err(Damage::Interrupted) => return Err(Error::Interrupted),
                Err(error) => {
                    given_up |= matches!(error, Damage::Io { .. });
                    self.damage(file, &error, &reader);
                }
            }
        }
        self.report.files_missing += u64::from(given_up);
        self.report.frames_twice += reader.frames_twice();
        for (name, entries) in reader.metadata() {
            if !SAID.contains(&name.as_str()) {
                // Frames know better who sent them.
                self.described.entry(name.clone()).or_insert_with(|| entries.clone());
            }
        }
        // Nothing behind it says what it cost, unless it is the index that is hit.
        if let Some(hole) = self.hole.as_mut().filter(|hole| reader.unread() > hole.unread) {
            hole.frames = hole.frames.filter(|_| reader.data_end().is_some_and(|end| hole.offset > end));
        }
        self.close(reader.unread());
        let following = files.get(number + 1).map(PathBuf::as_path);
        if let Some(what) = log::torn(&files[0], file, reader.metadata(), following).filter(|_| !self.is_piece) {
            self.missing_file(file, container::size(file), 0, what);
        }
        self.next = reader.metadata().get(metadata::NEXT).cloned();
        Ok(())
    }

    /// A file that cannot be opened, behind others.
    fn unopened(&mut self, file: &Path, error: &Damage) {
        self.next = None;
        self.report.damages += 1;
        self.report.files_missing += 1;
        let bytes = container::size(file);
        if let Some(hole) = &mut self.hole {
            hole.closed_bytes += bytes;
            return;
        }
        let hole = Hole::at(file, 0, 0, error.what());
        self.hole = Some(Hole { in_file: true, closed_bytes: bytes, ..hole });
    }

    /// What whoever opens the new log must know of it before anything else: which file of a recording it takes the place of, and what is in it.
    fn begin(&mut self, first: &log::Reader, from: &str) -> Result<(), Error> {
        self.is_piece = first.metadata().contains_key(metadata::PART);
        for name in [metadata::RECORDING, metadata::PART] {
            if let Some(said) = first.metadata().get(name) {
                self.log.metadata(name, said.clone())?;
            }
        }
        Ok(self.log.metadata(metadata::RECOVERED, [("from".to_owned(), from.to_owned())].into())?)
    }

    /// A file that gave nothing, found at a place.
    fn missing_file(&mut self, file: &Path, offset: u64, bytes: u64, what: String) {
        self.report.files_missing += 1;
        self.report.note(Loss { file: file.to_path_buf(), offset, bytes, frames: None, seconds: None, what });
    }

    fn damage(&mut self, file: &Path, error: &Damage, reader: &log::Reader) {
        self.report.damages += 1;
        let open_end = matches!(error, Damage::Cut { .. });
        let (damaged_to, unread) = reader.damage();
        self.report.open_ends += u64::from(open_end);
        let offset = error.offset().unwrap_or_default();
        let hole = self.hole.get_or_insert_with(|| Hole::at(file, offset, unread, error.what()));
        hole.until = hole.until.max(damaged_to);
        hole.open_end |= open_end;
        hole.in_file = true;
    }

    fn frame(&mut self, file: &Path, frame: &log::Frame, unread: u64) -> Result<(), Error> {
        self.report.frames += 1;
        let before = self.span.map(|(_, last)| last);
        let first = self.span.map_or(frame.receive_ns, |(first, _)| first);
        self.span = Some((first, frame.receive_ns));
        self.report.seconds = frame.receive_ns.saturating_sub(first) as f64 * 1e-9;
        let mut input = frame.bytes.as_slice();
        let (mut gaps, mut rejected) = (Vec::new(), false);
        let mut described = None;
        while let Some(event) = self.decoder.next(&mut input) {
            match event {
                Event::Frame(found) => {
                    gaps.push(self.sequence.observe_message(found.sequence, &found.body));
                    described = metadata::of(&found.body).or(described);
                }
                Event::Rejected(found) => {
                    rejected = true;
                    if let Some(sequence) = found.sequence {
                        gaps.push(self.sequence.observe(sequence));
                    }
                }
            }
        }
        rejected |= self.decoder.finish().is_some();
        self.report.bad_frames += u64::from(rejected || gaps.is_empty());
        if gaps.is_empty() {
            self.bad += 1;
        }
        let good = !gaps.is_empty();
        for gap in gaps {
            self.missing(file, frame.offset, gap, before, unread);
            self.bad = 0;
        }
        if let Some(hole) = &mut self.hole {
            // A frame without a readable time carries that of the one before.
            if let Some(since) = hole.since_ns.filter(|&since| since != frame.receive_ns) {
                let more = frame.receive_ns.saturating_sub(since) as f64 * 1e-9;
                hole.seconds = Some(hole.seconds.unwrap_or_default() + more);
                hole.since_ns = None;
            }
            if good && frame.offset >= hole.until && hole.since_ns.is_none() {
                self.close(unread);
            }
        }
        if let Some((name, entries)) = described
            && self.described.insert(name.to_owned(), entries.clone()).as_ref() != Some(&entries)
        {
            self.log.metadata(name, entries)?;
        }
        self.log.frame(frame.receive_ns, &frame.bytes)?;
        self.hash.add(frame.receive_ns, &frame.bytes);
        Ok(())
    }

    /// What a good frame's number says of what is missing before it.
    fn missing(&mut self, file: &Path, offset: u64, gap: Gap, before: Option<u64>, unread: u64) {
        let (count, what) = match gap {
            Gap::None => return,
            Gap::Missing(count) => (Some(u64::from(count)), "frames are missing".to_owned()),
            Gap::Unknown => (None, "frames are missing, too many for their numbers to count".to_owned()),
            Gap::Restarted => {
                self.report.restarts += 1;
                (None, "the board has restarted: what it had not sent is not known".to_owned())
            }
        };
        let begin = || Hole { until: offset, ..Hole::at(file, offset, unread, what) };
        let hole = self.hole.get_or_insert_with(begin);
        hole.frames = hole.frames.zip(count).map(|(frames, count)| frames + count);
        hole.since_ns = hole.since_ns.or(before);
        if hole.in_file {
            self.report.frames_lost_in_file += count.unwrap_or_default();
        }
    }

    /// The hole under way is over.
    fn close(&mut self, unread: u64) {
        let Some(hole) = self.hole.take() else { return };
        let Hole { file, offset, open_end, frames, seconds, unread: before, closed_bytes, what, .. } = hole;
        let bytes = unread.saturating_sub(before) + closed_bytes;
        let frames = frames.filter(|_| !open_end);
        // A damaged place all of whose frames are there costs nothing.
        if (frames, bytes) != (Some(0), 0) {
            self.report.note(Loss { file, offset, bytes, frames, seconds, what });
        }
    }
}

/// The account in the new log itself.
fn provenance(from: String, report: &Report) -> Entries {
    BTreeMap::from([
        ("from".to_owned(), from),
        ("frames_lost".to_owned(), report.frames_lost.to_string()),
        ("seconds_lost_at_most".to_owned(), format!("{:.3}", report.seconds_lost)),
        ("bytes_lost".to_owned(), report.bytes_lost.to_string()),
        ("unknown_gaps".to_owned(), report.unknown_gaps.to_string()),
        ("open_ends".to_owned(), report.open_ends.to_string()),
        ("files_missing".to_owned(), report.files_missing.to_string()),
        ("restarts".to_owned(), report.restarts.to_string()),
    ])
}

/// Count, times and bytes of frames in one number.
#[derive(Default)]
struct Hash {
    frames: u64,
    hasher: crc32fast::Hasher,
}

impl Hash {
    fn add(&mut self, receive_ns: u64, bytes: &[u8]) {
        self.frames += 1;
        self.hasher.update(&receive_ns.to_le_bytes());
        self.hasher.update(&(bytes.len() as u64).to_le_bytes());
        self.hasher.update(bytes);
    }
}

/// Reads the new log from the disk and holds it against what was written and reported.
fn prove(path: &Path, frames: u64, missing: u64, written: &Hash) -> Result<verify::Report, Error> {
    let unproved = |what: String| Error::Unproved { path: path.to_path_buf(), what };
    let mut read = Hash::default();
    for frame in log::Reader::open(path)? {
        let frame = frame.map_err(|error| unproved(error.to_string()))?;
        read.add(frame.receive_ns, &frame.bytes);
    }
    let sums = [&read, written].map(|hash| (hash.frames, hash.hasher.clone().finalize()));
    if sums[0] != sums[1] {
        return Err(unproved(format!("frames and their sum are {:X?}, expected {:X?}", sums[0], sums[1])));
    }
    let verified = verify(path, |_| ())?;
    let found = (verified.frames, verified.missing_frames);
    if found != (frames, missing) {
        return Err(unproved(format!("{} frames and {} missing, expected {frames} and {missing}", found.0, found.1)));
    }
    Ok(verified)
}

#[cfg(test)]
mod tests;
