//! SICK LMS 2xx laser scanners (200, 211, 221, 291): telegrams in, scans and replies out; commands and bring-up.
//!
//! Source: SICK, *Telegrams for operating/configuring the LMS 2xx*, 8007954/Q501 (the telegram listing, TL), checked
//! against recorded streams. What is an inference from recordings says so where it stands.

pub mod bring_up;
pub mod command;
mod decoder;
pub mod range;
mod reply;
mod telegram;

pub use decoder::{Decoder, Event};
pub use reply::{Configuration, ModeChange, Reply, Report, Severity, Status};
pub use telegram::{LONGEST, crc};
