//! MCAP files as a sequence of records, read linearly and with the place of everything.
//!
//! Captures and logs are MCAP files that must be readable however they ended: cut at any byte, with a flipped bit, without
//! the summary that a writer appends at the end. So the top level is walked here, record by record (an opcode of one byte and a
//! length of eight, MCAP specification, "Records"), with every step checked against the file's size; what the records hold
//! is left to the `mcap` crate. A chunk that is damaged or cut yields the messages before the damage, then says where it is.
//!
//! Bounds: one chunk is in memory at a time, and no chunk larger than [`MAX_CHUNK`] is accepted, whatever its header says.

mod chunk_head;
mod closing;
mod contents;
pub(crate) mod disk;
mod error;

use std::fs::{self, File};
use std::io::{self, BufReader, Read, Seek};
use std::path::{Path, PathBuf};

use chunk_head::{CHUNK_HEAD_MAX, ChunkHead, begins_chunk};
pub(crate) use closing::Index;
pub(crate) use contents::{ChannelName, Message};
use disk::{Disk, Source};
pub use error::Error;
use mcap::records::op;

/// The largest chunk, packed or unpacked, in bytes. Writers make them of about one megabyte.
pub const MAX_CHUNK: u64 = 256 << 20;

/// The largest record read as a whole that is not a chunk: metadata, a channel.
const MAX_RECORD: u64 = 16 << 20;

/// Times a file's size that may be walked again for records with wrong lengths: some of these cost most of a file each.
const AGAIN: u64 = 8;

/// Length of a footer's body.
const FOOTER: u64 = 20;

/// Bytes in which a chunk is looked for at some places of a file that does not begin as it should.
const LOOK: u64 = 1 << 20;

/// Opcode and length in front of every record.
const HEAD: u64 = 9;

/// One record of the top level.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Entry {
    /// Where its opcode is.
    pub offset: u64,
    /// Its opcode, see [`mcap::records::op`].
    pub opcode: u8,
    /// Length of its body. The file may end before that; see [`Container::next_entry`].
    pub length: u64,
}

impl Entry {
    /// Where the next record begins.
    pub fn end(&self) -> u64 {
        self.offset.saturating_add(HEAD).saturating_add(self.length)
    }
}

/// Bytes of a file, for progress and accounts; 0 where they cannot be told.
#[must_use]
pub fn size(path: &Path) -> u64 {
    fs::metadata(path).map_or(0, |metadata| metadata.len())
}

/// An open MCAP file.
#[derive(Debug)]
pub(crate) struct Container {
    path: PathBuf,
    file: BufReader<Disk>,
    size: u64,
    /// How it begins, if not as an MCAP file does.
    strange: Option<String>,
    position: u64,
    closed: bool,
    /// Bytes that were walked more than once, see [`Container::resume`].
    again: u64,
}

impl Container {
    /// Opens a file and checks that it is one of MCAP.
    pub fn open(path: &Path) -> Result<Self, Error> {
        let container = Self::open_as(path, false)?;
        match container.foreign() {
            None => Ok(container),
            Some(error) => Err(error),
        }
    }

    /// Opens a file that may be one of MCAP, see [`Container::foreign`]. Of one whose disk has bad sectors these are zeros, see [`Container::unreadable`].
    pub fn open_damaged(path: &Path) -> Result<Self, Error> {
        Self::open_as(path, true)
    }

    fn open_as(path: &Path, patient: bool) -> Result<Self, Error> {
        let wrap = |source| Error::Io { path: path.to_path_buf(), source };
        // Looked at before it is opened: opening a pipe waits for its writer.
        let metadata = fs::metadata(path).map_err(wrap)?;
        if metadata.is_dir() {
            return Err(wrap(io::Error::from(io::ErrorKind::IsADirectory)));
        }
        if !metadata.is_file() {
            let what = "is a pipe or a device, and must be a file: it is read at any place";
            return Err(wrap(io::Error::new(io::ErrorKind::NotSeekable, what)));
        }
        let file = File::open(path).map_err(wrap)?;
        Self::over(path, Box::new(file), metadata.len(), patient)
    }

