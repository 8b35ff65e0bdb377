//! One section: raw and levelled points, the road, its edges, the slopes (figure 4 of the median-slope paper).
//!
//! Seen from behind, so that the vehicle's left is on the left.

use plotters::coord::Shift;
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};

use super::axes::{across_road, svg, title as headed};
use super::{Error, Palette, Theme, signed, text};
use crate::section::{Fitted, Part, Place, Section};
use crate::side::Side;
use crate::units::metres;

const SIZE: (u32, u32) = (1200, 560);

/// Draws a section as SVG.
///
/// # Errors
/// When the drawing library fails.
pub fn section(section: &Section, title: &str, theme: Theme) -> Result<String, Error> {
    svg(SIZE, |area| draw(area, section, title, theme))
}

fn draw(area: &DrawingArea<SVGBackend<'_>, Shift>, section: &Section, title: &str, theme: Theme) -> Result<(), Error> {
    let colours = theme.palette();
    let (reach, low, high) = bounds(section);
    let exaggeration = (2.0 * reach / f64::from(SIZE.0 - 110)) / ((high - low) / f64::from(SIZE.1 - 190));
    let note = format!("seen from behind, heights exaggerated {exaggeration:.1} times");
    headed(area, &colours, title, &note)?;
    legend(area, &colours)?;

    let plot = area.margin(110, 16, 20, 30);
    let mut chart = across_road(&plot, &colours, reach, (low, high), "metres above the sensor", &|z| {
        if *z < 0.0 { format!("\u{2212}{:.1}", -z) } else { format!("{z:.1}") }
    })?;

    let within = |(y, z): &&Place| y.abs() <= reach && *z >= low && *z <= high;
    let dots = |places: &[Place], size: i32, style: ShapeStyle| -> Vec<_> {
        places.iter().filter(within).map(|&(y, z)| Circle::new((-y, z), size, style)).collect()
    };
    chart.draw_series(dots(&section.raw, 2, colours.faint.stroke_width(1)))?;
    chart.draw_series(dots(&section.levelled, 2, colours.points.filled()))?;

    let fitted = section.lines();
    let of = |part: Part| fitted.iter().filter(move |line| line.part == part);
    let marks = of(Part::Road).map(|line| (line.outer, colours.road, line.side));
    let lines = [Part::Road, Part::Adjacent, Part::Opposing].map(|part| of(part).map(Line::of).collect::<Vec<_>>());
    for (list, colour) in [(&lines[0], colours.road), (&lines[1], colours.adjacent), (&lines[2], colours.opposing)] {
        let paths =
            list.iter().map(|line| PathElement::new([flip(line.inner), flip(line.outer)], colour.stroke_width(3)));
        chart.draw_series(paths.collect::<Vec<_>>())?;
    }

    // The edges above the road; each slope's value beside its line, where the raw points are not.
    let span = high - low;
    for (place, colour, side) in marks {
        let at = flip(place);
        let top = (at.0, at.1 + span * 0.17);
        chart.draw_series([PathElement::new([(at.0, at.1 - span * 0.03), top], colour.stroke_width(1))])?;
        let horizontal = if side == Side::Left { HPos::Left } else { HPos::Right };
        let anchor = Pos::new(horizontal, VPos::Bottom);
        let label = format!("edge {} m", signed(place.0, 2));
        chart.draw_series([Text::new(label, top, text(16, colour).pos(anchor))])?;
    }
    // Nearer to the outer ends of both slopes than to the ditch between them, so that labels keep apart.
    let mut labels: Vec<Label> = Vec::new();
    let letter = (2.0 * reach * 9.8 / f64::from(SIZE.0 - 110), span * 22.0 / f64::from(SIZE.1 - 190));
    for (list, colour, part) in [(&lines[1], colours.adjacent, 0.35), (&lines[2], colours.opposing, 0.65)] {
        for line in list {
            let (from, to) = (flip(line.inner), flip(line.outer));
            let rises_right = (to.1 - from.1) * (to.0 - from.0) > 0.0;
            let above = raw_below(line, &section.raw);
            let to_left = rises_right == above;
            let along = |a: f64, b: f64| a + (b - a) * part;
            let place = (
                along(from.0, to.0) + 2.0 * reach * if to_left { -0.012 } else { 0.012 },
                along(from.1, to.1) + span * if above { 0.01 } else { -0.01 },
            );
            let (width, height) = (letter.0 * line.label.chars().count() as f64, letter.1);
            let mut label = Label {
                left: if to_left { place.0 - width } else { place.0 },
                bottom: if above { place.1 } else { place.1 - height },
                width,
                height,
            };
            // Clear of the labels that are there, away from its own line.
            for _ in 0..labels.len() {
                let Some(other) = labels.iter().find(|other| label.hides(other)) else { break };
                label.bottom = if above { other.bottom + other.height } else { other.bottom - height };
            }
            let at = (place.0, if above { label.bottom } else { label.bottom + height });
            labels.push(label);
            let horizontal = if to_left { HPos::Right } else { HPos::Left };
            let anchor = Pos::new(horizontal, if above { VPos::Bottom } else { VPos::Top });
            chart.draw_series([Text::new(line.label.clone(), at, text(18, colour).pos(anchor))])?;
        }
    }
    Ok(())
}

