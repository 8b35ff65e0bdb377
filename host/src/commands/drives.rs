//! Which files are meant by the logs that a user names: the first file of a recording is the drive.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use crossfall::container;
use crossfall::log::Parts;

use super::inputs::real;
use super::{tell, usage};

/// The drives that are named, each once. A file that belongs to another one of them is read with that and not once more. Tells how many files a drive has, and
/// what is missing or left out.
pub fn of(named: &[PathBuf]) -> Vec<PathBuf> {
    // What is no log is found out by whoever reads it.
    let recordings: Vec<Parts> = named.iter().map(|log| Parts::of(log).unwrap_or_default()).collect();
    let others = |recording: &Parts| [&recording.files[1.min(recording.files.len())..], &recording.within].concat();
    let followers: BTreeSet<PathBuf> = recordings.iter().flat_map(others).map(|file| real(&file)).collect();
    let (mut drives, mut seen) = (Vec::new(), BTreeSet::new());
    for (log, recording) in named.iter().zip(&recordings) {
        if !seen.insert(real(log)) {
            tell!("{}: is named more than once, and read once", log.display());
        } else if !followers.contains(&real(log)) {
            told(log, recording);
            drives.push(log.clone());
        }
    }
    drives
}

/// Files that are read in the order in which they are named, as one stream: each can be there once.
pub fn each_once(command: &str, named: &[PathBuf]) -> anyhow::Result<Vec<PathBuf>> {
    let mut seen = BTreeSet::new();
    match named.iter().find(|file| !seen.insert(real(file))) {
        Some(twice) => Err(usage(command, &format!("{}: is named more than once", twice.display()))),
        None => Ok(named.to_vec()),
    }
}

/// The files of a drive, the missing ones among them.
pub fn recording(log: &Path) -> Vec<PathBuf> {
    let recording = Parts::of(log).unwrap_or_else(|_| Parts { files: vec![log.to_path_buf()], ..Parts::default() });
    told(log, &recording);
    recording.files
}

/// The files of a drive that are there, and whether one is missing.
pub fn files(log: &Path) -> (Vec<PathBuf>, bool) {
    let (there, missing): (Vec<_>, Vec<_>) = recording(log).into_iter().partition(|file| file == log || file.exists());
    (there, !missing.is_empty())
}

/// Bytes of a drive, in all its files.
pub fn size(log: &Path) -> u64 {
    Parts::of(log).map_or_else(|_| container::size(log), |files| files.bytes())
}

fn told(log: &Path, recording: &Parts) {
    for remark in &recording.remarks {
        tell!("{remark}");
    }
    if recording.files.len() > 1 {
        tell!("{}: {} files, read as one drive", log.display(), recording.files.len());
    }
}
