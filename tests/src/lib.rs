//! What the end-to-end tests share.
#![forbid(unsafe_code)]

pub mod arrivals;
pub mod drives;
pub mod emulator;
pub mod fuzzing;
pub use crossfall::emulated::scanner as lms_emulator;

use std::path::PathBuf;

/// A folder of the real recordings, or `None`, said on the test's output, where there are none.
///
/// # Panics
/// When the variable names a folder that does not exist: a test that was meant to run must not pass by skipping.
#[must_use]
pub fn recordings(folder: &str) -> Option<PathBuf> {
    let Some(root) = std::env::var_os("CROSSFALL_RECORDINGS") else {
        println!("skipped: CROSSFALL_RECORDINGS does not name the folder of recordings");
        return None;
    };
    let path = PathBuf::from(root).join(folder);
    assert!(path.is_dir(), "CROSSFALL_RECORDINGS has no folder {}", path.display());
    Some(path)
}
