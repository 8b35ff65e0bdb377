//! Writing a log: chunks closed by time, one file after the other when one is full, nothing ever written over.

use std::collections::BTreeMap;
use std::fs;
use std::io::{self, BufWriter, Seek, SeekFrom, Write};
use std::mem;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{SystemTime, UNIX_EPOCH};

use mcap::records::{MessageHeader, Metadata};

use super::names::{has_room, part_path};
use super::storage::{self, Storage};
use super::{CHUNK_NS, TOPIC, WIRE_ID, metadata};
use crate::capture::unwritable;
use crate::output::{self, Output};

/// Bytes after which a chunk is closed in any case.
const CHUNK_BYTES: u64 = 1 << 20;

/// The highest number of a file. The one that gets it, or finds no free one behind its own, is the recording's last and grows on.
pub const PARTS: u32 = 9_999;

/// Receive time after which the next file is tried again where it could not be made: a minute.
const RETRY_NS: u64 = 60_000_000_000;

/// A file that follows another, and what it begins with is on the disk.
struct Successor {
    path: PathBuf,
    mcap: mcap::Writer<Sink>,
    written: Arc<AtomicU64>,
}

/// Why a file grows beyond its bounds.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum GrowsOn {
    /// The numbers of files are used up, now and later.
    Numbers,
    /// The next file could not be made; it is tried again a minute later.
    NoNext {
        /// What the operating system said, and of which file.
        why: String,
    },
}

/// Makes the storage of a file that must not exist.
type Opener = Box<dyn FnMut(&Path) -> io::Result<Box<dyn Storage>> + Send>;

/// How a live log is written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Options {
    /// A new file begins when one has so many bytes: looked at with every chunk.
    pub max_bytes: u64,
    /// A new file begins when one covers so much receive time.
    pub max_ns: u64,
    /// Chunks are packed with zstd. A damaged chunk is then lost as a whole, where plain bytes give up all frames but the one that was hit.
    pub compress: bool,
}

impl Default for Options {
    /// Files of 2 GiB, a day of driving: within what FAT32 holds, and what bounds the memory that the file's index takes.
    fn default() -> Self {
        Self { max_bytes: 2 << 30, max_ns: u64::MAX, compress: false }
    }
}

/// Writes a log.
pub struct Writer {
    /// The file that is written now.
    path: PathBuf,
    /// The first file of the recording, which names the others.
    first: PathBuf,
    /// The latest number that was tried for a file.
    number: u32,
    /// Files so far.
    files: u32,
    options: Options,
    /// How the next file is made; absent from logs that appear whole, and when all numbers are taken.
    open: Option<Opener>,
    /// When the next file could not be made, in receive time, and why.
    blocked: Option<(u64, String)>,
    /// What makes this recording another than any else, in hexadecimal digits: only of streams that cannot be had again.
    identity: Option<String>,
    mcap: mcap::Writer<Sink>,
    /// Bytes that have left `mcap` for this file; shared with its sink.
    written: Arc<AtomicU64>,
    sequence: u32,
    /// Receive time of the first frame of the open chunk.
    chunk_started: Option<u64>,
    /// Receive time of the first frame of this file.
    part_started: Option<u64>,
    /// Bytes in the files before this one.
    earlier_bytes: u64,
    /// Written again at the start of every file.
    described: BTreeMap<String, BTreeMap<String, String>>,
}

impl Writer {
    /// Starts a log of a stream that can be had again (a capture run in process): the file appears with [`Writer::finish`].
    ///
    /// # Errors
    /// When the file cannot be written.
    pub fn create(path: &Path) -> Result<Self, output::Error> {
        let options = Options { max_bytes: u64::MAX, ..Options::default() };
        Self::start(path, options, Target::Whole(Output::create(path)?), None)
    }

    /// Starts a log of a stream that cannot be had again: the file is there at once, and every chunk is brought to the disk when it is closed.
    ///
    /// # Errors
    /// When the file cannot be written or exists already.
    pub fn create_live(path: &Path) -> Result<Self, output::Error> {
        Self::create_with(path, Options::default())
    }

