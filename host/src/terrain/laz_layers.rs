//! Layers of LAZ, held against their file before they are unpacked.
//!
//! Points of format 6 and later are packed by chunks: the first point as it is, the number of points, the length of every layer, then the layers
//! (LASzip, "layered chunked"). The library makes room for a layer by the length that is told, up to 4 GiB, before it reads it. So the
//! chunks are walked first, by their heads alone, and the library is given the file up to the end of the last: it reads them one behind
//! the other, and so nothing else.

use std::fs::File;
use std::io::{self, BufReader, Read, Seek, SeekFrom};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use las::Header;

/// Of the record that says how points are packed.
const USER: &str = "laszip encoded";
const RECORD: u16 = 22_204;

/// Its kind of compressor that has one chunk and no table of chunks.
const ONE_CHUNK: u16 = 1;

/// Where its items begin, and bytes of each.
const ITEMS: usize = 34;
const ITEM: usize = 6;

/// From this version on an item is packed in layers.
const LAYERED: u16 = 3;

/// A file that ends where it is told to.
pub(super) struct Bounded {
    file: BufReader<File>,
    at: u64,
    end: Arc<AtomicU64>,
}

impl Bounded {
    /// The whole file, and what its end is told by.
    pub fn new(file: File) -> (Self, Arc<AtomicU64>) {
        let end = Arc::new(AtomicU64::new(u64::MAX));
        (Self { file: BufReader::new(file), at: 0, end: Arc::clone(&end) }, end)
    }
}

impl Read for Bounded {
    fn read(&mut self, into: &mut [u8]) -> io::Result<usize> {
        let room = self.end.load(Ordering::Relaxed).saturating_sub(self.at);
        let most = usize::try_from(room).unwrap_or(usize::MAX).min(into.len());
        let read = self.file.read(&mut into[..most])?;
        self.at += read as u64;
        Ok(read)
    }
}

impl Seek for Bounded {
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        self.at = self.file.seek(to)?;
        Ok(self.at)
    }
}

/// How a file's chunks begin.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Layers {
    /// Bytes between the header's place of the points and the first chunk.
    before: u64,
    /// Bytes of the first point.
    point: u64,
    /// Layers in all.
    layers: u64,
}

impl Layers {
    /// Of a file; nothing if it has no layers, or the library knows none like them.
    pub fn of(header: &Header) -> Option<Self> {
        let packed = header.vlrs().iter().find(|vlr| vlr.user_id == USER && vlr.record_id == RECORD)?;
        Self::parse(&packed.data)
    }

    fn parse(data: &[u8]) -> Option<Self> {
        let short = |at: usize| Some(u16::from_le_bytes(*data.get(at..)?.first_chunk()?));
        let before = if short(0)? == ONE_CHUNK { 0 } else { 8 };
        let mut found = Self { before, point: 0, layers: 0 };
        for item in 0..usize::from(short(ITEMS - 2)?) {
            let at = ITEMS + item * ITEM;
            if short(at + 4)? < LAYERED {
                return None;
            }
            // The library takes the length of an item from what it is, but for extra bytes.
            let (point, layers) = match short(at)? {
                10 => (30, 9),
                11 => (6, 1),
                12 => (8, 2),
                13 => (29, 1),
                14 => (u64::from(short(at + 2)?), u64::from(short(at + 2)?)),
                _ => return None,
            };
            found.point += point;
            found.layers += layers;
        }
        Some(found)
    }

    /// Where the last chunk of so many points ends, of a file of `bytes` whose points begin at `first`.
    ///
    /// # Errors
    /// [`Damage`], or what the disk says.
    pub fn end(&self, file: &mut File, first: u64, bytes: u64, points: u64) -> io::Result<Result<u64, Damage>> {
        let (mut at, mut left) = (first.saturating_add(self.before), points);
        let head = 4 * (1 + self.layers);
        while left > 0 {
            let lengths = at.saturating_add(self.point);
            if lengths.saturating_add(head) > bytes {
                return Ok(Err(Damage {
                    at,
                    what: format!("the file ends {left} points before what its header tells"),
                }));
            }
            file.seek(SeekFrom::Start(lengths))?;
            let mut numbers = Vec::new();
            Read::by_ref(file).take(head).read_to_end(&mut numbers)?;
            let mut numbers = numbers.as_chunks().0.iter().map(|&number| u64::from(u32::from_le_bytes(number)));
            let count = numbers.next().unwrap_or_default();
            if count == 0 {
                return Ok(Err(Damage { at, what: "a chunk without points".to_owned() }));
            }
            let (start, layers) = (lengths + head, numbers.sum::<u64>());
            if layers > bytes - start {
                let what = format!("a chunk with layers of {layers} bytes, of which the file holds {}", bytes - start);
                return Ok(Err(Damage { at, what }));
            }
            (at, left) = (start + layers, left.saturating_sub(count));
        }
        Ok(Ok(at))
    }
}

/// What is wrong with a chunk, and where it begins.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Damage {
    pub at: u64,
    pub what: String,
}
