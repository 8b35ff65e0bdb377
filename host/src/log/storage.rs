//! What a live log is written to: a file, or in tests a model of one that is cut off, slow or full.
//!
//! A file belongs to its writer alone: it is made new (never opened where one exists) and locked, so that a program that would replace or
//! repair it can see that it grows. Locks are advisory and die with their process; a file system without them loses only this courtesy.

use std::fs::{File, TryLockError};
use std::io::{self, Write};
use std::path::Path;
use std::thread;
use std::time::Duration;

use crate::output::folder_of;

/// Attempts to lock a new file, and the pause between them.
const LOCK_TRIES: u32 = 20;
const LOCK_PAUSE: Duration = Duration::from_millis(5);

/// Bytes go in at the end, and come to stay when asked.
pub trait Storage: Write + Send {
    /// Returns when everything written before is safe from a power cut.
    ///
    /// # Errors
    /// What the operating system says; the bytes may then be there or not.
    fn sync(&mut self) -> io::Result<()>;
}

impl Storage for File {
    fn sync(&mut self) -> io::Result<()> {
        self.sync_data()
    }
}

/// Makes a new file, which must not exist, and its name survive a power cut.
pub(super) fn create(path: &Path) -> io::Result<Box<dyn Storage>> {
    let file = File::create_new(path)?;
    // It is new, so only somebody who looks whether it is locked can have it, for a moment. Whatever else goes wrong: the file system knows no
    // locks, and the file is this writer's all the same.
    for _ in 0..LOCK_TRIES {
        match file.try_lock() {
            Ok(()) | Err(TryLockError::Error(_)) => break,
            Err(TryLockError::WouldBlock) => thread::sleep(LOCK_PAUSE),
        }
    }
    if let Err(error) = sync_folder(path) {
        // A name that may not survive is none, and must not be taken for a file that was written.
        drop(file);
        drop(std::fs::remove_file(path));
        return Err(error);
    }
    Ok(Box::new(file))
}

/// Brings a folder's list of names to the disk.
pub(crate) fn sync_folder(path: &Path) -> io::Result<()> {
    if cfg!(unix) {
        File::open(folder_of(path))?.sync_all()?;
    }
    Ok(())
}

/// Whether a recording is being written to a file at this moment, by this or another program.
#[must_use]
pub fn is_being_written(path: &Path) -> bool {
    // Opening a pipe waits for somebody who writes to it.
    std::fs::metadata(path).is_ok_and(|found| found.is_file())
        && File::open(path).is_ok_and(|file| matches!(file.try_lock_shared(), Err(TryLockError::WouldBlock)))
}
