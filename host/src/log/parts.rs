//! The files of a recording: which of those that are there belong to it.
//!
//! A live log that grows too large goes on in another file (`drive.log.mcap`, `drive.log.part0002.mcap`, ...), which says in its `part` metadata which
//! file was before it; that one names it in its `next` metadata when it is closed. Who names the first file means the drive: [`Parts::of`] finds the
//! others by their names and takes those that say that they follow, also where one between them is damaged or gone, and behind them what cannot be
//! read and has the number that comes next. One that says nothing of the kind, that says that it belongs to another
//! recording, or was recorded before the first began (an older drive of the same name), is left alone, and that is told. So is one whose frames are in another already, because `recover` has made that from it.
//!
//! That files are gone from the end, the `next` of the last one tells, and a file without an end that it was not closed. What no file tells is
//! that of a drive recorded before there was a `next`.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use super::names::{is_among, number_of, numbers, part_path};
use super::{Error, Reader, metadata};
use crate::container;

/// The files of a recording.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Parts {
    /// In their order, from the one that was named. One that is gone is among them: it cannot be opened, which is a damage.
    pub files: Vec<PathBuf>,
    /// Those beside them whose frames are in them already: one of them was recovered from these.
    pub within: Vec<PathBuf>,
    /// What the user should know of them, in words.
    pub remarks: Vec<String>,
}

impl Parts {
    /// The recording that begins with a file; a later file of one is read alone.
    ///
    /// # Errors
    /// As of [`Reader::open`], of the first.
    pub fn of(first: &Path) -> Result<Self, Error> {
        Ok(Self::behind(first, &Reader::open(first)?))
    }

    /// Their size in bytes.
    #[must_use]
    pub fn bytes(&self) -> u64 {
        self.files.iter().map(|file| container::size(file)).sum()
    }

    pub(super) fn behind(first: &Path, opened: &Reader) -> Self {
        if let Some(part) = opened.metadata().get(metadata::PART) {
            let said = |key| part.get(key).map_or("?", String::as_str);
            let (number, before) = (said("number"), said("before"));
            let remark =
                format!("{}: is file {number} of a recording and read alone; it follows {before}", first.display());
            return Self { files: vec![first.to_path_buf()], remarks: vec![remark], ..Self::default() };
        }
        let mut search = Search::from(first, opened);
        for number in numbers(first) {
            search.look(number).unwrap_or_else(|why| search.leave(number, &why));
        }
        search.finish()
    }
}

/// The search for what follows a first file, in the order of the numbers.
struct Search<'a> {
    first: &'a Path,
    opened: &'a Reader,
    parts: Parts,
    held: Held,
    /// The first was recovered from files of another name: those of this name are another drive's.
    is_renamed: bool,
    /// What recording it is: as the first file says, or if it does not, the first of the others that does.
    recording: Option<String>,
    /// Number of the last file that was taken.
    last: u32,
    /// Files that do not say what they follow, and whether damage may be the reason.
    silent: BTreeMap<u32, bool>,
    /// Files that are not of this recording.
    left: BTreeSet<u32>,
}

impl<'a> Search<'a> {
    fn from(first: &'a Path, opened: &'a Reader) -> Self {
        let parts = Parts { files: vec![first.to_path_buf()], ..Parts::default() };
        let mut held = Held::default();
        held.note(first, opened);
        let is_renamed = !held.files.is_empty() && held.by(first).is_none();
        let recording = metadata::recording_of(opened.metadata()).map(str::to_owned);
        Self {
            first,
            opened,
            parts,
            held,
            is_renamed,
            recording,
            last: 1,
            silent: BTreeMap::new(),
            left: BTreeSet::new(),
        }
    }

