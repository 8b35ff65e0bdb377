//! The embassy tasks of a crossfall board, generic over its lines, lights and stamps.
//!
//! | task | priority | does |
//! |---|---|---|
//! | [`sensors::scanner`] | acquisition | brings the scanner up, decodes it |
//! | [`sensors::inertial`] | acquisition | brings the inertial unit up, decodes it |
//! | [`sensors::pulse`] | acquisition | takes the pulse per second |
//! | [`link::send`], [`link::receive`], [`link::profiles`], [`link::log`], [`link::time`] | acquisition | the link |
//! | [`lights::lights`] | acquisition | status lights |
//! | [`survey::survey`] | the lowest | scans and poses to profiles |
//!
//! All acquisition tasks run on one executor and share [`acquisition::Acquisition`] without a lock; the survey runs below
//! them, connected by two bounded queues. A board gives each task its peripheral (`line`) and a stack to run on; on a
//! desktop all of them run on one thread.
#![no_std]
#![forbid(unsafe_code)]

pub mod acquisition;
pub mod lights;
pub mod line;
pub mod link;
pub mod outbox;
pub mod sensors;
pub mod survey;
pub mod work;

use crossfall_protocol::DeviceTime;
use embassy_time::Instant;

/// Device time: embassy's clock counts it from boot, in microseconds.
#[must_use]
pub fn now() -> DeviceTime {
    DeviceTime(Instant::now().as_micros())
}
