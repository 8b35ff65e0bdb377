//! Installing what a bare machine lacks, and saying what was done. Nothing is skipped in silence: what cannot be had is an error.

use crate::shell::{self, Tally};

/// The board's compilation target.
const TARGET: &str = "thumbv7em-none-eabihf";

/// The ARM target, QEMU 9 or newer, chromium, cargo-deny, and where there is a Python the programs that open what is handed in.
pub fn install(tally: &mut Tally) -> Result<(), String> {
    let targets = shell::output("rustup target list --installed").unwrap_or_default();
    if !targets.lines().any(|line| line.trim() == TARGET) {
        shell::run(&format!("rustup target add {TARGET}"), "", tally)?;
    }
    shell::run("sh tests/scripts/install-emulator.sh", "", tally)?;
    shell::run("sh tests/scripts/install-browser.sh", "", tally)?;
    if !shell::succeeds("cargo deny --version") {
        eprintln!("  cargo-deny is missing: building it (a few minutes, once)");
        shell::run("cargo install --locked cargo-deny", "", tally)?;
    }
    shell::run("sh tests/scripts/install-python-tools.sh", "", tally)
}
