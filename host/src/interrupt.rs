//! The user's wish to stop (Ctrl-C), as a flag that every long loop looks at.
//!
//! Nothing is torn down by a signal handler: a loop that sees the flag returns an error, and on the way out unfinished
//! outputs remove themselves. Readers of captures look at the flag with every chunk that they yield.

use std::sync::atomic::{AtomicBool, Ordering};

static REQUESTED: AtomicBool = AtomicBool::new(false);

/// Asks every loop to stop. Returns whether it had been asked before (then the caller may end the process at once).
pub fn request() -> bool {
    REQUESTED.swap(true, Ordering::Relaxed)
}

/// Whether stopping has been asked for.
#[must_use]
pub fn requested() -> bool {
    REQUESTED.load(Ordering::Relaxed)
}
