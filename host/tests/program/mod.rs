//! `crossfall` as a user starts it, for tests that look at what it says and how it ends.

use std::path::Path;
use std::process::{Command, Stdio};

/// `crossfall` with arguments in a folder: nothing to read, all that it says kept, and help as wide as it is by default.
pub fn crossfall(folder: &Path, arguments: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_crossfall"));
    command.args(arguments).current_dir(folder).env_remove("COLUMNS");
    command.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped());
    command
}
