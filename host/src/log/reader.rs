//! Reading a log from start to wherever it ends.
//!
//! Three things lead to frames: the records of whole chunks; in a damaged chunk its records as far as they go, and every good frame that
//! [`salvage`] finds in its bytes; and salvage again between a damaged record and the next chunk. Each damage is told once, before
//! the frames found in it; the bytes of it that gave none are counted. A file that was closed ends with a CRC over everything before, which is compared when
//! nothing else was wrong: no changed bit of a closed log goes unnoticed.
//!
//! What the disk cannot read is zeros, told as damage, and all around it is found as around any other. A file whose very first bytes are damaged is
//! a log all the same where its end or its chunks say so.
//!
//! Memory: one chunk, or one window of a stretch without structure.

use std::collections::{BTreeMap, VecDeque};
use std::path::Path;

use mcap::records::{Record, op};

use super::{Error, Frame, TOPIC, WIRE_ID, salvage};
use crate::capture::Channel;
use crate::container::{Container, Entry, Message};
use crate::interrupt;

/// Bytes of a stretch without structure that are looked at in one go.
const WINDOW: usize = 1 << 16;

/// Bytes in which frames are looked for at the beginning of a file that does not begin as it should.
const LOOK: usize = 1 << 20;

/// Damages after which such a file is a log without frames so far.
const FIRST_DAMAGES: usize = 1_000;

/// A record of bookkeeping longer than this hides something: an index has 16 bytes a frame, a chunk at most some thousands of these.
const MAX_BOOKKEEPING: u64 = 1 << 20;

/// Reads a log from start to end.
///
/// Errors are told where they occur; the frames behind them follow, but for [`Error::Interrupted`], which ends it.
#[derive(Debug)]
pub struct Reader {
    container: Container,
    metadata: BTreeMap<String, BTreeMap<String, String>>,
    wire: Option<u16>,
    ready: VecDeque<Result<Message, Error>>,
    /// Whether channels of another name are declared: then the file is no log, and no damaged one either.
    foreign: bool,
    /// Whether one of them is a capture's.
    capture: bool,
    /// What has no structure and is searched for frames.
    stretch: Option<Stretch>,
    /// Receive time of the latest frame.
    latest_ns: u64,
    /// Bytes of damaged places that gave no frame.
    unread: u64,
    /// Where the latest damage ends; 0 when there was none.
    damaged_to: u64,
    /// What `unread` was before it.
    unread_before: u64,
    /// Where the data section ends, and the CRC that it should have.
    data_end: Option<(u64, u32)>,
    done: bool,
    /// Whether it was told that the user asked to stop.
    stopped: bool,
}

/// Bytes that are searched for frames.
#[derive(Debug)]
struct Stretch {
    begin: u64,
    /// What has been searched.
    at: u64,
    end: u64,
    /// Where the last frame found ends.
    found_to: u64,
    /// Bytes of the frames found, with their heads.
    covered: u64,
}

impl Stretch {
    fn new(begin: u64, end: u64) -> Self {
        Self { begin, at: begin, end, found_to: begin, covered: 0 }
    }
}

impl Reader {
    /// Opens a log and reads up to its first frames.
    ///
    /// # Errors
    /// When the file cannot be read, is no MCAP file, or one without the channel `wire`.
    pub fn open(path: &Path) -> Result<Self, Error> {
        Self::over(Container::open_damaged(path)?)
    }

