//! `cargo xtask`: everything that is more than one cargo command.
//!
//! | command | does |
//! |---|---|
//! | `test` | installs what is missing, then format, lints, licences, every test, the board image and the emulated board |
//! | `setup` | only installs what is missing |
//! | `fuzz` | runs libFuzzer over every target, or those named |
//! | `soak --hours N` | drives for days of simulated time into a rotating log, and verifies it |
//! | `list` | names the steps of `test` |
//! | `soak` | ten minutes of drive through the emulated board |
//! | `size` | what the image takes of the board's memory |
#![forbid(unsafe_code)]

mod fuzz;
mod setup;
mod shell;
mod size;
mod soak_board;
mod soak_log;
mod steps;

use std::process::ExitCode;

const HELP: &str = "\
cargo xtask COMMAND

  test [--long] [STEP...]
                   install what is missing, then run every check (or only the steps named);
                   --long adds what takes long or wants the machine for itself
  setup            install what is missing: ARM target, emulator, browser, cargo-deny, Python tools, Spark
  fuzz [--seconds N] [TARGET...]
                   run libFuzzer over every target, N seconds each (60 unless told)
  soak --hours N   drive so long in simulated time into a rotating log, and verify all of it
  list             name the steps of `test`
  soak [SECONDS]   ten minutes of drive through the emulated board: nothing lost, nothing grown
  size             what the board's image takes of its memory, and its budget

Examples:
  cargo xtask test
  cargo xtask test lint unit
";

fn main() -> ExitCode {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let words: Vec<&str> = arguments.iter().map(String::as_str).collect();
    match words.as_slice() {
        ["test", "--long", wanted @ ..] => {
            shell::set_for_children(steps::LONG);
            steps::run(wanted)
        }
        ["test", wanted @ ..] => steps::run(wanted),
        ["setup"] => steps::run(&["setup"]),
        ["fuzz", "--seconds", seconds, wanted @ ..] => counted(seconds, |seconds| fuzz::run(seconds, wanted)),
        ["fuzz", wanted @ ..] => done(fuzz::run(fuzz::SECONDS, wanted)),
        ["soak", "--hours", hours] => counted(hours, soak_log::run),
        ["list"] => steps::list(),
        ["soak"] => soak_board::run(None),
        ["soak", seconds] => soak_board::run(Some(seconds)),
        ["size"] => size::run(),
        [] | ["help" | "--help" | "-h"] => {
            print!("{HELP}");
            ExitCode::SUCCESS
        }
        _ => {
            eprint!("xtask: unknown command: {}\n\n{HELP}", words.join(" "));
            ExitCode::from(2)
        }
    }
}

fn counted(number: &str, run: impl FnOnce(u64) -> Result<(), String>) -> ExitCode {
    match number.parse() {
        Ok(number) if number > 0 => done(run(number)),
        _ => {
            eprintln!("xtask: `{number}` is no whole number above 0");
            ExitCode::from(2)
        }
    }
}

fn done(outcome: Result<(), String>) -> ExitCode {
    match outcome {
        Ok(()) => ExitCode::SUCCESS,
        Err(problem) => {
            eprintln!("xtask: {problem}");
            ExitCode::FAILURE
        }
    }
}
