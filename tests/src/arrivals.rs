//! A capture as a board meets it: bytes and edges one by one, each at its own instant.

use std::path::Path;

use crossfall::capture::{self, Channel};
use crossfall_core::instrument::Line;
use crossfall_core::protocol::Config;

/// One byte or edge.
#[derive(Clone, Copy, Debug)]
pub struct Arrival {
    /// Device time, nanoseconds.
    pub at_ns: u64,
    /// Where it arrives.
    pub channel: Channel,
    /// The byte; of a pulse any.
    pub byte: u8,
}

/// The arrivals of a capture's scanner, inertial unit and pulses, in their order: lines of the configured rates, a pulse before a byte of the same instant.
///
/// # Panics
/// When the capture cannot be read.
#[must_use]
pub fn of(path: &Path, config: &Config) -> Vec<Arrival> {
    let (mut lidar, mut ins) = (Line::new(config.scanner.baud), Line::new(config.ins.baud));
    let mut arrivals = Vec::new();
    for chunk in capture::Reader::open(path).expect("a capture").map(|chunk| chunk.expect("whole")) {
        let (channel, chunk_ns) = (chunk.channel, chunk.device_time_ns);
        match channel {
            Channel::Pps => arrivals.push(Arrival { at_ns: chunk_ns, channel, byte: b'p' }),
            _ => arrivals.extend(chunk.data.iter().map(|&byte| {
                let line = if channel == Channel::Lidar { &mut lidar } else { &mut ins };
                Arrival { at_ns: line.take(chunk_ns), channel, byte }
            })),
        }
    }
    arrivals.sort_by_key(|arrival| (arrival.at_ns, arrival.channel != Channel::Pps));
    arrivals
}
