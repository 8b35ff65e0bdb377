//! The slopes along the road, four strips above each other with one axis, as SVG that takes its colours from the page.

use std::fmt::Write;

use super::bins::{Bins, round_length};
use crate::side::WhichSlope;

/// The charts' inner borders on the paper, in its units.
pub const LEFT: f64 = 62.0;
/// See [`LEFT`].
pub const RIGHT: f64 = 988.0;

const WIDTH: f64 = 1_000.0;
const PANEL: f64 = 118.0;
const GAP: f64 = 22.0;

/// A slope of 1:4 in degrees.
pub const ONE_IN_FOUR_DEG: f64 = 14.036;

/// Slopes that road design knows by their ratio (AASHTO, Roadside Design Guide): recoverable up to 1:4, traversable up to 1:3.
const RATIOS: [(f64, &str); 2] = [(ONE_IN_FOUR_DEG, "1:4"), (18.435, "1:3")];

/// Draws the strips.
pub fn draw(bins: &Bins) -> String {
    let height = 4.0 * (PANEL + GAP) + 46.0;
    let mut svg = format!(
        "<svg id=\"strips\" viewBox=\"0 0 {WIDTH} {height:.0}\" role=\"img\" tabindex=\"0\" aria-label=\"{}; \
         the arrow keys move along it\">",
        bins.unit.heading()
    );
    let span = bins.to - bins.from;
    let x = |at: f64| LEFT + (at - bins.from) / span * (RIGHT - LEFT);
    let bottom = 4.0 * (PANEL + GAP);
    for tick in ticks(bins.from, bins.to, 9) {
        let at = x(tick);
        let _ = write!(svg, "<path class=\"grid\" d=\"M{at:.1} {GAP}V{bottom:.1}\"/>");
        let _ = write!(
            svg,
            "<text class=\"tick\" text-anchor=\"middle\" x=\"{at:.1}\" y=\"{:.1}\">{}</text>",
            bottom + 16.0,
            thousands(tick)
        );
    }
    for slope in WhichSlope::ALL {
        panel(&mut svg, bins, slope, GAP + slope.index() as f64 * (PANEL + GAP), &x);
    }
    let axis = bins.unit.axis();
    let _ = write!(
        svg,
        "<text class=\"axis\" text-anchor=\"middle\" x=\"{:.0}\" y=\"{:.1}\">{axis}</text>",
        (LEFT + RIGHT) / 2.0,
        bottom + 36.0
    );
    let _ = write!(svg, "<path id=\"cursor\" d=\"M-10 {GAP}V{bottom:.1}\"/>");
    svg + "</svg>"
}

