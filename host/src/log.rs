//! Logs: every frame of the link as it was received, as an MCAP file.
//!
//! One channel, `wire`: COBS, CRC and the delimiting 0x00 included, log time = the host's receive time in nanoseconds. Metadata
//! records carry the firmware's identity, the schema's hash and the configuration.
//!
//! [`Writer`] closes an MCAP chunk at the latest [`CHUNK_NS`] of receive time after its first frame and only ever appends, so a file cut at any
//! byte lacks at most that much. [`Reader`] goes from the start to wherever the file ends, tells every damage with its place,
//! and goes on behind it.

use std::collections::{BTreeMap, VecDeque};
use std::fs::File;
use std::io::{BufWriter, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

use mcap::records::{MessageHeader, Metadata, Record, op};

use crate::capture::unwritable;
pub use crate::container::Error;
use crate::container::{Container, Message};
use crate::output::{self, Output};

/// The channel of a log.
pub const TOPIC: &str = "wire";

/// Its number in the logs that are written here: what is read as `wire` when the chunk that says so is lost.
const WIRE_ID: u16 = 1;

/// Receive time after which a chunk is closed: half of the second that may be lost.
pub const CHUNK_NS: u64 = 500_000_000;

/// Bytes after which it is closed in any case.
const CHUNK_BYTES: u64 = 1 << 20;

/// Names of metadata records.
pub mod metadata {
    /// Who sent the frames: `firmware`, `board`, `schema` (16 hexadecimal digits).
    pub const IDENTITY: &str = "identity";
    /// The configuration in force, as TOML under the key `toml`.
    pub const CONFIG: &str = "config";
}

/// One frame as received.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Frame {
    /// Where it is in the file: its own record.
    pub offset: u64,
    /// When it was received, in nanoseconds of the host's clock.
    pub receive_ns: u64,
    /// COBS, CRC and 0x00 included.
    pub bytes: Vec<u8>,
}

/// Reads a log from start to end.
///
/// Errors are told where they occur; the frames behind them follow.
#[derive(Debug)]
pub struct Reader {
    container: Container,
    metadata: BTreeMap<String, BTreeMap<String, String>>,
    wire: Option<u16>,
    frames: VecDeque<Message>,
    errors: VecDeque<Error>,
    /// Whether channels of another name are declared: then the file is no log, and no damaged one either.
    foreign: bool,
    done: bool,
}

impl Reader {
    /// Opens a log and reads up to its first frames.
    ///
    /// # Errors
    /// When the file cannot be read, is no MCAP file, or one without the channel `wire`.
    pub fn open(path: &Path) -> Result<Self, Error> {
        let container = Container::open(path)?;
        let mut reader = Self {
            container,
            metadata: BTreeMap::new(),
            wire: None,
            frames: VecDeque::new(),
            errors: VecDeque::new(),
            foreign: false,
            done: false,
        };
        while reader.frames.is_empty() && reader.errors.is_empty() && !reader.done {
            reader.advance();
        }
        if reader.wire.is_none() && reader.errors.is_empty() {
            let what = format!("not a log: it has no channel `{TOPIC}`");
            return Err(Error::Content { path: path.to_path_buf(), what });
        }
        Ok(reader)
    }

    /// Metadata read so far, by name. What the writer wrote before the first frame is there from the start.
    #[must_use]
    pub fn metadata(&self) -> &BTreeMap<String, BTreeMap<String, String>> {
        &self.metadata
    }

    /// Reads one record of the top level.
    fn advance(&mut self) {
        match self.container.next_entry() {
            None => self.done = true,
            Some(Ok(entry)) => match entry.opcode {
                op::METADATA => match self.container.body(entry) {
                    Ok(body) => match mcap::parse_record(op::METADATA, &body) {
                        Ok(Record::Metadata(found)) => drop(self.metadata.insert(found.name, found.metadata)),
                        _ => {
                            let what = "a metadata record that is not readable".to_owned();
                            self.errors.push_back(self.container.damaged(entry.offset, what));
                        }
                    },
                    Err(error) => self.errors.push_back(error),
                },
                op::CHUNK | op::CHANNEL | op::MESSAGE => {
                    let contents = self.container.contents(entry);
                    // What a damaged chunk says of channels is not believed.
                    let trusted = !matches!(contents.error, Some(Error::Damaged { .. }));
                    for channel in contents.channels.into_iter().filter(|_| trusted) {
                        if channel.topic == TOPIC {
                            self.wire = Some(channel.id);
                        } else {
                            self.foreign = true;
                        }
                    }
                    if self.wire.is_none() && !self.foreign && !contents.messages.is_empty() {
                        self.wire = Some(WIRE_ID);
                        let what =
                            format!("no record declares the channel `{TOPIC}`; number {WIRE_ID} is taken for it");
                        self.errors.push_back(self.container.damaged(entry.offset, what));
                    }
                    self.frames
                        .extend(contents.messages.into_iter().filter(|message| Some(message.channel) == self.wire));
                    self.errors.extend(contents.error);
                }
                _ => {}
            },
            Some(Err(error)) => {
                // Behind a damaged record the next chunk is looked for; a cut is the end.
                if matches!(error, Error::Damaged { .. }) {
                    match self.container.resume() {
                        Ok(Some(_)) => {}
                        Ok(None) => self.done = true,
                        Err(error) => self.errors.push_back(error),
                    }
                }
                self.errors.push_back(error);
            }
        }
    }
}

