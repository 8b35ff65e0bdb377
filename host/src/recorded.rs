//! What a file is: a capture, or else a log.

use std::path::Path;

use crate::capture;
use crate::container::Error;
use crate::stream::Stream;

/// What was recorded, opened.
#[expect(clippy::large_enum_variant, reason = "one at a time, on its way to who reads it")]
pub enum Recorded {
    /// Sensor bytes.
    Capture(capture::Reader),
    /// Frames of a board: every file of the drive.
    Log(Stream),
}

impl Recorded {
    /// Opens whichever it is.
    ///
    /// # Errors
    /// When the file cannot be read or is neither.
    pub fn open(path: &Path) -> Result<Self, Error> {
        let no_capture = match capture::Reader::open(path) {
            Ok(capture) => return Ok(Self::Capture(capture)),
            Err(error) => error,
        };
        // A damaged log is no capture for more reasons than one.
        match (Stream::open(path), no_capture) {
            (Ok(log), _) => Ok(Self::Log(log)),
            (Err(Error::Content { path, .. }), Error::Content { .. }) => {
                let what = "neither a capture (channels lidar, ins, pps) nor a log (channel wire)".to_owned();
                Err(Error::Content { path, what })
            }
            (Err(Error::Content { .. }), error) | (Err(error), _) => Err(error),
        }
    }
}
