//! A recording of several files, read as the one stream that it is.
//!
//! A live log that grows too large goes on in another file (`drive.log.mcap`, `drive.log.part0002.mcap`, ...), which says in its `part` metadata which
//! file was before it. Who names the first file means the drive: [`Parts::of`] finds the others by their names and takes those that say that they
//! follow. A file that another one follows belongs to the drive even if it is damaged or gone. One that says nothing of the kind, or was recorded before
//! the first began (an older drive of the same name), is left alone, and that is told. That the last file of all is gone, no metadata can tell.

use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::ffi::OsStr;
use std::fs;
use std::path::{Path, PathBuf};

use super::{Error, Frame, PARTS, Reader, metadata};

/// The files of a recording.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Parts {
    /// In their order, from the one that was named. One that is gone is among them: it cannot be opened, which is a damage.
    pub files: Vec<PathBuf>,
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
        self.files.iter().map(|file| fs::metadata(file).map_or(0, |metadata| metadata.len())).sum()
    }

    fn behind(first: &Path, opened: &Reader) -> Self {
        let mut parts = Self { files: vec![first.to_path_buf()], remarks: Vec::new() };
        if let Some(part) = opened.metadata().get(metadata::PART) {
            let said = |key| part.get(key).map_or("?", String::as_str);
            let (number, before) = (said("number"), said("before"));
            parts.remarks.push(format!(
                "{}: is file {number} of a recording and read alone; it follows {before}",
                first.display()
            ));
            return parts;
        }
        let (mut last, mut silent, mut others) = (1, BTreeMap::new(), BTreeSet::new());
        for number in numbers(first) {
            let path = part_path(first, number);
            let opened_part = Reader::open(&path);
            let part = opened_part.as_ref().ok().and_then(|part| part.metadata().get(metadata::PART));
            let (Ok(reader), Some(part)) = (&opened_part, part) else {
                silent.insert(number, opened_part.is_ok_and(|part| part.damage().0 > 0));
                continue;
            };
            let before = part.get("before").map_or("?", String::as_str);
            let follows = match number_of(first, before) {
                Some(before) if before >= last && before < number && !others.contains(&before) => before,
                _ => {
                    others.insert(number);
                    parts.leave(&path, &format!("it says that it follows {before}"));
                    continue;
                }
            };
            if opened.begin_ns().zip(reader.begin_ns()).is_some_and(|(first, this)| this < first) {
                others.insert(number);
                parts.leave(&path, "it was recorded earlier");
                continue;
            }
            if follows > last {
                let between = part_path(first, follows);
                if silent.remove(&follows).is_none() {
                    parts.remarks.push(format!("{}: is missing; {} follows it", between.display(), path.display()));
                }
                parts.files.push(between);
            }
            parts.files.push(path);
            last = number;
        }
        for (number, damaged) in silent {
            let path = part_path(first, number);
            // Nobody follows it, and what it follows is unreadable.
            if damaged && number == last + 1 {
                parts.files.push(path);
                last = number;
            } else {
                parts.leave(&path, "it does not say what it follows");
            }
        }
        parts
    }

    fn leave(&mut self, path: &Path, why: &str) {
        self.remarks.push(format!("{}: is not read with {}: {why}", path.display(), self.files[0].display()));
    }
}

/// `drive.log.mcap` -> `drive.log.part0002.mcap`: behind the first in the order of names.
pub(super) fn part_path(first: &Path, number: u32) -> PathBuf {
    let extension = first.extension().unwrap_or_default().to_string_lossy().into_owned();
    let extension =
        if extension.is_empty() { format!("part{number:04}") } else { format!("part{number:04}.{extension}") };
    first.with_extension(extension)
}

/// Which file of a recording has a name: 1 is the first.
fn number_of(first: &Path, name: &str) -> Option<u32> {
    let is = |path: &Path| path.file_name().map(OsStr::to_string_lossy).is_some_and(|found| found == name);
    if is(first) {
        return Some(1);
    }
    let stem = first.file_stem()?.to_string_lossy();
    let digits = name.strip_prefix(&*stem)?.strip_prefix(".part")?;
    let digits = digits.split('.').next()?;
    let number = digits.parse().ok().filter(|number| (2..=PARTS).contains(number))?;
    is(&part_path(first, number)).then_some(number)
}

