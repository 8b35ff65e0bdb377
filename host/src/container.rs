//! MCAP files as a sequence of records, read linearly and with the place of everything.
//!
//! Captures and logs are MCAP files that must be readable however they ended: cut at any byte, with a flipped bit, without
//! the summary that a writer appends at the end. So the top level is walked here, record by record (an opcode of one byte and a
//! length of eight, MCAP specification, "Records"), with every step checked against the file's size; what the records hold
//! is left to the `mcap` crate. A chunk that is damaged or cut yields the messages before the damage, then says where it is.
//!
//! Bounds: one chunk is in memory at a time, and no chunk larger than [`MAX_CHUNK`] is accepted, whatever its header says.

mod closing;
pub(crate) mod disk;

use std::fs::{self, File};
use std::io::{self, BufReader, Read, Seek};
use std::path::{Path, PathBuf};

pub(crate) use closing::Index;
use disk::{Disk, Source};
use mcap::records::{Record, op};
use mcap::sans_io::linear_reader::{LinearReadEvent, LinearReader, LinearReaderOptions};

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

/// What can be wrong with an MCAP file.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// The operating system refused.
    #[error("{}: {source}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// Why.
        source: io::Error,
    },
    /// Another kind of file.
    #[error("{}: not an MCAP file: it begins with {found}, expected 89 4D 43 41 50 30 0D 0A", path.display())]
    Foreign {
        /// The file.
        path: PathBuf,
        /// Its first bytes.
        found: String,
    },
    /// The file ends too early.
    #[error("{}: cut short: the file ends at byte {end}, {expected}", path.display())]
    Cut {
        /// The file.
        path: PathBuf,
        /// Its size.
        end: u64,
        /// What should have come.
        expected: String,
    },
    /// Some bytes are not what they should be.
    #[error("{}: damaged at byte {offset}: {what}", path.display())]
    Damaged {
        /// The file.
        path: PathBuf,
        /// Where.
        offset: u64,
        /// What was found and what was expected.
        what: String,
    },
    /// The file is whole but holds something else.
    #[error("{}: {what}", path.display())]
    Content {
        /// The file.
        path: PathBuf,
        /// What is missing.
        what: String,
    },
    /// The user asked to stop.
    #[error("interrupted")]
    Interrupted,
}

impl Error {
    /// Where in the file, as far as the error has a place.
    #[must_use]
    pub fn offset(&self) -> Option<u64> {
        match self {
            Self::Cut { end, .. } => Some(*end),
            Self::Damaged { offset, .. } => Some(*offset),
            _ => None,
        }
    }

    /// What is wrong, without the name of the file.
    #[must_use]
    pub fn what(&self) -> String {
        match self {
            Self::Cut { expected, .. } => format!("cut short: {expected}"),
            Self::Damaged { what, .. } | Self::Content { what, .. } => what.clone(),
            other => other.to_string(),
        }
    }
}

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

/// A channel: its number in this file and its name.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct ChannelName {
    pub id: u16,
    pub topic: String,
}

/// A message.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Message {
    /// Where the message's record is; in a compressed chunk, where the chunk is.
    pub offset: u64,
    pub channel: u16,
    /// The record's own number; writers here count all records of a recording.
    pub sequence: u32,
    /// Nanoseconds.
    pub log_time: u64,
    /// Nanoseconds; writers here give both times the same value.
    pub publish_time: u64,
    pub data: Vec<u8>,
}

/// Bytes of a file, for progress and accounts; 0 where they cannot be told.
#[must_use]
pub fn size(path: &Path) -> u64 {
    fs::metadata(path).map_or(0, |metadata| metadata.len())
}

/// What a chunk, or a message outside of any, holds.
#[derive(Debug, Default)]
pub(crate) struct Contents {
    pub channels: Vec<ChannelName>,
    pub messages: Vec<Message>,
    /// Bytes of the record that were understood.
    pub read: u64,
    /// What kept the rest from being read.
    pub error: Option<Error>,
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

