//! Captures: what the board sees on its pins, as an MCAP file.
//!
//! Three channels of encoding `application/octet-stream`: `lidar` and `ins` carry raw bytes in any chunking, their log time is the device
//! time (ns) of the first byte; `pps` is empty, its log time is the pulse's edge. `ins2` is a second inertial unit.
//!
//! [`Reader`] yields chunks in the order of time, whatever their order in the file, and needs no summary: it walks the
//! file once for the times that each MCAP chunk's header gives and then merges the chunks. Memory: the MCAP chunks that overlap in
//! time. A cut or damaged capture yields all that is whole and then the errors.

use std::collections::{BTreeMap, VecDeque};
use std::path::{Path, PathBuf};

use mcap::records::{MessageHeader, op};

pub use crate::container::Error;
use crate::container::{ChannelName, Container, Entry};
use crate::interrupt;
use crate::output::{self, Output};

/// Where a chunk of bytes comes from.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Channel {
    /// The laser scanner's serial line.
    Lidar,
    /// The inertial unit's serial line.
    Ins,
    /// The pulse per second.
    Pps,
    /// A second inertial unit's serial line.
    Ins2,
}

impl Channel {
    /// Every channel, in the order in which writers number them.
    pub const ALL: [Self; 4] = [Self::Lidar, Self::Ins, Self::Pps, Self::Ins2];

    /// The channel's name in the file.
    #[must_use]
    pub const fn topic(self) -> &'static str {
        match self {
            Self::Lidar => "lidar",
            Self::Ins => "ins",
            Self::Pps => "pps",
            Self::Ins2 => "ins2",
        }
    }

    /// The channel of a name.
    #[must_use]
    pub fn from_topic(topic: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|channel| channel.topic() == topic)
    }
}

/// Bytes that arrived together, or the edge of a pulse.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Chunk {
    /// Where from.
    pub channel: Channel,
    /// When the first byte arrived, in nanoseconds of device time.
    pub device_time_ns: u64,
    /// The bytes; none for a pulse.
    pub data: Vec<u8>,
}

/// Reads a capture in the order of time.
#[derive(Debug)]
pub struct Reader {
    container: Container,
    /// MCAP chunks and lone messages by the time of their first message.
    blocks: VecDeque<(u64, Entry)>,
    channels: BTreeMap<u16, String>,
    span_ns: Option<(u64, u64)>,
    /// Chunks that wait for their turn, by time and then by place in the file.
    waiting: BTreeMap<(u64, u64, usize), Chunk>,
    foreign: BTreeMap<String, u64>,
    errors: VecDeque<Error>,
    stopped: bool,
}

impl Reader {
    /// Opens a capture.
    ///
    /// # Errors
    /// When the file cannot be read, is no MCAP file, or is one without any channel of a capture.
    pub fn open(path: &Path) -> Result<Self, Error> {
        let mut container = Container::open(path)?;
        let mut blocks = Vec::new();
        let mut channels = BTreeMap::new();
        let mut span_ns: Option<(u64, u64)> = None;
        let mut errors = VecDeque::new();
        while let Some(entry) = container.next_entry() {
            match entry {
                Ok(entry) if entry.opcode == op::CHANNEL => {
                    let contents = container.contents(entry);
                    register(&mut channels, contents.channels);
                    errors.extend(contents.error);
                }
                Ok(entry) if matches!(entry.opcode, op::CHUNK | op::MESSAGE) => match container.times(entry) {
                    Ok((first, last)) => {
                        // An MCAP chunk without messages has the times 0 and 0.
                        if (first, last) != (0, 0) {
                            span_ns = Some(span_ns.map_or((first, last), |(a, b)| (a.min(first), b.max(last))));
                        }
                        blocks.push((first, entry));
                    }
                    Err(error) => errors.push_back(error),
                },
                Ok(_) => {}
                Err(error) => {
                    // Behind a damaged record the next chunk is looked for; a cut is the end.
                    if let Error::Damaged { offset, .. } = error {
                        container.resume(offset)?;
                    }
                    errors.push_back(error);
                }
            }
        }
        // Without a summary the channels are known from inside the chunks alone.
        if channels.is_empty() {
            for &(_, entry) in &blocks {
                register(&mut channels, container.contents(entry).channels);
            }
        }
        if !channels.values().any(|topic| Channel::from_topic(topic).is_some()) {
            if let Some(error) = errors.pop_front() {
                return Err(error);
            }
            let what = format!("not a capture: it has {}, expected lidar, ins and pps", list(channels.values()));
            return Err(Error::Content { path: path.to_path_buf(), what });
        }
        blocks.sort_by_key(|&(first, entry)| (first, entry.offset));
        Ok(Self {
            container,
            blocks: blocks.into(),
            channels,
            span_ns,
            waiting: BTreeMap::new(),
            foreign: BTreeMap::new(),
            errors,
            stopped: false,
        })
    }

    /// Whether the file declares a channel, with or without messages.
    #[must_use]
    pub fn has(&self, channel: Channel) -> bool {
        self.channels.values().any(|topic| topic == channel.topic())
    }

    /// An error that names the channel, if the file does not declare it.
    ///
    /// # Errors
    /// When the channel is missing.
    pub fn require(&self, channel: Channel) -> Result<(), Error> {
        if self.has(channel) {
            return Ok(());
        }
        let what = format!("the capture has no channel `{}`, only {}", channel.topic(), list(self.channels.values()));
        Err(Error::Content { path: self.container.path().to_path_buf(), what })
    }

