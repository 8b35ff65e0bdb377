//! TOML that a user writes: scenes and configurations. Errors are one line each and name the file, the line and the key.

use std::fs;
use std::path::{Path, PathBuf};

use serde::de::DeserializeOwned;

/// Why a file is not accepted.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// The operating system refused.
    #[error("{}: {source}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
    },
    /// Not TOML, a key that does not exist, a value of the wrong type.
    #[error("{}:{line}: {what}", path.display())]
    Syntax {
        /// The file.
        path: PathBuf,
        /// 1-based line.
        line: usize,
        /// What was found and what was expected.
        what: String,
    },
    /// Values out of range or in contradiction.
    #[error("{}: {source}", path.display())]
    Value {
        /// The file.
        path: PathBuf,
        /// Which.
        source: Invalid,
    },
}

/// A value that is not accepted.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{key} = {value}, expected {expected}")]
pub struct Invalid {
    /// The key with the tables around it.
    pub key: String,
    /// What the user wrote.
    pub value: String,
    /// What would be accepted.
    pub expected: String,
}

impl Invalid {
    /// A value that is not accepted.
    pub fn new(key: impl Into<String>, value: impl ToString, expected: impl Into<String>) -> Self {
        Self { key: key.into(), value: value.to_string(), expected: expected.into() }
    }
}

/// Requires a number to be within bounds (inclusive); no NaN passes.
///
/// # Errors
/// Names the key, its value and the bounds.
pub fn within(key: &str, value: f64, low: f64, high: f64) -> Result<(), Invalid> {
    if (low..=high).contains(&value) {
        return Ok(());
    }
    Err(Invalid::new(key, value, format!("a number from {low} to {high}")))
}

/// Reads a file and parses it.
///
/// # Errors
/// When it cannot be read or is not what `T` describes.
pub fn read<T: DeserializeOwned>(path: &Path) -> Result<T, Error> {
    let text = fs::read_to_string(path).map_err(|source| Error::Io { path: path.to_path_buf(), source })?;
    parse(path, &text)
}

/// Parses the text of a file; `path` is for the error.
///
/// # Errors
/// When the text is not what `T` describes.
pub fn parse<T: DeserializeOwned>(path: &Path, text: &str) -> Result<T, Error> {
    toml::from_str(text).map_err(|error| {
        let before = error.span().and_then(|span| text.get(..span.start)).unwrap_or_default();
        let line = before.matches('\n').count() + 1;
        let what = error.message().replace('\n', " ");
        Error::Syntax { path: path.to_path_buf(), line, what }
    })
}
