//! Work whose panics end with it: reading untrusted bytes by a library that does not promise to survive them.
//!
//! A thread is the wall: what panics in it comes back as its result. An allocation that fails is not held back, so what a file tells of its sizes is
//! held against its length beforehand.

use std::io;
use std::thread::{self, Builder};

/// What the threads are called.
const NAME: &str = "contained";

/// Does some work in a thread of its own and waits for it; `None` when it panicked.
///
/// # Errors
/// A system that has no room for a thread.
pub fn contained<T: Send>(work: impl FnOnce() -> T + Send) -> io::Result<Option<T>> {
    thread::scope(|scope| Ok(Builder::new().name(NAME.into()).spawn_scoped(scope, work)?.join().ok()))
}

/// Whether this is such a thread: its panic is told as damage of what it read, and is no defect.
#[must_use]
pub fn is_contained() -> bool {
    thread::current().name() == Some(NAME)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn work_that_panics_comes_back_as_nothing_and_other_work_as_its_result() {
        let read = |bytes: &[u8]| contained(|| (bytes[0], is_contained())).unwrap();
        assert_eq!(read(&[7]), Some((7, true)));
        assert_eq!(read(&[]), None);
        assert!(!is_contained());
    }
}
