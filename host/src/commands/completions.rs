//! `crossfall completions`: a script that completes commands and options in a shell.

use clap::CommandFactory;
use clap_complete::Shell;

use super::{Cli, Outcome, say};

/// Print a completion script for a shell
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  crossfall completions bash \\
      > ~/.local/share/bash-completion/completions/crossfall
  crossfall completions fish > ~/.config/fish/completions/crossfall.fish")]
pub struct Args {
    /// The shell
    shell: Shell,
}

pub fn run(args: &Args) -> anyhow::Result<Outcome> {
    let mut script = Vec::new();
    clap_complete::generate(args.shell, &mut Cli::command(), "crossfall", &mut script);
    say(String::from_utf8_lossy(&script).trim_end())?;
    Ok(Outcome::Done)
}
