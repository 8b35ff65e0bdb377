//! Metadata records, for readers that know no frames: their names, and what they say of the frames.

use std::collections::BTreeMap;

use crossfall_core::protocol::message::Message;
use mcap::records::{Record, op};

use crate::config;

/// What a record says, by key.
pub type Entries = BTreeMap<String, String>;

/// Who sent the frames: `firmware`, `board`, `schema` (16 hexadecimal digits).
pub const IDENTITY: &str = "identity";
/// The configuration in force, as TOML under the key `toml`.
pub const CONFIG: &str = "config";
/// In the first file of a recording of a stream that cannot be had again: its `id`, 32 hexadecimal digits that no other one has.
pub const RECORDING: &str = "recording";
/// In every file of a recording but the first: its `number`, counted from 1, the file `before` it, and the id of the `recording`.
pub const PART: &str = "part";
/// At the end of a file that another one follows: the `name` of that.
pub const NEXT: &str = "next";
/// The board has booted again: the `number` of the segment that begins, counted from 1, and `why`.
pub const SEGMENT: &str = "segment";
/// In a log that `recover` made: what it was made `from`, before its first frame; and at its end once more, with what was lost.
pub const RECOVERED: &str = "recovered";
/// The drive is a simulated one, which can be made again: its `seed`.
pub const SIMULATED: &str = "simulated";

/// The id of the recording that a file belongs to; none of those that were recorded before there were any, and of those that can be made again.
pub(super) fn recording_of(metadata: &BTreeMap<String, Entries>) -> Option<&str> {
    let first = metadata.get(RECORDING).and_then(|recording| recording.get("id"));
    first.or_else(|| metadata.get(PART)?.get("recording")).map(String::as_str)
}

/// Name and entries of the record that says what a message does, if one does: who the board is, and how it is configured.
#[must_use]
pub fn of(message: &Message<'_>) -> Option<(&'static str, Entries)> {
    let (name, entries) = match message {
        Message::Hello(hello) => (
            IDENTITY,
            vec![
                ("firmware", hello.firmware.to_owned()),
                ("board", hello.board.to_owned()),
                ("schema", format!("{:016x}", hello.schema)),
            ],
        ),
        Message::Config(found) => (CONFIG, vec![("toml", config::to_toml(found))]),
        _ => return None,
    };
    Some((name, entries.into_iter().map(|(key, value)| (key.to_owned(), value)).collect()))
}

/// Name and entries of a metadata record's body.
pub(super) fn parse(body: &[u8]) -> Option<(String, Entries)> {
    match mcap::parse_record(op::METADATA, body) {
        // It fills its length, or the length is wrong.
        Ok(Record::Metadata(found)) => {
            let pairs: usize = found.metadata.iter().map(|(key, value)| 8 + key.len() + value.len()).sum();
            (8 + found.name.len() + pairs == body.len()).then_some((found.name, found.metadata))
        }
        _ => None,
    }
}
