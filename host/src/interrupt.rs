//! The user's wish to stop (Ctrl-C), as a flag that every long loop looks at.
//!
//! Nothing is torn down by a signal handler: a loop that sees the flag returns an error, and on the way out unfinished
//! outputs remove themselves. Readers of captures look at the flag with every chunk that they yield.

use std::sync::OnceLock;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

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
