//! `crossfall` as a user starts it, for tests that look at what it says and how it ends.

use std::path::Path;
use std::process::{Command, Output, Stdio};

/// `crossfall` with arguments in a folder: nothing to read, all that it says kept, and help as wide as it is by default.
pub fn crossfall(folder: &Path, arguments: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_crossfall"));
    command.args(arguments).current_dir(folder).env_remove("COLUMNS");
    command.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped());
    command
}

/// What it said on stdout and stderr, after checking its status.
#[allow(dead_code, reason = "some tests look at other things")]
pub fn ended(output: &Output, code: i32) -> (String, String) {
    let (out, err) = (String::from_utf8_lossy(&output.stdout), String::from_utf8_lossy(&output.stderr));
    assert_eq!(output.status.code(), Some(code), "stdout: {out}\nstderr: {err}");
    (out.into_owned(), err.into_owned())
}

/// Runs it, and [`ended`].
#[allow(dead_code, reason = "some tests look at other things")]
pub fn ends(folder: &Path, arguments: &[&str], code: i32) -> (String, String) {
    ended(&crossfall(folder, arguments).output().expect("the binary runs"), code)
}
