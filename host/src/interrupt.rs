//! The user's wish to stop (Ctrl-C), as a flag that every long loop looks at.
//!
//! Nothing is torn down by a signal handler: a loop that sees the flag returns an error, and on the way out unfinished
//! outputs remove themselves. Readers of captures and logs look at the flag with every
//! chunk or frame that they yield; who walks a log by iterators that can say no more than that they are at an end asks [`check`] behind them.
//! No output is given its name once the flag is set (`output`).

use std::sync::OnceLock;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use crate::container::Error;

static REQUESTED: AtomicBool = AtomicBool::new(false);
static SINCE: OnceLock<Instant> = OnceLock::new();

/// Signals that come together are one wish: a terminal that closes hangs up its programs twice, once itself and once through the shell.
const TOGETHER: Duration = Duration::from_secs(1);

/// Asks every loop to stop. Returns whether it had been asked at least a second before (then the caller may end the process at once).
pub fn request() -> bool {
    let since = SINCE.get_or_init(Instant::now);
    REQUESTED.swap(true, Ordering::Relaxed) && since.elapsed() >= TOGETHER
}

/// Whether stopping has been asked for.
#[must_use]
pub fn requested() -> bool {
    REQUESTED.load(Ordering::Relaxed)
}

/// Whether to go on: a walk may have ended because it was asked to.
///
/// # Errors
/// [`Error::Interrupted`] when stopping has been asked for.
pub fn check() -> Result<(), Error> {
    if requested() { Err(Error::Interrupted) } else { Ok(()) }
}