/// Which files of such names there are behind the first.
fn numbers(first: &Path) -> BTreeSet<u32> {
    let folder = first.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let Ok(entries) = fs::read_dir(folder) else { return BTreeSet::new() };
    let names = entries.flatten().map(|entry| entry.file_name());
    names.filter_map(|name| number_of(first, &name.to_string_lossy())).filter(|&number| number > 1).collect()
}

/// Reads the files of a recording one after the other.
///
/// Errors are told where they occur; the frames behind them follow. A file that cannot be opened is one.
#[derive(Debug)]
pub struct Recording {
    reader: Reader,
    /// Files that follow.
    next: VecDeque<PathBuf>,
    file: usize,
    /// Size of the file under way, and of those before it.
    size: u64,
    before: u64,
}

impl Recording {
    /// Opens the recording that begins with a file, see [`Parts`].
    ///
    /// # Errors
    /// As of [`Reader::open`], of the first.
    pub fn open(first: &Path) -> Result<Self, Error> {
        let reader = Reader::open(first)?;
        let parts = Parts::behind(first, &reader);
        Ok(Self::over(reader, &parts.files[1..]))
    }

    /// Opens these files and no others, in this order. Those behind the first are opened when their turn comes.
    ///
    /// # Errors
    /// As of [`Reader::open`], of the first.
    pub fn open_all(first: &Path, others: &[PathBuf]) -> Result<Self, Error> {
        Ok(Self::over(Reader::open(first)?, others))
    }

    fn over(reader: Reader, others: &[PathBuf]) -> Self {
        Self { size: reader.size(), reader, next: others.iter().cloned().collect(), file: 0, before: 0 }
    }

    /// Metadata of the file under way, as far as it has been read.
    #[must_use]
    pub fn metadata(&self) -> &BTreeMap<String, BTreeMap<String, String>> {
        self.reader.metadata()
    }

    /// Bytes of damaged places of the file under way that gave no frame, so far.
    #[must_use]
    pub fn unread(&self) -> u64 {
        self.reader.unread()
    }

    /// 0-based number of the file under way.
    #[must_use]
    pub fn file(&self) -> usize {
        self.file
    }

    /// Bytes in the files before it.
    #[must_use]
    pub fn before(&self) -> u64 {
        self.before
    }
}

impl Iterator for Recording {
    type Item = Result<Frame, Error>;

    fn next(&mut self) -> Option<Self::Item> {
        loop {
            if let Some(item) = self.reader.next() {
                if matches!(item, Err(Error::Interrupted)) {
                    self.next.clear();
                }
                return Some(item);
            }
            let path = self.next.pop_front()?;
            self.file += 1;
            self.before += std::mem::take(&mut self.size);
            match Reader::open(&path) {
                Ok(reader) => (self.size, self.reader) = (reader.size(), reader),
                Err(error) => return Some(Err(error)),
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::log::{Options, Writer};

    const T: u64 = 1_790_000_000_000_000_000;

    /// A recording of 300 frames 20 ms apart in files of two seconds.
    fn record(folder: &Path, name: &str, from_ns: u64) -> Vec<PathBuf> {
        let first = folder.join(name);
        let options = Options { max_ns: 2_000_000_000, ..Options::default() };
        let mut log = Writer::create_with(&first, options).unwrap();
        let mut files = vec![first];
        for i in 0..300_u64 {
            log.frame(from_ns + i * 20_000_000, &[(i % 200) as u8 + 1; 12]).unwrap();
            if log.path() != files.last().unwrap() {
                files.push(log.path().to_path_buf());
            }
        }
        log.finish().unwrap();
        assert_eq!(files.len(), 3);
        files
    }

    fn count(first: &Path) -> (usize, usize) {
        let (frames, errors): (Vec<_>, Vec<_>) = Recording::open(first).unwrap().partition(Result::is_ok);
        (frames.len(), errors.len())
    }

    #[test]
    fn the_first_file_means_the_drive_and_a_later_one_itself() {
        let folder = tempfile::tempdir().unwrap();
        let files = record(folder.path(), "a.log.mcap", T);
        assert_eq!(Parts::of(&files[0]).unwrap(), Parts { files: files.clone(), remarks: Vec::new() });
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
}
