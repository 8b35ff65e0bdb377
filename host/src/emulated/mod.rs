//! The instrument without its hardware: a scanner that answers, and the board in QEMU.
//!
//! The image is the one that a user flashes. QEMU listens nowhere: it connects to ports of the loopback interface that are opened for it,
//! and it is ended with the [`Emulator`] that started it, also when this program is killed.

mod bench;
mod board;
mod collector;
mod drive;
mod image;
mod monitor;
pub mod scanner;
mod survey;

pub use bench::Bench;
pub use board::{Emulator, Failure, Options, SensorEnd};
pub use collector::Collector;
pub use drive::{Act, Played, Step, every_second};
pub use image::{Missing, find_image, require_qemu};
pub use monitor::Monitor;
pub use survey::{Error, Surveyed, at_line_rates, half_the_scans, survey};
