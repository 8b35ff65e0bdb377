//! Reading a log from start to wherever it ends.
//!
//! Three things lead to frames: the records of whole chunks; in a damaged chunk its records as far as they go, and every good frame that
//! [`salvage`] finds in its bytes; and salvage again between a damaged record and the next chunk. Each damage is told once, before
//! the frames found in it; the bytes of it that gave none are counted. The data of a file that was closed end with a CRC over everything before, which is compared when
//! nothing else was wrong there, and the index behind them with another: no changed bit of a closed log goes unnoticed.
//!
//! What the disk cannot read is zeros, told as damage, and all around it is found as around any other. A file whose very first bytes are damaged is
//! a log all the same where its end or its chunks say so.
//!
//! Memory: one chunk, or one window of a stretch without structure.

mod stretch;

use std::collections::{BTreeMap, VecDeque};
use std::ops::Range;
use std::path::Path;

use mcap::records::op;

use super::order::{Order, Settled};
use super::{Error, Frame, TOPIC, WIRE_ID, metadata, salvage};
use crate::capture::Channel;
use crate::container::{Container, Entry, Index, Message};
use crate::interrupt;
use stretch::Stretch;

/// Damages after which such a file is a log without frames so far.
const FIRST_DAMAGES: usize = 1_000;

/// Bytes in which frames are looked for that a later one stands before, and times a file's size that may be looked through so.
const AHEAD: usize = 1 << 20;
const AHEAD_TIMES: u64 = 4;

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
    /// Where the latest chunk ends that is damaged, and the last frame in it: the next one may lie across its end.
    frayed: Option<(u64, u64)>,
    /// Receive time of the latest frame.
    latest_ns: u64,
    /// Bytes of damaged places that gave no frame.
    unread: u64,
    /// What `unread` was before the step under way.
    unread_at_step: u64,
    /// Which records have been read.
    order: Order,
    /// Bytes that were looked through ahead.
    looked: u64,
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
            frayed: None,
            latest_ns: 0,
            unread: 0,
            unread_at_step: 0,
            order: Order::default(),
            looked: 0,
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

    /// Where the record begins that ends the data, once it is reached: what is damaged behind it costs no frame.
    #[must_use]
    pub fn data_end(&self) -> Option<u64> {
        self.data_end.map(|(place, _)| place)
    }

    /// Frames that stood in the file a second time, so far; each is read once.
    #[must_use]
    pub fn frames_twice(&self) -> u64 {
        self.order.frames_twice()
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

    /// One step, and before what it gave the places that the disk could not read.
    fn advance(&mut self) {
        let (first, unread) = (self.ready.len(), self.unread);
        self.unread_at_step = unread;
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
                if let Some((place, what)) = self.order.told_twice() {
                    self.remark(place, what);
                }
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
            op::METADATA => match self.container.body(entry).map(|body| metadata::parse(&body)) {
                Ok(Some((name, entries))) => drop(self.metadata.insert(name, entries)),
                Ok(None) => self.misread(entry, "a metadata record that is not readable"),
                Err(error) => self.tell(error, entry.end()),
            },
            op::DATA_END => match self.container.body(entry) {
                Ok(body) => match <[u8; 4]>::try_from(body).ok() {
                    Some(crc) => self.end_of_data(entry, u32::from_le_bytes(crc)),
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
                let (all, extra) = salvage::merge(messages, found);
                let last = all.iter().rev().find(|message| salvage::is_frame(&message.data));
                self.frayed = Some((end, last.map_or(entry.offset, salvage::end)));
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
        // The index of a chunk behind one flipped bit of its opcode has no time twice, and proves nothing.
        let may_be = |message: &Message| salvage::is_certain(message) || salvage::is_frame(&message.data);
        let ours = contents.messages.iter().all(|message| Some(message.channel) == self.wire && may_be(message));
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

    /// The end of the data, and behind it the index. That is looked at as a whole, once: what claims to be an end may stand in a file any number of times.
    fn end_of_data(&mut self, entry: Entry, crc: u32) {
        let is_first = self.data_end.is_none();
        self.data_end = Some((entry.offset, if self.damaged_to == 0 { crc } else { 0 }));
        if !is_first {
            return;
        }
        match self.container.index(entry.end()) {
            Ok(None | Some(Index::Sound)) => {}
            Ok(Some(Index::Damaged(error))) => {
                let size = self.container.size();
                self.tell(error, size);
                if !self.foreign {
                    self.stretch = Some(Stretch::new(entry.end(), size));
                }
            }
            Err(error) => self.tell(error, entry.end()),
        }
    }

    /// The CRC over everything before the index, when nothing else was wrong there.
    fn check_all(&mut self) {
        if self.data_end.is_none() && self.damaged_to == 0 {
            let size = self.container.size();
            let error = self.container.damaged(size, "no record says where the data end".to_owned());
            return self.tell(error, size);
        }
        let Some((end, expected)) = self.data_end.filter(|&(_, crc)| crc != 0) else { return };
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
        let straight = self.order.follow(&messages);
        let Settled { messages, told, broken } = if straight == messages.len() {
            Settled { messages, ..Settled::default() }
        } else {
            self.settle(messages, straight)
        };
        self.unread += broken;
        let mut told = told.into_iter().peekable();
        let is_certain = salvage::is_certain;
        let mut next_ns = u64::MAX;
        let mut bounds = Vec::with_capacity(messages.len());
        for message in messages.iter().rev() {
            next_ns = if is_certain(message) { message.log_time } else { next_ns };
            bounds.push(next_ns);
        }
        for (number, mut message) in messages.into_iter().enumerate() {
            while let Some((_, place, what)) = told.next_if(|(before, ..)| *before <= number) {
                self.remark(place, what);
            }
            let bound_ns = bounds.pop().unwrap_or(u64::MAX);
            if !is_certain(&message) {
                let best = salvage::choose(message.log_time, message.publish_time, self.latest_ns);
                message.log_time = best.max(self.latest_ns).min(bound_ns);
            }
            self.latest_ns = message.log_time;
            self.ready.push_back(Ok(message));
        }
    }

    /// Messages that do not follow each other, put into their order. In a file that is whole so far nothing is looked for further on.
    fn settle(&mut self, messages: Vec<Message>, straight: usize) -> Settled {
        let Self { container, order, looked, damaged_to, latest_ns, .. } = self;
        let most = AHEAD_TIMES.saturating_mul(container.size());
        order.settle(messages, straight, |from| {
            if *damaged_to == 0 || *looked > most {
                return Vec::new();
            }
            *looked += AHEAD as u64;
            // What cannot be read there is told when its place is reached.
            container.bytes(from, AHEAD).map_or_else(|_| Vec::new(), |bytes| salvage::frames(&bytes, from, *latest_ns))
        })
    }

    /// Tells of frames at a place that is no loss.
    fn remark(&mut self, place: Range<u64>, what: String) {
        let error = self.container.damaged(place.start, what);
        (self.damaged_to, self.unread_before) = (self.damaged_to.max(place.end), self.unread_at_step);
        self.ready.push_back(Err(error));
    }

    /// Tells damage that ends at `to`.
    fn tell(&mut self, error: Error, to: u64) {
        (self.damaged_to, self.unread_before) = (to.max(1), self.unread);
        self.ready.push_back(Err(error));
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
