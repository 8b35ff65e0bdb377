//! Installing what a bare machine lacks, and saying what was done. Nothing is skipped in silence: what cannot be had is an error, or, where tests can do
//! without, told at the end of a run.

use crate::shell::{self, Tally};

/// The board's compilation target.
const TARGET: &str = "thumbv7em-none-eabihf";

/// The ARM target, QEMU 9 or newer, chromium, cargo-deny, and where there is a Python the programs that open what is handed in, Spark among them.
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

/// What tests say that they skip for want of: a test that skips passes, and the test runner does not show what it says.
pub fn missing() -> Vec<String> {
    let mut missing = Vec::new();
    if std::env::var_os("CROSSFALL_RECORDINGS").is_none() {
        missing.push("CROSSFALL_RECORDINGS: no real recording is read".to_owned());
    }
    if !["chromium", "chromium-browser", "google-chrome"]
        .iter()
        .any(|name| shell::succeeds(&format!("{name} --version")))
    {
        missing.push("a chromium: the live page is not opened".to_owned());
    }
    match shell::output("sh tests/scripts/install-python-tools.sh missing") {
        Some(said) => missing.extend(said.lines().map(str::to_owned)),
        None => missing.push("a shell: what else is not there is not known".to_owned()),
    }
    missing
}
