//! Running commands: shown before they run, their test results counted, their failure an error.

use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::sync::OnceLock;
use std::thread;

/// Tests counted over all commands of a run.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Tally {
    /// Tests that passed.
    pub passed: u64,
    /// Tests that failed.
    pub failed: u64,
}

static CHILD_VARIABLE: OnceLock<&str> = OnceLock::new();

/// Sets a variable to 1 for every command run from now on.
pub fn set_for_children(variable: &'static str) {
    CHILD_VARIABLE.get_or_init(|| variable);
}

/// Whether it is.
pub fn is_set_for_children(variable: &str) -> bool {
    CHILD_VARIABLE.get().is_some_and(|set| *set == variable) || std::env::var_os(variable).is_some()
}

/// The root of the workspace: the parent of this crate's folder.
pub fn root() -> PathBuf {
    let here = Path::new(env!("CARGO_MANIFEST_DIR"));
    here.parent().unwrap_or(here).to_path_buf()
}

/// A command to be run in a folder below the root.
pub fn command(line: &str, folder: &str) -> Command {
    let mut words = line.split_whitespace();
    let mut command = Command::new(words.next().unwrap_or_default());
    command.args(words).current_dir(root().join(folder));
    if let Some(variable) = CHILD_VARIABLE.get() {
        command.env(variable, "1");
    }
    command
}

/// Runs a command line in a folder below the root, passing its output on and adding up what its test runners report.
pub fn run(line: &str, folder: &str, tally: &mut Tally) -> Result<(), String> {
    eprintln!("  $ {line}{}", if folder.is_empty() { String::new() } else { format!("   (in {folder})") });
    let started = command(line, folder).stdin(Stdio::null()).stdout(Stdio::piped()).spawn();
    let mut child = started.map_err(|error| format!("`{line}` did not start: {error}"))?;
    let output = child.stdout.take().ok_or("no pipe")?;
    let reader = thread::spawn(move || {
        let mut found = Tally::default();
        for text in BufReader::new(output).lines().map_while(Result::ok) {
            println!("{text}");
            let (passed, failed) = test_result(&text);
            found.passed += passed;
            found.failed += failed;
        }
        found
    });
    let status = child.wait().map_err(|error| format!("`{line}`: {error}"))?;
    let found = reader.join().map_err(|_| format!("`{line}`: its output could not be read"))?;
    tally.passed += found.passed;
    tally.failed += found.failed;
    if status.success() { Ok(()) } else { Err(format!("`{line}` failed: {status}")) }
}

/// Whether a command can be run and succeeds, its output kept quiet.
pub fn succeeds(line: &str) -> bool {
    command(line, "")
        .stdin(Stdio::null())
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .status()
        .is_ok_and(|s| s.success())
}

/// What a command prints.
pub fn output(line: &str) -> Option<String> {
    let output = command(line, "").stdin(Stdio::null()).stderr(Stdio::null()).output().ok()?;
    output.status.success().then(|| String::from_utf8_lossy(&output.stdout).into_owned())
}

/// Passed and failed in a line such as `test result: ok. 12 passed; 0 failed; ...`.
fn test_result(line: &str) -> (u64, u64) {
    let Some(rest) = line.trim_start().strip_prefix("test result:") else { return (0, 0) };
    let before = |word: &str| {
        let end = rest.find(word)?;
        rest[..end].trim_end().rsplit([' ', ';']).next()?.parse().ok()
    };
    (before("passed").unwrap_or(0), before("failed").unwrap_or(0))
}

#[cfg(test)]
mod tests {
    use super::test_result;

    #[test]
    fn counts_what_the_test_runner_reports() {
        assert_eq!(test_result("test result: ok. 12 passed; 0 failed; 0 ignored; 0 measured; 0 filtered out"), (12, 0));
        assert_eq!(test_result("test result: FAILED. 3 passed; 2 failed; 0 ignored"), (3, 2));
        assert_eq!(test_result("running 12 tests"), (0, 0));
    }
}
