//! The sensors' byte streams: bytes with their arrival times in, scans, poses and replies out.
//!
//! Both decoders are pure push parsers over one engine, `framing`: they hold no clock and no time-out, take one byte
//! at a time and account for every one of them. What comes out, and when each frame is said to have begun, depends on
//! the bytes and their arrivals alone, never on how they were chunked.

mod framing;
pub mod lms2xx;
pub mod novatel;