    /// Everything in a chunk, a channel record or a message record of the top level.
    pub fn contents(&mut self, entry: Entry) -> Contents {
        let mut contents = Contents::default();
        let result = match entry.opcode {
            op::CHUNK => self.chunk(entry, &mut contents),
            op::CHANNEL | op::MESSAGE => {
                self.body(entry).and_then(|body| self.keep(entry.offset, entry.opcode, &body, &mut contents))
            }
            _ => Ok(()),
        };
        contents.error = result.err();
        contents
    }

    fn chunk(&mut self, entry: Entry, contents: &mut Contents) -> Result<(), Error> {
        let room = self.size.saturating_sub(entry.offset + HEAD);
        let here = entry.length.min(room);
        if here > MAX_CHUNK {
            return Err(self.damaged(entry.offset, format!("a chunk of {here} bytes, expected at most {MAX_CHUNK}")));
        }
        let mut body = vec![0; here as usize];
        self.read_at(entry.offset + HEAD, &mut body)?;
        let Some(head) = ChunkHead::parse(&body) else {
            return Err(if entry.length > room {
                self.cut(format!("inside of the chunk that began at byte {}", entry.offset))
            } else {
                self.damaged(entry.offset, "the chunk's header is not readable".to_owned())
            });
        };
        if head.unpacked > MAX_CHUNK {
            let what = format!("a chunk of {} bytes, expected at most {MAX_CHUNK}", head.unpacked);
            return Err(self.damaged(entry.offset, what));
        }
        let result = if head.compression.is_empty() {
            self.plain_records(entry, &body, &head, contents)
        } else {
            self.packed_records(entry, &body, head.unpacked, contents)
        };
        // A cut chunk fails somehow; that it is cut is what the user needs to know.
        if entry.length > room {
            return Err(self.cut(format!("inside of the chunk that began at byte {}", entry.offset)));
        }
        result
    }

    /// Records of an uncompressed chunk: they lie in the file as they are, so each has its place.
    fn plain_records(&self, entry: Entry, body: &[u8], head: &ChunkHead, contents: &mut Contents) -> Result<(), Error> {
        let mut rest = body.get(head.records_at..).unwrap_or_default();
        rest = rest.get(..usize::try_from(head.packed).unwrap_or(usize::MAX)).unwrap_or(rest);
        let (actual, crc) = (crc32fast::hash(rest), head.crc);
        let end = entry.offset + HEAD + (head.records_at + rest.len()) as u64;
        contents.read = HEAD + head.records_at as u64;
        while let Some((&[opcode, ref length @ ..], after)) = rest.split_first_chunk::<{ HEAD as usize }>() {
            let offset = end - rest.len() as u64;
            let length = usize::try_from(u64::from_le_bytes(*length)).unwrap_or(usize::MAX);
            let Some((record, next)) = after.split_at_checked(length) else {
                return Err(self
                    .damaged(offset, format!("a record of {length} bytes, of which its chunk holds {}", after.len())));
            };
            self.keep(offset, opcode, record, contents)?;
            contents.read += HEAD + length as u64;
            rest = next;
        }
        // The messages are kept even so: what is in them has checks of its own.
        if crc != 0 && actual != crc {
            return Err(self.damaged(entry.offset, format!("the chunk's CRC is {actual:08X}, expected {crc:08X}")));
        }
        if !rest.is_empty() {
            return Err(self.damaged(entry.offset, format!("the chunk ends with {} stray bytes", rest.len())));
        }
        Ok(())
    }

    /// Records of a compressed chunk, through the crate's reader.
    fn packed_records(&self, entry: Entry, body: &[u8], unpacked: u64, contents: &mut Contents) -> Result<(), Error> {
        let options = LinearReaderOptions::default()
            .with_skip_start_magic(true)
            .with_skip_end_magic(true)
            .with_validate_chunk_crcs(true)
            .with_record_length_limit(MAX_CHUNK as usize);
        let mut reader = LinearReader::new_with_options(options);
        let mut total = 0;
        let mut input = io::Cursor::new([[op::CHUNK].as_slice(), &entry.length.to_le_bytes()].concat()).chain(body);
        while let Some(event) = reader.next_event() {
            match event {
                Ok(LinearReadEvent::ReadRequest(wanted)) => {
                    // In-memory reading does not fail; less than wanted means the end.
                    let got = input.read(reader.insert(wanted.min(1 << 20))).unwrap_or(0);
                    reader.notify_read(got);
                }
                Ok(LinearReadEvent::Record { opcode, data }) => {
                    // Some bytes can be packed for a million: no more comes out than the chunk has announced.
                    total += HEAD + data.len() as u64;
                    if total > unpacked {
                        let what = format!("a chunk of more than the {unpacked} bytes that it announces");
                        return Err(self.damaged(entry.offset, what));
                    }
                    self.keep(entry.offset, opcode, data, contents)?;
                }
                Err(error) => return Err(self.damaged(entry.offset, error.to_string())),
            }
        }
        Ok(())
    }

