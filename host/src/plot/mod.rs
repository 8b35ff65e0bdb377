//! Pictures, as SVG: they scale, and text in them stays text. [`png`] renders them for programs that want pixels.
//!
//! The drawing library is known in this folder only. Colours are Okabe and Ito's, which colour-blind readers can tell apart; what
//! matters is told by shape or label as well.

mod across;
mod agreement;
mod axes;
mod course;
mod drive;
mod errors;
mod layers;
mod raster;
mod runs;
mod section;
mod variation;
mod view;

use plotters::prelude::*;
use plotters::style::text_anchor::Pos;
use plotters::style::{RGBColor, TextStyle};

pub use across::{Across, across};
pub use agreement::{Twice, Words, agreement};
pub use course::{Course, Courses, courses};
pub use drive::{Series, TruthAt, drive};
pub use errors::errors;
pub use layers::layers;
pub use raster::png;
pub use runs::runs;
pub use section::section;
pub use variation::variation;
pub use view::view;

/// A picture could not be drawn.
#[derive(Debug, thiserror::Error)]
#[error("the picture cannot be drawn: {0}")]
pub struct Error(String);

impl<E: std::error::Error + Send + Sync> From<DrawingAreaErrorKind<E>> for Error {
    fn from(error: DrawingAreaErrorKind<E>) -> Self {
        Self(error.to_string())
    }
}

/// Light or dark.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Theme {
    /// For paper.
    #[default]
    Light,
    /// For screens.
    Dark,
}

/// The colours of a theme.
#[derive(Clone, Copy)]
struct Palette {
    ground: RGBColor,
    text: RGBColor,
    grid: RGBColor,
    faint: RGBColor,
    points: RGBColor,
    road: RGBColor,
    adjacent: RGBColor,
    opposing: RGBColor,
}

impl Palette {
    /// Colours to tell drives apart.
    fn several(&self) -> impl Iterator<Item = RGBColor> {
        [self.points, self.adjacent, self.opposing, self.road, self.faint].into_iter().cycle()
    }
}

impl Theme {
    fn palette(self) -> Palette {
        match self {
            Self::Light => Palette {
                ground: RGBColor(255, 255, 255),
                text: RGBColor(34, 34, 34),
                grid: RGBColor(226, 226, 226),
                faint: RGBColor(176, 176, 176),
                points: RGBColor(0, 114, 178),
                road: RGBColor(34, 34, 34),
                adjacent: RGBColor(213, 94, 0),
                opposing: RGBColor(0, 158, 115),
            },
            Self::Dark => Palette {
                ground: RGBColor(24, 26, 30),
                text: RGBColor(222, 222, 222),
                grid: RGBColor(58, 61, 67),
                faint: RGBColor(112, 116, 124),
                points: RGBColor(86, 180, 233),
                road: RGBColor(236, 236, 236),
                adjacent: RGBColor(230, 159, 0),
                opposing: RGBColor(0, 198, 145),
            },
        }
    }
}

/// Text of a size in a colour.
fn text(size: u32, colour: RGBColor) -> TextStyle<'static> {
    TextStyle { font: ("sans-serif", size).into_font(), color: colour.to_backend_color(), pos: Pos::default() }
}

/// A sign that is as wide as a plus, where typography has one.
fn signed(value: f64, digits: usize) -> String {
    let number = format!("{:.digits$}", value.abs());
    if value < 0.0 { format!("\u{2212}{number}") } else { format!("+{number}") }
}
