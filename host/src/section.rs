//! One levelled section out of a log: what the survey saw and what it made of it.

use std::path::Path;

use crossfall_core::protocol::message::Profile;

use crate::container::Error;
use crate::walk::Walk;

/// A place in a section: metres to the left of the sensor and above it.
pub type Place = (f64, f64);

/// A section.
#[derive(Clone, Debug)]
pub struct Section {
    /// Points as measured, without roll and mounting offset.
    pub raw: Vec<Place>,
    /// Points with every beam turned by the roll of its own instant.
    pub levelled: Vec<Place>,
    /// What the board made of it.
    pub profile: Profile,
}

/// The section of a scan, by the scan's number; nothing when the log has no profile of it.
///
/// # Errors
/// When the file cannot be read or is no log.
pub fn of_scan(path: &Path, number: u32) -> Result<Option<Section>, Error> {
    let mut walk = Walk::open(path)?;
    while let Some(step) = walk.next(|_, _| ()) {
        if step.profile.scan == number {
            return Ok(Some(step.section()));
        }
    }
    Ok(None)
}