    /// Over what is read as the file `path` of `size` bytes.
    pub(crate) fn over(path: &Path, source: Box<dyn Source>, size: u64, patient: bool) -> Result<Self, Error> {
        let file = BufReader::with_capacity(1 << 16, Disk::new(source, size, patient));
        let mut container =
            Self { path: path.to_path_buf(), file, size, strange: None, position: 0, closed: false, again: 0 };
        let start = container.bytes(0, mcap::MAGIC.len())?;
        if start != mcap::MAGIC {
            container.strange = Some(if start.is_empty() { "nothing (it is empty)".to_owned() } else { hex(&start) });
        }
        container.position = start.len() as u64;
        Ok(container)
    }

    /// The error of a file that does not begin as one of MCAP.
    pub fn foreign(&self) -> Option<Error> {
        Some(Error::Foreign { path: self.path.clone(), found: self.strange.clone()? })
    }

    /// Whether a file that does not begin as one of MCAP may be one all the same: by its end, or by the chunks at some places of it. What is looked at is bounded,
    /// however large it is; the chunks of a log are much nearer to each other than that.
    pub fn may_be_damaged(&mut self) -> Result<bool, Error> {
        const PLACES: u64 = 8;
        let mark = mcap::MAGIC.len();
        if self.size >= 2 * mark as u64 && self.bytes(self.size - mark as u64, mark)? == mcap::MAGIC {
            return Ok(true);
        }
        let last = self.size.saturating_sub(LOOK);
        for place in 0..=PLACES {
            let from = last / PLACES * place;
            if self.chunk_between(from, from + LOOK)?.is_some() {
                return Ok(true);
            }
            if last == 0 {
                break;
            }
        }
        Ok(false)
    }

    /// Damage told once for each place in front of `below` that the disk could not read, with where it begins and ends.
    pub fn unreadable(&mut self, below: u64) -> Vec<(std::ops::Range<u64>, Error)> {
        let Some(why) = self.file.get_ref().failure() else { return Vec::new() };
        let places = self.file.get_mut().unreadable(below);
        let told = places.into_iter().map(|place| {
            let what = format!("{} bytes cannot be read: {why}", place.end - place.start);
            (place.clone(), self.damaged(place.start, what))
        });
        told.collect()
    }

    /// Why something could not be read, if anything.
    pub fn failure(&self) -> Option<Error> {
        self.file.get_ref().failure().map(|source| Error::Io { path: self.path.clone(), source })
    }

    /// The file's name.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Where the next record begins, or what is left of one.
    pub fn reached(&self) -> u64 {
        self.position.min(self.size)
    }

    /// Ends the walk: nothing behind this is a record.
    pub fn close(&mut self) {
        self.closed = true;
    }

    /// Whether a record begins at the place that was reached, or the file ends there.
    pub fn goes_on(&mut self) -> bool {
        let Ok(head) = self.bytes(self.reached(), CHUNK_HEAD_MAX) else { return false };
        let Some((&[opcode, ref length @ ..], _)) = head.split_first_chunk::<{ HEAD as usize }>() else {
            return head.is_empty();
        };
        let room = self.size - self.reached();
        match opcode {
            op::CHUNK => begins_chunk(&head, room),
            1..=op::DATA_END => u64::from_le_bytes(*length) <= room - HEAD,
            _ => false,
        }
    }

    /// Its size in bytes.
    pub fn size(&self) -> u64 {
        self.size
    }

    /// Bytes of the file: from `from`, at most so many, up to its end.
    pub fn bytes(&mut self, from: u64, most: usize) -> Result<Vec<u8>, Error> {
        let length = usize::try_from(self.size.saturating_sub(from)).unwrap_or(usize::MAX).min(most);
        let mut bytes = vec![0; length];
        self.read_at(from, &mut bytes)?;
        Ok(bytes)
    }

    /// The CRC-32 of everything before `end`, read in one go.
    pub fn checksum(&mut self, end: u64) -> Result<u32, Error> {
        self.checksum_of(0, end)
    }