    pub(crate) fn over(container: Container) -> Result<Self, Error> {
        let mut reader = Self {
            container,
            metadata: BTreeMap::new(),
            wire: None,
            ready: VecDeque::new(),
            foreign: false,
            capture: false,
            stretch: None,
            latest_ns: 0,
            unread: 0,
            damaged_to: 0,
            unread_before: 0,
            data_end: None,
            done: false,
            stopped: false,
        };
        let foreign = reader.container.foreign();
        let damage = if foreign.is_some() { reader.begin_damaged()? } else { None };
        if let Some(error) = foreign.filter(|_| damage.is_none()) {
            return Err(reader.container.failure().unwrap_or(error));
        }
        let has_frame = |reader: &Self| reader.ready.iter().any(Result::is_ok);
        let goes_on = |reader: &Self| damage.is_some() && reader.ready.len() < FIRST_DAMAGES && !has_frame(reader);
        while (reader.ready.is_empty() || goes_on(&reader)) && !reader.done && !reader.capture {
            reader.advance();
        }
        let nothing = reader.wire.is_none() && !has_frame(&reader);
        if let Some(error) = reader.container.foreign().filter(|_| reader.capture || nothing) {
            return Err(reader.container.failure().unwrap_or(error));
        }
        // What damage there is in a file of another kind does not make it a log.
        if reader.wire.is_none() && (reader.capture || reader.ready.is_empty()) {
            let kind = if reader.capture { "; it is a capture, which `crossfall run` makes a log of" } else { "" };
            let what = format!("not a log: it has no channel `{TOPIC}`{kind}");
            let path = reader.container.path().to_path_buf();
            return Err(reader.container.failure().unwrap_or(Error::Content { path, what }));
        }
        if let Some(error) = damage {
            reader.unread_before = 0;
            reader.ready.push_front(Err(error));
        }
        Ok(reader)
    }

    /// Metadata read so far, by name. What the writer wrote before the first frame is there from the start.
    #[must_use]
    pub fn metadata(&self) -> &BTreeMap<String, BTreeMap<String, String>> {
        &self.metadata
    }

    /// The file's size in bytes.
    pub(super) fn size(&self) -> u64 {
        self.container.size()
    }

    /// Receive time of the first frame, as far as [`Reader::open`] came to one; before any is taken.
    pub(super) fn begin_ns(&self) -> Option<u64> {
        self.ready.iter().find_map(|item| item.as_ref().ok()).map(|message| message.log_time)
    }

    /// Bytes of damaged places that gave no frame, so far.
    #[must_use]
    pub fn unread(&self) -> u64 {
        self.unread
    }

    /// Whether damage has been told so far.
    #[must_use]
    pub(super) fn is_damaged(&self) -> bool {
        self.damaged_to > 0
    }

    /// Where the damage ends that was told last (0 before any), and what [`Reader::unread`] was before it. Frames that come before this place were
    /// found within it.
    #[must_use]
    pub fn damage(&self) -> (u64, u64) {
        (self.damaged_to, self.unread_before)
    }

    /// A file that does not begin as it should: with its records, if they are where they should be, or with the first chunk. What is no log is
    /// refused before much of it is read.
    fn begin_damaged(&mut self) -> Result<Option<Error>, Error> {
        let begin = self.container.bytes(0, LOOK)?;
        // One frame alone may be noise: where so much of it is looked at, that happens.
        if !self.container.may_be_damaged()? && salvage::frames(&begin, 0, 0).len() < 2 {
            return Ok(None);
        }
        let begun = self.container.reached();
        if self.container.goes_on() {
            (self.unread, self.damaged_to) = (begun, begun.max(1));
        } else {
            let end = self.container.resume(0)?.unwrap_or_else(|| {
                self.container.close();
                self.container.size()
            });
            self.stretch = Some(Stretch::new(0, end));
            self.damaged_to = end.max(1);
        }
        Ok(Some(self.container.damaged(0, "does not begin as an MCAP file".to_owned())))
    }

    /// One step, and before what it gave the places that the disk could not read.
    fn advance(&mut self) {
        let (first, unread) = (self.ready.len(), self.unread);
        self.step();
        let reached = self.container.reached();
        let told_to =
            if self.done { u64::MAX } else { self.stretch.as_ref().map_or(reached, |to| to.end.max(reached)) };
        for (at, (place, error)) in (first..).zip(self.container.unreadable(told_to)) {
            (self.damaged_to, self.unread_before) = (self.damaged_to.max(place.end), unread);
            self.ready.insert(at, Err(error));
        }
    }

    /// Reads one record of the top level, or one window of a stretch without structure.
    fn step(&mut self) {
        if let Some(stretch) = self.stretch.take() {
            return self.search(stretch);
        }
        match self.container.next_entry() {
            None => {
                self.done = true;
                self.check_all();
            }
            Some(Ok(entry)) => self.record(entry),
            // A cut: what the last record was is not known, and may have been a chunk.
            Some(Err(error @ Error::Cut { .. })) => {
                let (from, size) = (self.container.reached(), self.container.size());
                self.tell(error, size);
                self.stretch = Some(Stretch::new(from, size));
            }
            Some(Err(error @ Error::Damaged { .. })) => self.go_on_behind(error),
            Some(Err(error)) => {
                let from = self.container.reached();
                self.give_up(from, error);
            }
        }
    }

