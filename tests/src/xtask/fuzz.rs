//! `cargo xtask fuzz`: libFuzzer over the targets of `tests/fuzz`, beginning with inputs from a simulated drive.
//!
//! It needs a nightly compiler and cargo-fuzz, which are installed when they are missing. What libFuzzer finds new is kept in
//! `tests/fuzz/corpus`, what breaks a target in `tests/fuzz/artifacts`, with the command that repeats it.

use std::fs;

use crossfall_tests::fuzzing::{TARGETS, corpus};

use crate::shell::{self, Tally};
use crate::steps::LONG;

/// Seconds of each target.
pub const SECONDS: u64 = 60;

/// Where the fuzz workspace is.
const FOLDER: &str = "tests/fuzz";

/// Longest input, in bytes: the whole corpus fits, and a thousand a second are tried.
const LONGEST: u32 = 16_384;

/// The step of `cargo xtask test`, only with `--long`.
pub fn step(_: &mut Tally) -> Result<(), String> {
    if !shell::is_set_for_children(LONG) {
        eprintln!("  without --long it is left out; the targets ran over seeded mutations in `unit`");
        return Ok(());
    }
    run(SECONDS, &[])
}

/// Fuzzes the targets named, or all.
pub fn run(seconds: u64, wanted: &[&str]) -> Result<(), String> {
    if let Some(unknown) = wanted.iter().find(|word| TARGETS.iter().all(|(name, _)| name != *word)) {
        let names: Vec<_> = TARGETS.iter().map(|(name, _)| *name).collect();
        return Err(format!("no target `{unknown}`; there are {}", names.join(", ")));
    }
    let mut tally = Tally::default();
    install(&mut tally)?;
    let scratch = std::env::temp_dir().join(format!("crossfall-corpus-{}", std::process::id()));
    let made = seed(&scratch);
    let _ = fs::remove_dir_all(&scratch);
    made?;
    let mut failed = Vec::new();
    for (name, _) in TARGETS.iter().filter(|(name, _)| wanted.is_empty() || wanted.contains(name)) {
        // Debug assertions on: overflow is a defect. No sanitiser: there is no unsafe code to catch.
        let line = format!(
            "cargo +nightly fuzz run --fuzz-dir . -s none -O -a {name} -- -max_total_time={seconds} -max_len={LONGEST} \
             -rss_limit_mb=1024 -timeout=20 -print_final_stats=1"
        );
        if let Err(problem) = shell::run(&line, FOLDER, &mut tally) {
            failed.push(format!("{name}: {problem}"));
        }
    }
    if failed.is_empty() { Ok(()) } else { Err(failed.join("\n")) }
}

fn install(tally: &mut Tally) -> Result<(), String> {
    if !shell::succeeds("cargo +nightly --version") {
        shell::run("rustup toolchain install nightly --profile minimal", "", tally)?;
    }
    if !shell::succeeds("cargo fuzz --version") {
        eprintln!("  cargo-fuzz is missing: building it (a few minutes, once)");
        shell::run("cargo install --locked cargo-fuzz", "", tally)?;
    }
    Ok(())
}

/// Writes the corpus; what earlier runs have found stays beside it.
fn seed(scratch: &std::path::Path) -> Result<(), String> {
    let wrap = |error: std::io::Error| error.to_string();
    fs::create_dir_all(scratch).map_err(wrap)?;
    for (name, inputs) in corpus::make(scratch) {
        let folder = shell::root().join(FOLDER).join("corpus").join(name);
        fs::create_dir_all(&folder).map_err(wrap)?;
        for (number, input) in inputs.iter().enumerate() {
            fs::write(folder.join(format!("seed-{number:02}")), input).map_err(wrap)?;
        }
    }
    Ok(())
}