    fn checksum_of(&mut self, from: u64, end: u64) -> Result<u32, Error> {
        let (mut hasher, mut at) = (crc32fast::Hasher::new(), from);
        while at < end.min(self.size) {
            let most = usize::try_from(end - at).unwrap_or(usize::MAX).min(1 << 20);
            let bytes = self.bytes(at, most)?;
            at += bytes.len() as u64;
            hasher.update(&bytes);
        }
        Ok(hasher.finalize())
    }

    /// The next record of the top level.
    ///
    /// A chunk that the file cuts short is returned all the same, since its beginning is worth reading; its contents tell the error. After an error the walk ends, unless [`Container::resume`] finds a chunk further on.
    pub fn next_entry(&mut self) -> Option<Result<Entry, Error>> {
        if self.closed {
            return None;
        }
        let offset = self.position;
        if offset > self.size {
            // Inside of a chunk, as its contents have told.
            self.closed = true;
            return None;
        }
        if offset == self.size {
            self.closed = true;
            return Some(Err(self.cut("before the closing records that end a recording".to_owned())));
        }
        let mut head = [0; HEAD as usize];
        if self.size - offset < HEAD {
            self.closed = true;
            return Some(Err(self.cut(format!("inside of the record that began at byte {offset}"))));
        }
        if let Err(error) = self.read_at(offset, &mut head) {
            self.closed = true;
            return Some(Err(error));
        }
        let [opcode, length @ ..] = head;
        let length = u64::from_le_bytes(length);
        if opcode == 0 || (opcode > op::DATA_END && opcode < 0x80) {
            self.closed = true;
            return Some(Err(self.damaged(offset, format!("{opcode:02X} is no opcode of an MCAP record"))));
        }
        let room = self.size - offset - HEAD;
        if opcode == op::FOOTER && length == FOOTER && room >= FOOTER {
            self.closed = true;
            self.position = offset + HEAD + FOOTER;
            // The closing mark, or what a cut has left of it; and nothing more.
            let end = match self.bytes(self.position, mcap::MAGIC.len() + 1) {
                Ok(end) => end,
                Err(error) => return Some(Err(error)),
            };
            if mcap::MAGIC.starts_with(&end) {
                return None;
            }
            let behind = room - FOOTER;
            let what = format!("{behind} bytes behind the closing records, expected 8 that end the file");
            return Some(Err(self.damaged(self.position, what)));
        }
        if opcode == op::FOOTER || (length > room && opcode != op::CHUNK) {
            self.closed = true;
            // With nothing to read behind it, it is the file's end that is missing and not a length that is wrong, unless that end is there.
            let goes_on =
                self.chunk_from(offset + 1).and_then(|chunk| Ok(chunk.is_some() || self.closing()?.is_some()));
            return Some(Err(match goes_on {
                Err(error) => error,
                Ok(false) => self.cut(format!("inside of the record that began at byte {offset}")),
                Ok(true) => self.damaged(offset, format!("a record of {length} bytes, of which the file holds {room}")),
            }));
        }
        if opcode == op::CHUNK
            && let Err(error) = self.check_chunk(offset, length)
        {
            self.closed = true;
            return Some(Err(error));
        }
        self.position = offset.saturating_add(HEAD).saturating_add(length);
        Some(Ok(Entry { offset, opcode, length }))
    }

    /// Whether a chunk's length is what its own header says, so that no wrong length hides the chunks behind it.
    fn check_chunk(&mut self, offset: u64, length: u64) -> Result<(), Error> {
        const LONGEST: usize = HEAD as usize + 40 + ChunkHead::LONGEST_NAME;
        let room = self.size - offset - HEAD;
        let head = self.bytes(offset, LONGEST)?;
        let found = head.get(HEAD as usize..).and_then(ChunkHead::parse).map(|head| head.length());
        // Where the file ends within the header, nothing says that the length is wrong.
        let cut = found.is_none() && length > room && head.len() < LONGEST;
        if cut || (found == Some(Some(length)) && length <= MAX_CHUNK) {
            return Ok(());
        }
        Err(self.damaged(
            offset,
            match found.flatten() {
                Some(found) if found != length => {
                    format!("a chunk of {length} bytes, by its own header of {found}; the file holds {room}")
                }
                Some(_) => format!("a chunk of {length} bytes, expected at most {MAX_CHUNK}"),
                None => "the chunk's header is not readable".to_owned(),
            },
        ))
    }

