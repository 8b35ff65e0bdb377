//! The board's image, built by cargo in the board's own workspace.

use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::OnceLock;

/// Which of the board's images.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Image {
    /// The instrument: what a user flashes.
    Board,
    /// The bench that counts instructions.
    Bench,
}

const BOARD: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../firmware/boards/olimex-stm32-h405");

/// Path of an image, built first when it is not up to date; once a process.
///
/// # Panics
/// When it does not build: there is nothing to test then.
pub fn image(which: Image) -> PathBuf {
    static BUILT: OnceLock<PathBuf> = OnceLock::new();
    let folder = BUILT.get_or_init(build);
    folder.join(match which {
        Image::Board => "crossfall-board",
        Image::Bench => "crossfall-bench",
    })
}

fn build() -> PathBuf {
    let target = std::env::var_os("CARGO_TARGET_DIR").map_or_else(|| Path::new(BOARD).join("target"), PathBuf::from);
    let mut cargo = Command::new(std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into()));
    cargo.current_dir(BOARD).args(["build", "--release", "--locked", "--bins", "--target-dir"]).arg(&target);
    // The caller's flags are for the host.
    for name in ["RUSTFLAGS", "CARGO_ENCODED_RUSTFLAGS", "CARGO_BUILD_TARGET"] {
        cargo.env_remove(name);
    }
    let status = cargo.status().expect("cargo starts");
    assert!(status.success(), "the board's images do not build: {status}");
    target.join("thumbv7em-none-eabihf/release")
}
