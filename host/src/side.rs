//! Sides of the vehicle and slopes beside the road, as all of the host calls them.

use clap::ValueEnum;
use clap::builder::PossibleValue;
use crossfall_core::protocol::message::{self, Profile};
use serde::Serialize;

use crate::profiles::{Row, SlopeRow};

/// A side of the vehicle: the median is on the left where traffic keeps right.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Side {
    /// Of positive lateral distance.
    Left,
    /// Of negative lateral distance.
    Right,
}

impl Side {
    /// Both, left before right, as everywhere.
    pub const BOTH: [Self; 2] = [Self::Left, Self::Right];

    /// `left` or `right`, in tables and on the command line.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Left => "left",
            Self::Right => "right",
        }
    }

    /// What its road edge is called on a map.
    #[must_use]
    pub fn edge_name(self) -> &'static str {
        match self {
            Self::Left => "left road edge",
            Self::Right => "right road edge",
        }
    }

    /// Number in [`Side::BOTH`].
    #[must_use]
    pub fn index(self) -> usize {
        self as usize
    }

    /// The sign of a lateral distance on it: outward is away from the vehicle.
    #[must_use]
    pub fn outward(self) -> f64 {
        match self {
            Self::Left => 1.0,
            Self::Right => -1.0,
        }
    }

    /// What a profile has on it.
    #[must_use]
    pub fn of(self, profile: &Profile) -> &message::Side {
        match self {
            Self::Left => &profile.left,
            Self::Right => &profile.right,
        }
    }

    /// Its adjacent and its opposing slope.
    #[must_use]
    pub fn slopes(self) -> [WhichSlope; 2] {
        Kind::BOTH.map(|kind| WhichSlope { side: self, kind })
    }
}

// By hand: derived, the words above would stand in the help of every command that takes a side.
impl ValueEnum for Side {
    fn value_variants<'a>() -> &'a [Self] {
        &Self::BOTH
    }

    fn to_possible_value(&self) -> Option<PossibleValue> {
        Some(PossibleValue::new(self.name()))
    }
}

/// One of the two slopes on a side.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Kind {
    /// Beside the road.
    Adjacent,
    /// Beyond the ditch.
    Opposing,
}

impl Kind {
    /// Both.
    pub const BOTH: [Self; 2] = [Self::Adjacent, Self::Opposing];

    /// `adjacent` or `opposing`, in tables and styles.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Adjacent => "adjacent",
            Self::Opposing => "opposing",
        }
    }

    /// This slope of a row.
    #[must_use]
    pub fn of(self, row: &Row) -> Option<SlopeRow> {
        match self {
            Self::Adjacent => row.adjacent,
            Self::Opposing => row.opposing,
        }
    }
}

/// One of the four slopes of a section.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct WhichSlope {
    /// On which side.
    pub side: Side,
    /// Which of the two there.
    pub kind: Kind,
}

impl WhichSlope {
    /// All, in the order in which arrays hold them.
    pub const ALL: [Self; 4] = [
        Self { side: Side::Left, kind: Kind::Adjacent },
        Self { side: Side::Left, kind: Kind::Opposing },
        Self { side: Side::Right, kind: Kind::Adjacent },
        Self { side: Side::Right, kind: Kind::Opposing },
    ];

    /// Number in [`WhichSlope::ALL`].
    #[must_use]
    pub fn index(self) -> usize {
        2 * self.side as usize + self.kind as usize
    }

    /// Side and kind, as `left adjacent`.
    #[must_use]
    pub fn name(self) -> &'static str {
        ["left adjacent", "left opposing", "right adjacent", "right opposing"][self.index()]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_order_of_arrays_is_that_of_numbers_and_names() {
        assert_eq!(Side::BOTH.map(Side::index), [0, 1]);
        assert_eq!(WhichSlope::ALL.map(WhichSlope::index), [0, 1, 2, 3]);
        assert_eq!(Side::BOTH.map(Side::slopes).concat(), WhichSlope::ALL);
        for slope in WhichSlope::ALL {
            assert_eq!(slope.name(), format!("{} {}", slope.side.name(), slope.kind.name()));
        }
    }
}
