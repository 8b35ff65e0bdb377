//! The report of a drive: one HTML page that needs nothing else, no network and no server.
//!
//! The charts are drawn here and stand without scripts; a script of the page follows the pointer along the road and shows the nearest section. The page
//! keeps to the reader's light or dark and prints light. Its size is bounded: at most [`BINS`] places along the road and
//! [`SECTIONS`](crate::drive::SECTIONS) sections, about 1.5 MB for the longest drive.

mod bins;
mod map;
mod strip;
mod tables;

use serde_json::json;

use crate::drive::{Drive, Kept};
use crate::section::Part;
use bins::Bins;

/// Places along the road that the charts tell apart.
pub const BINS: usize = 700;

/// Makes the page.
#[must_use]
pub fn page(drive: &Drive, name: &str) -> String {
    let bins = Bins::of(drive);
    let map = map::draw(&bins);
    let data = json!({
        "unit": bins.unit.name(),
        "x": rounded(bins.list.iter().map(|bin| bin.at), 2),
        "width": bins.width,
        "slopes": (0..4).map(|i| rounded(bins.list.iter().map(|bin| bin.slopes[i].map_or(f64::NAN, |s| s.value)), 3)).collect::<Vec<_>>(),
        "ci": (0..4).map(|i| rounded(bins.list.iter().map(|bin| bin.slopes[i].map_or(f64::NAN, |s| s.ci95)), 3)).collect::<Vec<_>>(),
        "scans": bins.list.iter().map(|bin| bin.scans).collect::<Vec<_>>(),
        "map": bins.list.iter().map(|bin| bin.place.map(|place| map.on_paper(place))).collect::<Vec<_>>(),
        "chart": { "left": strip::LEFT, "right": strip::RIGHT, "from": bins.from, "to": bins.to },
        "sections": drive.sections.iter().filter_map(|kept| section(drive, &bins, kept)).collect::<Vec<_>>(),
    });
    // Nothing in the data may end the script that holds it.
    let data = data.to_string().replace("</", "<\\/");
    fill(
        include_str!("page.html"),
        &[
            ("style", include_str!("page.css")),
            ("name", &escaped(name)),
            ("subtitle", &tables::subtitle(drive)),
            ("heading", bins.unit.heading()),
            ("tiles", &tables::tiles(drive)),
            ("map", &map.svg),
            ("strips", &strip::draw(&bins)),
            ("miles", &tables::miles(drive)),
            ("health", &tables::health(drive)),
            ("calibration", &tables::calibration(drive)),
            ("version", env!("CARGO_PKG_VERSION")),
            ("data", &data),
            ("script", include_str!("page.js")),
        ],
    )
}

/// Puts values into the template, each in the one place of its name.
fn fill(template: &str, values: &[(&str, &str)]) -> String {
    let mut page = String::new();
    let mut rest = template;
    while let Some((before, behind)) = rest.split_once("{{") {
        page += before;
        let (name, after) = behind.split_once("}}").unwrap_or((behind, ""));
        page += values.iter().find(|(key, _)| *key == name).map_or("", |(_, value)| value);
        rest = after;
    }
    page + rest
}

/// Text as HTML has it.
fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

/// Numbers with some decimals, and null for what is not known.
fn rounded(values: impl Iterator<Item = f64>, decimals: i32) -> Vec<Option<f64>> {
    let scale = 10_f64.powi(decimals);
    values.map(|value| value.is_finite().then(|| (value * scale).round() / scale)).collect()
}

/// A section for the script: whole centimetres are too coarse to look at, so millimetres.
fn section(drive: &Drive, bins: &Bins, kept: &Kept) -> Option<serde_json::Value> {
    let scan = drive.scans.get(kept.scan)?;
    let at = drive.at(bins.unit, kept.scan)?;
    let millimetres = |value: f64| (value * 1e3).round() as i64;
    let points = kept.section.levelled.iter().filter(|point| point.0.abs() < 30.0);
    let lines = kept.section.lines().into_iter().map(|line| {
        let part = match line.part {
            Part::Road => 0,
            Part::Adjacent => 1,
            Part::Opposing => 2,
        };
        let ends = [line.inner.0, line.inner.1, line.outer.0, line.outer.1].map(millimetres);
        json!([part, ends, (line.slope_deg * 1e3).round() / 1e3, line.ci95_deg.map(|ci| (ci * 1e3).round() / 1e3)])
    });
    Some(json!({
        "at": (at * 100.0).round() / 100.0,
        "scan": scan.number,
        "roll": (f64::from(scan.roll_deg) * 1e3).round() / 1e3,
        "y": points.clone().map(|point| millimetres(point.0)).collect::<Vec<_>>(),
        "z": points.map(|point| millimetres(point.1)).collect::<Vec<_>>(),
        "lines": lines.collect::<Vec<_>>(),
    }))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_place_of_the_template_is_filled_once() {
        assert_eq!(fill("a{{x}}b{{y}}c", &[("x", "1"), ("y", "{{x}}")]), "a1b{{x}}c");
        assert_eq!(escaped("<a> & \"b\""), "&lt;a&gt; &amp; &quot;b&quot;");
    }
}
