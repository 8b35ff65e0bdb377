//! The crossfall host: logs, verification, profiles, maps.
#![forbid(unsafe_code)]

pub mod accuracy;
pub mod calibrate;
pub mod capture;
pub mod compare;
pub mod config;
pub mod container;
pub mod emulated;
pub mod import;
pub mod info;
pub mod interrupt;
pub mod log;
pub mod output;
pub mod plot;
pub mod profiles;
pub mod record;
pub mod replay;
pub mod reproduce;
pub mod run;
pub mod section;
pub mod simulate;
pub mod stream;
pub mod terrain;
pub mod toml_file;
pub mod track;
pub mod verify;
pub mod words;
