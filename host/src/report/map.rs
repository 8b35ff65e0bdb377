//! The drive's trace, north up, with a scale: no tiles, no network.

use std::fmt::Write;

use super::bins::{Bins, round_length};
use super::strip::thousands;
use crate::geodesy::{Geodetic, Plane};

const WIDTH: f64 = 480.0;
const HEIGHT: f64 = 360.0;
const MARGIN: f64 = 34.0;

/// A map.
pub struct Map {
    /// It.
    pub svg: String,
    plane: Plane,
    centre_m: [f64; 2],
    scale: f64,
}

impl Map {
    /// Where a place lies on the paper.
    pub fn on_paper(&self, place: Geodetic) -> [f64; 2] {
        let [east, north] = self.plane.metres(place);
        let x = WIDTH / 2.0 + (east - self.centre_m[0]) * self.scale;
        let y = HEIGHT / 2.0 - (north - self.centre_m[1]) * self.scale;
        [(x * 10.0).round() / 10.0, (y * 10.0).round() / 10.0]
    }
}

/// Draws the trace.
pub fn draw(bins: &Bins) -> Map {
    let places: Vec<_> = bins.list.iter().filter_map(|bin| bin.place).collect();
    // Where there are no places, nothing is asked of the plane.
    let plane = Plane::at(places.get(places.len() / 2).copied().unwrap_or_default());
    let mut map = Map { svg: String::new(), plane, centre_m: [0.0; 2], scale: 1.0 };
    let _ = write!(
        map.svg,
        "<svg id=\"map\" viewBox=\"0 0 {WIDTH} {HEIGHT}\" role=\"img\" aria-label=\"Trace of the drive\">"
    );
    if places.is_empty() {
        let _ = write!(
            map.svg,
            "<text class=\"none\" text-anchor=\"middle\" x=\"{}\" y=\"{}\">no position in this log</text></svg>",
            WIDTH / 2.0,
            HEIGHT / 2.0
        );
        return map;
    }
    let (mut low, mut high) = ([f64::MAX; 2], [f64::MIN; 2]);
    for place in &places {
        for (axis, value) in map.plane.metres(*place).into_iter().enumerate() {
            low[axis] = low[axis].min(value);
            high[axis] = high[axis].max(value);
        }
    }
    map.centre_m = [(low[0] + high[0]) / 2.0, (low[1] + high[1]) / 2.0];
    let (wide, tall) = ((high[0] - low[0]).max(10.0), (high[1] - low[1]).max(10.0));
    map.scale = ((WIDTH - 2.0 * MARGIN) / wide).min((HEIGHT - 2.0 * MARGIN - 14.0) / tall);
    let path: Vec<_> = places.iter().map(|place| map.on_paper(*place)).collect();
    let text: Vec<_> = path.iter().map(|[x, y]| format!("{x} {y}")).collect();
    let _ = write!(map.svg, "<path class=\"trace\" d=\"M{}\"/>", text.join(" "));
    if let (Some(start), Some(end)) = (path.first(), path.last()) {
        let _ = write!(map.svg, "<circle class=\"start\" cx=\"{}\" cy=\"{}\" r=\"5\"/>", start[0], start[1]);
        let _ = write!(map.svg, "<text class=\"tick\" x=\"{}\" y=\"{}\">start</text>", start[0] + 9.0, start[1] + 4.0);
        let _ = write!(map.svg, "<circle class=\"end\" cx=\"{}\" cy=\"{}\" r=\"5\"/>", end[0], end[1]);
    }
    scale_bar(&mut map);
    let _ = write!(
        map.svg,
        "<path class=\"bar\" d=\"M{x} 38V14l-5 8m5-8l5 8\"/><text class=\"tick\" text-anchor=\"middle\" x=\"{x}\" y=\"52\">N</text>",
        x = WIDTH - 22.0
    );
    let _ = write!(map.svg, "<circle id=\"here\" r=\"6\" cx=\"-20\" cy=\"-20\"/></svg>");
    map
}

fn scale_bar(map: &mut Map) {
    // The longest round length that is at most a third of the paper.
    let mut length = round_length(WIDTH / 3.0 / map.scale);
    while length * map.scale > WIDTH / 3.0 {
        length = round_length(length / 2.6);
    }
    let name = if length >= 1_000.0 { format!("{} km", thousands(length / 1_000.0)) } else { format!("{length} m") };
    let (x, y) = (14.0, HEIGHT - 14.0);
    let _ = write!(map.svg, "<path class=\"bar\" d=\"M{x} {}v5h{:.1}v-5\"/>", y - 5.0, length * map.scale);
    let _ = write!(map.svg, "<text class=\"tick\" x=\"{:.1}\" y=\"{y}\">{name}</text>", x + length * map.scale + 7.0);
}