    /// [`Writer::create_live`] with options. The second file of `drive.log.mcap` is `drive.log.part0002.mcap`, and so on.
    ///
    /// # Errors
    /// When the file cannot be written or exists already, or its name is too long for those of the files that may follow it.
    pub fn create_with(path: &Path, options: Options) -> Result<Self, output::Error> {
        has_room(path).map_err(|source| output::Error { path: path.to_path_buf(), source })?;
        Self::create_over(path, options, Box::new(storage::create))
    }

    /// [`Writer::create_with`] on storage that is no file.
    ///
    /// # Errors
    /// When it cannot be made or written.
    pub fn create_over(path: &Path, options: Options, mut open: Opener) -> Result<Self, output::Error> {
        let storage = open(path).map_err(|source| output::Error { path: path.to_path_buf(), source })?;
        let mut writer = Self::start(path, options, Target::live(storage), Some(open))?;
        let identity = identity();
        writer.record(metadata::RECORDING, [("id".to_owned(), identity.clone())].into())?;
        writer.identity = Some(identity);
        // The channel's record is on the disk before the first frame comes.
        writer.flush()?;
        Ok(writer)
    }

    fn start(path: &Path, options: Options, target: Target, open: Option<Opener>) -> Result<Self, output::Error> {
        let written = Arc::default();
        let mcap = begin(path, options, Sink { target, written: Arc::clone(&written) })?;
        Ok(Self {
            path: path.to_path_buf(),
            first: path.to_path_buf(),
            number: 1,
            files: 1,
            options,
            open,
            blocked: None,
            identity: None,
            mcap,
            written,
            sequence: 0,
            chunk_started: None,
            part_started: None,
            earlier_bytes: 0,
            described: BTreeMap::new(),
        })
    }

    /// Appends a frame as received, the delimiting 0x00 included.
    ///
    /// # Errors
    /// When the file cannot be written.
    pub fn frame(&mut self, receive_ns: u64, bytes: &[u8]) -> Result<(), output::Error> {
        // A receive clock that was set back closes the chunk as well.
        if self.chunk_started.is_some_and(|started| is_over(started, receive_ns, CHUNK_NS)) {
            self.flush()?;
        }
        if self.chunk_started.is_none() && self.is_full(receive_ns) {
            self.rotate(receive_ns)?;
        }
        self.chunk_started.get_or_insert(receive_ns);
        self.part_started.get_or_insert(receive_ns);
        let (channel_id, sequence, log_time) = (WIRE_ID, self.sequence, receive_ns);
        self.sequence = self.sequence.wrapping_add(1);
        let header = MessageHeader { channel_id, sequence, log_time, publish_time: log_time };
        self.mcap.write_to_known_channel(&header, bytes).map_err(|error| unwritable(&self.path, error))
    }

    /// [`Writer::flush`] when the open chunk is [`CHUNK_NS`] old. To be called when frames fail to come.
    ///
    /// # Errors
    /// When the file cannot be written.
    pub fn settle(&mut self, now_ns: u64) -> Result<(), output::Error> {
        match self.chunk_started {
            Some(started) if now_ns.saturating_sub(started) >= CHUNK_NS => self.flush(),
            _ => Ok(()),
        }
    }

    /// Closes the open chunk and brings everything to the disk (a live log only).
    ///
    /// # Errors
    /// When the file cannot be written.
    pub fn flush(&mut self) -> Result<(), output::Error> {
        self.chunk_started = None;
        self.mcap.flush().map_err(|error| unwritable(&self.path, error))
    }

    /// Appends a metadata record, see [`metadata`].
    ///
    /// # Errors
    /// When the file cannot be written.
    pub fn metadata(&mut self, name: &str, entries: BTreeMap<String, String>) -> Result<(), output::Error> {
        if matches!(name, metadata::IDENTITY | metadata::CONFIG) {
            self.described.insert(name.to_owned(), entries.clone());
        }
        self.record(name, entries)
    }

    fn record(&mut self, name: &str, entries: BTreeMap<String, String>) -> Result<(), output::Error> {
        // It closes the open chunk.
        self.chunk_started = None;
        describe(&mut self.mcap, &self.path, name, entries)
    }

