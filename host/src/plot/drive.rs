//! The slopes along a road, of one drive with intervals and truth or of several over each other.
//!
//! What is drawn is what a screen can show: scans are gathered into places two pixels wide, each with its robust mean, its interval and the spread of
//! its scans. A picture is 150 kB at most, however long the drive.

use plotters::coord::Shift;
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};

use super::axes::{names_in_row, number, span, svg};
use super::{Error, Palette, Theme, text};
use crate::drive::Unit;
use crate::intervals::{Estimate, Sample, Samples};

const SIZE: (u32, u32) = (1200, 900);

/// Places along the picture.
const PLACES: f64 = 540.0;

/// One slope along the road.
#[derive(Clone, Debug, Default)]
pub struct Series {
    /// What it is, for example `left adjacent slope`.
    pub name: String,
    /// Each drive's: place along the road in its unit, slope in degrees, half width of the 95 % interval in degrees.
    pub drives: Vec<Vec<(f64, f64, f64)>>,
    /// The truth, in the order of the road.
    pub truth: Vec<TruthAt>,
}

/// Place along the road in its unit, slope in degrees.
pub type TruthAt = (f64, f64);

/// Draws slopes along a road as SVG, one panel each.
///
/// `names` are those of the drives, told where there are several; scans are gathered into places of `least` or longer, in the unit.
///
/// # Errors
/// When the drawing library fails.
pub fn drive(series: &[Series], names: &[String], unit: Unit, least: f64, theme: Theme) -> Result<String, Error> {
    svg(SIZE, |area| draw_all(area, series, names, unit, least, theme))
}

fn draw_all(
    area: &DrawingArea<SVGBackend<'_>, Shift>,
    series: &[Series],
    names: &[String],
    unit: Unit,
    least: f64,
    theme: Theme,
) -> Result<(), Error> {
    let colours = theme.palette();
    area.fill(&colours.ground)?;
    area.draw(&Text::new(unit.heading(), (24, 18), text(24, colours.text)))?;
    let places =
        || series.iter().flat_map(|s| s.drives.iter().flatten().map(|m| m.0).chain(s.truth.iter().map(|t| t.0)));
    let (from, to) = span(places(), 1.0, 0.0);
    let width = ((to - from) / PLACES).max(least);
    let width = if unit == Unit::Metres { width } else { width.ceil() };
    let along = Along { unit, from, to, width };
    legend(area, &colours, names, &along, series.iter().any(|series| !series.truth.is_empty()))?;
    let panels = area.margin(76, 8, 12, 30).split_evenly((series.len().max(1), 1));
    for (i, (panel, series)) in panels.iter().zip(series).enumerate() {
        draw(panel, series, &colours, &along, i + 1 == panels.len())?;
    }
    Ok(())
}

/// The axis that all panels share.
struct Along {
    unit: Unit,
    from: f64,
    to: f64,
    /// Length of a place.
    width: f64,
}

fn legend(
    area: &DrawingArea<SVGBackend<'_>, Shift>,
    colours: &Palette,
    names: &[String],
    along: &Along,
    truth: bool,
) -> Result<(), Error> {
    let y = 56;
    if names.len() > 1 {
        let names: Vec<&str> = names.iter().map(String::as_str).collect();
        for ((x, name), colour) in names_in_row(&names, 32, SIZE.0).into_iter().zip(colours.several()) {
            area.draw(&PathElement::new([(x, y), (x + 24, y)], colour.stroke_width(3)))?;
            area.draw(&Text::new(name, (x + 32, y - 6), text(16, colours.text)))?;
        }
        return Ok(());
    }
    let digits = usize::from(along.unit == Unit::Metres && along.width < 9.5);
    let each = format!("{:.digits$} {}", along.width, along.unit.name());
    area.draw(&PathElement::new([(34, y), (58, y)], colours.points.stroke_width(2)))?;
    area.draw(&Text::new(format!("mean of each {each}"), (66, y - 6), text(16, colours.text)))?;
    area.draw(&Rectangle::new([(250, y - 7), (274, y + 7)], colours.points.mix(0.45).filled()))?;
    area.draw(&Text::new("95 % interval", (282, y - 6), text(16, colours.text)))?;
    area.draw(&Rectangle::new([(410, y - 7), (434, y + 7)], colours.points.mix(0.16).filled()))?;
    area.draw(&Text::new("two standard deviations of scans", (442, y - 6), text(16, colours.text)))?;
    if truth {
        area.draw(&PathElement::new([(730, y), (754, y)], truth_style(colours)))?;
        area.draw(&Text::new("truth", (762, y - 6), text(16, colours.text)))?;
    }
    Ok(())
}

