//! The crossfall host: logs, verification, profiles, maps.
#![forbid(unsafe_code)]

pub mod accuracy;
pub mod calibrate;
pub mod capture;
pub mod config;
pub mod container;
pub mod dataset;
pub mod geodesy;
pub mod import;
pub mod info;
pub mod interrupt;
pub mod intervals;
pub mod log;
pub mod output;
pub mod plot;
pub mod profiles;
pub mod record;
pub mod run;
pub mod section;
pub mod simulate;
pub mod stream;
pub mod table;
pub mod terrain;
pub mod toml_file;
pub mod track;
pub mod verify;
pub mod walk;
