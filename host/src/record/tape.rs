//! Where a recording goes.
//!
//! A log is a [`Tape`]; so is what the live page looks at, which starts and ends logs while the connection lasts.

use std::collections::BTreeMap;

use crossfall_core::protocol::message::Message;

use crate::{log, output};

/// Takes what comes from a board.
pub trait Tape {
    /// A frame as received, the delimiting 0x00 included, and its message where it is good.
    ///
    /// # Errors
    /// When it cannot be written; this ends the recording.
    fn frame(&mut self, receive_ns: u64, raw: &[u8], message: Option<&Message<'_>>) -> Result<(), output::Error>;

    /// A metadata record, see [`log::metadata`].
    ///
    /// # Errors
    /// As of [`Tape::frame`].
    fn metadata(&mut self, name: &str, entries: BTreeMap<String, String>) -> Result<(), output::Error>;

    /// Bytes on the disk, in how many files.
    fn extent(&self) -> (u64, u32);

    /// Why the log's file grows beyond its bounds, if it does, see [`log::Writer::grows_on`].
    fn grows_on(&self) -> Option<log::GrowsOn>;

    /// Time goes by; called at least twenty times a second.
    ///
    /// # Errors
    /// As of [`Tape::frame`].
    fn settle(&mut self, now_ns: u64) -> Result<(), output::Error>;
}

impl Tape for log::Writer {
    fn frame(&mut self, receive_ns: u64, raw: &[u8], _: Option<&Message<'_>>) -> Result<(), output::Error> {
        Self::frame(self, receive_ns, raw)
    }

    fn metadata(&mut self, name: &str, entries: BTreeMap<String, String>) -> Result<(), output::Error> {
        Self::metadata(self, name, entries)
    }

    fn extent(&self) -> (u64, u32) {
        (self.bytes(), self.parts())
    }

    fn grows_on(&self) -> Option<log::GrowsOn> {
        Self::grows_on(self)
    }

    fn settle(&mut self, now_ns: u64) -> Result<(), output::Error> {
        Self::settle(self, now_ns)
    }
}
