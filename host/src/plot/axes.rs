//! What the pictures of calibration, comparison and validation share: a title, a legend, axes in the project's style.

use plotters::chart::ChartContext;
use plotters::coord::Shift;
use plotters::coord::types::RangedCoordf64;
use plotters::prelude::*;

use super::{Error, Palette, signed, text};

/// A panel with axes.
pub type Chart<'a, DB> = ChartContext<'a, DB, Cartesian2d<RangedCoordf64, RangedCoordf64>>;

/// What an axis shows.
#[derive(Clone, Copy, Debug)]
pub struct Axis<'a> {
    /// From where to where.
    pub range: (f64, f64),
    /// What it is and its unit; empty for an axis without labels.
    pub name: &'a str,
    /// Digits behind the point.
    pub digits: usize,
    /// Whether it is the vehicle's y, which runs from right to left on the paper: labels have the other sign, and always one.
    pub across: bool,
}

impl<'a> Axis<'a> {
    /// An axis.
    pub fn new(range: (f64, f64), name: &'a str, digits: usize) -> Self {
        Self { range, name, digits, across: false }
    }

    /// The vehicle's y, seen from behind, from so many metres on the left to as many on the right.
    pub fn across(reach: f64, name: &'a str, digits: usize) -> Self {
        Self { range: (-reach, reach), name, digits, across: true }
    }
}

/// How a mark looks in the legend.
#[derive(Clone, Copy, Debug)]
pub enum Mark {
    /// A round dot.
    Dot(RGBColor),
    /// A ring.
    Ring(RGBColor),
    /// A line of a width.
    Line(RGBColor, u32),
}

