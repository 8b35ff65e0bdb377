//! The board in QEMU, over an image that cargo builds here when it is not up to date.

mod image;
mod size;

pub use crossfall::emulated::{
    Collector, Emulator, Failure, Monitor, Options, Played, SensorEnd, Step, at_line_rates, every_second,
    half_the_scans,
};
use crossfall_core::protocol::DeviceTime;
use crossfall_core::protocol::message::{Level, Message};
pub use image::{Image, image};
pub use size::{Size, ram_used, size};

/// What the board has told in words, and when.
#[must_use]
pub fn told(board: &Emulator) -> Vec<(DeviceTime, String)> {
    board.link.collect(|message| match message {
        Message::Log(line) if line.level != Level::Defmt => {
            Some((line.time, String::from_utf8_lossy(line.text).into_owned()))
        }
        _ => None,
    })
}
