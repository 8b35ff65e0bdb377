//! Scans: when each beam was measured, at which roll, and where its point lies.

mod raw;
mod roll_track;

pub use raw::{MAX_BEAMS, RawScan, TURN_US};
pub use roll_track::{KNOTS, MAX_TURNS, RollTrack};
