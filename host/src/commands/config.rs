//! `crossfall config`: the configuration, with comments.
//!
//! Without a file it prints the defaults. With one it checks the file and prints the whole configuration that the file
//! stands for.

use std::path::PathBuf;

use super::{Outcome, say};

/// Print the defaults, or check a configuration
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  crossfall config > my.toml
  crossfall config my.toml")]
pub struct Args {
    /// A configuration to check and complete (TOML)
    file: Option<PathBuf>,
}

pub fn run(args: &Args) -> anyhow::Result<Outcome> {
    let config = super::configuration(args.file.as_deref())?;
    say(crossfall::config::to_toml(&config).trim_end())?;
    Ok(Outcome::Done)
}
