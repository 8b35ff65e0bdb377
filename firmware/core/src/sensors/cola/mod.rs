//! SICK LMS 1xx and LMS 5xx laser scanners in CoLa B, the binary form of their command language: scan telegrams in, scans out.
//!
//! Source: SICK, *Telegrams for configuring and operating the LMS1xx, LMS5xx, TiM2xx, TiM5xx, TiM7xx, LMS1000, MRS1000 ...*, 8014631 (the telegram
//! listing, `LMDscandata`). No recording was at hand: tests rest on the listing's layout and on simulated bytes. What is an inference says so where it
//! stands.
//!
//! These scanners measure a scan in one turn of the mirror and tell in each telegram when it was measured and when it was sent, on a clock of their own.

mod decoder;
mod telegram;

pub use decoder::{Decoder, Event, INDEX_CDEG};
pub use telegram::{LONGEST, checksum};
