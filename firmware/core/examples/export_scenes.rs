//! Writes simulated sections for other programs to fit, and prints what the survey makes of them: `cargo run --release -p crossfall-core --example
//! export_scenes FOLDER [SECTIONS]`.
//!
//! One file a set, one line a slope: set, section, side, slope, its true inclination in degrees, then the levelled returns (y z in metres) from 0.3 m before
//! its true beginning to 0.3 m past its true end. Whoever reads it need not search: the windows are given, the levelling is done.

#[path = "../tests/scenes/mod.rs"]
mod scenes;

use std::fmt::Write as _;

use crossfall_core::profile::{Workspace, measure};
use crossfall_core::protocol::Config;
use crossfall_core::scan::{Points, level};
use scenes::{Family, Random, Scene, Truth, scene, tally};

const SEED: u64 = 1;

/// How far a window reaches beyond the ends of its slope, in metres.
const MARGIN_M: f64 = 0.3;

fn main() -> std::io::Result<()> {
    let mut arguments = std::env::args().skip(1);
    let folder = arguments.next().unwrap_or_else(|| ".".to_owned());
    let sections = arguments.next().and_then(|text| text.parse().ok()).unwrap_or(1000);
    let sets = [
        ("plain-3.5", Family::plain("3.5 mm", 0.0035)),
        ("plain-10", Family::plain("10 mm", 0.010)),
        ("grass-10", Family::grass("10 mm, grass", 0.010)),
    ];
    println!("{:>14} {:>12} {:>22} {:>18}", "set", "us a scan", "RMS degrees adj / opp", "above 1 degree");
    for (file, family) in sets {
        let mut random = Random::new(SEED);
        let mut text = String::new();
        for index in 0..sections {
            write_section(&mut text, file, index, &scene(&family, &mut random, index));
        }
        std::fs::write(format!("{folder}/{file}.txt"), text)?;
        let tally = tally::run(&family, sections, SEED);
        let cost_us = cost_us(&family, sections);
        let (adjacent, opposing) = (&tally.adjacent, &tally.opposing);
        println!(
            "{file:>14} {:>12.1} {:>13.3} / {:.3} {:>12} / {}",
            cost_us,
            adjacent.rms(),
            opposing.rms(),
            adjacent.far,
            opposing.far
        );
    }
    Ok(())
}

/// Processor time of a scan, the least of three rounds: what else the machine does is not in it.
fn cost_us(family: &Family, sections: u32) -> f64 {
    let mut random = Random::new(SEED);
    let scenes: Vec<Scene> = (0..sections).map(|index| scene(family, &mut random, index)).collect();
    let (config, mut work) = (Config::default(), Workspace::new());
    let mut round = || {
        let begin = processor_ns();
        for scene in &scenes {
            std::hint::black_box(measure(&scene.scan, &scene.track, &config, &mut work));
        }
        (processor_ns() - begin) as f64 / 1e3 / f64::from(sections)
    };
    std::iter::repeat_with(&mut round).take(3).fold(f64::INFINITY, f64::min)
}

/// Nanoseconds that this process has run, by Linux.
fn processor_ns() -> u64 {
    let text = std::fs::read_to_string("/proc/self/schedstat").unwrap_or_default();
    text.split_whitespace().next().and_then(|word| word.parse().ok()).unwrap_or(0)
}

fn write_section(text: &mut String, set: &str, index: u32, scene: &Scene) {
    let mut points = Points::new();
    level(&scene.scan, &scene.track, &Config::default().scanner, &mut points);
    let places: Vec<(f64, f64)> =
        points.iter().map(|echo| (f64::from(echo.point.y_um) * 1e-6, f64::from(echo.point.z_um) * 1e-6)).collect();
    for (side, truth, outward) in [("left", &scene.left, 1.0), ("right", &scene.right, -1.0)] {
        let Truth { edge_m, foot_m, adjacent_deg, opposing_start_m, top_m, opposing_deg, .. } = *truth;
        let opposing = opposing_deg.map(|degrees| ("opposing", degrees, opposing_start_m, top_m));
        for (slope, degrees, from, to) in [("adjacent", adjacent_deg, edge_m, foot_m)].into_iter().chain(opposing) {
            let _ = write!(text, "{set} {index} {side} {slope} {degrees:.9}");
            let window = (from - MARGIN_M)..(to + MARGIN_M);
            for (y, z) in places.iter().map(|(y, z)| (y * outward, *z)).filter(|(y, _)| window.contains(y)) {
                let _ = write!(text, " {y:.6} {z:.6}");
            }
            text.push('\n');
        }
    }
}
