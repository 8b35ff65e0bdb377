//! Medians with grass, held against measurements by hand (the paper's figure 7a, actual medians).
//!
//! V-shaped medians whose centre is 10 to 15 m from the vehicle, on undulating ground, 30 % of the returns from grass (exponential heights of mean 50 mm, at
//! most 200) and 1 % strays. Every 10 m an inclinometer of 1.22 m is laid on the middle of either slope; it presses the grass down and shows
//! the ground it covers to 0.1 degrees. What it shows is not the slope of the whole, which is what the scanner measures: most of the paper's
//! 0.62 degrees is that, and crossfall's error against the whole slope stands beside it.

use std::fmt::Write as _;

use super::pipeline::{BOTH_METHODS, Bench};
use super::surface_truth::{TrueSlope, surface};
use super::{Error, Line, Picture, RANGE_NOISE_MM, Report, limit, mean_magnitude};
use crate::compare::{Drive, Kind, Options, Sides, UNRELIABLE, manual};
use crate::output;
use crate::plot::{self, Twice, Words};
use crate::simulate::scene::{Random, Scene, Vegetation};
use crate::simulate::truth;

/// From one measurement by hand to the next.
const APART_M: f64 = 10.0;

/// Share of off-road returns from the ground itself.
const GROUND_SHARE: f64 = 0.69;

/// The road of this experiment and of the repeat drives.
pub fn scene(bench: &Bench, seconds: f64, range_noise_mm: f64) -> Scene {
    let mut scene = Scene::default();
    scene.drive.seed = bench.seed;
    scene.drive.seconds = bench.seconds(seconds);
    scene.scanner.range_noise_mm = range_noise_mm;
    scene.sections.seed = Some(bench.seed);
    scene.sections.surface.undulation_mm = 15.0;
    scene.sections.random = Random {
        left_edge_m: [4.0, 5.0],
        road_width_m: [8.5, 9.5],
        adjacent_length_m: [5.0, 8.0],
        ditch_m: [0.0, 0.0],
        opposing_length_m: [5.0, 8.0],
        ..Random::default()
    };
    scene.vegetation = Vegetation { share: 0.3, stray_share: 0.01, ..Vegetation::default() };
    scene
}

pub fn run(bench: &Bench, report: &mut Report) -> Result<(), Error> {
    for range_noise_mm in RANGE_NOISE_MM {
        let scene = scene(bench, 60.0, range_noise_mm);
        let surface = surface(&scene);
        let captured = bench.drive("medians", &scene)?;
        let truth = &captured.made.truth;
        let whole_deg = |row: &truth::Row, kind| TrueSlope::of(row, &surface, kind).whole_deg();
        let (mut table, mut by_position) = (String::from("side,slope,slope_deg,station_m\n"), Vec::new());
        let mut next_m = truth.first().map_or(0.0, |row| row.station_m) + APART_M;
        for row in truth.iter() {
            if row.station_m < next_m {
                continue;
            }
            next_m += APART_M;
            for kind in Kind::BOTH {
                let slope = TrueSlope::of(row, &surface, kind);
                let (from, to) = slope.ends();
                let read = slope.by_hand_deg((from + to) / 2.0);
                by_position.push(read - slope.whole_deg());
                let name = if kind == Kind::Adjacent { "adjacent" } else { "opposing" };
                let _ = writeln!(table, "left,{name},{read:.1},{:.3}", row.station_m);
            }
        }
        let path = bench.file("medians.csv");
        output::write(&path, table.as_bytes())?;
        let list = manual::read(&path)?;
        let options = Options { sides: Sides::Left, within_m: 0.5, over_m: None };
        let (mut held, mut against_whole) = (Vec::new(), Vec::new());
        for method in BOTH_METHODS {
            let drive = bench.profiles("medians", &captured, method)?;
            held.push(manual::hold(&drive, &list, &options, false));
            against_whole.push(errors(&drive, |row, kind| Some(whole_deg(truth.get(row)?, kind))));
        }
        let sigma_m = range_noise_mm * 1e-3;
        let bounds: Vec<f64> = truth
            .iter()
            .step_by(20)
            .flat_map(|row| Kind::BOTH.map(|k| limit::slope_deg(&row.section, true, k, sigma_m, GROUND_SHARE)))
            .collect();
        let one = super::rms(bounds.iter().copied()).hypot(scene.ins.attitude_drift_deg);
        let by_hand = by_position.iter().map(|d| d.abs()).sum::<f64>() / by_position.len().max(1) as f64;
        let mut line = |quantity: &str, paper, values: [f64; 2], limit| {
            report.lines.push(Line {
                experiment: "medians with grass",
                quantity: quantity.to_owned(),
                range_noise_mm: Some(range_noise_mm),
                paper,
                crossfall: values[0],
                seed_search: Some(values[1]),
                limit: Some(limit),
                unit: "deg",
            });
        };
        let of = |part: fn(&manual::Manual) -> f64| [part(&held[0]), part(&held[1])];
        line("mean difference from the inclinometer", Some(0.62), of(|h| h.all.mean_absolute_deg), by_hand);
        let mean = |list: &Vec<f64>| list.iter().map(|e| e.abs()).sum::<f64>() / list.len().max(1) as f64;
        let whole = [mean(&against_whole[0]), mean(&against_whole[1])];
        line("mean error against the whole slope, one scan", None, whole, mean_magnitude(one));
        let found = |list: &Vec<f64>| list.len() as f64 / (2 * truth.len()) as f64;
        report.lines.push(Line {
            experiment: "medians with grass",
            quantity: "slopes found and not flagged doubtful".to_owned(),
            range_noise_mm: Some(range_noise_mm),
            paper: None,
            crossfall: found(&against_whole[0]),
            seed_search: Some(found(&against_whole[1])),
            limit: Some(1.0),
            unit: "share",
        });
        if range_noise_mm == RANGE_NOISE_MM[1] {
            picture(&held[0], report)?;
        }
    }
    Ok(())
}

/// Errors of the reliable slopes on the left, in degrees.
pub fn errors(drive: &Drive, truth_deg: impl Fn(usize, Kind) -> Option<f64>) -> Vec<f64> {
    let rows = drive.rows.iter().filter(|row| row.left && row.flags & UNRELIABLE == 0);
    rows.flat_map(|row| Kind::BOTH.map(|kind| (row, kind)))
        .filter_map(|(row, kind)| Some(kind.of(row)?.slope_deg - truth_deg(row.scan as usize, kind)?))
        .collect()
}

fn picture(held: &manual::Manual, report: &mut Report) -> Result<(), Error> {
    let dots: Vec<Twice> = held
        .held
        .iter()
        .map(|h| Twice { kind: h.slope, first_deg: h.manual_deg, other_deg: h.measured_deg, half_deg: None })
        .collect();
    let note = format!(
        "10 mm range noise, 30 % grass; mean difference {:.2}\u{b0}, the paper\u{2019}s 0.62\u{b0}",
        held.all.mean_absolute_deg
    );
    let words = Words {
        title: "Medians with grass",
        note: &note,
        first: "by the inclinometer on 1.22 m, \u{b0}",
        other: "by the scanner on the whole slope, \u{b0}",
    };
    report.pictures.push(Picture::new(
        "validation-medians",
        "Slopes of medians by the scanner against those by an inclinometer on part of the slope",
        |theme| plot::agreement(&dots, &words, theme),
    )?);
    Ok(())
}
