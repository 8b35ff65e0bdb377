//! What a board gives the tasks: lines whose bytes are stamped on arrival, and the pulse per second.

use core::future::Future;

use crossfall_protocol::DeviceTime;
use embedded_io_async::{Read, Write};

/// A line whose bytes carry the time of their arrival. A read may be dropped while it waits, and has then taken nothing; it should let
/// bytes gather for a millisecond or so, as a wake-up for each would cost more than all else.
pub trait StampedRead: Read {
    /// Arrival of byte `k` of what the latest read returned.
    fn arrival(&self, k: usize) -> DeviceTime;

    /// Bytes lost since boot before they could be read: receiver overruns and bytes without room.
    fn lost(&self) -> u32;
}

/// A sensor's line: bytes in both directions, at a rate that the bring-up changes.
pub trait SensorLine: StampedRead + Write {
    /// Changes the rate of the line once everything written has left it.
    fn set_baud(&mut self, baud: u32) -> impl Future<Output = ()>;
}

/// The pulse per second.
pub trait PulseInput {
    /// Waits for the next edge and returns its instant.
    fn edge(&mut self) -> impl Future<Output = DeviceTime>;

    /// Edges lost since boot because another came before they could be read.
    fn overruns(&self) -> u32;
}
