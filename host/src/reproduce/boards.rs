//! Boards of known slope passed at 2 to 3 m (the paper's figure 7a, controlled surfaces).
//!
//! The paper names two boards of 40 by 32 inches and a distance of 2 to 3 m; it does not say how they were put together. Here two
//! boards lie end to end, falling away from the road's edge: 2.03 m of slope, 0.81 m along the road, at 4 to 18 degrees, on otherwise level
//! ground, passed at 5 m/s. The inclinometer reads the boards' true slope to its 0.1 degrees.

use std::fmt::Write as _;

use super::pipeline::{BOTH_METHODS, Bench};
use super::surface_truth::RESOLUTION_DEG;
use super::{Error, Line, Picture, RANGE_NOISE_MM, Report, limit, mean_magnitude};
use crate::compare::{Kind, Options, Sides, manual};
use crate::output;
use crate::plot::{self, Words};
use crate::side::Side;
use crate::simulate::noise::{Noise, Purpose};
use crate::simulate::scene::{Interpolation, Mode, Scene, Station, StationSide};
use crate::statistics::rms;

/// Two boards end to end, and a board's width along the road, in metres.
const LENGTH_M: f64 = 2.0 * 1.016;
const WIDTH_M: f64 = 0.813;

/// From one pair of boards to the next along the road.
const APART_M: f64 = 8.0;

const SPEED_M_S: f64 = 5.0;

/// The drive with its boards, and what the inclinometer reads of each: station and slope.
fn scene(bench: &Bench, range_noise_mm: f64) -> (Scene, Vec<(f64, f64)>) {
    let mut scene = Scene::default();
    scene.drive.seed = bench.seed;
    scene.drive.seconds = bench.seconds(40.0);
    scene.drive.speed_m_s = SPEED_M_S;
    scene.scanner.range_noise_mm = range_noise_mm;
    scene.sections.mode = Mode::Stations;
    scene.sections.interpolation = Interpolation::Linear;
    let mut noise = Noise::new(bench.seed, Purpose::Sections);
    let count = (scene.drive.seconds * SPEED_M_S / APART_M) as usize;
    let mut boards = Vec::new();
    for i in 0..count.max(1) {
        let at_m = (i as f64 + 0.6) * APART_M;
        // The slopes in the order of the draw, evenly spread over the limits of what counts as one.
        let part = (i as f64 + noise.unit()) / count.max(1) as f64;
        let slope_deg = -(4.3 + 13.4 * part);
        let (edge_m, height_m) = (noise.between([2.0, 3.0]), 2.5);
        let flat = |at_m: f64| station(at_m, height_m, edge_m, 0.0);
        let board = |at_m: f64| station(at_m, height_m, edge_m, slope_deg);
        let (from, to) = (at_m - WIDTH_M / 2.0, at_m + WIDTH_M / 2.0);
        scene.sections.station.extend([flat(from - 0.001), board(from), board(to), flat(to + 0.001)]);
        boards.push((at_m, slope_deg));
    }
    (scene, boards)
}

fn station(at_m: f64, height_m: f64, edge_m: f64, slope_deg: f64) -> Station {
    let side = |edge_m: f64, slope_deg: f64| StationSide {
        edge_m,
        adjacent_slope_deg: slope_deg,
        adjacent_length_m: LENGTH_M * slope_deg.to_radians().cos(),
        ditch_m: 10.0,
        opposing_slope_deg: 0.0,
        opposing_length_m: 1.0,
    };
    Station { at_m, height_m, cross_slope_deg: 0.0, left: side(edge_m, slope_deg), right: side(4.0, 0.0) }
}

pub fn run(bench: &Bench, report: &mut Report) -> Result<(), Error> {
    for range_noise_mm in RANGE_NOISE_MM {
        let (scene, boards) = scene(bench, range_noise_mm);
        let captured = bench.drive("boards", &scene)?;
        let mut table = String::from("side,slope,slope_deg,station_m\n");
        for (at_m, slope_deg) in &boards {
            let read = (slope_deg / RESOLUTION_DEG).round() * RESOLUTION_DEG;
            let _ = writeln!(table, "left,adjacent,{read:.1},{at_m:.3}");
        }
        let path = bench.file("boards.csv");
        output::write(&path, table.as_bytes())?;
        let by_hand = manual::read(&path)?;
        let options = Options { sides: Sides::One(Side::Left), within_m: WIDTH_M / 2.0 - 0.05, over_m: None };
        let mut held = Vec::new();
        for method in BOTH_METHODS {
            let drive = bench.profiles("boards", &captured, method)?;
            held.push(manual::hold(&drive, drive.way().as_ref(), &by_hand, &options, false));
        }
        let [measuring, searched] = &held[..] else { return Ok(()) };
        // A board is the median of the scans that meet it; the unit's error lasts from one to the next.
        let scans = 2.0 * options.within_m / (SPEED_M_S * 0.026_64);
        let bounds = captured.made.truth.iter().filter(|row| row.section.left.adjacent_slope_deg < -1.0).map(|row| {
            let one = limit::slope_deg(&row.section, Side::Left, Kind::Adjacent, range_noise_mm * 1e-3, 1.0);
            one * (core::f64::consts::FRAC_PI_2 / scans).sqrt()
        });
        let ranges = rms(bounds);
        let reading = RESOLUTION_DEG / 12_f64.sqrt();
        let deviation = ranges.hypot(scene.ins.attitude_drift_deg).hypot(reading);
        let found = |held: &manual::Manual| held.all.matched as f64 / boards.len() as f64;
        let mut line = |quantity: &str, paper, crossfall, seed, limit, unit| {
            report.lines.push(Line {
                experiment: "boards",
                quantity: quantity.to_owned(),
                range_noise_mm: Some(range_noise_mm),
                paper,
                crossfall,
                seed_search: Some(seed),
                limit: Some(limit),
                unit,
            });
        };
        let errors = (measuring.all.mean_absolute_deg, searched.all.mean_absolute_deg);
        line("mean error against the inclinometer", Some(0.36), errors.0, errors.1, mean_magnitude(deviation), "deg");
        line("boards found", None, found(measuring), found(searched), 1.0, "share");
        if range_noise_mm == RANGE_NOISE_MM[1] {
            let note = format!("10 mm range noise; mean error {:.3}\u{b0}, the paper\u{2019}s 0.36\u{b0}", errors.0);
            let words = Words {
                title: "Boards at 2 to 3 m",
                note: &note,
                first: "by the inclinometer, \u{b0}",
                other: "by the scanner, median of a board\u{2019}s scans, \u{b0}",
            };
            report.pictures.push(Picture::new(
                "validation-boards",
                "Slopes of boards by the scanner against those by an inclinometer: all lie on the line of equality",
                |theme| plot::agreement(&measuring.held, &words, theme),
            )?);
        }
    }
    Ok(())
}