impl Iterator for Reader {
    type Item = Result<Frame, Error>;

    fn next(&mut self) -> Option<Self::Item> {
        loop {
            if let Some(message) = self.frames.pop_front() {
                let Message { offset, log_time, data, .. } = message;
                return Some(Ok(Frame { offset, receive_ns: log_time, bytes: data }));
            }
            if let Some(error) = self.errors.pop_front() {
                return Some(Err(error));
            }
            if self.done {
                return None;
            }
            self.advance();
        }
    }
}

/// Writes a log.
pub struct Writer {
    path: PathBuf,
    mcap: mcap::Writer<Sink>,
    wire: u16,
    sequence: u32,
    /// Receive time of the first frame of the open chunk.
    chunk_started: Option<u64>,
}

impl Writer {
    /// Starts a log of a stream that can be had again (a capture run in process): the file appears with [`Writer::finish`].
    ///
    /// # Errors
    /// When the file cannot be written.
    pub fn create(path: &Path) -> Result<Self, output::Error> {
        Self::start(path, Sink::Whole(Output::create(path)?))
    }

    /// Starts a log of a stream that cannot be had again: the file is there at once, and every chunk is brought to the disk when it is closed.
    ///
    /// # Errors
    /// When the file cannot be written or exists already.
    pub fn create_live(path: &Path) -> Result<Self, output::Error> {
        let wrap = |source| output::Error { path: path.to_path_buf(), source };
        let file = File::create_new(path).map_err(wrap)?;
        Self::start(path, Sink::Live(BufWriter::new(file)))
    }

    fn start(path: &Path, sink: Sink) -> Result<Self, output::Error> {
        let wrap = |error| unwritable(path, error);
        let mut mcap = mcap::WriteOptions::new()
            .compression(None)
            .chunk_size(Some(CHUNK_BYTES))
            .disable_seeking(true)
            .library(concat!("crossfall ", env!("CARGO_PKG_VERSION")))
            .create(sink)
            .map_err(wrap)?;
        let wire =
            mcap.add_channel_with_id(WIRE_ID, 0, TOPIC, crate::capture::ENCODING, &BTreeMap::new()).map_err(wrap)?;
        Ok(Self { path: path.to_path_buf(), mcap, wire, sequence: 0, chunk_started: None })
    }

    /// Appends a frame as received, the delimiting 0x00 included.
    ///
    /// # Errors
    /// When the file cannot be written.
    pub fn frame(&mut self, receive_ns: u64, bytes: &[u8]) -> Result<(), output::Error> {
        let started = *self.chunk_started.get_or_insert(receive_ns);
        // A receive clock that was set back closes the chunk as well.
        if receive_ns.checked_sub(started).is_none_or(|age| age >= CHUNK_NS) {
            self.flush()?;
            self.chunk_started = Some(receive_ns);
        }
        let (channel_id, sequence, log_time) = (self.wire, self.sequence, receive_ns);
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
        let record = Metadata { name: name.to_owned(), metadata: entries };
        self.mcap.write_metadata(&record).map_err(|error| unwritable(&self.path, error))
    }

    /// Closes the file with its summary.
    ///
    /// # Errors
    /// When the last of it cannot be written.
    pub fn finish(mut self) -> Result<(), output::Error> {
        self.mcap.finish().map_err(|error| unwritable(&self.path, error))?;
        match self.mcap.into_inner() {
            Sink::Whole(output) => output.commit(),
            mut live @ Sink::Live(_) => live.flush().map_err(|source| output::Error { path: self.path, source }),
        }
    }
}

/// Where the bytes of a log go.
enum Sink {
    Whole(Output),
    Live(BufWriter<File>),
}

impl Write for Sink {
    fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
        match self {
            Self::Whole(output) => output.write(bytes),
            Self::Live(file) => file.write(bytes),
        }
    }

    /// `mcap` flushes when a chunk is closed by [`Writer::flush`], and at the end.
    fn flush(&mut self) -> std::io::Result<()> {
        match self {
            Self::Whole(output) => output.flush(),
            Self::Live(file) => {
                file.flush()?;
                file.get_ref().sync_data()
            }
        }
    }
}

impl Seek for Sink {
    fn seek(&mut self, to: SeekFrom) -> std::io::Result<u64> {
        match self {
            Self::Whole(output) => output.seek(to),
            Self::Live(file) => file.seek(to),
        }
    }
}

#[cfg(test)]
mod tests;