    /// The rest of the file, from `from` on, cannot be read.
    fn give_up(&mut self, from: u64, error: Error) {
        let size = self.container.size();
        self.done = true;
        self.tell(error, size);
        self.unread += size.saturating_sub(from);
    }

    fn record(&mut self, entry: Entry) {
        match entry.opcode {
            op::CHUNK => self.chunk(entry),
            op::CHANNEL => self.channel(entry),
            // Writers here put every message into a chunk; so it is another one's, or no message.
            op::MESSAGE => self.message(entry),
            op::METADATA => match self.container.body(entry).map(|body| parse_metadata(&body)) {
                Ok(Some((name, entries))) => drop(self.metadata.insert(name, entries)),
                Ok(None) => self.misread(entry, "a metadata record that is not readable"),
                Err(error) => self.tell(error, entry.end()),
            },
            op::DATA_END => match self.container.body(entry) {
                Ok(body) => match <[u8; 4]>::try_from(body).ok() {
                    Some(crc) => self.data_end = Some((entry.offset, u32::from_le_bytes(crc))),
                    None => self.misread(entry, "an end of the data that is not readable"),
                },
                Err(error) => self.tell(error, entry.end()),
            },
            // Bookkeeping that is not needed here. A chunk may hide behind one flipped bit of an opcode, so what it says must fit its length.
            _ if entry.length > MAX_BOOKKEEPING || !self.is_sound(entry) => {
                self.misread(entry, "a record that does not say what its kind says");
            }
            _ => {}
        }
    }

    fn chunk(&mut self, entry: Entry) {
        let contents = self.container.contents(entry);
        // What a damaged chunk says of channels is not believed.
        let damaged = contents.error.is_some();
        let trusted = !matches!(contents.error, Some(Error::Damaged { .. }));
        self.channels(contents.channels.into_iter().filter(|_| trusted).map(|channel| (channel.id, channel.topic)));
        if self.wire.is_none() && !self.foreign && !contents.messages.is_empty() {
            self.wire = Some(WIRE_ID);
            let what = format!("no record declares the channel `{TOPIC}`; number {WIRE_ID} is taken for it");
            let error = self.container.damaged(entry.offset, what);
            self.tell(error, entry.offset);
        }
        let wire = self.wire;
        let messages: Vec<_> = contents.messages.into_iter().filter(|message| Some(message.channel) == wire).collect();
        let Some(error) = contents.error.filter(|_| damaged) else {
            return self.keep(messages);
        };
        let end = entry.end().min(self.container.size());
        let unreadable = matches!(error, Error::Io { .. });
        self.tell(error, end);
        if self.foreign || unreadable {
            self.unread += if unreadable { end - entry.offset } else { 0 };
            return self.keep(messages);
        }
        // The chunk once more, by what its frames prove of themselves.
        match self.container.bytes(entry.offset, (end - entry.offset) as usize) {
            Ok(bytes) => {
                let found = salvage::frames(&bytes, entry.offset, self.latest_ns);
                // Writers here give a message one time twice: what has two and proves nothing is none.
                let (messages, none): (Vec<_>, Vec<_>) = messages
                    .into_iter()
                    .partition(|message| salvage::is_certain(message) || salvage::is_frame(&message.data));
                let none: usize = none.iter().map(|message| salvage::HEAD + message.data.len()).sum();
                let (all, extra) = merge(messages, found);
                self.unread += (end - entry.offset + none as u64).saturating_sub(contents.read + extra);
                self.keep(all);
            }
            Err(error) => self.tell(error, end),
        }
    }

    fn channel(&mut self, entry: Entry) {
        let contents = self.container.contents(entry);
        match contents.error {
            Some(_) => self.misread(entry, "a channel record that is not readable"),
            None => self.channels(contents.channels.into_iter().map(|channel| (channel.id, channel.topic))),
        }
    }

