//! How much a slope varies within one section, and along a road (the median-slope paper's figure 9).

use plotters::coord::Shift;
use plotters::prelude::*;

use super::axes::{Axis, Mark, axes, legend, span, svg, thinned, title};
use super::{Error, Theme};

const SIZE: (u32, u32) = (1200, 820);

/// The slope of a section by the reach of a manual instrument, and of the road by single scans.
#[derive(Clone, Debug, Default)]
pub struct Across {
    /// Lateral distance in metres and true slope of what an inclinometer's length covers, in degrees.
    pub truth: Vec<(f64, f64)>,
    /// The same by the scans of one place.
    pub measured: Vec<(f64, f64)>,
    /// The same by hand.
    pub manual: Vec<(f64, f64)>,
    /// The whole slope by one scan: where it begins and ends, in metres, and its slope.
    pub whole: Option<(f64, f64, f64)>,
    /// Metres along the road and slope of single scans, in degrees.
    pub along: Vec<(f64, f64)>,
    /// The true slope there.
    pub along_truth: Vec<(f64, f64)>,
}

/// Draws the variation of a slope across a section and along the road, as SVG.
///
/// # Errors
/// When the drawing library fails.
pub fn across(shown: &Across, heading: &str, note: &str, theme: Theme) -> Result<String, Error> {
    svg(SIZE, |area| draw(area, shown, heading, note, theme))
}

fn draw(
    area: &DrawingArea<SVGBackend<'_>, Shift>,
    shown: &Across,
    heading: &str,
    note: &str,
    theme: Theme,
) -> Result<(), Error> {
    let colours = theme.palette();
    title(area, &colours, heading, note)?;
    let entries = [
        (Mark::Line(colours.faint, 5), "truth over 1.22 m"),
        (Mark::Dot(colours.points), "scanned, over 1.22 m"),
        (Mark::Ring(colours.opposing), "by hand"),
        (Mark::Line(colours.adjacent, 3), "the whole slope, by one scan"),
    ];
    legend(area, &colours, (30, 86), &entries)?;
    let (upper, lower) = area.margin(100, 8, 12, 30).split_vertically(350);
    let every = shown.truth.iter().chain(&shown.measured).chain(&shown.manual);
    let whole = shown.whole.map(|(_, _, slope)| slope);
    let range = span(every.clone().map(|at| at.1).chain(whole), 0.5, 0.1);
    let places = span(every.map(|at| at.0), 1.0, 0.03);
    let (x, y) =
        (Axis::new(places, "metres from the sensor", 1), Axis::new(range, "slope within one section, \u{b0}", 1));
    let mut chart = axes(&upper, &colours, &x, &y)?;
    chart.draw_series(LineSeries::new(shown.truth.iter().copied(), colours.faint.stroke_width(5)))?;
    if let Some((from, to, slope)) = shown.whole {
        chart.draw_series([PathElement::new([(from, slope), (to, slope)], colours.adjacent.stroke_width(3))])?;
    }
    chart.draw_series(shown.measured.iter().map(|at| Circle::new(*at, 4, colours.points.filled())))?;
    chart.draw_series(shown.manual.iter().map(|at| Circle::new(*at, 6, colours.opposing.stroke_width(2))))?;

    let entries = [(Mark::Line(colours.faint, 5), "truth"), (Mark::Dot(colours.points), "one scan each")];
    legend(area, &colours, (30, 470), &entries)?;
    let lower = lower.margin(34, 0, 0, 0);
    let range = span(shown.along.iter().chain(&shown.along_truth).map(|at| at.1), 0.5, 0.06);
    let places = span(shown.along_truth.iter().map(|at| at.0), 1.0, 0.0);
    let (x, y) = (Axis::new(places, "metres along the road", 0), Axis::new(range, "adjacent slope, \u{b0}", 1));
    let mut chart = axes(&lower, &colours, &x, &y)?;
    let truth: Vec<_> = thinned(&shown.along_truth, 1_000).copied().collect();
    chart.draw_series(LineSeries::new(truth, colours.faint.stroke_width(5)))?;
    chart.draw_series(thinned(&shown.along, 1_200).map(|at| Circle::new(*at, 2, colours.points.filled())))?;
    Ok(())
}
