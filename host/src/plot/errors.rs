//! Histograms of slopes' errors against a known truth.

use plotters::coord::Shift;
use plotters::prelude::*;

use super::axes::svg;
use super::{Error, Theme, signed, text};
use crate::statistics::rms;

const SIZE: (u32, u32) = (1200, 660);

/// Bars of a histogram.
const BARS: usize = 61;

/// Draws histograms of errors in degrees, one panel each.
///
/// # Errors
/// When the drawing library fails.
pub fn errors(kinds: &[(String, Vec<f64>)], title: &str, theme: Theme) -> Result<String, Error> {
    svg(SIZE, |area| draw(area, kinds, title, theme))
}

fn draw(
    area: &DrawingArea<SVGBackend<'_>, Shift>,
    kinds: &[(String, Vec<f64>)],
    title: &str,
    theme: Theme,
) -> Result<(), Error> {
    let colours = theme.palette();
    area.fill(&colours.ground)?;
    area.draw(&Text::new(title.to_owned(), (24, 18), text(24, colours.text)))?;
    // One scale for all, to the 99.5th percentile of them: what lies beyond is counted at its borders, and told.
    let mut sizes: Vec<f64> = kinds.iter().flat_map(|(_, errors)| errors.iter().map(|e| e.abs())).collect();
    sizes.sort_by(f64::total_cmp);
    let reach = sizes.get(sizes.len() * 199 / 200).copied().unwrap_or(0.1).max(0.01) * 1.15;
    let beyond = sizes.len() - sizes.partition_point(|size| *size <= reach);
    if beyond > 0 {
        let note = format!(
            "{beyond} of {} errors are greater than {reach:.2}\u{b0}: they are counted in the outermost bars",
            sizes.len()
        );
        area.draw(&Text::new(note, (24, 48), text(16, colours.text)))?;
    }
    let panels = area.margin(78, 8, 12, 24).split_evenly((kinds.len().div_ceil(2).max(1), 2));
    for (panel, (name, errors)) in panels.iter().zip(kinds) {
        let mut bars = [0_u32; BARS];
        for error in errors {
            let place = (error / reach + 1.0) / 2.0 * BARS as f64;
            bars[(place as usize).min(BARS - 1)] += 1;
        }
        let count = errors.len().max(1) as f64;
        let rms = rms(errors.iter().copied());
        let mean = errors.iter().sum::<f64>() / count;
        let tallest = f64::from(bars.iter().copied().max().unwrap_or_default().max(1));
        let mut chart = ChartBuilder::on(panel)
            .margin(8)
            .margin_top(38)
            .x_label_area_size(44)
            .y_label_area_size(56)
            .build_cartesian_2d(-reach..reach, 0.0..tallest * 1.08)?;
        chart
            .configure_mesh()
            .light_line_style(colours.ground)
            .bold_line_style(colours.grid)
            .axis_style(colours.faint)
            .x_labels(7)
            .y_labels(5)
            .x_label_formatter(&|x| if x.abs() < 1e-9 { "0".to_owned() } else { signed(*x, 2) })
            .y_label_formatter(&|n| format!("{n:.0}"))
            .label_style(text(15, colours.text))
            .axis_desc_style(text(16, colours.text))
            .x_desc("error, degrees")
            .y_desc("scans")
            .draw()?;
        let width = 2.0 * reach / BARS as f64;
        chart.draw_series(bars.iter().enumerate().map(|(i, n)| {
            let from = -reach + i as f64 * width;
            Rectangle::new([(from, 0.0), (from + width * 0.92, f64::from(*n))], colours.points.filled())
        }))?;
        let told = format!("{name}: RMS {rms:.3}\u{b0}, mean {}\u{b0}", signed(mean, 3));
        panel.draw(&Text::new(told, (66, 12), text(16, colours.text)))?;
    }
    Ok(())
}
