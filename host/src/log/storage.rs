//! What a live log is written to: a file, or in tests a model of one that is cut off, slow or full.
//!
//! A file belongs to its writer alone: it is made new (never opened where one exists) and locked, so that a program that would replace or
//! repair it can see that it grows. Locks are advisory and die with their process; a file system without them loses only this courtesy.

use std::fs::{File, TryLockError};
use std::io::{self, Write};
use std::path::Path;

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
    match file.try_lock() {
        // Nobody else can have it yet; whatever else goes wrong, the file system knows no locks.
        Ok(()) | Err(TryLockError::Error(_)) => {}
        Err(TryLockError::WouldBlock) => return Err(io::Error::from(io::ErrorKind::ResourceBusy)),
    }
    sync_folder(path)?;
    Ok(Box::new(file))
}

/// Brings a folder's list of names to the disk.
pub(crate) fn sync_folder(path: &Path) -> io::Result<()> {
    if cfg!(unix) {
        let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
        File::open(folder)?.sync_all()?;
    }
    Ok(())
}

/// Whether a recording is being written to a file at this moment, by this or another program.
#[must_use]
pub fn is_being_written(path: &Path) -> bool {
    File::open(path).is_ok_and(|file| matches!(file.try_lock_shared(), Err(TryLockError::WouldBlock)))
}
