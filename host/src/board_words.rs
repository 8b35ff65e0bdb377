//! What the board has said in words: its log lines, and its bench messages (defmt), which are numbers and arguments on the link and become
//! text against the image that sent them.
//!
//! defmt frames are cut into link frames without regard to each other. Where a link frame is lost, the defmt frame it was part of is lost
//! too and counted; the next one is read again.

use std::path::Path;

use crossfall_core::protocol::DeviceTime;
use crossfall_core::protocol::message::{Level, Message};
use defmt_decoder::DecodeError;
pub use defmt_decoder::Table;
use serde::Serialize;

use crate::container::Error;
use crate::interrupt;
use crate::stream::{Item, Stream};

/// One line.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Line {
    /// Number of the link frame that ended it.
    pub frame: u64,
    /// Device time of that frame, in microseconds.
    pub device_time_us: u64,
    /// `error`, `warn`, `info`, `debug`, `trace`, or `print` for a defmt message without a level.
    pub level: &'static str,
    /// Whether it is a bench message.
    pub defmt: bool,
    /// The text.
    pub text: String,
}

/// What could not be told.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Untold {
    /// Bytes of bench messages, for want of an image.
    pub defmt_bytes: u64,
    /// Bench messages that do not decode against the image.
    pub malformed: u64,
    /// Damaged or broken frames.
    pub broken: u64,
    /// Gaps, of missing frames.
    pub gaps: u64,
}

impl Untold {
    /// Whether all that was said was told.
    #[must_use]
    pub fn is_nothing(&self) -> bool {
        *self == Self::default()
    }
}

/// Why an image cannot serve.
#[derive(Debug, thiserror::Error)]
pub enum ImageError {
    /// It cannot be read.
    #[error("{path}")]
    Unreadable {
        /// Where.
        path: String,
        /// Why.
        source: std::io::Error,
    },
    /// It is no image with bench messages.
    #[error("{path}: no image with defmt messages: {why}")]
    Foreign {
        /// Where.
        path: String,
        /// Why.
        why: String,
    },
}

/// The bench messages of an image.
///
/// # Errors
/// When the file cannot be read or holds none.
pub fn table(image: &Path) -> Result<Table, ImageError> {
    let path = image.display().to_string();
    let elf = std::fs::read(image).map_err(|source| ImageError::Unreadable { path: path.clone(), source })?;
    match Table::parse(&elf) {
        Ok(Some(table)) => Ok(table),
        Ok(None) => Err(ImageError::Foreign { path, why: "it has none".to_owned() }),
        Err(error) => Err(ImageError::Foreign { path, why: error.to_string() }),
    }
}

/// Reads the lines of a log in their order; `out` gets each, until it fails.
///
/// # Errors
/// When the log cannot be opened, what `out` fails with, or when the user asks to stop.
pub fn read<E: From<Error>>(
    log: &Path,
    table: Option<&Table>,
    mut out: impl FnMut(Line) -> Result<(), E>,
) -> Result<Untold, E> {
    let mut stream = Stream::open(log)?;
    let mut untold = Untold::default();
    let mut defmt = table.map(Table::new_stream_decoder);
    while let Some((place, item)) = stream.next() {
        let line = |time: DeviceTime, level, defmt, text| Line {
            frame: place.frame,
            device_time_us: time.0,
            level,
            defmt,
            text,
        };
        let log = match item {
            Item::Message { message: Message::Log(log), .. } => log,
            Item::Message { .. } => continue,
            Item::Rejected { .. } | Item::Damage(_) => {
                untold.broken += 1;
                continue;
            }
        };
        let level = match (log.level, &mut defmt) {
            (Level::Error, _) => "error",
            (Level::Warn, _) => "warn",
            (Level::Info, _) => "info",
            (Level::Defmt, None) => {
                untold.defmt_bytes += log.text.len() as u64;
                continue;
            }
            (Level::Defmt, Some(decoder)) => {
                decoder.received(log.text);
                loop {
                    match decoder.decode() {
                        Ok(frame) => {
                            let level = frame.level().map_or("print", |level| level.as_str());
                            out(line(log.time, level, true, frame.display_message().to_string()))?;
                        }
                        Err(DecodeError::UnexpectedEof) => break,
                        Err(DecodeError::Malformed) => untold.malformed += 1,
                    }
                }
                continue;
            }
        };
        out(line(log.time, level, false, String::from_utf8_lossy(log.text).into_owned()))?;
    }
    interrupt::check()?;
    untold.gaps = stream.losses() - untold.broken;
    Ok(untold)
}
