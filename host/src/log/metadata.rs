//! Metadata records, for readers that know no frames: their names, and what they say of the frames.

use std::collections::BTreeMap;

use crossfall_core::protocol::message::Message;

use crate::config;

/// What a record says, by key.
pub type Entries = BTreeMap<String, String>;

/// Who sent the frames: `firmware`, `board`, `schema` (16 hexadecimal digits).
pub const IDENTITY: &str = "identity";
/// The configuration in force, as TOML under the key `toml`.
pub const CONFIG: &str = "config";
/// In every file of a recording but the first: its `number`, counted from 1, and the file `before` it.
pub const PART: &str = "part";
/// At the end of a file that another one follows: the `name` of that.
pub const NEXT: &str = "next";
/// The board has booted again: the `number` of the segment that begins, counted from 1, and `why`.
pub const SEGMENT: &str = "segment";
/// In a log that `recover` made: what it was made `from`, before its first frame; and at its end once more, with what was lost.
pub const RECOVERED: &str = "recovered";
/// The drive is a simulated one, which can be made again: its `seed`.
pub const SIMULATED: &str = "simulated";

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
