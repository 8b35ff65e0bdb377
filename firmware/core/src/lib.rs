//! The crossfall instrument as pure state machines: no I/O, no clock of its own, no heap.
#![no_std]
#![forbid(unsafe_code)]

pub mod attitude;
pub mod clock;
pub mod instrument;
pub mod profile;
pub mod scan;
pub mod sensors;
pub mod trig;

pub use crossfall_protocol as protocol;