    fn message(&mut self, entry: Entry) {
        let contents = self.container.contents(entry);
        let ours = contents.messages.iter().all(|message| Some(message.channel) == self.wire);
        let sound = ours && contents.error.is_none();
        // A length that is wrong and fits the file would hide what follows in a message that is no frame.
        let whole = |message: &Message| salvage::is_frame(&message.data);
        if self.foreign || (sound && (self.container.goes_on() || contents.messages.iter().all(whole))) {
            let wire = self.wire;
            return self.keep(contents.messages.into_iter().filter(|message| Some(message.channel) == wire).collect());
        }
        self.misread(entry, "a message record that is not readable");
    }

    fn channels(&mut self, channels: impl Iterator<Item = (u16, String)>) {
        for (id, topic) in channels {
            if topic == TOPIC {
                self.wire = Some(id);
            } else {
                self.foreign = true;
                self.capture |= Channel::from_topic(&topic).is_some();
            }
        }
    }

    /// Whether a record of bookkeeping says what its kind says.
    fn is_sound(&mut self, entry: Entry) -> bool {
        let Ok(body) = self.container.body(entry) else { return false };
        match entry.opcode {
            // Its list must fill it: channel, length of the list, the list.
            op::MESSAGE_INDEX => {
                let list = body.get(2..).and_then(<[u8]>::first_chunk).map(|length| u32::from_le_bytes(*length));
                list.is_some_and(|list| u64::from(list) + 6 == entry.length) && salvage::frames(&body, 0, 0).is_empty()
            }
            op::HEADER..=op::DATA_END if mcap::parse_record(entry.opcode, &body).is_err() => false,
            // Also private records: allowed, and never written here.
            _ => salvage::frames(&body, 0, 0).is_empty(),
        }
    }

    /// A record that is not what it says: its bytes may be anything, and what follows may begin within it.
    fn misread(&mut self, entry: Entry, what: &str) {
        let error = self.container.damaged(entry.offset, what.to_owned());
        if self.foreign {
            self.tell(error, entry.end());
        } else if self.container.goes_on() {
            // Its length is right, whatever else is not.
            self.tell(error, entry.end());
            self.stretch = Some(Stretch::new(entry.offset, entry.end()));
        } else {
            self.go_on_behind(error);
        }
    }

    /// Damage of the structure: the next chunk is looked for, and frames in between.
    fn go_on_behind(&mut self, error: Error) {
        let at = error.offset().unwrap_or_default();
        let end = match self.container.resume(at) {
            Ok(Some(next)) => next,
            Ok(None) => {
                self.container.close();
                self.container.size()
            }
            Err(failed) => {
                self.tell(error, at);
                return self.give_up(at, failed);
            }
        };
        self.tell(error, end);
        if !self.foreign {
            self.stretch = Some(Stretch::new(at, end));
        }
    }

    /// One window of a stretch without structure. Windows overlap by the longest frame with its head.
    fn search(&mut self, mut stretch: Stretch) {
        let room = usize::try_from(stretch.end.saturating_sub(stretch.at)).unwrap_or(usize::MAX);
        let last = room <= WINDOW;
        let bytes = match self.container.bytes(stretch.at, room.min(WINDOW)) {
            Ok(bytes) => bytes,
            Err(error) => {
                self.tell(error, stretch.end);
                self.unread += (stretch.end - stretch.begin).saturating_sub(stretch.covered);
                return;
            }
        };
        let end = |message: &Message| message.offset + (salvage::HEAD + message.data.len()) as u64;
        let mut found = salvage::frames(&bytes, stretch.at, self.latest_ns);
        found.retain(|message| end(message) > stretch.found_to);
        stretch.found_to = found.last().map_or(stretch.found_to, end);
        stretch.covered += found.iter().map(|message| (salvage::HEAD + message.data.len()) as u64).sum::<u64>();
        if self.wire.is_none() && !found.is_empty() {
            self.wire = Some(WIRE_ID);
        }
        self.keep(found);
        if last {
            self.unread += (stretch.end - stretch.begin).saturating_sub(stretch.covered);
            return;
        }
        // Behind the last delimiter a frame may be under way, and its head before that: the next window has both.
        let reach = bytes.iter().rposition(|&byte| byte == 0).map_or(0, |last| last + 1);
        let taken = reach.max(bytes.len() - salvage::LONGEST).saturating_sub(salvage::HEAD);
        stretch.at += taken as u64;
        self.stretch = Some(stretch);
    }

