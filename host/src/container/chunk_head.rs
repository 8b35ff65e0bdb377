//! The fields in front of a chunk's records, by which a chunk is known wherever it lies.

use mcap::records::op;

use super::{HEAD, MAX_CHUNK};

/// Longest chunk record up to its records: opcode and length, fixed fields, the name of a compression.
pub const CHUNK_HEAD_MAX: usize = HEAD as usize + 40 + 4;

/// The fields in front of a chunk's records (MCAP specification, "Chunk").
pub struct ChunkHead {
    start: u64,
    end: u64,
    pub unpacked: u64,
    pub crc: u32,
    pub compression: String,
    pub packed: u64,
    /// Where the records begin in the body.
    pub records_at: usize,
}

impl ChunkHead {
    /// Of a compression, in bytes.
    pub const LONGEST_NAME: usize = 64;

    /// Length of the chunk's record, as its header has it.
    pub fn length(&self) -> Option<u64> {
        self.packed.checked_add(self.records_at as u64)
    }

    pub fn parse(body: &[u8]) -> Option<Self> {
        let long = |at: usize| Some(u64::from_le_bytes(*body.get(at..)?.first_chunk()?));
        let short = |at: usize| Some(u32::from_le_bytes(*body.get(at..)?.first_chunk()?));
        // An unknown compression is refused by the crate's reader; an absurd length is no header.
        let name = short(28).filter(|&length| length as usize <= Self::LONGEST_NAME)? as usize;
        Some(Self {
            start: long(0)?,
            end: long(8)?,
            unpacked: long(16)?,
            crc: short(24)?,
            compression: str::from_utf8(body.get(32..32 + name)?).ok()?.to_owned(),
            packed: long(32 + name)?,
            records_at: 40 + name,
        })
    }
}

/// Whether a chunk record begins here, by every relation that its header must fulfil.
pub fn begins_chunk(bytes: &[u8], room: u64) -> bool {
    let Some((&[opcode, ref length @ ..], body)) = bytes.split_first_chunk::<{ HEAD as usize }>() else { return false };
    let length = u64::from_le_bytes(*length);
    if opcode != op::CHUNK || !(40..=MAX_CHUNK).contains(&length) || room < HEAD {
        return false;
    }
    ChunkHead::parse(body).is_some_and(|head| {
        head.start <= head.end
            && head.unpacked <= MAX_CHUNK
            && matches!(head.compression.as_str(), "" | "lz4" | "zstd")
            && head.length() == Some(length)
    })
}
