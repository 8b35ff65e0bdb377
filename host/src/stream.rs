//! A log as the messages that it holds, each with its place.
//!
//! One record of a log is one frame as received; whatever is wrong with one record stays within it. A recording of several files is read as one.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use crossfall_core::protocol::frame::{DELIMITER, Event, Fault, Gap, HostDecoder, Sequence};
use crossfall_core::protocol::message::Message;

use crate::container::Error;
use crate::log;

/// Where a frame is.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Place {
    /// 0-based number of the file, in a recording of several.
    pub file: usize,
    /// 0-based number of the record in the log.
    pub frame: u64,
    /// Where the record is in the file, in bytes.
    pub offset: u64,
    /// When it was received, in nanoseconds of the host's clock.
    pub receive_ns: u64,
    /// The frame's own number, as far as it could be read.
    pub sequence: Option<u16>,
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
    files: log::Recording,
    decoder: HostDecoder,
    sequence: Sequence,
    place: Place,
    frames: u64,
    losses: u64,
    record: Vec<u8>,
    taken: usize,
}

impl Stream {
    /// Opens a log, with the files that follow it when it is the first of a recording of several (see [`log::Parts`]).
    ///
    /// # Errors
    /// As of [`log::Reader::open`].
    pub fn open(path: &Path) -> Result<Self, Error> {
        Ok(Self::over(log::Recording::open(path)?))
    }

    /// Opens these files of one recording and no others, in this order. Those behind the first are opened when their turn comes; one that cannot be is a damage.
    ///
    /// # Errors
    /// As of [`log::Reader::open`], of the first.
    pub fn open_all(first: &Path, others: &[PathBuf]) -> Result<Self, Error> {
        Ok(Self::over(log::Recording::open_all(first, others)?))
    }

    fn over(files: log::Recording) -> Self {
        Self {
            files,
            decoder: HostDecoder::new(),
            sequence: Sequence::new(),
            place: Place::default(),
            frames: 0,
            losses: 0,
            record: Vec::new(),
            taken: 0,
        }
    }

    /// Metadata of the file under way, as far as it has been read.
    #[must_use]
    pub fn metadata(&self) -> &BTreeMap<String, BTreeMap<String, String>> {
        self.files.metadata()
    }

    /// How far the recording has been read, in bytes of all its files.
    #[must_use]
    pub fn reached(&self) -> u64 {
        self.files.before() + self.place.offset
    }

    /// Records read so far.
    #[must_use]
    pub fn frames(&self) -> u64 {
        self.frames
    }

    /// Damaged parts, broken frames and gaps so far. A board that boots again has none.
    #[must_use]
    pub fn losses(&self) -> u64 {
        self.losses
    }

    /// The next item; a lending iterator, as messages borrow from the frame. It ends early when the user asks to stop: [`check`](crate::interrupt::check) tells.
    #[expect(clippy::should_implement_trait, reason = "an iterator cannot lend")]
    pub fn next(&mut self) -> Option<(Place, Item<'_>)> {
        while self.taken >= self.record.len() {
            let read = self.files.next()?;
            let file = self.files.file();
            if file != self.place.file {
                self.place = Place { file, offset: 0, ..self.place };
            }
            match read {
                Err(Error::Interrupted) => return None,
                Err(error) => {
                    self.losses += 1;
                    let place = Place { offset: error.offset().unwrap_or(self.place.offset), ..self.place };
                    return Some((Place { frame: self.frames, ..place }, Item::Damage(error)));
                }
                Ok(log::Frame { offset, receive_ns, bytes }) => {
                    self.place = Place { file, frame: self.frames, offset, receive_ns, sequence: None };
                    self.frames += 1;
                    self.record = bytes;
                    self.taken = 0;
                    if self.record.is_empty() {
                        let fault = Fault::Truncated;
                        self.losses += 1;
                        return Some((self.place, Item::Rejected { fault, bytes: 0 }));
                    }
                }
            }
        }
        let mut place = self.place;
        let rest = self.record.get(self.taken..).unwrap_or_default();
        let idle = rest.iter().take_while(|&&byte| byte == DELIMITER).count();
        let mut input = rest.get(idle..).unwrap_or_default();
        if !input.contains(&DELIMITER) {
            // No frame ends here: the record is cut, or there is nothing in it.
            self.taken = self.record.len();
            let bytes = rest.len() as u64;
            while self.decoder.next(&mut input).is_some() {}
            self.decoder.finish();
            self.losses += 1;
            return Some((place, Item::Rejected { fault: Fault::Truncated, bytes }));
        }
        let before = input.len();
        let length = input.iter().position(|&byte| byte == DELIMITER).map_or(before, |end| end + 1);
        self.taken += idle + length;
        let item = match self.decoder.next(&mut input)? {
            Event::Frame(frame) => {
                place.sequence = Some(frame.sequence);
                let gap = self.sequence.observe_message(frame.sequence, &frame.body);
                self.losses += u64::from(matches!(gap, Gap::Missing(_) | Gap::Unknown));
                Item::Message { message: frame.body, gap }
            }
            Event::Rejected(rejected) => {
                self.losses += 1;
                place.sequence = rejected.sequence;
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

    /// Gaps so far of which it is not known how many frames they cost.
    #[must_use]
    pub fn unknown_gaps(&self) -> u64 {
        self.sequence.unknown()
    }

    /// Bytes of damaged places of the file under way that gave no frame, so far.
    #[must_use]
    pub fn unread(&self) -> u64 {
        self.files.unread()
    }
}
