//! Time: a free-running 32-bit counter made endless, and its mapping to GPS time.
//!
//! The core has no clock of its own: every instant is passed in as [`DeviceTime`].

mod counter;
mod gps;
mod gps_time;
mod pulses;

pub use counter::Counter;
pub use gps::GpsClock;
pub use gps_time::{GpsTime, WEEK_US};
pub use pulses::{MAX_DRIFT, PulseTrain, WINDOW};

/// One second, in the unit of [`DeviceTime`](crate::protocol::DeviceTime).
pub const SECOND_US: i64 = 1_000_000;
