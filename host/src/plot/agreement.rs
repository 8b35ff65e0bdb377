//! Slopes measured twice, one against the other: the median-slope paper's figure 7.

use plotters::coord::Shift;
use plotters::prelude::*;

use super::axes::{Axis, Mark, axes, legend, span, svg, thinned, title};
use super::{Error, Theme};
use crate::compare::manual::Held;
use crate::compare::{Dot, Kind};

const SIZE: (u32, u32) = (820, 860);

/// Dots beyond this many are thinned out.
const MOST_DOTS: usize = 1_600;

/// A slope measured twice.
#[derive(Clone, Copy, Debug)]
pub struct Twice {
    /// Which slope.
    pub kind: Kind,
    /// The measurement that the other is held against, in degrees.
    pub first_deg: f64,
    /// The other, in degrees.
    pub other_deg: f64,
    /// Half width of the other's 95 % interval or of its spread, if it is to be shown.
    pub half_deg: Option<f64>,
}

impl From<&Dot> for Twice {
    fn from(dot: &Dot) -> Self {
        Self { kind: dot.kind, first_deg: dot.first_deg, other_deg: dot.other_deg, half_deg: None }
    }
}

impl From<&Held> for Twice {
    fn from(held: &Held) -> Self {
        Self { kind: held.slope, first_deg: held.manual_deg, other_deg: held.measured_deg, half_deg: None }
    }
}

/// What the picture says.
#[derive(Clone, Copy, Debug)]
pub struct Words<'a> {
    /// Title.
    pub title: &'a str,
    /// The line below it.
    pub note: &'a str,
    /// What the first measurement is.
    pub first: &'a str,
    /// What the other is.
    pub other: &'a str,
}

/// Draws slopes measured twice as SVG, with the line on which both agree.
///
/// # Errors
/// When the drawing library fails.
pub fn agreement<S>(slopes: impl IntoIterator<Item = S>, words: &Words<'_>, theme: Theme) -> Result<String, Error>
where
    Twice: From<S>,
{
    let slopes: Vec<_> = slopes.into_iter().map(Twice::from).collect();
    svg(SIZE, |area| draw(area, &slopes, words, theme))
}

fn draw(
    area: &DrawingArea<SVGBackend<'_>, Shift>,
    slopes: &[Twice],
    words: &Words<'_>,
    theme: Theme,
) -> Result<(), Error> {
    let colours = theme.palette();
    title(area, &colours, words.title, words.note)?;
    let colour = |kind: Kind| if kind == Kind::Adjacent { colours.adjacent } else { colours.opposing };
    let mut entries = vec![(Mark::Line(colours.faint, 2), "equal")];
    for (kind, mark, name) in [
        (Kind::Opposing, Mark::Ring(colours.opposing), "opposing slope"),
        (Kind::Adjacent, Mark::Dot(colours.adjacent), "adjacent slope"),
    ] {
        if slopes.iter().any(|slope| slope.kind == kind) {
            entries.insert(0, (mark, name));
        }
    }
    legend(area, &colours, (30, 86), &entries)?;
    let range = span(slopes.iter().flat_map(|slope| [slope.first_deg, slope.other_deg]), 2.0, 0.05);
    let panel = area.margin(104, 10, 10, 20);
    let (x, y) = (Axis::new(range, words.first, 0), Axis::new(range, words.other, 0));
    let mut chart = axes(&panel, &colours, &x, &y)?;
    chart.draw_series([PathElement::new([(range.0, range.0), (range.1, range.1)], colours.faint.stroke_width(2))])?;
    for slope in thinned(slopes, MOST_DOTS) {
        let (at, colour) = ((slope.first_deg, slope.other_deg), colour(slope.kind));
        if let Some(half) = slope.half_deg {
            let ends = [(at.0, at.1 - half), (at.0, at.1 + half)];
            chart.draw_series([PathElement::new(ends, colour.stroke_width(1))])?;
        }
        let size = if slopes.len() > 200 { 2 } else { 4 };
        let style: ShapeStyle =
            if slope.kind == Kind::Adjacent { colour.mix(0.7).filled() } else { colour.stroke_width(1) };
        chart.draw_series([Circle::new(at, size, style)])?;
    }
    Ok(())
}
