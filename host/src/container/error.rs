//! What can be wrong with an MCAP file.

use std::io;
use std::path::PathBuf;

/// What can be wrong with an MCAP file.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// The operating system refused.
    #[error("{}: {source}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// Why.
        source: io::Error,
    },
    /// Another kind of file.
    #[error("{}: not an MCAP file: it begins with {found}, expected 89 4D 43 41 50 30 0D 0A", path.display())]
    Foreign {
        /// The file.
        path: PathBuf,
        /// Its first bytes.
        found: String,
    },
    /// The file ends too early.
    #[error("{}: cut short: the file ends at byte {end}, {expected}", path.display())]
    Cut {
        /// The file.
        path: PathBuf,
        /// Its size.
        end: u64,
        /// What should have come.
        expected: String,
    },
    /// Some bytes are not what they should be.
    #[error("{}: damaged at byte {offset}: {what}", path.display())]
    Damaged {
        /// The file.
        path: PathBuf,
        /// Where.
        offset: u64,
        /// What was found and what was expected.
        what: String,
    },
    /// The file is whole but holds something else.
    #[error("{}: {what}", path.display())]
    Content {
        /// The file.
        path: PathBuf,
        /// What is missing.
        what: String,
    },
    /// The user asked to stop.
    #[error("interrupted")]
    Interrupted,
}

impl Error {
    /// Where in the file, as far as the error has a place.
    #[must_use]
    pub fn offset(&self) -> Option<u64> {
        match self {
            Self::Cut { end, .. } => Some(*end),
            Self::Damaged { offset, .. } => Some(*offset),
            _ => None,
        }
    }

    /// What is wrong, without the name of the file.
    #[must_use]
    pub fn what(&self) -> String {
        match self {
            Self::Cut { expected, .. } => format!("cut short: {expected}"),
            Self::Damaged { what, .. } | Self::Content { what, .. } => what.clone(),
            other => other.to_string(),
        }
    }
}
