//! The named steps of `cargo xtask test`, in the order in which they run.

use std::process::ExitCode;
use std::time::Instant;

use crate::shell::{self, Tally};
use crate::{fuzz, setup, size};

type Step = (&'static str, &'static str, fn(&mut Tally) -> Result<(), String>);

/// Set for tests that take long, or the whole machine.
pub const LONG: &str = "CROSSFALL_LONG";

const STEPS: &[Step] = &[
    ("setup", "install what is missing", setup::install),
    ("format", "every file as rustfmt leaves it", |tally| shell::run("cargo fmt --all --check", "", tally)),
    ("lint", "clippy without a warning", lint),
    ("licences", "licences, bans and sources of every dependency", licences),
    ("size", "the board's image within its budget", |_| size::check()),
    ("unit", "every test of the workspace, recordings and emulated board included", unit),
    ("fuzz", "with --long: libFuzzer over every target, a minute each", fuzz::step),
];

fn lint(tally: &mut Tally) -> Result<(), String> {
    shell::run("cargo clippy --workspace --all-targets --quiet -- -D warnings", "", tally)
}

/// The advisory list needs a network beyond the package registry, so it has a command of its own: `cargo deny check advisories`.
fn licences(tally: &mut Tally) -> Result<(), String> {
    shell::run("cargo deny --log-level error check licenses bans sources", "", tally)
}

fn unit(tally: &mut Tally) -> Result<(), String> {
    let outcome = shell::run("cargo test --workspace --no-fail-fast", "", tally);
    // After the tests, where it is still to be seen.
    for what in setup::missing() {
        eprintln!("  NOT TESTED for want of {what}");
    }
    if !shell::is_set_for_children(LONG) {
        eprintln!("  NOT TESTED without --long: what takes minutes");
    }
    outcome
}

/// Names the steps.
pub fn list() -> ExitCode {
    for (name, what, _) in STEPS {
        println!("{name:10} {what}");
    }
    ExitCode::SUCCESS
}

/// Runs the steps named, or all. Every step runs even after one has failed, so that one run tells everything.
pub fn run(wanted: &[&str]) -> ExitCode {
    if let Some(unknown) = wanted.iter().find(|word| STEPS.iter().all(|(name, ..)| name != *word)) {
        eprintln!("xtask: no step named {unknown}; `cargo xtask list` names them");
        return ExitCode::from(2);
    }
    let mut tally = Tally::default();
    let mut problems = Vec::new();
    for (name, what, step) in STEPS.iter().filter(|(name, ..)| wanted.is_empty() || wanted.contains(name)) {
        eprintln!("\n== {name}: {what}");
        let start = Instant::now();
        let outcome = step(&mut tally);
        let seconds = start.elapsed().as_secs_f32();
        match outcome {
            Ok(()) => eprintln!("== {name}: good, {seconds:.0} s"),
            Err(problem) => {
                eprintln!("== {name}: FAILED, {seconds:.0} s: {problem}");
                problems.push(format!("{name}: {problem}"));
            }
        }
    }
    eprintln!();
    for problem in &problems {
        eprintln!("xtask: {problem}");
    }
    // A step that fails without a failing test (a lint, a licence) counts as one failure.
    let failed = tally.failed.max(problems.len() as u64);
    println!("{} passed, {failed} failed", tally.passed);
    if failed == 0 { ExitCode::SUCCESS } else { ExitCode::FAILURE }
}
