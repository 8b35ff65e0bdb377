//! NovAtel SPAN receivers (OEM4 to OEM7): binary logs in, poses, raw inertial data, positions and times out.
//!
//! Source: NovAtel, *OEM7 Commands and Logs Reference Manual*, messages and log pages, checked against recorded streams.
//! Doubles become the project's integers by exact integer arithmetic, rounded once, to nearest; see [`Number`].

pub mod bring_up;
mod decoder;
mod frame;
mod ieee;
mod logs;

pub use decoder::Decoder;
pub use frame::{Header, LONGEST, LONGEST_BODY, crc32};
pub use ieee::Number;
pub use logs::{Event, InsSolution, InspvaxDetail, Log, Position, Quality, RawImu, TimeLog, id, state_name};
