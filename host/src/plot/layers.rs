//! The ground under a rocked vehicle: as measured, with roll taken out, with roll and delay taken out (the median-slope paper's figure 6).
//!
//! The paper draws the three over each other; here each has a panel of its own with its own heights, as the last is a hundred times
//! flatter than the first.

use plotters::coord::Shift;
use plotters::prelude::*;

use super::axes::{Axis, axes, span, svg, thinned, title};
use super::{Error, Theme, text};
use crate::calibrate::Layers;
use crate::section::Place;

const SIZE: (u32, u32) = (1200, 900);

/// Dots of a panel beyond this many are thinned out.
const MOST_DOTS: usize = 800;

/// Draws the layers of a rock test as SVG.
///
/// # Errors
/// When the drawing library fails.
pub fn layers(layers: &Layers, heading: &str, note: &str, theme: Theme) -> Result<String, Error> {
    svg(SIZE, |area| draw(area, layers, heading, note, theme))
}

fn draw(
    area: &DrawingArea<SVGBackend<'_>, Shift>,
    layers: &Layers,
    heading: &str,
    note: &str,
    theme: Theme,
) -> Result<(), Error> {
    let colours = theme.palette();
    title(area, &colours, heading, note)?;
    let all: [(&str, &[Place], RGBColor); 3] = [
        ("as measured", &layers.raw, colours.adjacent),
        ("roll taken out, with the old calibration", &layers.compensated, colours.points),
        ("roll taken out beam by beam, with the offset and delay found", &layers.corrected, colours.opposing),
    ];
    let panels = area.margin(76, 8, 12, 30).split_evenly((3, 1));
    for (i, (panel, (name, places, colour))) in panels.iter().zip(all).enumerate() {
        let rms_mm = Layers::deviation_m(places) * 1e3;
        let about = format!("{name}: heights within {rms_mm:.0} mm RMS");
        panel.draw(&Text::new(about, (84, 6), text(17, colour)))?;
        let middle = places.iter().map(|(_, z)| z).sum::<f64>() / places.len().max(1) as f64;
        let range = span(places.iter().map(|(_, z)| (z - middle) * 1e3), 20.0, 0.06);
        let last = i + 1 == panels.len();
        let name = if last { "metres to the left (+) and right (\u{2212}) of the sensor" } else { "" };
        let x = Axis::across(3.0, name, 0);
        let y = Axis::new(range, "height, mm", 0);
        let mut chart = axes(&panel.margin(26, 0, 0, 0), &colours, &x, &y)?;
        // Seen from behind: the vehicle's left is on the left.
        let dots = thinned(places, MOST_DOTS).map(|(y, z)| Circle::new((-y, (z - middle) * 1e3), 1, colour.filled()));
        chart.draw_series(dots)?;
    }
    Ok(())
}