fn draw(
    panel: &DrawingArea<SVGBackend<'_>, Shift>,
    series: &Series,
    colours: &Palette,
    &Along { unit, from, to, width }: &Along,
    last: bool,
) -> Result<(), Error> {
    let gathered: Vec<Vec<(f64, Estimate)>> = series.drives.iter().map(|drive| gather(drive, from, width)).collect();
    // The scale follows the bulk of the slopes: one stray interval must not flatten the rest.
    let mut slopes: Vec<f64> =
        gathered.iter().flatten().map(|m| m.1.value).chain(series.truth.iter().map(|t| t.1)).collect();
    slopes.sort_by(f64::total_cmp);
    let trimmed = slopes.len() / 200;
    let bulk = slopes.get(trimmed..slopes.len() - trimmed).unwrap_or(&slopes);
    let (low, high) = span(bulk.iter().copied(), 0.5, 0.12);
    let mut chart = ChartBuilder::on(panel)
        .margin_top(6)
        .x_label_area_size(if last { 48 } else { 10 })
        .y_label_area_size(70)
        .build_cartesian_2d(from..to, low..high)?;
    let digits = usize::from(to - from < 10.0);
    let place = |x: &f64| number(*x, digits);
    let mut mesh = chart.configure_mesh();
    mesh.light_line_style(colours.ground)
        .bold_line_style(colours.grid)
        .axis_style(colours.faint)
        .x_labels(12)
        .y_labels(5)
        .y_label_formatter(&|z| number(*z, 1))
        .x_label_formatter(&place)
        .label_style(text(15, colours.text))
        .axis_desc_style(text(16, colours.text))
        .y_desc(format!("{}, \u{b0}", series.name));
    if last {
        mesh.x_desc(unit.axis());
    } else {
        mesh.x_labels(12).x_label_formatter(&|_| String::new());
    }
    mesh.draw()?;
    // Wide and underneath: the measurement lies on it, or visibly does not.
    if !series.truth.is_empty() {
        let mut next = f64::MIN;
        let shown = series.truth.iter().filter(|(x, _)| {
            let due = *x >= next;
            next = if due { x + width } else { next };
            due
        });
        let line = shown.map(|&(x, slope)| (x, slope.clamp(low, high)));
        chart.draw_series(LineSeries::new(line, truth_style(colours)))?;
    }
    if slopes.is_empty() {
        let style = text(16, colours.text).pos(Pos::new(HPos::Center, VPos::Center));
        chart.draw_series([Text::new("found nowhere", ((from + to) / 2.0, (low + high) / 2.0), style)])?;
    }
    let several = gathered.len() > 1;
    for (drive, colour) in gathered.iter().zip(colours.several()) {
        for stretch in stretches(drive, width) {
            if let [(x, one)] = stretch {
                // No band can be drawn over one place: its interval and spread are bars.
                for (half, share) in [(spread(one), 0.16), (interval(one), 0.45)].into_iter().filter(|_| !several) {
                    let ends = [-half, half].map(|half| (*x, (one.value + half).clamp(low, high)));
                    chart.draw_series([PathElement::new(ends, colour.mix(share).stroke_width(3))])?;
                }
                chart.draw_series([Circle::new((*x, one.value.clamp(low, high)), 2, colour.filled())])?;
                continue;
            }
            if !several {
                for (half, share) in [(spread as fn(&Estimate) -> f64, 0.16), (interval, 0.45)] {
                    let upper = stretch.iter().map(|(x, one)| (*x, (one.value + half(one)).clamp(low, high)));
                    let lower = stretch.iter().rev().map(|(x, one)| (*x, (one.value - half(one)).clamp(low, high)));
                    let band = Polygon::new(upper.chain(lower).collect::<Vec<_>>(), colour.mix(share).filled());
                    chart.draw_series([band])?;
                }
            }
            let line = stretch.iter().map(|(x, one)| (*x, one.value.clamp(low, high)));
            chart.draw_series(LineSeries::new(line, colour.stroke_width(2)))?;
        }
    }
    Ok(())
}

fn spread(one: &Estimate) -> f64 {
    2.0 * one.sd
}

fn interval(one: &Estimate) -> f64 {
    one.ci95
}

/// Gathers slopes into places of a width.
fn gather(measured: &[(f64, f64, f64)], from: f64, width: f64) -> Vec<(f64, Estimate)> {
    let number = |x: f64| ((x - from) / width).floor();
    measured
        .chunk_by(|a, b| number(a.0) == number(b.0))
        .filter_map(|place| {
            let mut samples = Samples::default();
            place.iter().for_each(|&(at, slope, half)| samples.push(Sample::new(slope, half, at)));
            let middle = place.iter().map(|one| one.0).sum::<f64>() / place.len() as f64;
            Some((middle, samples.estimate()?))
        })
        .collect()
}

fn truth_style(colours: &Palette) -> ShapeStyle {
    colours.adjacent.mix(0.55).stroke_width(6)
}

/// Runs of places without a gap of more than five metres (or scans) or three places, which no band may bridge.
fn stretches(places: &[(f64, Estimate)], width: f64) -> impl Iterator<Item = &[(f64, Estimate)]> {
    let gap = (3.0 * width).max(5.0);
    places.chunk_by(move |a, b| (b.0 - a.0).abs() < gap)
}
