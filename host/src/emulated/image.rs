//! What the emulated board needs and a machine may lack: QEMU with this board, and the board's image. Each is looked for, and where it is
//! missing one line says how to get it.

use std::env;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use super::board::QEMU;

/// QEMU's name for the board.
const MACHINE: &str = "olimex-stm32-h405";

/// The board's folder below the repository.
const FOLDER: &str = "firmware/boards/olimex-stm32-h405";

/// Where cargo puts the image, below its target folder.
const BUILT: &str = "thumbv7em-none-eabihf/release/crossfall-board";

/// What is missing, and what to do about it.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum Missing {
    /// QEMU itself.
    #[error(
        "{QEMU} is not installed: `apt install qemu-system-arm` (on Debian 12: `sh tests/scripts/install-emulator.sh`)"
    )]
    Qemu,
    /// The board in it.
    #[error(
        "this {QEMU} has no machine {MACHINE}: version 9 or newer is needed (on Debian 12: `sh tests/scripts/install-emulator.sh`)"
    )]
    Machine,
    /// The image.
    #[error(
        "no image of the board found: run `rustup target add thumbv7em-none-eabihf` once and `cargo build --release` in {FOLDER}, or name an image with --image"
    )]
    Image,
    /// The image that was named.
    #[error("{0}: no such file; `cargo build --release` in {FOLDER} builds the image")]
    Named(String),
}

/// Checks that QEMU is installed and knows the board.
///
/// # Errors
/// When it is not or does not.
pub fn require_qemu() -> Result<(), Missing> {
    let asked = Command::new(QEMU).args(["-M", "help"]).stdin(Stdio::null()).stderr(Stdio::null()).output();
    let machines = asked.map_err(|_| Missing::Qemu)?.stdout;
    let known = String::from_utf8_lossy(&machines).lines().any(|line| line.split(' ').next() == Some(MACHINE));
    if known { Ok(()) } else { Err(Missing::Machine) }
}

/// The board's image: the one named, or the one that cargo has built in the repository around the working folder or around
/// this program.
///
/// # Errors
/// When there is none.
pub fn find_image(named: Option<&Path>) -> Result<PathBuf, Missing> {
    if let Some(path) = named {
        return if path.is_file() { Ok(path.to_owned()) } else { Err(Missing::Named(path.display().to_string())) };
    }
    let target = env::var_os("CARGO_TARGET_DIR").map(|folder| Path::new(&folder).join(BUILT));
    let starts = [env::current_dir().ok(), env::current_exe().ok()];
    let around = starts.iter().flatten().flat_map(|start| start.ancestors());
    let built = around.map(|folder| folder.join(FOLDER).join("target").join(BUILT));
    target.into_iter().chain(built).find(|path| path.is_file()).ok_or(Missing::Image)
}
