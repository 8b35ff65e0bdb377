//! A recording of several files, read as the one stream that it is.

use std::collections::{BTreeMap, VecDeque};
use std::path::{Path, PathBuf};

use super::names::{has_name, is_among, number_of, part_path};
use super::parts::{before, is_other};
use super::{Error, Frame, Parts, Reader, metadata};

/// Reads the files of a recording one after the other.
///
/// Errors are told where they occur; the frames behind them follow. A file that cannot be opened is one, and so is the end of one that goes on in a file
/// that is not there, unless the first is itself a later file of a recording, and read for what it is.
#[derive(Debug)]
pub struct Recording {
    reader: Reader,
    /// The first file.
    first: PathBuf,
    /// The one under way, while its end is to be held against what follows.
    path: Option<PathBuf>,
    /// Whether the first is a later file of a recording.
    is_piece: bool,
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
        Ok(Self::over(first, reader, &parts.files[1..]))
    }

    /// Opens these files and no others, in this order. Those behind the first are opened when their turn comes.
    ///
    /// # Errors
    /// As of [`Reader::open`], of the first.
    pub fn open_all(first: &Path, others: &[PathBuf]) -> Result<Self, Error> {
        Ok(Self::over(first, Reader::open(first)?, others))
    }

    fn over(first: &Path, reader: Reader, others: &[PathBuf]) -> Self {
        Self {
            first: first.to_path_buf(),
            path: Some(first.to_path_buf()),
            is_piece: reader.metadata().contains_key(metadata::PART),
            next: others.iter().cloned().collect(),
            file: 0,
            size: reader.size(),
            before: 0,
            reader,
        }
    }

    /// What is wrong at the end of the file under way, once.
    fn torn(&mut self) -> Option<Error> {
        let path = self.path.take().filter(|_| !self.is_piece)?;
        let what = torn(&self.first, &path, self.reader.metadata(), self.next.front().map(PathBuf::as_path))?;
        Some(Error::Damaged { path, offset: self.size, what })
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
                    self.path = None;
                }
                return Some(item);
            }
            if let Some(error) = self.torn() {
                return Some(Err(error));
            }
            let path = self.next.pop_front()?;
            self.file += 1;
            self.before += std::mem::take(&mut self.size);
            match Reader::open(&path) {
                Ok(reader) => (self.size, self.reader, self.path) = (reader.size(), reader, Some(path)),
                Err(error) => return Some(Err(error)),
            }
        }
    }
}

/// What is wrong where a file of a recording ends. With its metadata it names the one that follows it, which is neither `next` nor there, or does not say that
/// it follows. `first` is the file that all their names are made of.
pub(crate) fn torn(
    first: &Path,
    file: &Path,
    metadata: &BTreeMap<String, BTreeMap<String, String>>,
    next: Option<&Path>,
) -> Option<String> {
    let name = metadata.get(metadata::NEXT)?.get("name")?;
    if next.is_some_and(|next| has_name(next, name)) {
        return None;
    }
    let from = metadata.get(metadata::RECOVERED).and_then(|recovered| recovered.get("from"));
    let is_this = |name: &str| has_name(file, name) || from.is_some_and(|from| is_among(name, from));
    // A name that is found in a file is no path: only its number is taken from it.
    let follower = number_of(first, name).map(|number| part_path(first, number)).filter(|path| path.exists());
    match follower.map(|path| Reader::open(&path)) {
        None => Some(format!("goes on in {name}, which is not there")),
        Some(Err(_)) => Some(format!("goes on in {name}, which cannot be read")),
        Some(Ok(log)) if is_other(metadata::recording_of(metadata), &log) => {
            Some(format!("goes on in {name}, and that is a file of another recording"))
        }
        // Not asked for, and there.
        Some(Ok(log)) if before(&log).is_some_and(is_this) => None,
        Some(Ok(_)) => Some(format!("goes on in {name}, which does not say that it follows")),
    }
}