    /// Takes the file that says that it follows, or the reason why it is left; one that says nothing waits for [`Search::finish`].
    fn look(&mut self, number: u32) -> Result<(), String> {
        let path = part_path(self.first, number);
        if let Some(holder) = self.held.by(&path) {
            let why = format!("its frames are in {}, which was recovered from it", holder.display());
            self.parts.within.push(path);
            return Err(why);
        }
        if self.is_renamed {
            return Err("that was recovered from files of another name".to_owned());
        }
        let reader = match Reader::open(&path) {
            Ok(reader) => reader,
            // A whole file of another kind says nothing; what cannot be opened at all may have been of this one.
            Err(error) => {
                self.silent.insert(number, !matches!(error, Error::Content { .. }));
                return Ok(());
            }
        };
        let Some(before) = before(&reader) else {
            self.silent.insert(number, reader.is_damaged());
            return Ok(());
        };
        if self.opened.begin_ns().zip(reader.begin_ns()).is_some_and(|(first, this)| this < first) {
            return Err("it was recorded earlier".to_owned());
        }
        let recording = metadata::recording_of(reader.metadata());
        if is_other(self.recording.as_deref(), &reader) {
            return Err("it is a file of another recording".to_owned());
        }
        let is_proved = recording.is_some() && recording == self.recording.as_deref();
        let follows =
            self.followed(number, before, is_proved).ok_or_else(|| format!("it says that it follows {before}"))?;
        if self.left.contains(&follows) {
            let (place, path) = (part_path(self.first, follows), path.display());
            self.parts.remarks.push(format!("{}: is in the place of the file that {path} follows", place.display()));
        } else if follows > self.last {
            let between = part_path(self.first, follows);
            if self.silent.remove(&follows).is_none() {
                let (missing, path) = (between.display(), path.display());
                self.parts.remarks.push(format!("{missing}: is missing; {path} follows it"));
            }
            self.parts.files.push(between);
        }
        self.recording = self.recording.take().or_else(|| recording.map(str::to_owned));
        self.held.note(&path, &reader);
        self.take(number);
        Ok(())
    }

    /// The number of the file that one follows by its own words: the last that was taken, or a later one that is damaged or gone.
    /// Of a file that proves to be of this recording also one whose place another drive's file has taken.
    fn followed(&self, number: u32, before: &str, is_proved: bool) -> Option<u32> {
        let before = number_of(self.first, before)?;
        if self.is_held(before) {
            return Some(self.last);
        }
        let is_ahead = before >= self.last && before < number;
        (is_ahead && (is_proved || !self.left.contains(&before))).then_some(before)
    }

    /// Whether a file taken so far has the frames of this one.
    fn is_held(&self, number: u32) -> bool {
        self.held.by(&part_path(self.first, number)).is_some()
    }

    fn take(&mut self, number: u32) {
        self.parts.files.push(part_path(self.first, number));
        self.last = number;
    }

    fn leave(&mut self, number: u32, why: &str) {
        let (path, first) = (part_path(self.first, number), self.first.display());
        self.parts.remarks.push(format!("{}: is not read with {first}: {why}", path.display()));
        self.left.insert(number);
    }

    /// Takes what is unreadable and comes next. Nobody follows it, and what it follows cannot be read; a writer passes over numbers that others have, and
    /// over no more.
    fn finish(mut self) -> Parts {
        for (number, damaged) in std::mem::take(&mut self.silent) {
            let is_next = number > self.last
                && (self.last + 1..number).all(|between| self.left.contains(&between) || self.is_held(between));
            if damaged && is_next {
                self.take(number);
            } else {
                self.leave(number, "it does not say what it follows");
            }
        }
        self.parts
    }
}

/// What `recover` has put into files: each with the names of those whose frames are in it.
#[derive(Default)]
struct Held {
    files: Vec<(PathBuf, String)>,
}

impl Held {
    fn note(&mut self, path: &Path, reader: &Reader) {
        let from = reader.metadata().get(metadata::RECOVERED).and_then(|recovered| recovered.get("from"));
        self.files.extend(from.map(|from| (path.to_path_buf(), from.clone())));
    }

    /// The file that has the frames of another one, or of what had its own name before.
    fn by(&self, path: &Path) -> Option<&Path> {
        let name = path.file_name()?.to_string_lossy();
        self.files.iter().find(|(_, from)| is_among(&name, from)).map(|(holder, _)| holder.as_path())
    }
}

/// The name of the file that a log says it follows.
pub(super) fn before(log: &Reader) -> Option<&str> {
    log.metadata().get(metadata::PART)?.get("before").map(String::as_str)
}

/// Whether a log says that it belongs to another recording than this one. One that does not say to which it belongs was recorded before there were
/// numbers for it, or its first words are damaged.
pub(super) fn is_other(recording: Option<&str>, log: &Reader) -> bool {
    recording.zip(metadata::recording_of(log.metadata())).is_some_and(|(this, that)| this != that)
}

#[cfg(test)]
mod tests {
    use crossfall_core::protocol::DeviceTime;
    use crossfall_core::protocol::frame::{MAX_MESSAGE_FRAME, Sequencer};
    use crossfall_core::protocol::message::{Message, Pulse, PulseVerdict};

    use std::fs;

    use super::*;
    use crate::log::{Options, Recording, Writer};

    const T: u64 = 1_790_000_000_000_000_000;