/// What is drawn on an area of so many pixels, as SVG.
///
/// # Errors
/// When the drawing library fails.
pub fn svg(
    size: (u32, u32),
    draw: impl FnOnce(&DrawingArea<SVGBackend<'_>, Shift>) -> Result<(), Error>,
) -> Result<String, Error> {
    let mut svg = String::new();
    let area = SVGBackend::with_string(&mut svg, size).into_drawing_area();
    draw(&area)?;
    area.present()?;
    drop(area);
    Ok(svg)
}

/// The title and a line below it.
pub fn title<DB: DrawingBackend>(
    area: &DrawingArea<DB, Shift>,
    colours: &Palette,
    title: &str,
    note: &str,
) -> Result<(), Error>
where
    DB::ErrorType: 'static,
{
    area.fill(&colours.ground)?;
    area.draw(&Text::new(title.to_owned(), (24, 18), text(24, colours.text)))?;
    area.draw(&Text::new(note.to_owned(), (24, 48), text(16, colours.text)))?;
    Ok(())
}

/// What the marks mean, in a row; widths follow the names' lengths.
pub fn legend<DB: DrawingBackend>(
    area: &DrawingArea<DB, Shift>,
    colours: &Palette,
    (mut x, y): (i32, i32),
    entries: &[(Mark, &str)],
) -> Result<(), Error>
where
    DB::ErrorType: 'static,
{
    for (mark, name) in entries {
        match mark {
            Mark::Dot(colour) => area.draw(&Circle::new((x + 8, y), 4, colour.filled()))?,
            Mark::Ring(colour) => area.draw(&Circle::new((x + 8, y), 4, colour.stroke_width(1)))?,
            Mark::Line(colour, width) => {
                area.draw(&PathElement::new([(x, y), (x + 22, y)], colour.stroke_width(*width)))?;
            }
        }
        area.draw(&Text::new((*name).to_owned(), (x + 30, y - 7), text(16, colours.text)))?;
        // About eight units a letter at this size.
        x += 30 + 8 * name.chars().count() as i32 + 24;
    }
    Ok(())
}

/// Names in a row of a canvas so wide, each with where it begins and `mark` units of room for its mark: their middles are left out as far as all of them
/// need, and of more than eight the last stands for the rest.
pub fn names_in_row(names: &[&str], mark: i32, width: u32) -> Vec<(i32, String)> {
    const LEFT: i32 = 26;
    /// Units of a letter at this size, those of a wide face among them, and from a name to the next mark.
    const LETTER: i32 = 9;
    const APART: i32 = 20;
    const MOST: usize = 8;
    let mut shown: Vec<String> = names.iter().take(MOST).map(|name| (*name).to_owned()).collect();
    if let (Some(last), true) = (shown.last_mut(), names.len() > MOST) {
        *last = format!("and {} more", names.len() - MOST + 1);
    }
    let letters = (width as i32 - LEFT - shown.len() as i32 * (mark + APART)) / LETTER;
    let length = |name: &String| name.chars().count();
    let longest = shown.iter().map(length).max().unwrap_or_default();
    let fits = |most: &usize| shown.iter().map(|name| length(name).min(*most)).sum::<usize>() as i32 <= letters;
    let most = (3..=longest).rev().find(fits).unwrap_or(3);
    let mut x = LEFT;
    let place = |name: String| {
        let name = elided(&name, most);
        let from = x;
        x += mark + APART + LETTER * length(&name) as i32;
        (from, name)
    };
    shown.into_iter().map(place).collect()
}

/// A name of at most so many letters: the beginning and the end of a longer one.
fn elided(name: &str, most: usize) -> String {
    let letters: Vec<char> = name.chars().collect();
    if letters.len() <= most {
        return name.to_owned();
    }
    let (before, behind) = (most / 2, most.saturating_sub(1) / 2);
    let end = &letters[letters.len() - behind..];
    letters[..before].iter().chain(['\u{2026}'].iter()).chain(end).collect()
}

/// Axes of a picture across the road, seen from behind: the axis runs from left to right on the paper, the vehicle's y from
/// right to left. `height` writes what is on the other axis.
pub fn across_road<'a, DB: DrawingBackend + 'a>(
    panel: &DrawingArea<DB, Shift>,
    colours: &Palette,
    reach: f64,
    (low, high): (f64, f64),
    name: &str,
    height: &dyn Fn(&f64) -> String,
) -> Result<Chart<'a, DB>, Error>
where
    DB::ErrorType: 'static,
{
    let mut chart = ChartBuilder::on(panel)
        .x_label_area_size(48)
        .y_label_area_size(58)
        .build_cartesian_2d(-reach..reach, low..high)?;
    chart
        .configure_mesh()
        .light_line_style(colours.ground)
        .bold_line_style(colours.grid)
        .axis_style(colours.faint)
        .x_labels(13)
        .y_labels(8)
        .x_label_formatter(&|x| if *x == 0.0 { "0".to_owned() } else { signed(-x, 0) })
        .y_label_formatter(height)
        .label_style(text(16, colours.text))
        .axis_desc_style(text(18, colours.text))
        .x_desc("metres to the left (+) and right (\u{2212}) of the sensor")
        .y_desc(name)
        .draw()?;
    Ok(chart)
}

/// Axes with a grid.
pub fn axes<'a, DB: DrawingBackend + 'a>(
    panel: &DrawingArea<DB, Shift>,
    colours: &Palette,
    x: &Axis<'_>,
    y: &Axis<'_>,
) -> Result<Chart<'a, DB>, Error>
where
    DB::ErrorType: 'static,
{
    let mut chart = ChartBuilder::on(panel)
        .margin_top(6)
        .margin_right(12)
        .x_label_area_size(if x.name.is_empty() { 10 } else { 48 })
        .y_label_area_size(72)
        .build_cartesian_2d(x.range.0..x.range.1, y.range.0..y.range.1)?;
    let (x_digits, y_digits) = (x.digits, y.digits);
    let x_label = |value: &f64| match (x.name, x.across) {
        ("", _) => String::new(),
        (_, false) => number(*value, x_digits),
        (_, true) if value.abs() < 1e-9 => "0".to_owned(),
        (_, true) => signed(-value, x_digits),
    };
    let y_label = |value: &f64| number(*value, y_digits);
    let mut mesh = chart.configure_mesh();
    mesh.light_line_style(colours.ground)
        .bold_line_style(colours.grid)
        .axis_style(colours.faint)
        .x_labels(11)
        .y_labels(6)
        .x_label_formatter(&x_label)
        .y_label_formatter(&y_label)
        .label_style(text(15, colours.text))
        .axis_desc_style(text(16, colours.text))
        .y_desc(y.name);
    if !x.name.is_empty() {
        mesh.x_desc(x.name);
    }
    mesh.draw()?;
    Ok(chart)
}

/// A number with a proper minus, and none before what rounds to nothing.
pub fn number(value: f64, digits: usize) -> String {
    let size = format!("{:.digits$}", value.abs());
    let nothing = size.bytes().all(|byte| matches!(byte, b'0' | b'.'));
    if value < 0.0 && !nothing { format!("\u{2212}{size}") } else { size }
}

/// The least and the greatest of some values with a share of room around, and at least so far apart.
pub fn span(values: impl Iterator<Item = f64>, least: f64, room: f64) -> (f64, f64) {
    let (low, high) = values.fold((f64::MAX, f64::MIN), |(low, high), value| (low.min(value), high.max(value)));
    if low > high {
        return (-least / 2.0, least / 2.0);
    }
    let around = ((least - (high - low)).max(0.0) / 2.0).max((high - low) * room);
    (low - around, high + around)
}

/// At most so many of a list, evenly spread: a picture does not get clearer by a hundred thousand dots.
pub fn thinned<T>(items: &[T], most: usize) -> impl Iterator<Item = &T> {
    items.iter().step_by(items.len().div_ceil(most.max(1)).max(1))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_end_within_the_canvas() {
        let long =
            "a very long name of a survey drive on interstate 80 westbound mile 147 to 161 on a wet monday morning";
        let row = |names: &[&str]| names_in_row(names, 32, 1_200);
        assert_eq!(row(&["mon", "tue"]), [(26, "mon".to_owned()), (105, "tue".to_owned())]);
        for names in [&[long][..], &[long, "mon", long], &[long; 5], &[long; 30]] {
            let row = row(names);
            let (x, last) = row.last().unwrap();
            assert!(x + 32 + 9 * last.chars().count() as i32 <= 1_200, "{row:?}");
            assert!(row.len() == names.len().min(8) && row.iter().all(|(_, name)| name.chars().count() > 2), "{row:?}");
        }
        assert!(row(&[long, "mon", long])[1].1 == "mon", "short names stay");
        assert_eq!(elided("interstate", 7), "int\u{2026}ate");
    }
}
