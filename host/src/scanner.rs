//! Which family of scanners speaks in a stream of bytes.
//!
//! A capture does not say it: it holds what came over a line. The first telegrams do: those of an LMS 1xx or 5xx are CoLa B, framed by four equal
//! bytes, a length and a check, and hold a scan; all else is left to the LMS 2xx, which counts what it does not understand.

use std::collections::VecDeque;

use crossfall_core::protocol::DeviceTime;
use crossfall_core::sensors::{Scanner, cola};

use crate::capture::{Channel, Chunk};
use crate::container;

/// Bytes of the scanner's line that are looked at: some dozens of scans of either family.
const ENOUGH: usize = 1 << 16;

/// Chunks of all lines that are held for it: a capture without a scanner must not be held as a whole.
const MOST_HELD: usize = 1 << 14;

/// Baud rate that bytes of an Ethernet line are spaced by: faster than any of these scanners.
pub const ETHERNET_BAUD: u32 = 100_000_000;

/// Scanners of one language.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Family {
    /// LMS 200, 211, 221, 291: serial telegrams.
    #[default]
    Lms2xx,
    /// LMS 1xx and 5xx: CoLa B over Ethernet.
    Cola,
}

impl Family {
    /// Its name.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Lms2xx => "SICK LMS 2xx",
            Self::Cola => "SICK LMS 1xx/5xx (CoLa B)",
        }
    }

    /// The family whose bytes these are.
    #[must_use]
    pub fn of(bytes: &[u8]) -> Self {
        let mut decoder = cola::Decoder::default();
        for &byte in bytes.iter().take(ENOUGH) {
            decoder.push(byte, DeviceTime(0), &mut |_| ());
        }
        decoder.finish(&mut |_| ());
        if decoder.scans() + decoder.scans_unreadable() > 0 { Self::Cola } else { Self::Lms2xx }
    }
}

/// The family that speaks in a capture's chunks, and all of the chunks. What has been looked at is held meanwhile.
pub fn of_chunks<I: Iterator<Item = Result<Chunk, container::Error>>>(
    mut chunks: I,
) -> (Family, impl Iterator<Item = I::Item>) {
    let mut held = VecDeque::new();
    let mut bytes = Vec::new();
    while bytes.len() < ENOUGH && held.len() < MOST_HELD {
        let Some(chunk) = chunks.next() else { break };
        if let Ok(Chunk { channel: Channel::Lidar, data, .. }) = &chunk {
            bytes.extend_from_slice(data);
        }
        held.push_back(chunk);
    }
    (Family::of(&bytes), held.into_iter().chain(chunks))
}
