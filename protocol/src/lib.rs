//! What goes over the wire between a crossfall board and its host.
//!
//! [`message`] has what is said, [`config`] what a user may set, [`frame`] how it becomes bytes and is found again in
//! a damaged stream, [`ranges`] the lossless code of a scan's ranges, [`schema`] the hash by which both ends know that
//! they speak of the same. `SPEC.md` beside this crate has the byte tables.
#![no_std]
#![forbid(unsafe_code)]

pub mod config;
pub mod frame;
pub mod message;
pub mod ranges;
mod scan_wire;
pub mod schema;
pub mod units;

pub use config::Config;
pub use message::{Command, Message};
pub use units::{Angle, DeviceTime};
