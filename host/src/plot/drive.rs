//! The slopes along a drive, with their intervals and, where it is known, the truth.

use plotters::coord::Shift;
use plotters::prelude::*;

use super::{Error, Palette, Theme, text};

const SIZE: (u32, u32) = (1200, 900);

/// One slope along the drive.
#[derive(Clone, Debug, Default)]
pub struct Series {
    /// What it is, for example `left adjacent slope`.
    pub name: String,
    /// Place along the road in metres, slope in degrees, half width of the 95 % interval in degrees.
    pub measured: Vec<(f64, f64, f64)>,
    /// The truth, in the order of the road.
    pub truth: Vec<TruthAt>,
}

/// Place along the road in metres, slope in degrees.
pub type TruthAt = (f64, f64);

/// Draws slopes along a drive as SVG, one panel each.
///
/// # Errors
/// When the drawing library fails.
pub fn drive(series: &[Series], title: &str, theme: Theme) -> Result<String, Error> {
    let mut svg = String::new();
    let area = SVGBackend::with_string(&mut svg, SIZE).into_drawing_area();
    let colours = theme.palette();
    area.fill(&colours.ground)?;
    area.draw(&Text::new(title.to_owned(), (24, 18), text(24, colours.text)))?;
    legend(&area, &colours, series.iter().any(|series| !series.truth.is_empty()))?;
    let panels = area.margin(76, 8, 12, 30).split_evenly((series.len().max(1), 1));
    for (i, (panel, series)) in panels.iter().zip(series).enumerate() {
        draw(panel, series, &colours, i + 1 == panels.len())?;
    }
    area.present()?;
    drop((area, panels));
    Ok(svg)
}

fn legend(area: &DrawingArea<SVGBackend<'_>, Shift>, colours: &Palette, truth: bool) -> Result<(), Error> {
    let y = 56;
    area.draw(&Circle::new((34, y), 3, colours.points.filled()))?;
    area.draw(&Text::new("measured, one scan each", (46, y - 6), text(16, colours.text)))?;
    area.draw(&Rectangle::new([(250, y - 7), (274, y + 7)], colours.points.mix(0.3).filled()))?;
    area.draw(&Text::new("95 % interval", (282, y - 6), text(16, colours.text)))?;
    if truth {
        area.draw(&PathElement::new([(410, y), (434, y)], truth_style(colours)))?;
        area.draw(&Text::new("truth", (442, y - 6), text(16, colours.text)))?;
    }
    Ok(())
}

fn draw(
    panel: &DrawingArea<SVGBackend<'_>, Shift>,
    series: &Series,
    colours: &Palette,
    last: bool,
) -> Result<(), Error> {
    let places = series.measured.iter().map(|m| m.0).chain(series.truth.iter().map(|t| t.0));
    let (from, to) = span(places, 1.0, 0.0);
    // The scale follows the bulk of the slopes: one stray interval must not flatten the rest.
    let mut slopes: Vec<f64> = series.measured.iter().map(|m| m.1).chain(series.truth.iter().map(|t| t.1)).collect();
    slopes.sort_by(f64::total_cmp);
    let trimmed = slopes.len() / 200;
    let bulk = slopes.get(trimmed..slopes.len() - trimmed).unwrap_or(&slopes);
    let (low, high) = span(bulk.iter().copied(), 0.5, 0.12);
    let mut chart = ChartBuilder::on(panel)
        .margin_top(6)
        .x_label_area_size(if last { 48 } else { 10 })
        .y_label_area_size(70)
        .build_cartesian_2d(from..to, low..high)?;
    let mut mesh = chart.configure_mesh();
    mesh.light_line_style(colours.ground)
        .bold_line_style(colours.grid)
        .axis_style(colours.faint)
        .x_labels(12)
        .y_labels(5)
        .y_label_formatter(&|z| if *z < 0.0 { format!("\u{2212}{:.1}", -z) } else { format!("{z:.1}") })
        .x_label_formatter(&|x| format!("{x:.0}"))
        .label_style(text(15, colours.text))
        .axis_desc_style(text(16, colours.text))
        .y_desc(format!("{}, \u{b0}", series.name));
    if last {
        mesh.x_desc("metres along the road");
    } else {
        mesh.x_labels(12).x_label_formatter(&|_| String::new());
    }
    mesh.draw()?;
    // Wide and underneath: the points lie on it, or visibly do not.
    if !series.truth.is_empty() {
        let line = series.truth.iter().map(|&(x, slope)| (x, slope.clamp(low, high)));
        chart.draw_series(LineSeries::new(line, truth_style(colours)))?;
    }
    for stretch in stretches(&series.measured) {
        let upper = stretch.iter().map(|&(x, slope, half)| (x, (slope + half).clamp(low, high)));
        let lower = stretch.iter().rev().map(|&(x, slope, half)| (x, (slope - half).clamp(low, high)));
        chart.draw_series([Polygon::new(upper.chain(lower).collect::<Vec<_>>(), colours.points.mix(0.3).filled())])?;
    }
    let inside = series.measured.iter().filter(|m| (low..=high).contains(&m.1));
    chart.draw_series(inside.map(|&(x, slope, _)| Circle::new((x, slope), 1, colours.points.filled())))?;
    Ok(())
}

fn truth_style(colours: &Palette) -> ShapeStyle {
    colours.adjacent.mix(0.45).stroke_width(6)
}

/// The least and greatest of some values, at least `least` apart, with a share of room around.
fn span(values: impl Iterator<Item = f64>, least: f64, room: f64) -> (f64, f64) {
    let (low, high) = values.fold((f64::MAX, f64::MIN), |(low, high), v| (low.min(v), high.max(v)));
    if low > high {
        return (0.0, least);
    }
    let missing = (least - (high - low)).max(0.0) / 2.0;
    let around = (high - low) * room;
    (low - missing - around, high + missing + around)
}

/// Runs of measurements without a gap of more than five metres, which no band may bridge.
fn stretches(measured: &[(f64, f64, f64)]) -> impl Iterator<Item = &[(f64, f64, f64)]> {
    measured.chunk_by(|a, b| b.0 - a.0 < 5.0).filter(|stretch| stretch.len() > 1)
}
