//! The files of a folder that are frames, in their order.

use std::fs;
use std::path::{Path, PathBuf};

use super::Error;

/// How frames lie in their files.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Format {
    Kitti,
    Pcd,
    Las,
}

/// The frames of a folder in their order.
pub struct Listed {
    pub files: Vec<PathBuf>,
    /// The first one's number, where the files bear numbers that leave none out.
    number: Option<usize>,
}

impl Listed {
    /// Which of `found` poses or times is the first frame's.
    pub fn first_of(
        &self,
        path: &Path,
        what: &'static str,
        found: usize,
        remarks: &mut Vec<String>,
    ) -> Result<usize, Error> {
        let frames = self.files.len();
        if found == frames {
            return Ok(0);
        }
        let named = self.number.filter(|number| number.saturating_add(frames) <= found);
        let Some(first) = named else { return Err(Error::Count { path: path.into(), found, what, frames }) };
        let name = self.files[0].file_name().unwrap_or_default().display();
        remarks.push(format!(
            "{}: {found} {what} for {frames} frames: taken by the files' numbers; {first} before {name} and {} behind the last are not used",
            path.display(),
            found - first - frames
        ));
        Ok(first)
    }
}

/// The frames of a folder, and their format.
pub fn list_frames(folder: &Path) -> Result<(Listed, Format), Error> {
    let velodyne = folder.join("velodyne");
    if velodyne.is_dir() {
        let frames = listed(&velodyne, &["bin"])?;
        return if frames.files.is_empty() { Err(Error::NoFrames(folder.into())) } else { Ok((frames, Format::Kitti)) };
    }
    for place in [folder.to_path_buf(), folder.join("frames"), folder.join("pcd"), folder.join("las")] {
        // A folder that is not there is the user's mistake only if it is the one named.
        if place != folder && !place.is_dir() {
            continue;
        }
        for (format, endings) in [(Format::Pcd, &["pcd"][..]), (Format::Las, &["las", "laz"])] {
            let frames = listed(&place, endings)?;
            if !frames.files.is_empty() {
                return Ok((frames, format));
            }
        }
    }
    Err(Error::NoFrames(folder.into()))
}

/// Files of some endings, by their numbers where all names are numbers, else by their names. Numbers that count from 0 or 1 must
/// leave none out.
fn listed(folder: &Path, endings: &[&str]) -> Result<Listed, Error> {
    let read = |source| Error::Read { path: folder.into(), source };
    let mut files = Vec::new();
    for entry in fs::read_dir(folder).map_err(read)? {
        let path = entry.map_err(read)?.path();
        let ending = path.extension().and_then(|ending| ending.to_str()).map(str::to_ascii_lowercase);
        if ending.is_some_and(|ending| endings.contains(&ending.as_str())) {
            files.push(path);
        }
    }
    files.sort();
    let stem = |path: &PathBuf| path.file_stem().and_then(|stem| stem.to_str()).map(str::to_owned);
    let numbers: Option<Vec<u64>> = files.iter().map(|path| stem(path)?.parse().ok()).collect();
    let Some(numbers) = numbers.filter(|numbers| !numbers.is_empty()) else {
        return Ok(Listed { files, number: None });
    };
    let mut numbered: Vec<(u64, PathBuf)> = numbers.into_iter().zip(files).collect();
    numbered.sort();
    let (first, last) = (numbered[0].0, numbered[numbered.len() - 1].0);
    let counted = first <= 1 && last < 100_000_000;
    let gap = numbered.iter().zip(first..).find(|((number, _), wanted)| number != wanted).map(|(_, missing)| missing);
    if let Some(missing) = gap.filter(|_| counted) {
        return Err(Error::Gap { folder: folder.into(), missing: missing as usize, last: last as usize });
    }
    let number = gap.is_none().then_some(first).and_then(|first| usize::try_from(first).ok());
    Ok(Listed { files: numbered.into_iter().map(|(_, path)| path).collect(), number })
}
