//! Drives held against each other, against measurements by hand, and two attitude sources against each other: what the
//! median-slope paper calls repeatability (its figures 7 and 8) and sensor placement (figure 2).
//!
//! Repeat drives are matched by station on the first drive's track: every scan of another drive is projected onto it by its position, and each
//! scan of the first is held against the nearest one, scan by scan and without averaging, as the paper does. Drives without
//! positions are matched by the way travelled since their beginning, which is said. Positions err by metres, slopes vary over metres:
//! so the variation is also given with the drives shifted against each other by what makes their slopes agree best, one shift for
//! each half kilometre; medians over stretches are as coarse as the positions and are not shifted. Sections that say themselves unreliable (`doubtful`, `no_attitude`) are left out and counted.

mod align;
pub mod attitude;
pub mod manual;
mod matching;
mod repeat;

use std::path::Path;

use clap::ValueEnum;
use clap::builder::PossibleValue;
use serde::Serialize;

use crate::container::Error;
use crate::profiles::{Row, Rows};
use crate::side::Side;
use crate::way::{Reach, Way};

pub use crate::side::Kind;
pub use repeat::{Aligned, Dot, Pair, Repeat, repeat};

/// Which sides are compared.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Sides {
    /// Left and right.
    #[default]
    Both,
    /// One of them.
    One(Side),
}

impl Sides {
    fn holds(self, side: Side) -> bool {
        match self {
            Self::Both => true,
            Self::One(one) => side == one,
        }
    }
}

impl ValueEnum for Sides {
    fn value_variants<'a>() -> &'a [Self] {
        &[Self::Both, Self::One(Side::Left), Self::One(Side::Right)]
    }

    fn to_possible_value(&self) -> Option<PossibleValue> {
        match self {
            Self::Both => Some(PossibleValue::new("both")),
            Self::One(side) => side.to_possible_value(),
        }
    }
}

/// One drive's profiles.
#[derive(Clone, Debug, Default)]
pub struct Drive {
    /// What it is called in tables.
    pub name: String,
    /// Its rows, in order.
    pub rows: Vec<Row>,
    /// Damaged parts and gaps of the log.
    pub damage: u64,
}

impl Drive {
    /// Reads the profiles of a log.
    ///
    /// # Errors
    /// When the log cannot be opened, or holds no profile, or the user asks to stop.
    pub fn read(path: &Path) -> Result<Self, Error> {
        let mut rows = Rows::open(path)?;
        let all: Vec<Row> = rows.by_ref().collect();
        crate::interrupt::check()?;
        if all.is_empty() {
            return Err(Error::Content { path: path.to_path_buf(), what: "the log has no profile".to_owned() });
        }
        Ok(Self { name: path.display().to_string(), rows: all, damage: rows.damage() })
    }

    /// The track, for places to be found on; nothing without positions or without a way travelled.
    #[must_use]
    pub fn way(&self) -> Option<Way> {
        let placed = self.rows.iter().filter_map(|row| Some((row.position.geodetic?, row.position.station_m?)));
        Way::through(placed, Reach::LANE)
    }
}

/// How to compare.
#[derive(Clone, Copy, Debug)]
pub struct Options {
    /// Which sides.
    pub sides: Sides,
    /// Measurements further apart along the road than this are not of the same place, in metres.
    pub within_m: f64,
    /// Compare medians over stretches of this length in metres instead of single scans.
    pub over_m: Option<f64>,
}

impl Default for Options {
    fn default() -> Self {
        Self { sides: Sides::Both, within_m: 1.0, over_m: None }
    }
}

/// How well two sets of slopes agree.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Agreement {
    /// Pairs of measurements.
    pub matched: usize,
    /// Mean of the difference's magnitude, in degrees: what the paper calls variation.
    pub mean_absolute_deg: f64,
    /// Mean of the difference.
    pub mean_deg: f64,
    /// Root mean square of the difference.
    pub rms_deg: f64,
    /// The mean magnitude that the measurements' own intervals let expect of one and the same place; absent where there are none.
    pub expected_deg: Option<f64>,
}

impl Agreement {
    /// Of differences in degrees, each with the half widths of both 95 % intervals where there are.
    #[must_use]
    pub fn of(differences: &[(f64, Option<f64>)]) -> Self {
        if differences.is_empty() {
            return Self::default();
        }
        let count = differences.len() as f64;
        let sum = |part: &dyn Fn(f64) -> f64| differences.iter().map(|(d, _)| part(*d)).sum::<f64>() / count;
        let expected: Vec<f64> = differences.iter().filter_map(|(_, half)| *half).collect();
        // The magnitude of a normal error of deviation s has the mean s sqrt(2 / pi); an interval is 1.96 deviations to either side.
        let per_half = (2.0 / core::f64::consts::PI).sqrt() / 1.96;
        Self {
            matched: differences.len(),
            mean_absolute_deg: sum(&f64::abs),
            mean_deg: sum(&|d| d),
            rms_deg: sum(&|d| d * d).sqrt(),
            expected_deg: (!expected.is_empty())
                .then(|| per_half * expected.iter().sum::<f64>() / expected.len() as f64),
        }
    }
}

#[cfg(test)]
mod tests;