    /// The file that is written now.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Files so far.
    #[must_use]
    pub fn parts(&self) -> u32 {
        self.files
    }

    /// Why the file grows beyond its bounds, where it should have been followed by another one and is not.
    #[must_use]
    pub fn grows_on(&self) -> Option<GrowsOn> {
        if self.number >= PARTS && self.open.is_none() {
            return Some(GrowsOn::Numbers);
        }
        self.blocked.as_ref().map(|(_, why)| GrowsOn::NoNext { why: why.clone() })
    }

    /// Bytes in all files so far, without those of the open chunk.
    #[must_use]
    pub fn bytes(&self) -> u64 {
        self.earlier_bytes + self.written.load(Ordering::Relaxed)
    }

    /// Closes the file with its summary.
    ///
    /// # Errors
    /// When the last of it cannot be written.
    pub fn finish(self) -> Result<(), output::Error> {
        end(self.mcap, &self.path)
    }

    fn is_full(&self, now_ns: u64) -> bool {
        let Some(started) = self.part_started.filter(|_| self.open.is_some()) else { return false };
        let full = self.written.load(Ordering::Relaxed) >= self.options.max_bytes
            || is_over(started, now_ns, self.options.max_ns);
        full && self.blocked.as_ref().is_none_or(|(since, _)| is_over(*since, now_ns, RETRY_NS))
    }

    /// Goes on in the next file, which says again who sends and how it is configured, and closes this one, which names the next. Where there can be none,
    /// this one grows on: a file that is too large is better than a drive that ends.
    ///
    /// What the next file begins with is on the disk before anything of this one's end is written: whenever the power goes, one of the two
    /// is open, and a reader can tell.
    fn rotate(&mut self, now_ns: u64) -> Result<(), output::Error> {
        let next = match self.successor() {
            Ok(Some(next)) => next,
            Ok(None) => return Ok(()),
            Err(error) => {
                self.blocked = Some((now_ns, error.to_string()));
                return Ok(());
            }
        };
        self.blocked = None;
        self.record(metadata::NEXT, [("name".to_owned(), named(&next.path))].into())?;
        let full = mem::replace(&mut self.mcap, next.mcap);
        let before = mem::replace(&mut self.path, next.path);
        self.part_started = None;
        self.files += 1;
        end(full, &before)?;
        self.earlier_bytes += mem::replace(&mut self.written, next.written).load(Ordering::Relaxed);
        Ok(())
    }

    /// Makes the next file. None when the last number is taken: then there is no next one, now and later.
    fn successor(&mut self) -> Result<Option<Successor>, output::Error> {
        let Some(open) = &mut self.open else { return Ok(None) };
        while self.number < PARTS {
            let number = self.number + 1;
            let path = part_path(&self.first, number);
            let storage = match open(&path) {
                Ok(storage) => storage,
                // Somebody's file: it stays as it is, and its number is passed over.
                Err(error) if error.kind() == io::ErrorKind::AlreadyExists => {
                    self.number = number;
                    continue;
                }
                Err(source) => return Err(output::Error { path, source }),
            };
            return match self.introduce(&path, number, storage) {
                Ok(next) => {
                    self.number = number;
                    Ok(Some(next))
                }
                Err(error) => {
                    // It is new and holds nothing. Left there, it would pass for a file of the drive that cannot be read.
                    drop(fs::remove_file(&path));
                    Err(error)
                }
            };
        }
        self.open = None;
        Ok(None)
    }

    /// What a file that follows begins with, on the disk.
    fn introduce(&self, path: &Path, number: u32, storage: Box<dyn Storage>) -> Result<Successor, output::Error> {
        let written = Arc::default();
        let sink = Sink { target: Target::live(storage), written: Arc::clone(&written) };
        let mut mcap = begin(path, self.options, sink)?;
        let identity = self.identity.iter().map(|identity| ("recording".to_owned(), identity.clone()));
        let part = [("number".to_owned(), number.to_string()), ("before".to_owned(), named(&self.path))];
        describe(&mut mcap, path, metadata::PART, part.into_iter().chain(identity).collect())?;
        for (name, entries) in &self.described {
            describe(&mut mcap, path, name, entries.clone())?;
        }
        mcap.flush().map_err(|error| unwritable(path, error))?;
        Ok(Successor { path: path.to_path_buf(), mcap, written })
    }
}