    fn keep(&self, offset: u64, opcode: u8, body: &[u8], contents: &mut Contents) -> Result<(), Error> {
        match opcode {
            op::CHANNEL | op::MESSAGE => {}
            op::SCHEMA => return Ok(()),
            _ => return Err(self.damaged(offset, format!("a record {opcode:02X}, expected a channel or a message"))),
        }
        match mcap::parse_record(opcode, body) {
            Ok(Record::Channel(channel)) => {
                let pairs: usize = channel.metadata.iter().map(|(key, value)| 8 + key.len() + value.len()).sum();
                if body.len() != 16 + channel.topic.len() + channel.message_encoding.len() + pairs {
                    return Err(self.damaged(offset, "a channel record that does not fill its length".to_owned()));
                }
                contents.channels.push(ChannelName { id: channel.id, topic: channel.topic });
            }
            Ok(Record::Message { header, data }) => contents.messages.push(Message {
                offset,
                channel: header.channel_id,
                sequence: header.sequence,
                log_time: header.log_time,
                publish_time: header.publish_time,
                data: data.into_owned(),
            }),
            Ok(_) => {}
            Err(_) => return Err(self.damaged(offset, "a channel or message record that is not readable".to_owned())),
        }
        Ok(())
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

/// Longest chunk record up to its records: opcode and length, fixed fields, the name of a compression.
const CHUNK_HEAD_MAX: usize = HEAD as usize + 40 + 4;

/// The fields in front of a chunk's records (MCAP specification, "Chunk").
struct ChunkHead {
    start: u64,
    end: u64,
    unpacked: u64,
    crc: u32,
    compression: String,
    packed: u64,
    /// Where the records begin in the body.
    records_at: usize,
}

impl ChunkHead {
    /// Of a compression, in bytes.
    const LONGEST_NAME: usize = 64;

    /// Length of the chunk's record, as its header has it.
    fn length(&self) -> Option<u64> {
        self.packed.checked_add(self.records_at as u64)
    }

    fn parse(body: &[u8]) -> Option<Self> {
        let long = |at: usize| Some(u64::from_le_bytes(*body.get(at..)?.first_chunk()?));
        let short = |at: usize| Some(u32::from_le_bytes(*body.get(at..)?.first_chunk()?));
        // An unknown compression is refused by the crate's reader; an absurd length is no header.
        let name = short(28).filter(|&length| length as usize <= Self::LONGEST_NAME)? as usize;
        Some(Self {
            start: long(0)?,
            end: long(8)?,
            unpacked: long(16)?,
            crc: short(24)?,
            compression: str::from_utf8(body.get(32..32 + name)?).ok()?.to_owned(),
            packed: long(32 + name)?,
            records_at: 40 + name,
        })
    }
}

/// Whether a chunk record begins here, by every relation that its header must fulfil.
fn begins_chunk(bytes: &[u8], room: u64) -> bool {
    let Some((&[opcode, ref length @ ..], body)) = bytes.split_first_chunk::<{ HEAD as usize }>() else { return false };
    let length = u64::from_le_bytes(*length);
    if opcode != op::CHUNK || !(40..=MAX_CHUNK).contains(&length) || room < HEAD {
        return false;
    }
    ChunkHead::parse(body).is_some_and(|head| {
        head.start <= head.end
            && head.unpacked <= MAX_CHUNK
            && matches!(head.compression.as_str(), "" | "lz4" | "zstd")
            && head.length() == Some(length)
    })
}

fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02X}")).collect::<Vec<_>>().join(" ")
}
