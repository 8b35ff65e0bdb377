//! The levelled returns of several runs at one place over each other.

use plotters::coord::Shift;
use plotters::prelude::*;

use super::axes::{across_road, names_in_row, span, svg};
use super::{Error, Theme, signed, text};
use crate::section::{Place, Section};
use crate::statistics::upper_median;

const SIZE: (u32, u32) = (1200, 560);

/// Draws the levelled returns of several runs at one place over each other (figure 8). Heights are taken from the road under each sensor, so
/// that the runs lie on each other whatever their springs did.
///
/// # Errors
/// When the drawing library fails.
pub fn runs(runs: &[(String, Section)], title: &str, theme: Theme) -> Result<String, Error> {
    svg(SIZE, |area| draw(area, runs, title, theme))
}

fn draw(
    area: &DrawingArea<SVGBackend<'_>, Shift>,
    runs: &[(String, Section)],
    title: &str,
    theme: Theme,
) -> Result<(), Error> {
    let colours = theme.palette();
    area.fill(&colours.ground)?;
    area.draw(&Text::new(title.to_owned(), (24, 18), text(24, colours.text)))?;
    // The first as dots, those after it as rings around them: runs that agree do not hide each other.
    let mark = |run: usize, colour: RGBColor| match run {
        0 => (2, colour.filled()),
        _ => (2 + 2 * run as i32, colour.stroke_width(1)),
    };
    let names: Vec<&str> = runs.iter().map(|(name, _)| name.as_str()).collect();
    for ((run, (x, name)), colour) in names_in_row(&names, 22, SIZE.0).into_iter().enumerate().zip(colours.several()) {
        let (size, style) = mark(run, colour);
        area.draw(&Circle::new((x + 8, 62), size.max(4), style))?;
        area.draw(&Text::new(name, (x + 22, 56), text(16, colours.text)))?;
    }
    let lowered: Vec<Vec<Place>> = runs.iter().map(|(_, section)| from_road(&section.levelled)).collect();
    let outer = runs.iter().flat_map(|(_, section)| section.lines()).map(|line| line.outer.0.abs()).fold(8.0, f64::max);
    let reach = (outer * 1.12).min(30.0);
    let seen = || lowered.iter().flatten().filter(|place| place.0.abs() <= reach);
    let (low, high) = span(seen().map(|place| place.1), 1.0, 0.1);
    let plot = area.margin(86, 16, 20, 30);
    let mut chart = across_road(&plot, &colours, reach, (low, high), "metres above the road", &|z| {
        if z.abs() < 1e-9 { "0".to_owned() } else { signed(*z, 1) }
    })?;
    for (run, (places, colour)) in lowered.iter().zip(colours.several()).enumerate() {
        let inside = places.iter().filter(|place| place.0.abs() <= reach);
        let (size, style) = mark(run, colour);
        chart.draw_series(inside.map(|&(y, z)| Circle::new((-y, z), size, style)))?;
    }
    Ok(())
}

/// Heights from the median of the returns within a metre of straight down.
fn from_road(places: &[Place]) -> Vec<Place> {
    let mut under: Vec<f64> = places.iter().filter(|place| place.0.abs() < 1.0).map(|place| place.1).collect();
    let road = upper_median(&mut under).unwrap_or_default();
    places.iter().map(|&(y, z)| (y, z - road)).collect()
}
