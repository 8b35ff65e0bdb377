//! The median-slope paper's experiments once more, on simulated drives with known truth.
//!
//! Each experiment makes sensor bytes, puts them through the board's own code into a log, and evaluates the log with the same commands
//! that a user has (`calibrate`, `compare`). Beside the paper's figure and crossfall's stands the limit: what the sensors' noise and, on
//! repeat drives, the error of the positions leave even to a perfect evaluation. The paper's own search, which is a mode of the core, is run on
//! the same bytes. The paper gives the range accuracy as 35 mm in one place and 3.5 mm in another, SICK's data sheet 10 mm as one sigma: both 3.5
//! and 10 mm are tried. Everything random is drawn from one seed, so the same build prints the same table.

mod boards;
mod document;
mod limit;
mod medians;
mod pipeline;
mod repeats;
mod rock;
mod surface_truth;
mod two_units;
mod variation;

use std::path::PathBuf;

use serde::Serialize;

use crate::{compare, container, output, plot, run, simulate};

pub use document::{markdown, table};

/// Both readings of the scanner's range accuracy, one sigma, in millimetres.
pub const RANGE_NOISE_MM: [f64; 2] = [3.5, 10.0];

/// One line of the table.
#[derive(Clone, Debug, Serialize)]
pub struct Line {
    /// The experiment.
    pub experiment: &'static str,
    /// What was measured.
    pub quantity: String,
    /// Standard deviation of a range, in millimetres; absent where no range is involved.
    pub range_noise_mm: Option<f64>,
    /// What the paper reports.
    pub paper: Option<f64>,
    /// What crossfall reaches.
    pub crossfall: f64,
    /// What the paper's own search reaches on the same bytes, where a search is involved.
    pub seed_search: Option<f64>,
    /// What a perfect evaluation of the same sensors would reach.
    pub limit: Option<f64>,
    /// `deg`, `us` or `share`.
    pub unit: &'static str,
}

/// A picture in both themes.
#[derive(Clone, Debug)]
pub struct Picture {
    /// Name of the file without extension.
    pub name: &'static str,
    /// What it shows, for those who do not see it.
    pub says: &'static str,
    /// Light and dark, as SVG.
    pub svg: [String; 2],
}

/// What the experiments gave.
#[derive(Clone, Debug, Default)]
pub struct Report {
    /// The table.
    pub lines: Vec<Line>,
    /// The pictures.
    pub pictures: Vec<Picture>,
}

/// An experiment could not be done.
#[derive(Debug, thiserror::Error)]
#[expect(missing_docs, reason = "each is the error of one step")]
pub enum Error {
    #[error(transparent)]
    Simulate(#[from] simulate::Error),
    #[error(transparent)]
    Output(#[from] output::Error),
    #[error(transparent)]
    Read(#[from] container::Error),
    #[error(transparent)]
    Run(#[from] run::Error),
    #[error(transparent)]
    Plot(#[from] plot::Error),
    #[error(transparent)]
    Calibrate(#[from] crate::calibrate::Refusal),
    #[error(transparent)]
    Manual(#[from] compare::manual::Error),
    #[error("a folder for the drives: {0}")]
    Scratch(#[from] std::io::Error),
    #[error("interrupted")]
    Interrupted,
}

/// One experiment.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Experiment {
    /// One unit in the vehicle, one on the scanner.
    TwoUnits,
    /// The vehicle rocked while parked.
    Rock,
    /// Boards of known slope at 2 to 3 m.
    Boards,
    /// Medians with grass, held against measurements by hand.
    Medians,
    /// Three drives over one road.
    Repeats,
    /// How much slopes vary within a section and along a road.
    Variation,
}

impl Experiment {
    /// All, in the paper's order.
    pub const ALL: [Self; 6] =
        [Self::TwoUnits, Self::Rock, Self::Boards, Self::Medians, Self::Repeats, Self::Variation];

    /// Its name on the command line.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::TwoUnits => "two-units",
            Self::Rock => "rock",
            Self::Boards => "boards",
            Self::Medians => "medians",
            Self::Repeats => "repeats",
            Self::Variation => "variation",
        }
    }

    /// Does it. `seconds` shortens its drives where it is less than theirs.
    ///
    /// # Errors
    /// When a step fails or the user asks to stop.
    pub fn run(self, seed: u64, seconds: f64, report: &mut Report) -> Result<(), Error> {
        let bench = pipeline::Bench::new(seed, seconds)?;
        match self {
            Self::TwoUnits => two_units::run(&bench, report),
            Self::Rock => rock::run(&bench, report),
            Self::Boards => boards::run(&bench, report),
            Self::Medians => medians::run(&bench, report),
            Self::Repeats => repeats::run(&bench, report),
            Self::Variation => variation::run(&bench, report),
        }
    }
}

impl Picture {
    fn new(
        name: &'static str,
        says: &'static str,
        draw: impl Fn(plot::Theme) -> Result<String, plot::Error>,
    ) -> Result<Self, Error> {
        Ok(Self { name, says, svg: [draw(plot::Theme::Light)?, draw(plot::Theme::Dark)?] })
    }

    /// Names and contents of its files: `<name>.svg` and `<name>-dark.svg`.
    #[must_use]
    pub fn files(&self) -> [(PathBuf, &str); 2] {
        let [light, dark] = &self.svg;
        [(format!("{}.svg", self.name).into(), light), (format!("{}-dark.svg", self.name).into(), dark)]
    }
}

/// The mean magnitude of a normal error with this standard deviation.
fn mean_magnitude(deviation: f64) -> f64 {
    deviation * (2.0 / core::f64::consts::PI).sqrt()
}
