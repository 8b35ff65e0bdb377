//! The crossfall host: logs, verification, profiles, maps.
#![forbid(unsafe_code)]

pub mod capture;
pub mod container;
pub mod interrupt;
pub mod log;
pub mod output;
