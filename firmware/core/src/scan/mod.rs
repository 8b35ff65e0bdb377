//! Scans: when each beam was measured, at which roll, and where its point lies.

mod level;
mod raw;
pub mod resample;
mod roll_track;
mod sweep;

pub use level::{Echo, Point, Points, for_each_return, level};
pub use raw::{MAX_BEAMS, ONE_TURN, PERIODS_US, RawScan, TURN_US};
pub use resample::resample;
pub use roll_track::{KNOTS, MAX_TURNS, RollTrack};
