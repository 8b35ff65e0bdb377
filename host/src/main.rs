//! The `crossfall` command.
//!
//! Data on stdout, progress and messages on stderr. This is the only place that makes exit codes: 0 done, 1 failed, 2 usage, 3 done but
//! data was lost or did not verify.
#![forbid(unsafe_code)]

mod commands;

use std::io::Write;
use std::process::ExitCode;

use clap::{CommandFactory, Parser};

use commands::{Cli, Outcome};

fn main() -> ExitCode {
    // A panic is a defect of this program; the user gets a line and not a trace. RUST_BACKTRACE brings the trace back.
    if std::env::var_os("RUST_BACKTRACE").is_none() {
        std::panic::set_hook(Box::new(|info| {
            if !crossfall::unwinding::is_contained() {
                complain(&format!("internal error, please report it: {info}"));
            }
        }));
    }
    // The first Ctrl-C asks every loop to stop and to leave no half-written file; the second one ends the process.
    let handler = ctrlc::set_handler(|| {
        if crossfall::interrupt::request() {
            std::process::exit(130);
        }
    });
    if let Err(error) = handler {
        complain(&format!("Ctrl-C will not be handled: {error}"));
    }
    let Some(command) = Cli::parse().command else {
        let printed = Cli::command().print_help();
        return if printed.is_ok() { ExitCode::SUCCESS } else { ExitCode::FAILURE };
    };
    match command.run() {
        Ok(Outcome::Done) => ExitCode::SUCCESS,
        Ok(Outcome::Lost) => ExitCode::from(3),
        Err(error) => match error.downcast_ref::<clap::Error>() {
            Some(usage) => {
                // A closed stderr changes nothing.
                let _ = usage.print();
                ExitCode::from(2)
            }
            None => {
                complain(&commands::visible(&line(&error)));
                ExitCode::FAILURE
            }
        },
    }
}

/// A stderr that is closed or full must not change how the program ends, which a panic of `eprintln!` would.
fn complain(what: &str) {
    let _ = writeln!(std::io::stderr(), "crossfall: {what}");
}

/// The error and its causes in one line; a cause that the error before it has told already is not told again.
fn line(error: &anyhow::Error) -> String {
    error.chain().map(ToString::to_string).fold(String::new(), |told, cause| match told.as_str() {
        "" => cause,
        before if before.ends_with(&cause) => told,
        before => format!("{before}: {cause}"),
    })
}
