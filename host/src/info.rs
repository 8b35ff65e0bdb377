//! What a file holds: a capture or a log at a glance.

use std::collections::BTreeMap;
use std::path::Path;

use crossfall_core::protocol::DeviceTime;
use crossfall_core::protocol::frame::Gap;
use crossfall_core::protocol::message::Message;
use crossfall_core::sensors::{Scanner, cola, lms2xx, novatel};
use serde::Serialize;

use crate::capture::{Channel, Chunk, Reader};
use crate::container::Error;
use crate::counters::{self, Totals};
use crate::interrupt;
use crate::log;
use crate::recorded::Recorded;
use crate::scanner::{self, Family};
use crate::span::Span;
use crate::stream::{Item, Stream};

/// A file at a glance.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Info {
    /// `capture` or `log`.
    pub kind: &'static str,
    /// From the first to the last thing in a capture, from the first to the last scan or pose of a log over all boots, in device time.
    pub seconds: f64,
    /// Scans.
    pub scans: u64,
    /// Poses.
    pub poses: u64,
    /// Pulses.
    pub pulses: u64,
    /// Every counter by name: of a capture those of the decoders, of a log those of the board, over all its boots, and of the link.
    pub counters: BTreeMap<String, u64>,
    /// Of a capture the family of its scanner, of a log its metadata and the board's hello.
    pub about: BTreeMap<String, String>,
    /// Damage of the file itself, in words.
    pub damage: Vec<String>,
    /// Damaged parts, broken frames and gaps.
    #[serde(skip)]
    losses: u64,
}

impl Info {
    /// Whether nothing of the file is damaged, broken or missing.
    #[must_use]
    pub fn is_whole(&self) -> bool {
        self.losses == 0
    }
}

/// Looks at a capture or a log.
///
/// # Errors
/// When the file cannot be read or is neither.
pub fn look(path: &Path) -> Result<Info, Error> {
    match Recorded::open(path)? {
        Recorded::Capture(capture) => look_at_capture(capture),
        Recorded::Log(log) => look_at_log(log),
    }
}

fn look_at_capture(mut capture: Reader) -> Result<Info, Error> {
    let (first, last) = capture.span_ns().unwrap_or_default();
    let mut info = Info { kind: "capture", seconds: last.saturating_sub(first) as f64 * 1e-9, ..Info::default() };
    let (family, chunks) = scanner::of_chunks(capture.by_ref());
    match family {
        // The mode only says what the ranges mean: every scan is counted.
        Family::Lms2xx => look_at_chunks(chunks, lms2xx::Decoder::new(6), &mut info)?,
        Family::Cola => look_at_chunks(chunks, cola::Decoder::default(), &mut info)?,
    }
    // The family of a line without a scan is a default, and none's.
    if info.scans > 0 {
        info.about.insert("scanner".to_owned(), family.name().to_owned());
    }
    for (topic, count) in capture.foreign_messages() {
        info.counters.insert(format!("foreign.{topic}"), *count);
    }
    info.losses = info.damage.len() as u64;
    Ok(info)
}

fn look_at_chunks<S: Scanner>(
    chunks: impl Iterator<Item = Result<Chunk, Error>>,
    mut lidar: S,
    info: &mut Info,
) -> Result<(), Error> {
    let mut ins = novatel::Decoder::new();
    for chunk in chunks {
        match chunk {
            Ok(chunk) => {
                let at = DeviceTime(chunk.device_time_ns / 1_000);
                match chunk.channel {
                    Channel::Lidar => chunk.data.iter().for_each(|&byte| lidar.push(byte, at, &mut |_| ())),
                    Channel::Ins => chunk.data.iter().for_each(|&byte| ins.push(byte, at, &mut |_| ())),
                    Channel::Pps => info.pulses += 1,
                    Channel::Ins2 => {
                        *info.counters.entry("ins2.bytes".to_owned()).or_default() += chunk.data.len() as u64
                    }
                }
            }
            Err(Error::Interrupted) => return Err(Error::Interrupted),
            Err(error) => info.damage.push(error.to_string()),
        }
    }
    lidar.finish(&mut |_| ());
    ins.finish(&mut |_| ());
    info.scans = u64::from(lidar.scans());
    info.poses = u64::from(ins.solutions());
    counters::line("lidar", &lidar.counters(), &mut info.counters);
    counters::line("ins", &ins.counters(), &mut info.counters);
    info.counters.insert("scans_missing".to_owned(), u64::from(lidar.scans_missing()));
    info.counters.insert("scans_unreadable".to_owned(), u64::from(lidar.scans_unreadable()));
    Ok(())
}

fn look_at_log(mut log: Stream) -> Result<Info, Error> {
    let mut info = Info { kind: "log", ..Info::default() };
    let (mut frames, mut bad, mut profiles) = (0, 0, 0);
    let (mut span, mut totals) = (Span::default(), Totals::default());
    while let Some((_, item)) = log.next() {
        match item {
            Item::Message { message, gap } => {
                frames += 1;
                if gap == Gap::Restarted {
                    span.restart();
                    totals.restart();
                }
                span.see(&message);
                match message {
                    Message::Hello(hello) => {
                        info.about.insert("firmware".to_owned(), hello.firmware.to_owned());
                        info.about.insert("board".to_owned(), hello.board.to_owned());
                        info.about.insert("schema".to_owned(), format!("{:016x}", hello.schema));
                    }
                    Message::Scan(_) => info.scans += 1,
                    Message::Pose(_) => info.poses += 1,
                    Message::Pulse(_) => info.pulses += 1,
                    Message::Profile(_) => profiles += 1,
                    Message::Status(status) => totals.status(&status),
                    _ => {}
                }
            }
            Item::Rejected { .. } => bad += 1,
            Item::Damage(error) => info.damage.push(error.to_string()),
        }
    }
    interrupt::check()?;
    info.counters = totals.counters();
    for (name, count) in [
        ("frames", frames),
        ("bad_frames", bad),
        ("missing_frames", log.missing()),
        ("unknown_gaps", log.unknown_gaps()),
        ("profiles", profiles),
        ("restarts", totals.restarts()),
    ] {
        info.counters.insert(format!("link.{name}"), count);
    }
    // Which file of a drive was read last says nothing of the drive.
    for (name, entries) in log.metadata().iter().filter(|(name, _)| *name != log::metadata::PART) {
        for (key, value) in entries.iter().filter(|(_, value)| !value.contains('\n')) {
            info.about.insert(format!("{name}.{key}"), value.clone());
        }
    }
    info.seconds = span.seconds();
    info.losses = log.losses();
    Ok(info)
}
