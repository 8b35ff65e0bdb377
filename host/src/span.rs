//! How long a drive took by the board's clock, which begins again with every boot.

use crossfall_core::protocol::DeviceTime;
use crossfall_core::protocol::message::{Message, Pose};

/// Device time from the first to the last scan or pose, over all boots.
#[derive(Debug, Default)]
pub struct Span {
    /// Of the boot under way.
    now: Option<(DeviceTime, DeviceTime)>,
    earlier_us: u64,
}

impl Span {
    /// The board has booted: its time begins again.
    pub fn restart(&mut self) {
        self.earlier_us += self.now.take().map_or(0, |(first, last)| last.0 - first.0);
    }

    /// Takes a scan or a pose in; other messages have no part in it.
    pub fn see(&mut self, message: &Message<'_>) {
        let time = match message {
            Message::Scan(scan) => scan.stx,
            Message::Pose(pose) => arrival(pose),
            _ => return,
        };
        let (first, last) = self.now.unwrap_or((time, time));
        self.now = Some((first.min(time), last.max(time)));
    }

    /// So many seconds.
    pub fn seconds(&self) -> f64 {
        let now = self.now.map_or(0, |(first, last)| last.0 - first.0);
        (self.earlier_us + now) as f64 * 1e-6
    }
}

/// When a pose arrived: poses of two logs may be valid at one instant, and the mapping may move by its own correction.
pub fn arrival(pose: &Pose) -> DeviceTime {
    pose.time.offset(pose.latency_us.into())
}
