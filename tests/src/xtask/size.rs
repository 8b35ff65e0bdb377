//! `cargo xtask size`: what the image takes of the board's memory, held against its budget. How much stack it uses is measured under load,
//! by the drive through the emulated board (`tests/tests/board_drive.rs`).

use std::process::ExitCode;

use crossfall_tests::emulator::{Image, Size, image, size};

/// The regions of the board's `memory.x`: an image beyond them does not link.
const FLASH: u32 = 128 * 1024;
const RAM: u32 = 64 * 1024;

/// Prints the sizes.
pub fn run() -> ExitCode {
    match check() {
        Ok(()) => ExitCode::SUCCESS,
        Err(problem) => {
            eprintln!("xtask: {problem}");
            ExitCode::FAILURE
        }
    }
}

/// Prints the sizes; an error when one is beyond its budget.
pub fn check() -> Result<(), String> {
    let Size { flash, ram } = size(&image(Image::Board))?;
    let mut over = Vec::new();
    for (what, used, budget) in [("flash", flash, FLASH), ("static RAM", ram, RAM)] {
        println!("  {what:12}{used:8} of {budget:7} bytes, {:5.1} %", 100.0 * f64::from(used) / f64::from(budget));
        if used > budget {
            over.push(format!("{what}: {used} bytes, {budget} are budgeted"));
        }
    }
    if over.is_empty() { Ok(()) } else { Err(over.join("; ")) }
}
