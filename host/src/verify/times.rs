//! Time must go forward, each kind of it by itself, and the device clock must run at a believable rate.

use crossfall_core::protocol::DeviceTime;
use crossfall_core::protocol::message::Message;

use crate::span::{Span, arrival};

use crate::units::drift_ppm;

/// A crystal is good to 100 ppm over temperature; beyond this it is no crystal, or no second.
const MAX_DRIFT_PPM: f64 = 500.0;

/// Kinds of time in a stream. They advance one by one: a pose is valid before the scan whose frame came first.
#[derive(Clone, Copy)]
enum Kind {
    Scan,
    Pose,
    Pulse,
    Status,
    Profile,
}

/// The latest time of each kind.
#[derive(Debug, Default)]
pub struct Times {
    receive_ns: u64,
    latest: [Option<DeviceTime>; 5],
    span: Span,
}

impl Times {
    /// The board has booted: its time begins again.
    pub fn restart(&mut self) {
        self.latest = [None; 5];
        self.span.restart();
    }

    /// Seconds of device time over all boots.
    pub fn seconds(&self) -> f64 {
        self.span.seconds()
    }

    /// Checks one message and its receive time.
    pub fn check(&mut self, receive_ns: u64, message: &Message<'_>, problems: &mut Vec<String>) {
        if receive_ns < self.receive_ns {
            let back_ms = (self.receive_ns - receive_ns) as f64 * 1e-6;
            problems.push(format!("receive time goes back by {back_ms:.3} ms"));
        }
        self.receive_ns = receive_ns;
        self.span.see(message);
        match message {
            Message::Scan(scan) => self.advance(Kind::Scan, "scan", scan.stx, problems),
            Message::Pose(pose) => self.advance(Kind::Pose, "pose", arrival(pose), problems),
            Message::Pulse(pulse) => self.advance(Kind::Pulse, "pulse", pulse.time, problems),
            Message::Status(status) => self.advance(Kind::Status, "status", status.time, problems),
            Message::Profile(profile) => self.advance(Kind::Profile, "profile", profile.time, problems),
            Message::Clock(clock) => {
                let ppm = drift_ppm(clock);
                if ppm.abs() > MAX_DRIFT_PPM {
                    problems.push(format!("implausible clock: {ppm:.0} ppm against GPS"));
                }
            }
            _ => {}
        }
    }

    fn advance(&mut self, kind: Kind, name: &str, time: DeviceTime, problems: &mut Vec<String>) {
        let latest = &mut self.latest[kind as usize];
        if let Some(before) = *latest
            && time < before
        {
            let back_ms = before.since(time) as f64 * 1e-3;
            problems.push(format!("time goes back by {back_ms:.3} ms from one {name} to the next"));
        }
        *latest = Some(time);
    }
}
