//! A stretch of road in perspective: the cloud's returns by what they are of, seen from behind and above (figure 10 of the median-slope paper).
//!
//! Drawn as paths, one for each class in each band of depth, from far to near: some 300 kB of SVG however many returns there are.

use std::fmt::Write;

use plotters::style::RGBColor;

use super::axes::thinned;
use super::{Palette, Theme};
use crate::cloud::{Class, Stretch};

const SIZE: (f64, f64) = (1200.0, 760.0);

/// Returns beyond this many are thinned out.
const MOST_RETURNS: usize = 30_000;

/// Bands of depth that are drawn one over the other.
const BANDS: usize = 16;

/// Metres between the sections that are drawn as lines.
const SECTIONS_M: f64 = 10.0;

/// Where the picture is taken from and what it looks at: metres forward, to the left and up from the scanner's first place.
const EYE: [f64; 3] = [-9.0, -7.0, 6.5];
const TARGET: [f64; 3] = [22.0, 3.0, -3.0];

/// Pixels to a metre at a distance of one.
const FOCAL: f64 = 1_050.0;

/// Where on the paper what it looks at is.
const MIDDLE_Y: f64 = 360.0;

/// Draws a stretch as SVG.
#[must_use]
pub fn view(stretch: &Stretch, title: &str, theme: Theme) -> String {
    let colours = theme.palette();
    let camera = Camera::new(EYE, TARGET);
    let returns = stretch.returns.iter();
    let within: Vec<(f64, f64, f64, Class)> = returns
        .filter_map(|(place, class)| camera.see(*place).map(|[x, y, depth]| (x, y, depth, *class)))
        .filter(|(x, y, ..)| (4.0..SIZE.0 - 4.0).contains(x) && (112.0..SIZE.1 - 4.0).contains(y))
        .collect();
    let seen: Vec<_> = thinned(&within, MOST_RETURNS).copied().collect();
    let mut svg = String::new();
    let (width, height) = SIZE;
    let _ = write!(
        svg,
        "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{width}\" height=\"{height}\" viewBox=\"0 0 {width} {height}\" \
         font-family=\"sans-serif\"><rect width=\"{width}\" height=\"{height}\" fill=\"{}\"/>",
        hex(colours.ground)
    );
    let note = format!(
        "{} of {} returns over {:.0} m, lines every {SECTIONS_M:.0} m, true to scale in perspective",
        seen.len(),
        stretch.returns.len(),
        stretch.length_m
    );
    words(&mut svg, (24.0, 38.0), 24, colours.text, title);
    words(&mut svg, (24.0, 64.0), 16, colours.text, &note);
    legend(&mut svg, &colours, theme);
    points(&mut svg, &seen, &colours, theme);
    lines(&mut svg, stretch, &camera, &colours);
    svg + "</svg>\n"
}

/// The returns, far ones first and small.
fn points(svg: &mut String, seen: &[(f64, f64, f64, Class)], colours: &Palette, theme: Theme) {
    let depths = || seen.iter().map(|point| point.2.ln());
    let (near, far) = depths().fold((f64::MAX, f64::MIN), |(near, far), depth| (near.min(depth), far.max(depth)));
    let band = |depth: f64| (((depth.ln() - near) / (far - near).max(1e-9) * BANDS as f64) as usize).min(BANDS - 1);
    for at in (0..BANDS).rev() {
        for class in Class::ALL {
            let here = || seen.iter().filter(|point| point.3 == class && band(point.2) == at);
            let Some(depth) = here().map(|point| point.2).reduce(f64::min) else { continue };
            let size = (FOCAL * 0.05 / depth).clamp(1.2, 5.0);
            let colour = hex(of_class(class, colours, theme));
            let _ = write!(
                svg,
                "<path fill=\"none\" stroke=\"{colour}\" stroke-width=\"{size:.1}\" stroke-linecap=\"round\" d=\""
            );
            for (x, y, ..) in here() {
                let _ = write!(svg, "M{x:.1} {y:.1}h.1");
            }
            svg.push_str("\"/>");
        }
    }
}

