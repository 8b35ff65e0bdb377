//! The crossfall host: logs, verification, profiles, maps.
#![forbid(unsafe_code)]

pub mod capture;
pub mod container;
pub mod interrupt;
pub mod log;
pub mod output;
pub mod profiles;
pub mod run;
pub mod stream;
pub mod track;
pub mod verify;