    /// A recording of 300 frames 20 ms apart in files of two seconds.
    fn record(folder: &Path, name: &str, from_ns: u64) -> Vec<PathBuf> {
        let first = folder.join(name);
        let options = Options { max_ns: 2_000_000_000, ..Options::default() };
        let mut log = Writer::create_with(&first, options).unwrap();
        let mut files = vec![first];
        for i in 0..300_u64 {
            log.frame(from_ns + i * 20_000_000, &frame(i)).unwrap();
            if log.path() != files.last().unwrap() {
                files.push(log.path().to_path_buf());
            }
        }
        log.finish().unwrap();
        assert_eq!(files.len(), 3);
        files
    }

    /// One that proves itself.
    fn frame(i: u64) -> Vec<u8> {
        let pulse = Pulse { time: DeviceTime(i * 20_000), verdict: PulseVerdict::Accepted };
        let mut out = [0; MAX_MESSAGE_FRAME];
        let length = Sequencer::new().message(&Message::Pulse(pulse), &mut out).unwrap();
        out[..length].to_vec()
    }

    fn errors(first: &Path) -> Vec<String> {
        Recording::open(first).unwrap().filter_map(Result::err).map(|error| error.to_string()).collect()
    }

    fn count(first: &Path) -> (usize, usize) {
        let (frames, errors): (Vec<_>, Vec<_>) = Recording::open(first).unwrap().partition(Result::is_ok);
        (frames.len(), errors.len())
    }

    #[test]
    fn the_first_file_means_the_drive_and_a_later_one_itself() {
        let folder = tempfile::tempdir().unwrap();
        let files = record(folder.path(), "a.log.mcap", T);
        assert_eq!(Parts::of(&files[0]).unwrap(), Parts { files: files.clone(), ..Parts::default() });
        assert_eq!(count(&files[0]), (300, 0));
        let alone = Parts::of(&files[1]).unwrap();
        assert_eq!(alone.files, files[1..2]);
        assert!(alone.remarks[0].ends_with("is file 2 of a recording and read alone; it follows a.log.mcap"));
        assert_eq!(count(&files[1]), (100, 0));
        // Also without a folder or an extension in the name.
        assert_eq!(number_of(Path::new("a"), "a.part0012"), Some(12));
        assert_eq!(number_of(Path::new("a.mcap"), "a.part12.mcap"), None);
        assert_eq!(number_of(Path::new("a.mcap"), "b.part0012.mcap"), None);
    }

    #[test]
    fn a_file_that_is_gone_or_damaged_in_the_middle_is_told() {
        let folder = tempfile::tempdir().unwrap();
        let files = record(folder.path(), "a.log.mcap", T);
        let whole = fs::read(&files[1]).unwrap();
        fs::remove_file(&files[1]).unwrap();
        let parts = Parts::of(&files[0]).unwrap();
        assert_eq!(parts.files, files);
        assert!(parts.remarks.len() == 1 && parts.remarks[0].contains("part0002.mcap: is missing; "), "{parts:?}");
        assert_eq!(count(&files[0]), (200, 1));
        // Its own words are lost, but the next one names it.
        let mut bytes = whole.clone();
        let at = bytes.windows(4).position(|window| window == b"part").unwrap();
        bytes[at] ^= 1;
        fs::write(&files[1], &bytes).unwrap();
        assert_eq!(Parts::of(&files[0]).unwrap().files, files);
        assert_eq!(count(&files[0]).0, 300);
    }

    #[test]
    fn files_of_other_recordings_stay_out_of_it() {
        let folder = tempfile::tempdir().unwrap();
        let old = record(folder.path(), "a.log.mcap", T);
        fs::remove_file(&old[0]).unwrap();
        // Somebody's own file takes a number as well.
        fs::write(folder.path().join("a.log.part0005.mcap"), b"somebody's").unwrap();
        let new = record(folder.path(), "a.log.mcap", T + 86_400_000_000_000);
        let parts = Parts::of(&new[0]).unwrap();
        assert_eq!(parts.files, new);
        assert_eq!(parts.remarks.len(), 3, "{parts:?}");
        assert!(parts.remarks[0].contains("part0002.mcap: is not read with") && parts.remarks[0].ends_with("earlier"));
        assert_eq!(count(&new[0]), (300, 0));
    }