/// A section every some metres, with its distance.
fn lines(svg: &mut String, stretch: &Stretch, camera: &Camera, colours: &Palette) {
    let mut next_m = 0.0;
    for section in &stretch.sections {
        if section.at_m < next_m {
            continue;
        }
        let at_m = next_m;
        next_m = (section.at_m / SECTIONS_M).floor() * SECTIONS_M + SECTIONS_M;
        let on_paper: Vec<_> = section.places.iter().filter_map(|place| camera.see(*place)).collect();
        let path: Vec<_> = on_paper.iter().map(|[x, y, _]| format!("{x:.1} {y:.1}")).collect();
        if path.len() < 2 {
            continue;
        }
        let colour = hex(colours.text);
        let _ = write!(
            svg,
            "<path fill=\"none\" stroke=\"{colour}\" stroke-width=\"1.2\" stroke-opacity=\"0.75\" stroke-linejoin=\"round\" d=\"M{}\"/>",
            path.join("L")
        );
        // The right end of the line, which is the nearer to the eye.
        let end = on_paper
            .iter()
            .filter(|[x, y, _]| *x < SIZE.0 - 60.0 && *y < SIZE.1 - 12.0)
            .max_by(|a, b| a[0].total_cmp(&b[0]));
        if let Some([x, y, _]) = end {
            words(svg, (x + 8.0, y - 7.0), 15, colours.text, &format!("{at_m:.0} m"));
        }
    }
}

fn legend(svg: &mut String, colours: &Palette, theme: Theme) {
    let mut x = 32.0;
    for class in Class::ALL.iter().rev() {
        let colour = hex(of_class(*class, colours, theme));
        let _ = write!(svg, "<circle cx=\"{x}\" cy=\"90\" r=\"5\" fill=\"{colour}\"/>");
        words(svg, (x + 12.0, 95.5), 16, colours.text, class.name());
        x += 12.0 + 8.6 * class.name().len() as f64 + 26.0;
    }
}

fn of_class(class: Class, colours: &Palette, theme: Theme) -> RGBColor {
    match class {
        Class::Road => colours.points,
        Class::Adjacent => colours.adjacent,
        Class::Opposing => colours.opposing,
        // Okabe and Ito's reddish purple, which no other picture needs.
        Class::Vegetation if theme == Theme::Light => RGBColor(204, 121, 167),
        Class::Vegetation => RGBColor(222, 150, 190),
        Class::Other => colours.faint,
    }
}

fn words(svg: &mut String, (x, y): (f64, f64), size: u32, colour: RGBColor, text: &str) {
    let text = text.replace('&', "&amp;").replace('<', "&lt;");
    let _ = write!(svg, "<text x=\"{x:.1}\" y=\"{y:.1}\" font-size=\"{size}\" fill=\"{}\">{text}</text>", hex(colour));
}

fn hex(RGBColor(red, green, blue): RGBColor) -> String {
    format!("#{red:02x}{green:02x}{blue:02x}")
}

/// A pinhole.
struct Camera {
    eye: [f64; 3],
    right: [f64; 3],
    down: [f64; 3],
    ahead: [f64; 3],
}

impl Camera {
    fn new(eye: [f64; 3], target: [f64; 3]) -> Self {
        let ahead = unit([target[0] - eye[0], target[1] - eye[1], target[2] - eye[2]]);
        // Forward, left and up: what is to the right of the view is ahead x up.
        let right = unit(cross(ahead, [0.0, 0.0, 1.0]));
        Self { eye, right, down: cross(ahead, right), ahead }
    }

    /// Place on the paper, and how far ahead it is; nothing for what is behind or too near.
    fn see(&self, place: [f64; 3]) -> Option<[f64; 3]> {
        let from = [place[0] - self.eye[0], place[1] - self.eye[1], place[2] - self.eye[2]];
        let depth = dot(from, self.ahead);
        let scale = FOCAL / depth;
        (depth > 1.0)
            .then(|| [SIZE.0 / 2.0 + scale * dot(from, self.right), MIDDLE_Y + scale * dot(from, self.down), depth])
    }
}

fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

fn cross(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

fn unit(a: [f64; 3]) -> [f64; 3] {
    let length = dot(a, a).sqrt();
    a.map(|part| part / length)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_left_and_up_is_left_and_up_on_the_paper() {
        let camera = Camera::new(EYE, TARGET);
        let [x, y, depth] = camera.see(TARGET).unwrap();
        assert!((x - SIZE.0 / 2.0).abs() < 1e-6 && (y - MIDDLE_Y).abs() < 1e-6 && depth > 30.0);
        let [left, ..] = camera.see([TARGET[0], TARGET[1] + 2.0, TARGET[2]]).unwrap();
        let [_, above, _] = camera.see([TARGET[0], TARGET[1], TARGET[2] + 2.0]).unwrap();
        assert!(left < x && above < y);
        assert!(camera.see([-30.0, -7.0, 6.5]).is_none(), "behind the eye");
    }
}
