//! The crossfall host: logs, verification, profiles, maps.
#![forbid(unsafe_code)]

pub mod terrain;
