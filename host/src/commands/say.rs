//! What a command says: data on stdout, which may be closed before all is said, and the rest on stderr.

use std::io::{self, Write};
use std::path::{Path, PathBuf};

use super::visible;

/// Prints data for people that a command does nothing but stream; an error as of [`has_read_enough`] tells it to stop.
pub fn print(text: &str) -> io::Result<()> {
    put(&visible(text))
}

/// The same of data for machines, a line each.
pub fn print_json_line(value: &impl serde::Serialize) -> anyhow::Result<()> {
    Ok(put(&serde_json::to_string(value)?)?)
}

fn put(text: &str) -> io::Result<()> {
    let mut out = io::stdout().lock();
    out.write_all(text.as_bytes())?;
    out.write_all(b"\n")?;
    out.flush()
}

/// Whether printing failed because whoever read stdout has closed it.
pub fn has_read_enough(error: &io::Error) -> bool {
    error.kind() == io::ErrorKind::BrokenPipe
}

/// What was printed, or that nobody reads on: the work that is left and the verdict are the same.
fn heard_or_not(printed: io::Result<()>) -> io::Result<()> {
    printed.or_else(|error| if has_read_enough(&error) { Ok(()) } else { Err(error) })
}

/// Prints data for people.
pub fn say(text: &str) -> io::Result<()> {
    heard_or_not(print(text))
}

/// Prints data for machines.
pub fn say_json(value: &impl serde::Serialize) -> anyhow::Result<()> {
    Ok(heard_or_not(put(&serde_json::to_string_pretty(value)?))?)
}

/// Tells the user something that is not data.
macro_rules! tell {
    ($($arg:tt)*) => {{
        use std::io::Write;
        // A closed stderr must not end the work.
        let _ = writeln!(std::io::stderr(), "{}", $crate::commands::visible(&format!($($arg)*)));
    }};
}
pub(super) use tell;

/// Tells how much of a log, or of several, was passed over; true when it was any.
pub fn tell_passed_over(log: Option<&Path>, parts: u64) -> bool {
    if parts > 0 {
        let log = log.map(|log| format!("{}: ", log.display())).unwrap_or_default();
        tell!("{log}{parts} damaged, broken or missing parts passed over; see `crossfall verify`");
    }
    parts > 0
}

/// Says that a log is being recorded, since what is `done` with it ends where the recording is now.
pub fn tell_growing(logs: &[PathBuf], done: &str) {
    for log in logs.iter().filter(|log| crossfall::log::is_being_written(log)) {
        tell!("{}: is being recorded: what is {done} ends with its last closed chunk", log.display());
    }
}
