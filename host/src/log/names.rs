//! The names of a recording's files: all are made of the first one's, and a number.

use std::collections::BTreeSet;
use std::ffi::OsStr;
use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use super::{PARTS, Reader, metadata};
use crate::output::folder_of;

/// `drive.log.mcap` -> `drive.log.part0002.mcap`: behind the first in the order of names.
pub(super) fn part_path(first: &Path, number: u32) -> PathBuf {
    let extension = first.extension().unwrap_or_default().to_string_lossy().into_owned();
    let extension =
        if extension.is_empty() { format!("part{number:04}") } else { format!("part{number:04}.{extension}") };
    first.with_extension(extension)
}

/// Which file of a recording has a name: 1 is the first.
pub(super) fn number_of(first: &Path, name: &str) -> Option<u32> {
    if has_name(first, name) {
        return Some(1);
    }
    let stem = first.file_stem()?.to_string_lossy();
    let digits = name.strip_prefix(&*stem)?.strip_prefix(".part")?;
    let digits = digits.split('.').next()?;
    let number = digits.parse().ok().filter(|number| (2..=PARTS).contains(number))?;
    has_name(&part_path(first, number), name).then_some(number)
}

/// Which files of such names there are behind the first.
pub(super) fn numbers(first: &Path) -> BTreeSet<u32> {
    let Ok(entries) = fs::read_dir(folder_of(first)) else { return BTreeSet::new() };
    let names = entries.flatten().map(|entry| entry.file_name());
    names.filter_map(|name| number_of(first, &name.to_string_lossy())).filter(|&number| number > 1).collect()
}

/// Whether the folder takes the names of all files that may follow a first one, by the words of its file system.
pub(super) fn has_room(first: &Path) -> io::Result<()> {
    let is_too_long =
        |path: &Path| fs::symlink_metadata(path).is_err_and(|error| error.kind() == io::ErrorKind::InvalidFilename);
    let last = part_path(first, PARTS);
    if !is_too_long(&last) {
        return Ok(());
    }
    let bytes = |path: &Path| path.file_name().unwrap_or_default().len();
    let added = bytes(&last).saturating_sub(bytes(first));
    let most = (1..bytes(&last)).rev().find(|&most| !is_too_long(&last.with_file_name("x".repeat(most))));
    Err(io::Error::new(
        io::ErrorKind::InvalidFilename,
        match most {
            Some(most) => format!(
                "the name has {} bytes, and at most {} are allowed here: the files that may follow are called {}",
                bytes(first),
                most.saturating_sub(added),
                "NAME.part0002 and so on",
            ),
            None => "the path is too long".to_owned(),
        },
    ))
}

pub(super) fn has_name(path: &Path, name: &str) -> bool {
    path.file_name().map(OsStr::to_string_lossy).is_some_and(|found| found == name)
}

/// The names of files, and of those that they were recovered from, as [`metadata::RECOVERED`] has them under `from`.
///
/// Names and not paths: where they lay is nobody's business who gets the log.
pub(crate) fn names_of(files: &[PathBuf]) -> String {
    let mut names = Vec::new();
    for file in files {
        names.extend(file.file_name().map(|name| name.to_string_lossy().into_owned()));
        let recovered = Reader::open(file).ok().and_then(|log| log.metadata().get(metadata::RECOVERED).cloned());
        names.extend(recovered.and_then(|recovered| recovered.get("from").cloned()));
    }
    names.join(", ")
}

/// Whether a name is among those of [`names_of`]; commas may be in names, too.
pub(super) fn is_among(name: &str, from: &str) -> bool {
    format!(", {from}, ").contains(&format!(", {name}, "))
}