    /// Device time (ns) of the first and of the last chunk, as the file's headers say.
    #[must_use]
    pub fn span_ns(&self) -> Option<(u64, u64)> {
        self.span_ns
    }

    /// Messages passed over so far because their channel is none of a capture's, by topic.
    #[must_use]
    pub fn foreign_messages(&self) -> &BTreeMap<String, u64> {
        &self.foreign
    }

    /// Loads every MCAP chunk that may hold something earlier than what waits.
    fn load(&mut self) {
        while let Some(&(first, entry)) = self.blocks.front() {
            if self.waiting.first_key_value().is_some_and(|((time, ..), _)| *time < first) {
                return;
            }
            self.blocks.pop_front();
            let contents = self.container.contents(entry);
            register(&mut self.channels, contents.channels);
            for (number, message) in contents.messages.into_iter().enumerate() {
                let topic = self.channels.get(&message.channel);
                let Some(channel) = topic.and_then(|topic| Channel::from_topic(topic)) else {
                    let name = topic.map_or_else(|| format!("channel {}", message.channel), Clone::clone);
                    *self.foreign.entry(name).or_default() += 1;
                    continue;
                };
                let chunk = Chunk { channel, device_time_ns: message.log_time, data: message.data };
                self.waiting.insert((message.log_time, message.offset, number), chunk);
            }
            self.errors.extend(contents.error);
        }
    }
}

impl Iterator for Reader {
    type Item = Result<Chunk, Error>;

    fn next(&mut self) -> Option<Self::Item> {
        if self.stopped {
            return None;
        }
        if interrupt::requested() {
            self.stopped = true;
            return Some(Err(Error::Interrupted));
        }
        self.load();
        match self.waiting.pop_first() {
            Some((_, chunk)) => Some(Ok(chunk)),
            None => self.errors.pop_front().map(Err),
        }
    }
}

fn register(channels: &mut BTreeMap<u16, String>, found: Vec<ChannelName>) {
    channels.extend(found.into_iter().map(|channel| (channel.id, channel.topic)));
}

fn list<'a>(topics: impl Iterator<Item = &'a String>) -> String {
    let names: Vec<_> = topics.map(|topic| format!("`{topic}`")).collect();
    if names.is_empty() { "no channel".to_owned() } else { names.join(", ") }
}

/// Bytes of messages in one MCAP chunk.
const CHUNK_BYTES: u64 = 1 << 20;

/// What every channel of a capture says of its messages.
pub const ENCODING: &str = "application/octet-stream";

/// Writes a capture. The file appears when [`Writer::finish`] is called, whole, or not at all.
pub struct Writer {
    path: PathBuf,
    mcap: mcap::Writer<Output>,
    ids: BTreeMap<Channel, u16>,
    sequence: BTreeMap<Channel, u32>,
}

impl Writer {
    /// Starts a capture with the channels `lidar`, `ins` and `pps`.
    ///
    /// # Errors
    /// When the file cannot be written.
    pub fn create(path: &Path) -> Result<Self, output::Error> {
        let output = Output::create(path)?;
        let wrap = |error| unwritable(path, error);
        // Not compressed: the same bytes from every version of the libraries, and a cut file loses nothing before the cut.
        let mut mcap = mcap::WriteOptions::new()
            .compression(None)
            .chunk_size(Some(CHUNK_BYTES))
            .disable_seeking(true)
            .library(concat!("crossfall ", env!("CARGO_PKG_VERSION")))
            .create(output)
            .map_err(wrap)?;
        let mut ids = BTreeMap::new();
        for channel in [Channel::Lidar, Channel::Ins, Channel::Pps] {
            ids.insert(channel, mcap.add_channel(0, channel.topic(), ENCODING, &BTreeMap::new()).map_err(wrap)?);
        }
        Ok(Self { path: path.to_path_buf(), mcap, ids, sequence: BTreeMap::new() })
    }

    /// Appends bytes of a sensor or, with none, a pulse.
    ///
    /// # Errors
    /// When the file cannot be written.
    pub fn write(&mut self, channel: Channel, device_time_ns: u64, data: &[u8]) -> Result<(), output::Error> {
        self.append(channel, device_time_ns, data).map_err(|error| unwritable(&self.path, error))
    }

    fn append(&mut self, channel: Channel, device_time_ns: u64, data: &[u8]) -> mcap::McapResult<()> {
        let channel_id = match self.ids.get(&channel) {
            Some(&id) => id,
            None => {
                let id = self.mcap.add_channel(0, channel.topic(), ENCODING, &BTreeMap::new())?;
                self.ids.insert(channel, id);
                id
            }
        };
        let sequence = self.sequence.entry(channel).or_default();
        *sequence += 1;
        let (sequence, log_time) = (*sequence, device_time_ns);
        let header = MessageHeader { channel_id, sequence, log_time, publish_time: log_time };
        self.mcap.write_to_known_channel(&header, data)
    }

    /// Closes the file and gives it its name.
    ///
    /// # Errors
    /// When the last of it cannot be written; nothing is left then.
    pub fn finish(mut self) -> Result<(), output::Error> {
        self.mcap.finish().map_err(|error| unwritable(&self.path, error))?;
        self.mcap.into_inner().commit()
    }
}

pub(crate) fn unwritable(path: &Path, error: mcap::McapError) -> output::Error {
    let source = match error {
        mcap::McapError::Io(source) => source,
        other => std::io::Error::other(other),
    };
    output::Error { path: path.to_path_buf(), source }
}

#[cfg(test)]
mod tests;