fn panel(svg: &mut String, bins: &Bins, slope: WhichSlope, top: f64, x: &dyn Fn(f64) -> f64) {
    let found: Vec<_> = bins.list.iter().filter_map(|bin| bin.slopes[slope.index()]).collect();
    let bottom = top + PANEL - GAP;
    let (name, kind) = (slope.name(), slope.kind.name());
    let _ = write!(svg, "<text class=\"title {kind}\" x=\"{LEFT}\" y=\"{:.1}\">{name} slope</text>", top - 5.0);
    if found.is_empty() {
        let _ = write!(
            svg,
            "<text class=\"none\" text-anchor=\"middle\" x=\"{:.0}\" y=\"{:.1}\">found nowhere</text>",
            (LEFT + RIGHT) / 2.0,
            (top + bottom) / 2.0
        );
        return;
    }
    // The scale follows the bulk: a stray must not flatten the rest.
    let mut values: Vec<f64> = found.iter().map(|one| one.value).collect();
    values.sort_by(f64::total_cmp);
    let trimmed = values.len() / 100;
    let (low, high) = (values[trimmed], values[values.len() - 1 - trimmed]);
    let room = ((high - low) * 0.15).max(0.5);
    let (low, high) = (low - room, high + room);
    let y = |slope: f64| bottom - (slope.clamp(low, high) - low) / (high - low) * (bottom - top);
    for tick in ticks(low, high, 4) {
        let at = y(tick);
        let _ = write!(svg, "<path class=\"grid\" d=\"M{LEFT} {at:.1}H{RIGHT}\"/>");
        let _ = write!(
            svg,
            "<text class=\"tick\" text-anchor=\"end\" x=\"{:.0}\" y=\"{:.1}\">{}\u{b0}</text>",
            LEFT - 7.0,
            at + 4.0,
            degrees(tick)
        );
    }
    for (ratio, name) in RATIOS {
        for slope in [-ratio, ratio] {
            if (low..=high).contains(&slope) {
                let at = y(slope);
                let _ = write!(
                    svg,
                    "<path class=\"ratio\" d=\"M{LEFT} {at:.1}H{RIGHT}\"/><text class=\"tick\" text-anchor=\"end\" x=\"{RIGHT}\" y=\"{:.1}\">{name}</text>",
                    at - 3.0
                );
            }
        }
    }
    for run in bins.runs(slope) {
        if let [(at, one)] = &*run {
            // No band can be drawn over one place: its interval and spread are bars.
            for (class, half) in [("spread", 2.0 * one.sd), ("interval", one.ci95)] {
                let (low, high) = (y(one.value - half), y(one.value + half));
                let _ = write!(svg, "<path class=\"{class} whisker {kind}\" d=\"M{:.1} {low:.1}V{high:.1}\"/>", x(*at));
            }
            let _ =
                write!(svg, "<circle class=\"dot {kind}\" cx=\"{:.1}\" cy=\"{:.1}\" r=\"1.6\"/>", x(*at), y(one.value));
            continue;
        }
        let band = |half: &dyn Fn(&crate::intervals::Estimate) -> f64| {
            let upper = run.iter().map(|(at, one)| format!("{:.1} {:.1}", x(*at), y(one.value + half(one))));
            let lower = run.iter().rev().map(|(at, one)| format!("{:.1} {:.1}", x(*at), y(one.value - half(one))));
            upper.chain(lower).collect::<Vec<_>>().join(" ")
        };
        let _ = write!(svg, "<path class=\"spread {kind}\" d=\"M{}Z\"/>", band(&|one| 2.0 * one.sd));
        let _ = write!(svg, "<path class=\"interval {kind}\" d=\"M{}Z\"/>", band(&|one| one.ci95));
        let line: Vec<_> = run.iter().map(|(at, one)| format!("{:.1} {:.1}", x(*at), y(one.value))).collect();
        let _ = write!(svg, "<path class=\"line {kind}\" d=\"M{}\"/>", line.join(" "));
    }
}

/// Round values within a range, about so many.
fn ticks(low: f64, high: f64, about: usize) -> Vec<f64> {
    let step = round_length((high - low) / about as f64);
    let first = (low / step).ceil() as i64;
    let last = (high / step).floor() as i64;
    (first..=last).map(|i| i as f64 * step).collect()
}

fn degrees(value: f64) -> String {
    let text = if value.fract().abs() < 1e-6 { format!("{:.0}", value.abs()) } else { format!("{:.1}", value.abs()) };
    if value < -1e-9 { format!("\u{2212}{text}") } else { text }
}

/// A whole number with a thin space between its thousands.
pub fn thousands(value: f64) -> String {
    let digits = format!("{:.0}", value.abs());
    let mut text = String::new();
    for (i, c) in digits.chars().enumerate() {
        if i > 0 && (digits.len() - i).is_multiple_of(3) {
            text.push('\u{202f}');
        }
        text.push(c);
    }
    if value < -0.5 { format!("\u{2212}{text}") } else { text }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_written_as_people_do() {
        assert_eq!(thousands(1_234_567.0), "1\u{202f}234\u{202f}567");
        assert_eq!(thousands(-42.0), "\u{2212}42");
        assert_eq!((degrees(-8.0), degrees(0.5)), ("\u{2212}8".to_owned(), "0.5".to_owned()));
        assert_eq!(ticks(-1.2, 2.3, 4), [-1.0, 0.0, 1.0, 2.0]);
    }
}
