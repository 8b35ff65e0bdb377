//! Pictures beside the section and the drive: variation along a section, runs over each other, errors.

use plotters::prelude::*;

use super::axes::{across_road, title as headed};
use super::drive::span;
use super::{Error, Theme, signed, text};
use crate::section::{Part, Place, Section, local_slopes};

const SIZE: (u32, u32) = (1200, 560);

/// Width of the window in which a slope is taken: a four-foot level, the tool that surveys by hand use.
pub const LEVEL_M: f64 = 1.22;

/// Draws the slope of small pieces along a section beside the slopes that the profile gives (figure 9a of the median-slope paper).
///
/// # Errors
/// When the drawing library fails.
pub fn variation(section: &Section, title: &str, theme: Theme) -> Result<String, Error> {
    let mut svg = String::new();
    let area = SVGBackend::with_string(&mut svg, SIZE).into_drawing_area();
    let colours = theme.palette();
    let note = "slope of each piece of 1.22 m (a four-foot level); lines: what the profile gives, with 95 % intervals";
    headed(&area, &colours, title, note)?;
    let lines = section.lines();
    let outer = lines.iter().map(|line| line.outer.0.abs()).fold(8.0, f64::max);
    let reach = (outer * 1.08).min(30.0);
    let local: Vec<_> =
        local_slopes(&section.levelled, LEVEL_M).into_iter().filter(|one| one.0.abs() <= reach).collect();
    let (low, high) = span(lines.iter().map(|line| line.slope_deg).chain([0.0]), 4.0, 0.35);
    let plot = area.margin(86, 16, 20, 30);
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
    area.present()?;
    drop((area, plot, chart));
    Ok(svg)
}

/// Draws the levelled returns of several runs at one place over each other (figure 8). Heights are taken from the road under each sensor, so
/// that the runs lie on each other whatever their springs did.
///
/// # Errors
/// When the drawing library fails.
pub fn runs(runs: &[(String, Section)], title: &str, theme: Theme) -> Result<String, Error> {
    let mut svg = String::new();
    let area = SVGBackend::with_string(&mut svg, SIZE).into_drawing_area();
    let colours = theme.palette();
    area.fill(&colours.ground)?;
    area.draw(&Text::new(title.to_owned(), (24, 18), text(24, colours.text)))?;
    let mut x = 34;
    // The first as dots, those after it as rings around them: runs that agree do not hide each other.
    let mark = |run: usize, colour: RGBColor| match run {
        0 => (2, colour.filled()),
        _ => (2 + 2 * run as i32, colour.stroke_width(1)),
    };
    for (run, ((name, _), colour)) in runs.iter().zip(colours.several()).enumerate() {
        let (size, style) = mark(run, colour);
        area.draw(&Circle::new((x, 62), size.max(4), style))?;
        area.draw(&Text::new(name.clone(), (x + 12, 56), text(16, colours.text)))?;
        x += 44 + 9 * name.chars().count() as i32;
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
    area.present()?;
    drop((area, plot, chart));
    Ok(svg)
}

/// Heights from the median of the returns within a metre of straight down.
fn from_road(places: &[Place]) -> Vec<Place> {
    let mut under: Vec<f64> = places.iter().filter(|place| place.0.abs() < 1.0).map(|place| place.1).collect();
    under.sort_by(f64::total_cmp);
    let road = under.get(under.len() / 2).copied().unwrap_or_default();
    places.iter().map(|&(y, z)| (y, z - road)).collect()
}

/// Draws histograms of errors in degrees, one panel each.
///
/// # Errors
/// When the drawing library fails.
pub fn errors(kinds: &[(String, Vec<f64>)], title: &str, theme: Theme) -> Result<String, Error> {
    let mut svg = String::new();
    let area = SVGBackend::with_string(&mut svg, (1200, 640)).into_drawing_area();
    let colours = theme.palette();
    area.fill(&colours.ground)?;
    area.draw(&Text::new(title.to_owned(), (24, 18), text(24, colours.text)))?;
    // One scale for all, to the 99.5th percentile of them: what lies beyond is counted at its borders.
    let mut sizes: Vec<f64> = kinds.iter().flat_map(|(_, errors)| errors.iter().map(|e| e.abs())).collect();
    sizes.sort_by(f64::total_cmp);
    let reach = sizes.get(sizes.len() * 199 / 200).copied().unwrap_or(0.1).max(0.01) * 1.15;
    const BARS: usize = 61;
    let panels = area.margin(56, 8, 12, 24).split_evenly((kinds.len().div_ceil(2).max(1), 2));
    for (panel, (name, errors)) in panels.iter().zip(kinds) {
        let mut bars = [0_u32; BARS];
        for error in errors {
            let place = (error / reach + 1.0) / 2.0 * BARS as f64;
            bars[(place as usize).min(BARS - 1)] += 1;
        }
        let count = errors.len().max(1) as f64;
        let rms = (errors.iter().map(|e| e * e).sum::<f64>() / count).sqrt();
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
    area.present()?;
    drop((area, panels));
    Ok(svg)
}