/// Where a label is, in metres of the picture.
struct Label {
    left: f64,
    bottom: f64,
    width: f64,
    height: f64,
}

impl Label {
    fn hides(&self, other: &Self) -> bool {
        let beside = |at: f64, size: f64, from: f64, length: f64| at + size <= from || from + length <= at;
        !beside(self.left, self.width, other.left, other.width)
            && !beside(self.bottom, self.height * 0.999, other.bottom, other.height * 0.999)
    }
}

/// What the marks mean, in a row above the picture.
fn legend(area: &DrawingArea<SVGBackend<'_>, Shift>, colours: &Palette) -> Result<(), Error> {
    let y = 86;
    let name = |at: i32, name: &str| Text::new(name.to_owned(), (at, y - 6), text(16, colours.text));
    area.draw(&Circle::new((32, y), 3, colours.faint.stroke_width(1)))?;
    area.draw(&name(42, "as measured"))?;
    area.draw(&Circle::new((162, y), 3, colours.points.filled()))?;
    area.draw(&name(172, "levelled beam by beam"))?;
    for (at, colour, what) in [
        (372, colours.road, "road"),
        (458, colours.adjacent, "adjacent slope"),
        (618, colours.opposing, "opposing slope, with 95 % intervals"),
    ] {
        area.draw(&PathElement::new([(at, y), (at + 22, y)], colour.stroke_width(3)))?;
        area.draw(&name(at + 30, what))?;
    }
    Ok(())
}

/// A fitted line between two places.
#[derive(Clone, Debug)]
struct Line {
    inner: Place,
    outer: Place,
    label: String,
}

impl Line {
    fn of(fitted: &Fitted) -> Self {
        let slope = signed(fitted.slope_deg, 2);
        let label = match fitted.ci95_deg {
            _ if fitted.part == Part::Road => String::new(),
            Some(interval) => format!("{slope}\u{b0} \u{b1} {interval:.2}\u{b0}"),
            None => format!("{slope}\u{b0}"),
        };
        Self { inner: fitted.inner, outer: fitted.outer, label }
    }
}

fn flip((y, z): Place) -> Place {
    (-y, z)
}

/// Whether the raw points lie below a line.
fn raw_below(line: &Line, raw: &[Place]) -> bool {
    let (low, high) = (line.inner.0.min(line.outer.0), line.inner.0.max(line.outer.0));
    let rise = (line.outer.1 - line.inner.1) / (line.outer.0 - line.inner.0);
    let over = raw.iter().filter(|(y, _)| (low..=high).contains(y));
    over.map(|(y, z)| z - line.inner.1 - rise * (y - line.inner.0)).sum::<f64>() < 0.0
}

/// How far to the sides and between which heights the picture reaches: to the outermost hinge and a bit beyond.
fn bounds(section: &Section) -> (f64, f64, f64) {
    let ends = [&section.profile.left, &section.profile.right].into_iter().flat_map(|side| {
        [side.opposing.map(|s| s.end.y_um), side.adjacent.map(|s| s.end.y_um), side.edge.map(|e| e.y_um)]
    });
    let outermost = ends.flatten().map(|um| metres(um.abs())).fold(8.0, f64::max);
    let reach = (outermost * 1.12).min(30.0);
    let seen = section.levelled.iter().chain(&section.raw).filter(|(y, _)| y.abs() <= reach).map(|&(_, z)| z);
    let (low, high) = seen.fold((f64::MAX, f64::MIN), |(low, high), z| (low.min(z), high.max(z)));
    if low > high {
        return (reach, -5.0, 0.0);
    }
    let room = (high - low).max(1.0);
    (reach, low - 0.2 * room, high + 0.35 * room)
}