    /// The CRC over everything before the summary, when nothing else was wrong.
    fn check_all(&mut self) {
        let Some((end, expected)) = self.data_end.filter(|&(_, crc)| crc != 0 && self.damaged_to == 0) else { return };
        match self.container.checksum(end) {
            Ok(actual) if actual == expected => {}
            Ok(actual) => {
                let what = format!(
                    "the CRC of all before is {actual:08X}, expected {expected:08X}: bytes outside of every frame have changed"
                );
                let error = self.container.damaged(end, what);
                self.tell(error, end);
            }
            Err(error) => self.tell(error, end),
        }
    }

    /// Keeps messages for whoever reads. A time that its record does not say twice is not taken for later than the next one that is certain, nor for
    /// earlier than the one before: a damaged head must not make time go back.
    fn keep(&mut self, messages: Vec<Message>) {
        let is_certain = salvage::is_certain;
        let mut next_ns = u64::MAX;
        let mut bounds = Vec::with_capacity(messages.len());
        for message in messages.iter().rev() {
            next_ns = if is_certain(message) { message.log_time } else { next_ns };
            bounds.push(next_ns);
        }
        for mut message in messages {
            let bound_ns = bounds.pop().unwrap_or(u64::MAX);
            if !is_certain(&message) {
                let best = salvage::choose(message.log_time, message.publish_time, self.latest_ns);
                message.log_time = best.max(self.latest_ns).min(bound_ns);
            }
            self.latest_ns = message.log_time;
            self.ready.push_back(Ok(message));
        }
    }

    /// Tells damage that ends at `to`.
    fn tell(&mut self, error: Error, to: u64) {
        (self.damaged_to, self.unread_before) = (to.max(1), self.unread);
        self.ready.push_back(Err(error));
    }
}

/// What records led to and what was found without them, in the order of the file. A frame that proves itself is believed before a record that overlaps
/// it. Also the bytes of found frames to which no record led.
fn merge(records: Vec<Message>, found: Vec<Message>) -> (Vec<Message>, u64) {
    let extent = |message: &Message| message.offset..message.offset + (salvage::HEAD + message.data.len()) as u64;
    let mut extra = 0;
    let mut all: Vec<Message> = Vec::with_capacity(records.len());
    let mut records = records.into_iter().peekable();
    for good in found {
        // In a compressed chunk all records have the chunk's own place; nothing is found there.
        while let Some(record) = records.next_if(|record| extent(record).end <= good.offset) {
            all.push(record);
        }
        let mut same = None;
        while let Some(record) = records.next_if(|record| extent(record).start < extent(&good).end) {
            if record.data == good.data {
                same = Some(record);
            }
        }
        extra += if same.is_some() { 0 } else { (salvage::HEAD + good.data.len()) as u64 };
        all.push(same.unwrap_or(good));
    }
    all.extend(records);
    (all, extra)
}

fn parse_metadata(body: &[u8]) -> Option<(String, BTreeMap<String, String>)> {
    match mcap::parse_record(op::METADATA, body) {
        // It fills its length, or the length is wrong.
        Ok(Record::Metadata(found)) => {
            let pairs: usize = found.metadata.iter().map(|(key, value)| 8 + key.len() + value.len()).sum();
            (8 + found.name.len() + pairs == body.len()).then_some((found.name, found.metadata))
        }
        _ => None,
    }
}

impl Iterator for Reader {
    type Item = Result<Frame, Error>;

    fn next(&mut self) -> Option<Self::Item> {
        if interrupt::requested() {
            let told = std::mem::replace(&mut self.stopped, true);
            return (!told).then_some(Err(Error::Interrupted));
        }
        loop {
            if let Some(ready) = self.ready.pop_front() {
                return Some(ready.map(|Message { offset, log_time, data, .. }| Frame {
                    offset,
                    receive_ns: log_time,
                    bytes: data,
                }));
            }
            if self.done {
                return None;
            }
            self.advance();
        }
    }
}