    /// Two drives of one name, recorded in two folders and put into one: all that names and times say is that they follow each other.
    #[test]
    fn a_file_of_another_drive_of_the_same_name_does_not_continue_this_one() {
        let folder = tempfile::tempdir().unwrap();
        let [here, there] = ["here", "there"].map(|name| folder.path().join(name));
        [&here, &there].into_iter().for_each(|folder| fs::create_dir(folder).unwrap());
        let ours = record(&here, "a.log.mcap", T);
        let theirs = record(&there, "a.log.mcap", T + 60_000_000_000);
        let last = fs::read(&ours[2]).unwrap();
        // Their end in the place of ours.
        fs::copy(&theirs[2], &ours[2]).unwrap();
        let parts = Parts::of(&ours[0]).unwrap();
        assert_eq!(parts.files, ours[..2]);
        assert!(parts.remarks[0].ends_with("it is a file of another recording"), "{parts:?}");
        let told = errors(&ours[0]);
        let expected = "goes on in a.log.part0003.mcap, and that is a file of another recording";
        assert!(told.len() == 1 && told[0].ends_with(expected), "{told:?}");
        assert_eq!(count(&ours[0]), (200, 1));
        // Their middle in the place of ours: our end is read all the same.
        fs::write(&ours[2], &last).unwrap();
        fs::copy(&theirs[1], &ours[1]).unwrap();
        let parts = Parts::of(&ours[0]).unwrap();
        assert_eq!(parts.files, [ours[0].clone(), ours[2].clone()]);
        assert_eq!(parts.remarks.len(), 2, "{parts:?}");
        assert_eq!(count(&ours[0]), (200, 1));
    }

    /// Whose first words are damaged, or were written before recordings had numbers, belongs where its names and times put it.
    #[test]
    fn files_that_do_not_say_whose_they_are_follow_by_name_and_time() {
        let folder = tempfile::tempdir().unwrap();
        let files = record(folder.path(), "a.log.mcap", T);
        for file in &files[..2] {
            let mut bytes = fs::read(file).unwrap();
            let at = bytes.windows(9).position(|window| window == b"recording").unwrap();
            bytes[at] ^= 1;
            fs::write(file, &bytes).unwrap();
            assert_eq!(Parts::of(&files[0]).unwrap().files, files);
            assert_eq!(count(&files[0]).0, 300);
        }
    }

    /// A kill between the next file's name and its first bytes, a disk that has given it its length alone, a bit of its first eight bytes.
    #[test]
    fn a_last_file_that_cannot_be_read_belongs_to_the_drive_and_is_told() {
        let folder = tempfile::tempdir().unwrap();
        // The numbers 2 and 3 are an older drive's: the new one has 4 and 5.
        let old = record(folder.path(), "a.log.mcap", T);
        fs::remove_file(&old[0]).unwrap();
        let files = record(folder.path(), "a.log.mcap", T + 86_400_000_000_000);
        assert_eq!(files[2], part_path(&files[0], 5));
        let whole = fs::read(&files[2]).unwrap();
        let mut hit = whole.clone();
        hit[3] ^= 0x10;
        let (cut, zeros) = (whole[..7].to_vec(), vec![0; 4096]);
        for bytes in [Vec::new(), cut, zeros, hit] {
            fs::write(&files[2], &bytes).unwrap();
            assert_eq!(Parts::of(&files[0]).unwrap().files, files, "{} bytes", bytes.len());
            let (frames, errors) = count(&files[0]);
            assert!(frames >= 200 && errors > 0, "{} bytes: {frames} frames, {errors} errors", bytes.len());
        }
        // With what is before it gone as well.
        fs::remove_file(&files[1]).unwrap();
        fs::write(&files[2], b"").unwrap();
        let told = errors(&files[0]);
        assert!(told.len() == 1 && told[0].ends_with("goes on in a.log.part0004.mcap, which is not there"), "{told:?}");
    }

    #[test]
    fn a_drive_whose_end_is_gone_is_told_by_what_is_left() {
        let folder = tempfile::tempdir().unwrap();
        let files = record(folder.path(), "a.log.mcap", T);
        fs::remove_file(&files[2]).unwrap();
        assert_eq!(count(&files[0]), (200, 1));
        let told = errors(&files[0]);
        assert!(told[0].contains("a.log.part0002.mcap: damaged at byte "), "{told:?}");
        assert!(told[0].ends_with(": goes on in a.log.part0003.mcap, which is not there"), "{told:?}");
        // Somebody's file of this name is not it.
        fs::copy(&files[1], &files[2]).unwrap();
        let told = errors(&files[0]);
        assert!(told.len() == 1 && told[0].ends_with("which does not say that it follows"), "{told:?}");
        fs::remove_file(&files[2]).unwrap();
        // One that is named itself is read for what it is, and so is the first where it alone was asked for.
        assert_eq!(count(&files[1]), (100, 0));
        let alone = |first: &Path| Recording::open_all(first, &[]).unwrap().filter(Result::is_err).count();
        assert_eq!(alone(&files[0]), 0);
        fs::remove_file(&files[1]).unwrap();
        assert_eq!((alone(&files[0]), count(&files[0])), (1, (100, 1)));
    }
}