    /// After damage at `at`: goes on at the next place behind it at which a chunk begins. Returns where, or nothing if there is none.
    ///
    /// A chunk is known by its header: plausible lengths that agree with each other, times in order, a known compression.
    ///
    /// The place may lie within a record that was walked over, since that record's length may be what is wrong; nothing before `at` is ever read
    /// again, though. Records within each other's bodies would have most of a file walked again and again: from [`AGAIN`] times its size on, the
    /// search begins behind what was walked.
    pub fn resume(&mut self, at: u64) -> Result<Option<u64>, Error> {
        let tired = self.again > AGAIN.saturating_mul(self.size);
        let found = self.chunk_from(if tired { self.position.max(at + 1) } else { at + 1 })?;
        if let Some(place) = found {
            self.again += self.position.saturating_sub(place);
            (self.position, self.closed) = (place, false);
        }
        Ok(found)
    }

    /// The first byte from `from` on at which a chunk begins.
    fn chunk_from(&mut self, from: u64) -> Result<Option<u64>, Error> {
        self.chunk_between(from, self.size)
    }

    fn chunk_between(&mut self, from: u64, to: u64) -> Result<Option<u64>, Error> {
        // The next one is mostly near.
        let (mut base, mut window) = (from, 1 << 12);
        while base < to.min(self.size) {
            let bytes = self.bytes(base, window + CHUNK_HEAD_MAX)?;
            let found = (0..bytes.len().min(window)).find(|&i| begins_chunk(&bytes[i..], self.size - base - i as u64));
            if let Some(i) = found {
                return Ok(Some(base + i as u64));
            }
            base += window as u64;
            window = (2 * window).min(1 << 16);
        }
        Ok(None)
    }

    /// The body of a record that is not a chunk.
    pub fn body(&mut self, entry: Entry) -> Result<Vec<u8>, Error> {
        if entry.length > MAX_RECORD {
            return Err(self
                .damaged(entry.offset, format!("a record of {} bytes, expected at most {MAX_RECORD}", entry.length)));
        }
        let mut body = vec![0; entry.length as usize];
        self.read_at(entry.offset + HEAD, &mut body)?;
        Ok(body)
    }

    /// The times of the first and last message of a chunk, by its header, or of a message outside of any.
    pub fn times(&mut self, entry: Entry) -> Result<(u64, u64), Error> {
        let mut head = [0; 16];
        let (at, needed) = if entry.opcode == op::CHUNK { (0, 16) } else { (6, 8) };
        let room = self.size.saturating_sub(entry.offset + HEAD).min(entry.length);
        if room < at + needed {
            return Err(self.cut(format!("inside of the record that began at byte {}", entry.offset)));
        }
        self.read_at(entry.offset + HEAD + at, &mut head[..needed as usize])?;
        let [a, b, c, d, e, f, g, h, rest @ ..] = head;
        let first = u64::from_le_bytes([a, b, c, d, e, f, g, h]);
        Ok((first, if entry.opcode == op::CHUNK { u64::from_le_bytes(rest) } else { first }))
    }

    fn read_at(&mut self, offset: u64, into: &mut [u8]) -> Result<(), Error> {
        let mut read = || -> io::Result<()> {
            let here = self.file.stream_position()?;
            // A relative seek keeps what is buffered.
            let distance = i64::try_from(i128::from(offset) - i128::from(here)).map_err(io::Error::other)?;
            self.file.seek_relative(distance)?;
            self.file.read_exact(into)
        };
        read().map_err(|source| Error::Io { path: self.path.clone(), source })
    }

    fn cut(&self, expected: String) -> Error {
        Error::Cut { path: self.path.clone(), end: self.size, expected }
    }

    /// An error at a place of this file.
    pub fn damaged(&self, offset: u64, what: String) -> Error {
        Error::Damaged { path: self.path.clone(), offset, what }
    }
}

fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02X}")).collect::<Vec<_>>().join(" ")
}
