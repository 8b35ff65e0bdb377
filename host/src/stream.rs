//! A log as the messages that it holds, each with its place.
//!
//! One record of a log is one frame as received; whatever is wrong with one record stays within it.

use std::path::Path;

use crossfall_core::protocol::frame::{DELIMITER, Event, Fault, Gap, HostDecoder, Sequence};
use crossfall_core::protocol::message::Message;

use crate::container::Error;
use crate::log;

/// Where a frame is.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Place {
    /// 0-based number of the record in the log.
    pub frame: u64,
    /// Where the record is in the file, in bytes.
    pub offset: u64,
    /// When it was received, in nanoseconds of the host's clock.
    pub receive_ns: u64,
}

/// What a record holds.
#[derive(Debug)]
pub enum Item<'a> {
    /// A good frame.
    Message {
        /// Its message.
        message: Message<'a>,
        /// What is missing before it.
        gap: Gap,
    },
    /// Bytes that are no good frame.
    Rejected {
        /// Why.
        fault: Fault,
        /// How many.
        bytes: u64,
    },
    /// A part of the file that cannot be read.
    Damage(Error),
}

/// Reads a log message by message, in memory that does not grow.
#[derive(Debug)]
pub struct Stream {
    reader: log::Reader,
    decoder: HostDecoder,
    sequence: Sequence,
    place: Place,
    frames: u64,
    record: Vec<u8>,
    taken: usize,
}

impl Stream {
    /// Opens a log.
    ///
    /// # Errors
    /// As of [`log::Reader::open`].
    pub fn open(path: &Path) -> Result<Self, Error> {
        Ok(Self {
            reader: log::Reader::open(path)?,
            decoder: HostDecoder::new(),
            sequence: Sequence::new(),
            place: Place::default(),
            frames: 0,
            record: Vec::new(),
            taken: 0,
        })
    }

    /// The log's metadata, as far as it has been read.
    #[must_use]
    pub fn metadata(&self) -> &std::collections::BTreeMap<String, std::collections::BTreeMap<String, String>> {
        self.reader.metadata()
    }

    /// Records read so far.
    #[must_use]
    pub fn frames(&self) -> u64 {
        self.frames
    }

    /// The next item; a lending iterator, as messages borrow from the frame.
    #[expect(clippy::should_implement_trait, reason = "an iterator cannot lend")]
    pub fn next(&mut self) -> Option<(Place, Item<'_>)> {
        if self.taken >= self.record.len() {
            match self.reader.next()? {
                Err(error) => {
                    let place = Place { offset: error.offset().unwrap_or(self.place.offset), ..self.place };
                    return Some((Place { frame: self.frames, ..place }, Item::Damage(error)));
                }
                Ok(frame) => {
                    self.place = Place { frame: self.frames, offset: frame.offset, receive_ns: frame.receive_ns };
                    self.frames += 1;
                    self.record = frame.bytes;
                    self.taken = 0;
                }
            }
        }
        let place = self.place;
        let rest = self.record.get(self.taken..).unwrap_or_default();
        let idle = rest.iter().take_while(|&&byte| byte == DELIMITER).count();
        let mut input = rest.get(idle..).unwrap_or_default();
        if !input.contains(&DELIMITER) {
            // No frame ends here: the record is cut, or there is nothing in it.
            self.taken = self.record.len();
            let bytes = rest.len() as u64;
            while self.decoder.next(&mut input).is_some() {}
            self.decoder.finish();
            return Some((place, Item::Rejected { fault: Fault::Truncated, bytes }));
        }
        let before = input.len();
        let length = input.iter().position(|&byte| byte == DELIMITER).map_or(before, |end| end + 1);
        self.taken += idle + length;
        let item = match self.decoder.next(&mut input)? {
            Event::Frame(frame) => {
                let gap = self.sequence.observe_message(frame.sequence, &frame.body);
                Item::Message { message: frame.body, gap }
            }
            Event::Rejected(rejected) => {
                if let Some(sequence) = rejected.sequence {
                    self.sequence.observe(sequence);
                }
                Item::Rejected { fault: rejected.fault, bytes: rejected.len }
            }
        };
        Some((place, item))
    }

    /// Frames that the sequence numbers prove missing so far.
    #[must_use]
    pub fn missing(&self) -> u64 {
        self.sequence.missing()
    }
}