fn named(path: &Path) -> String {
    path.file_name().unwrap_or_default().to_string_lossy().into_owned()
}

/// A number that no other recording has. Without the system's random numbers the time and the process have to do: no recording fails for this.
fn identity() -> String {
    let mut bytes = [0; 16];
    if getrandom::fill(&mut bytes).is_err() {
        let since = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
        let apart = (since.as_nanos() << 32) | u128::from(std::process::id());
        bytes = apart.to_be_bytes();
    }
    format!("{:032x}", u128::from_be_bytes(bytes))
}

fn is_over(started_ns: u64, now_ns: u64, most_ns: u64) -> bool {
    now_ns.checked_sub(started_ns).is_none_or(|age| age >= most_ns)
}

fn begin(path: &Path, options: Options, sink: Sink) -> Result<mcap::Writer<Sink>, output::Error> {
    let wrap = |error| unwritable(path, error);
    let mut mcap = mcap::WriteOptions::new()
        .compression(options.compress.then_some(mcap::Compression::Zstd))
        // In the caller's thread: the same bytes, and no threads for a few kilobytes a second.
        .compression_threads(0)
        .chunk_size(Some(CHUNK_BYTES))
        .disable_seeking(true)
        .library(concat!("crossfall ", env!("CARGO_PKG_VERSION")))
        .create(sink)
        .map_err(wrap)?;
    mcap.add_channel_with_id(WIRE_ID, 0, TOPIC, crate::capture::ENCODING, &BTreeMap::new()).map_err(wrap)?;
    Ok(mcap)
}

fn describe(
    mcap: &mut mcap::Writer<Sink>,
    path: &Path,
    name: &str,
    entries: BTreeMap<String, String>,
) -> Result<(), output::Error> {
    let record = Metadata { name: name.to_owned(), metadata: entries };
    mcap.write_metadata(&record).map_err(|error| unwritable(path, error))
}

fn end(mut mcap: mcap::Writer<Sink>, path: &Path) -> Result<(), output::Error> {
    mcap.finish().map_err(|error| unwritable(path, error))?;
    match mcap.into_inner().target {
        Target::Whole(output) => output.commit(),
        mut live @ Target::Live(_) => live.flush().map_err(|source| output::Error { path: path.to_path_buf(), source }),
    }
}

/// Where the bytes of a log go, counted.
struct Sink {
    target: Target,
    written: Arc<AtomicU64>,
}

enum Target {
    Whole(Output),
    Live(BufWriter<Box<dyn Storage>>),
}

impl Target {
    /// The buffer takes a chunk of a drive, so that it goes to the system in one write.
    fn live(storage: Box<dyn Storage>) -> Self {
        Self::Live(BufWriter::with_capacity(1 << 16, storage))
    }

    /// `mcap` flushes when a chunk is closed by [`Writer::flush`], and at the end.
    fn flush(&mut self) -> io::Result<()> {
        match self {
            Self::Whole(output) => output.flush(),
            Self::Live(storage) => {
                storage.flush()?;
                storage.get_mut().sync()
            }
        }
    }
}

impl Write for Sink {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let written = match &mut self.target {
            Target::Whole(output) => output.write(bytes),
            Target::Live(storage) => storage.write(bytes),
        }?;
        self.written.fetch_add(written as u64, Ordering::Relaxed);
        Ok(written)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.target.flush()
    }
}

impl Seek for Sink {
    /// Only tells the position: a log is appended to and nothing else.
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        let here = self.written.load(Ordering::Relaxed);
        match to {
            SeekFrom::Current(0) => Ok(here),
            SeekFrom::Start(there) if there == here => Ok(here),
            _ => Err(io::Error::from(io::ErrorKind::NotSeekable)),
        }
    }
}
