//! LAS and LAZ frames, one file a frame.
//!
//! The library makes room for what a header tells, so what it tells is held against the file's size first. Damaged LAZ makes its decoder divide by
//! nothing or read beyond its end; so it decodes where a panic ends with the frame.

use std::fs::File;
use std::io::{self, Read, Seek, SeekFrom};
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use las::Reader;

use super::frames::{Error, MOST_POINTS};
use super::laz_layers::{Bounded, Layers};
use crate::unwinding::contained;

/// Bytes of points that are read at once.
const PART: u64 = 4 << 20;

fn open(path: &Path) -> Result<(Reader, Arc<AtomicU64>), Error> {
    check(path)?;
    let file = File::open(path).map_err(|source| Error::Read { path: path.into(), source })?;
    let (file, end) = Bounded::new(file);
    let reader = Reader::new(file).map_err(|source| Error::Las { path: path.into(), source })?;
    Ok((reader, end))
}

/// Number of points that a file's header tells.
pub(super) fn count(path: &Path) -> Result<u64, Error> {
    // What is wrong is told when the frame is read.
    Ok(walled(path, || open(path).map(|(reader, _)| reader.header().number_of_points())).unwrap_or(0))
}

/// What a library makes of a file; its panic is damage of the file.
fn walled<T: Send>(path: &Path, work: impl FnOnce() -> Result<T, Error> + Send) -> Result<T, Error> {
    let damaged =
        || Error::Format { path: path.into(), offset: 0, what: "damaged, and the LAZ library cannot go on".into() };
    contained(work).map_err(|source| Error::Read { path: path.into(), source })?.unwrap_or_else(|| Err(damaged()))
}

/// Reads a frame.
///
/// # Errors
/// A file that the library cannot read, or one of more points than any frame has.
pub(super) fn read(path: &Path, put: &mut (impl FnMut([f64; 3], f32) + Send)) -> Result<(), Error> {
    walled(path, || read_all(path, put))
}

fn read_all(path: &Path, put: &mut impl FnMut([f64; 3], f32)) -> Result<(), Error> {
    let (mut reader, end) = open(path)?;
    let mut left = reader.header().number_of_points();
    if let Some(layers) = Layers::of(reader.header()) {
        end.store(end_of(path, layers, left)?, Ordering::Relaxed);
    }
    let most = PART / u64::from(reader.header().point_format().len()).max(1);
    while left > 0 {
        let part = left.min(most);
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

/// Where the last chunk ends.
fn end_of(path: &Path, layers: Layers, points: u64) -> Result<u64, Error> {
    let failed = |source| Error::Read { path: path.into(), source };
    let mut file = File::open(path).map_err(failed)?;
    let bytes = file.metadata().map_err(failed)?.len();
    // LAS 1.4 R15, table 3: where the points begin.
    let first = whole(&bytes_at::<4>(&mut file, 96).map_err(failed)?);
    let end = layers.end(&mut file, first, bytes, points).map_err(failed)?;
    end.map_err(|damage| Error::Format { path: path.into(), offset: damage.at, what: damage.what })
}

/// Refuses a file of more points than any frame has, and one that is shorter than its points (LAS), its chunks (LAZ) or its extended records are told to be. What else is wrong with it, and a
/// file that is none of either, is the library's to say.
fn check(path: &Path) -> Result<(), Error> {
    let failed = |source| Error::Read { path: path.into(), source };
    let mut file = File::open(path).map_err(failed)?;
    let bytes = file.metadata().map_err(failed)?.len();
    let wrong = |offset, what| Err(Error::Format { path: path.into(), offset, what });
    // LAS 1.4 R15, table 3; the last of what is needed ends at 255.
    let head = bytes_at::<255>(&mut file, 0).map_err(failed)?;
    let number = |at: usize, size: usize| whole(&head[at..at + size]);
    if !head.starts_with(b"LASF") {
        return Ok(());
    }
    let (first, format, record) = (number(96, 4), head[104], number(105, 2));
    let extended = head[25] >= 4;
    let points = number(107, 4).max(if extended { number(247, 8) } else { 0 });
    // Further on they are multiplied by their length.
    if points > MOST_POINTS {
        return wrong(107, format!("{points} points are more than any frame has ({MOST_POINTS})"));
    }
    // Either of the upper bits stands for LAZ.
    if format & 0xC0 == 0 {
        if first + points * record > bytes {
            return wrong(
                bytes,
                format!("the file ends before {points} points of {record} bytes, which its header tells"),
            );
        }
    } else {
        let mut table = whole(&bytes_at::<8>(&mut file, first).map_err(failed)?);
        // Written by a program that could not go back: the table's place stands at the end.
        if table == u64::MAX {
            table = whole(&bytes_at::<8>(&mut file, bytes.saturating_sub(8)).map_err(failed)?);
        }
        let chunks = whole(&bytes_at::<8>(&mut file, table).map_err(failed)?[4..]);
        if chunks > bytes {
            return wrong(table, format!("{chunks} chunks do not fit into {bytes} bytes"));
        }
    }
    let mut at = number(235, 8);
    for _ in 0..if extended { number(243, 4) } else { 0 } {
        let record = bytes_at::<60>(&mut file, at).map_err(failed)?;
        let length = whole(&record[20..28]);
        let end = at.saturating_add(60).saturating_add(length);
        if end > bytes {
            return wrong(at, format!("an extended record of {length} bytes does not fit into {bytes} bytes"));
        }
        at = end;
    }
    Ok(())
}

/// A whole number of up to eight bytes, the lowest first.
fn whole(bytes: &[u8]) -> u64 {
    bytes.iter().rev().fold(0, |value, byte| value << 8 | u64::from(*byte))
}

/// Bytes at a place of a file, zeros where it has ended.
fn bytes_at<const N: usize>(file: &mut File, at: u64) -> io::Result<[u8; N]> {
    let mut bytes = Vec::with_capacity(N);
    // No file reaches further than a place can be sought.
    if at <= i64::MAX as u64 {
        file.seek(SeekFrom::Start(at))?;
        file.take(N as u64).read_to_end(&mut bytes)?;
    }
    bytes.resize(N, 0);
    Ok(bytes.try_into().unwrap_or([0; N]))
}
