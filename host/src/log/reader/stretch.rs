//! What has no structure: the places of a file to which no record leads, searched for frames up to the next chunk.

use super::{Reader, WIRE_ID};
use crate::container::{Entry, Error};
use crate::log::salvage;

/// Bytes of a stretch without structure that are looked at in one go.
const WINDOW: usize = 1 << 16;

/// Bytes in which frames are looked for at the beginning of a file that does not begin as it should.
const LOOK: usize = 1 << 20;

/// Bytes that are searched for frames.
#[derive(Debug)]
pub struct Stretch {
    begin: u64,
    /// What has been searched.
    at: u64,
    /// Where they end.
    pub end: u64,
    /// Where the last frame found ends.
    found_to: u64,
    /// Bytes of the frames found, with their heads.
    covered: u64,
}

impl Stretch {
    pub fn new(begin: u64, end: u64) -> Self {
        Self { begin, at: begin, end, found_to: begin, covered: 0 }
    }

    /// One behind a damaged chunk, whose last frame ends somewhat before.
    pub fn behind(begin: u64, end: u64, frayed: Option<(u64, u64)>) -> Self {
        let Some((_, found_to)) = frayed.filter(|(end, _)| *end == begin) else { return Self::new(begin, end) };
        Self { at: found_to.max(begin.saturating_sub(salvage::LONGEST as u64)), found_to, ..Self::new(begin, end) }
    }
}

impl Reader {
    /// A file that does not begin as it should: with its records, if they are where they should be, or with the first chunk. What is no log is
    /// refused before much of it is read.
    pub(super) fn begin_damaged(&mut self) -> Result<Option<Error>, Error> {
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

    /// A record that is not what it says: its bytes may be anything, and what follows may begin within it.
    pub(super) fn misread(&mut self, entry: Entry, what: &str) {
        let error = self.container.damaged(entry.offset, what.to_owned());
        if self.foreign {
            self.tell(error, entry.end());
        } else if self.container.goes_on() {
            // Its length is right, whatever else is not.
            self.tell(error, entry.end());
            self.stretch = Some(Stretch::behind(entry.offset, entry.end(), self.frayed));
        } else {
            self.go_on_behind(error);
        }
    }

    /// Damage of the structure: the next chunk is looked for, and frames in between.
    pub(super) fn go_on_behind(&mut self, error: Error) {
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
            self.stretch = Some(Stretch::behind(at, end, self.frayed));
        }
    }

    /// One window of a stretch without structure. Windows overlap by the longest frame with its head.
    pub(super) fn search(&mut self, mut stretch: Stretch) {
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
        let end = salvage::end;
        let mut found = salvage::frames(&bytes, stretch.at, self.latest_ns);
        found.retain(|message| end(message) > stretch.found_to);
        stretch.found_to = found.last().map_or(stretch.found_to, end);
        for message in &found {
            // What lies in the chunk before was counted as unread there.
            self.unread = self.unread.saturating_sub(stretch.begin.saturating_sub(message.offset));
            stretch.covered += end(message) - message.offset.max(stretch.begin);
        }
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
}
