//! LAS and LAZ frames, one file a frame.

use std::path::Path;

use las::Reader;

use super::frames::{Error, MOST_POINTS};

fn open(path: &Path) -> Result<Reader, Error> {
    Reader::from_path(path).map_err(|source| Error::Las { path: path.into(), source })
}

/// Number of points that a file's header tells.
pub(super) fn count(path: &Path) -> Result<u64, Error> {
    // What is wrong is told when the frame is read.
    Ok(open(path).map_or(0, |reader| reader.header().number_of_points()))
}

/// Reads a frame.
///
/// # Errors
/// A file that the library cannot read, or one of more points than any frame has.
pub(super) fn read(path: &Path, put: &mut impl FnMut([f64; 3], f32)) -> Result<(), Error> {
    let mut reader = open(path)?;
    let mut left = reader.header().number_of_points();
    if left > MOST_POINTS {
        return Err(Error::Large { path: path.into(), bytes: left });
    }
    while left > 0 {
        let part = left.min(1 << 16);
        let points = reader.read_points(part).map_err(|source| Error::Las { path: path.into(), source })?;
        if points.is_empty() {
            let what = format!("the file ends {left} points before what its header tells");
            return Err(Error::Format { path: path.into(), offset: 0, what });
        }
        left = left.saturating_sub(points.len() as u64);
        for (((x, y), z), intensity) in points.x().zip(points.y()).zip(points.z()).zip(points.intensity()) {
            put([x, y, z], f32::from(intensity) / 65_535.0);
        }
    }
    Ok(())
}
