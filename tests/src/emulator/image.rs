//! The board's image, built by cargo in the board's own workspace.

use std::path::{Path, PathBuf};
use std::process::Command;

/// Which of the board's images.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Image {
    /// The instrument: what a user flashes.
    Board,
    /// The bench that counts instructions.
    Bench,
    /// The one that links only when nothing can panic of what a board runs.
    Proof,
    /// The same of the map of elevation and risk.
    ProofOfMap,
}

const BOARD: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../firmware/boards/olimex-stm32-h405");

impl Image {
    const fn name(self) -> &'static str {
        match self {
            Self::Board => "crossfall-board",
            Self::Bench => "crossfall-bench",
            Self::Proof => "crossfall-proof",
            Self::ProofOfMap => "crossfall-proof-map",
        }
    }

    /// Features that it needs.
    const fn features(self) -> &'static str {
        match self {
            Self::Board => "",
            Self::Bench => "bench",
            Self::Proof | Self::ProofOfMap => "proof",
        }
    }
}

/// Path of an image, built first when it is not up to date.
///
/// # Panics
/// When it does not build: there is nothing to test then.
#[must_use]
pub fn image(which: Image) -> PathBuf {
    let target = std::env::var_os("CARGO_TARGET_DIR").map_or_else(|| Path::new(BOARD).join("target"), PathBuf::from);
    let mut cargo = Command::new(std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into()));
    cargo.current_dir(BOARD).args(["build", "--release", "--locked", "--quiet", "--bin", which.name()]);
    cargo.args(["--features", which.features(), "--target-dir"]).arg(&target);
    // The caller's flags are for the host.
    for name in ["RUSTFLAGS", "CARGO_ENCODED_RUSTFLAGS", "CARGO_BUILD_TARGET"] {
        cargo.env_remove(name);
    }
    let status = cargo.status().expect("cargo starts");
    assert!(status.success(), "{} does not build: {status}", which.name());
    target.join("thumbv7em-none-eabihf/release").join(which.name())
}
