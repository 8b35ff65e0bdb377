//! The board in QEMU, over an image that cargo builds here when it is not up to date.

mod image;
mod size;

pub use crossfall::emulated::{
    Collector, Emulator, Failure, Monitor, Options, Played, SensorEnd, Step, at_line_rates, every_second,
    half_the_scans,
};
pub use image::{Image, image};
pub use size::{Size, ram_used, size};
