//! Room on the disk: watched while a recording goes on, told early, and the recording ended while there is room to end it well.
//!
//! A log that fills its disk loses its index and its last chunk; other programs on the disk lose more. So a recording stops at a reserve, with a
//! closed log, and says long before for how many minutes the room lasts at the present rate.

use std::io;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use crate::output::folder_of;

/// Bytes that stay free unless told otherwise.
pub const RESERVE: u64 = 64 << 20;

/// How often the disk is asked.
const EVERY: Duration = Duration::from_secs(1);

/// Minutes left at which the user is told, once each.
const TOLD_AT: [u64; 5] = [30, 10, 5, 2, 1];

/// Seconds of recording before its rate is known well enough to speak of minutes.
const SETTLED_S: f64 = 10.0;

/// What is worth telling.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Space {
    /// The room lasts for so many minutes at the present rate.
    Low {
        /// Minutes.
        minutes: u64,
    },
    /// The reserve is reached: the recording should end.
    Full {
        /// Bytes that are still free.
        free: u64,
    },
}

/// Asks the disk for its free bytes.
type Free = Box<dyn FnMut() -> io::Result<u64> + Send>;

/// Watches the disk of one log.
pub struct Watch {
    free: Free,
    reserve: u64,
    asked: Option<Instant>,
    told: usize,
}

impl Watch {
    /// Watches the disk on which a log lies, for so many bytes that must stay free.
    #[must_use]
    pub fn new(log: &Path, reserve: u64) -> Self {
        Self::over_folder(folder_of(log).to_path_buf(), reserve)
    }

    /// The same of a log that is yet to be made in a folder.
    #[must_use]
    pub fn over_folder(folder: PathBuf, reserve: u64) -> Self {
        Self::of(Box::new(move || fs4::available_space(&folder)), reserve)
    }

    pub(crate) fn of(free: Free, reserve: u64) -> Self {
        Self { free, reserve, asked: None, told: 0 }
    }

    /// Asks the disk, at most once a second. `bytes` are those of the log after `seconds`.
    pub fn look(&mut self, bytes: u64, seconds: f64) -> Option<Space> {
        if self.asked.is_some_and(|asked| asked.elapsed() < EVERY) {
            return None;
        }
        self.asked = Some(Instant::now());
        self.judge(bytes, seconds)
    }

    fn judge(&mut self, bytes: u64, seconds: f64) -> Option<Space> {
        // A file system that does not tell is not watched; the log survives a full disk, only less well.
        let free = (self.free)().ok()?;
        if free <= self.reserve {
            return Some(Space::Full { free });
        }
        if seconds < SETTLED_S || bytes == 0 {
            return None;
        }
        let minutes = ((free - self.reserve) as f64 * seconds / bytes as f64 / 60.0) as u64;
        let due = TOLD_AT.iter().filter(|&&at| minutes < at).count();
        if due > self.told {
            self.told = due;
            return Some(Space::Low { minutes });
        }
        None
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_is_told_early_once_each_and_ended_at_the_reserve() {
        // 1 MB a minute; 100 MB to keep.
        let mut free = 150_000_000_u64;
        let left = std::sync::Arc::new(std::sync::atomic::AtomicU64::new(free));
        let shown = std::sync::Arc::clone(&left);
        let mut watch = Watch::of(Box::new(move || Ok(shown.load(std::sync::atomic::Ordering::Relaxed))), 100_000_000);
        let mut told = Vec::new();
        for minute in 1.. {
            free -= 1_000_000;
            left.store(free, std::sync::atomic::Ordering::Relaxed);
            if let Some(space) = watch.judge(1_000_000 * minute, 60.0 * minute as f64) {
                told.push((minute, space));
                if matches!(space, Space::Full { .. }) {
                    break;
                }
            }
        }
        let low = |minutes| Space::Low { minutes };
        assert_eq!(
            told,
            [(21, low(29)), (41, low(9)), (46, low(4)), (49, low(1)), (50, Space::Full { free: 100_000_000 })]
        );
    }

    #[test]
    fn a_disk_that_does_not_tell_is_not_watched() {
        let mut watch = Watch::of(Box::new(|| Err(io::Error::from(io::ErrorKind::Unsupported))), 1);
        assert_eq!(watch.judge(1, 60.0), None);
    }
}
