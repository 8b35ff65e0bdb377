//! Two courses over time and what is left between them: the pictures of two attitude sources and of a rock test (the median-slope paper's
//! figures 2 and 5).

use plotters::coord::Shift;
use plotters::prelude::*;

use super::axes::{Axis, Mark, axes, legend, span, svg, thinned, title};
use super::{Error, Theme};

const SIZE: (u32, u32) = (1200, 760);

/// Points of a line beyond this many are thinned out.
const MOST_POINTS: usize = 1_500;

/// A quantity over time: seconds and degrees.
pub type Course = [(f64, f64)];

/// Two courses and their differences.
#[derive(Clone, Copy, Debug)]
pub struct Courses<'a> {
    /// Title.
    pub title: &'a str,
    /// The line below it.
    pub note: &'a str,
    /// Name and course of the first.
    pub first: (&'a str, &'a Course),
    /// Name and course of the second.
    pub second: (&'a str, &'a Course),
    /// The part of both that is shown, in seconds: all of a minute would be a blue bar.
    pub shown_s: (f64, f64),
    /// Name and course of what was left before, if there was a before.
    pub before: Option<(&'a str, &'a Course)>,
    /// Name and course of what is left.
    pub left: (&'a str, &'a Course),
    /// What the lower panel's axis says.
    pub left_axis: &'a str,
}

/// Draws two courses above what is left between them, as SVG.
///
/// # Errors
/// When the drawing library fails.
pub fn courses(courses: &Courses<'_>, theme: Theme) -> Result<String, Error> {
    svg(SIZE, |area| draw(area, courses, theme))
}

fn draw(area: &DrawingArea<SVGBackend<'_>, Shift>, shown: &Courses<'_>, theme: Theme) -> Result<(), Error> {
    let colours = theme.palette();
    title(area, &colours, shown.title, shown.note)?;
    let (from, to) = shown.shown_s;
    let within = |course: &Course| -> Vec<(f64, f64)> {
        course.iter().filter(|(seconds, _)| (from..=to).contains(seconds)).copied().collect()
    };
    let (first, second) = (within(shown.first.1), within(shown.second.1));
    let entries = [(Mark::Line(colours.points, 2), shown.first.0), (Mark::Dot(colours.opposing), shown.second.0)];
    legend(area, &colours, (30, 86), &entries)?;
    let (upper, lower) = area.margin(100, 8, 12, 30).split_vertically(330);
    let range = span(first.iter().chain(&second).map(|point| point.1), 0.5, 0.08);
    let (x, y) = (Axis::new((from, to), "seconds", 0), Axis::new(range, "roll, \u{b0}", 1));
    let mut chart = axes(&upper, &colours, &x, &y)?;
    chart.draw_series(LineSeries::new(first, colours.points.stroke_width(2)))?;
    chart.draw_series(second.iter().map(|at| Circle::new(*at, 2, colours.opposing.filled())))?;

    let mut entries = vec![(Mark::Line(colours.text, 1), shown.left.0)];
    if let Some((name, _)) = shown.before {
        entries.insert(0, (Mark::Line(colours.adjacent, 1), name));
    }
    let lower = lower.margin(34, 0, 0, 0);
    legend(area, &colours, (30, 452), &entries)?;
    let all = shown.before.iter().flat_map(|before| before.1).chain(shown.left.1);
    let values = span(all.clone().map(|point| point.1), 0.02, 0.08);
    let seconds = span(all.map(|point| point.0), 1.0, 0.0);
    let digits = if values.1 - values.0 < 0.5 { 2 } else { 1 };
    let (x, y) = (Axis::new(seconds, "seconds", 0), Axis::new(values, shown.left_axis, digits));
    let mut chart = axes(&lower, &colours, &x, &y)?;
    let line = |course: &Course| thinned(course, MOST_POINTS).copied().collect::<Vec<_>>();
    if let Some((_, before)) = shown.before {
        chart.draw_series(LineSeries::new(line(before), colours.adjacent.stroke_width(1)))?;
    }
    chart.draw_series(LineSeries::new(line(shown.left.1), colours.text.stroke_width(1)))?;
    Ok(())
}
