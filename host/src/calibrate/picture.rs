//! A rock test as the median-slope paper's figure 5: both courses of roll, and what is left between them before and after.

use super::Sample;
use crate::plot::{self, Courses, Theme};

/// The most of the courses that is shown, in seconds.
const SHOWN_S: f64 = 8.0;

/// Draws the scans of [`estimate`](super::estimate) as SVG, under a title and a line of the caller's.
///
/// # Errors
/// When the drawing library fails.
pub fn picture(samples: &[Sample], title: &str, note: &str, theme: Theme) -> Result<String, plot::Error> {
    let course = |of: fn(&Sample) -> f64| samples.iter().map(|s| (s.seconds, of(s))).collect::<Vec<_>>();
    // Before, the old offset is in it as well: what is shown is how it scatters.
    let mean = samples.iter().map(|s| s.before_deg).sum::<f64>() / samples.len().max(1) as f64;
    let before: Vec<_> = samples.iter().map(|s| (s.seconds, s.before_deg - mean)).collect();
    let courses = Courses {
        title,
        note: &note.replace('-', "\u{2212}"),
        first: ("roll by the inertial unit", &course(|s| s.roll_deg)),
        second: ("slope of the ground by the scanner, one scan each", &course(|s| s.seen_roll_deg)),
        shown_s: (0.0, samples.last().map_or(1.0, |s| s.seconds).min(SHOWN_S)),
        before: Some(("residual with the old delay", &before)),
        left: ("residual with the delay found, the whole test", &course(|s| s.after_deg)),
        left_axis: "residual, \u{b0}",
    };
    plot::courses(&courses, theme)
}
