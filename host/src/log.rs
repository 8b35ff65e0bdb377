//! Logs: every frame of the link as it was received, as an MCAP file.
//!
//! One channel, `wire`: COBS, CRC and the delimiting 0x00 included, log time = the host's receive time in nanoseconds. Metadata
//! records carry the firmware's identity, the schema's hash and the configuration.
//!
//! [`Writer`] closes an MCAP chunk at the latest [`CHUNK_NS`] of receive time after its first frame and only ever appends, so a file cut at any
//! byte lacks at most that much. [`Reader`] goes from the start to wherever the file ends, tells every damage with its place,
//! finds the good frames within it, and goes on behind it. [`Recording`] does so over all files of a recording.

mod files;
pub mod metadata;
mod names;
mod order;
mod parts;
mod reader;
mod recording;
mod salvage;
mod storage;
mod writer;

pub use crate::container::Error;
pub use files::Recording;
pub(crate) use files::torn;
pub(crate) use names::names_of;
pub use parts::Parts;
pub use reader::Reader;
pub use recording::is_recording;
pub(crate) use storage::sync_folder;
pub use storage::{Storage, is_being_written};
pub use writer::{GrowsOn, Options, PARTS, Writer};

/// The channel of a log.
pub const TOPIC: &str = "wire";

/// Its number in the logs that are written here: what is read as `wire` when the chunk that says so is lost.
const WIRE_ID: u16 = 1;

/// Receive time after which a chunk is closed: half of the second that may be lost.
pub const CHUNK_NS: u64 = 500_000_000;

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

#[cfg(test)]
mod tests;
