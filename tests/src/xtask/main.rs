//! `cargo xtask`: everything that is more than one cargo command.
//!
//! | command | does |
//! |---|---|
//! | `test` | installs what is missing, then format, lints, licences, every test, the board image and the emulated board |
//! | `setup` | only installs what is missing |
//! | `list` | names the steps of `test` |
#![forbid(unsafe_code)]

mod setup;
mod shell;
mod steps;

use std::process::ExitCode;

const HELP: &str = "\
cargo xtask COMMAND

  test [--long] [STEP...]
                   install what is missing, then run every check (or only the steps named);
                   --long adds what takes long or wants the machine for itself
  setup            install what is missing: ARM target, emulator, browser, cargo-deny
  list             name the steps of `test`

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
        ["list"] => steps::list(),
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
