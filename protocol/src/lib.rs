//! What goes over the wire between a crossfall board and its host.
#![no_std]
#![forbid(unsafe_code)]

pub mod config;
pub mod message;
pub mod units;

pub use config::Config;
pub use message::{Command, Message};
pub use units::{Angle, DeviceTime};
