//! The slope of small pieces along one section, beside the slopes that its profile gives.

use plotters::coord::Shift;
use plotters::prelude::*;

use super::axes::{Mark, across_road, legend, span, svg, title as headed};
use super::{Error, Theme, signed};
use crate::section::{Part, Section, local_slopes};

const SIZE: (u32, u32) = (1200, 580);

/// Width of the window in which a slope is taken: a four-foot level, the tool that surveys by hand use.
pub const LEVEL_M: f64 = 1.22;

/// Draws the slope of small pieces along a section beside the slopes that the profile gives (figure 9a of the median-slope paper).
///
/// # Errors
/// When the drawing library fails.
pub fn variation(section: &Section, title: &str, theme: Theme) -> Result<String, Error> {
    svg(SIZE, |area| draw(area, section, title, theme))
}

fn draw(area: &DrawingArea<SVGBackend<'_>, Shift>, section: &Section, title: &str, theme: Theme) -> Result<(), Error> {
    let colours = theme.palette();
    let note = "lines: what the profile gives, with their 95 % intervals where these are wider than the line";
    headed(area, &colours, title, note)?;
    let entries = [
        (Mark::Line(colours.points, 2), "each piece of 1.22 m (a four-foot level)"),
        (Mark::Line(colours.road, 3), "road"),
        (Mark::Line(colours.adjacent, 3), "adjacent slope"),
        (Mark::Line(colours.opposing, 3), "opposing slope"),
    ];
    legend(area, &colours, (30, 86), &entries)?;
    let lines = section.lines();
    let outer = lines.iter().map(|line| line.outer.0.abs()).fold(8.0, f64::max);
    let reach = (outer * 1.08).min(30.0);
    let local: Vec<_> =
        local_slopes(&section.levelled, LEVEL_M).into_iter().filter(|one| one.0.abs() <= reach).collect();
    let (low, high) = span(lines.iter().map(|line| line.slope_deg).chain([0.0]), 4.0, 0.35);
    let plot = area.margin(108, 16, 20, 30);
    let mut chart = across_road(&plot, &colours, reach, (low, high), "degrees, rising outward", &|z| {
        if z.abs() < 1e-9 { "0".to_owned() } else { signed(*z, 0) }
    })?;
    // Windows that lie on two surfaces, and the vehicle's own middle, where outward changes sides, break the line.
    for run in local.chunk_by(|a, b| b.0 - a.0 < 0.25 && (a.0 < 0.0) == (b.0 < 0.0)) {
        let inside = run.iter().map(|&(y, slope)| (-y, slope.clamp(low, high)));
        chart.draw_series(LineSeries::new(inside, colours.points.stroke_width(2)))?;
    }
    for line in &lines {
        let colour = match line.part {
            Part::Road => colours.road,
            Part::Adjacent => colours.adjacent,
            Part::Opposing => colours.opposing,
        };
        let half = line.ci95_deg.unwrap_or_default();
        let (from, to) = (-line.inner.0, -line.outer.0);
        let band =
            Rectangle::new([(from, line.slope_deg - half), (to, line.slope_deg + half)], colour.mix(0.25).filled());
        chart.draw_series([band])?;
        chart
            .draw_series([PathElement::new([(from, line.slope_deg), (to, line.slope_deg)], colour.stroke_width(3))])?;
    }
    Ok(())
}
