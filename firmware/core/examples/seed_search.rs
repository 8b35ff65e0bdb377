//! The figures of `docs/seed-search.md`: cost and error of the seed's mode on random medians, beside trying all pairs.
//!
//! `cargo run --release -p crossfall-core --example seed_search [MEDIANS]`

#[path = "../tests/seed/oracle.rs"]
mod oracle;
#[path = "../tests/seed/scenes.rs"]
mod scenes;

use std::time::Instant;

use crossfall_core::profile::seed::{self, Work};
use crossfall_core::protocol::config::Survey;
use crossfall_core::protocol::message::Slope;
use crossfall_core::scan::Point;

use scenes::{Median, Scanning, UNKIND, median, resampled, unkind};

fn main() {
    let medians = std::env::args().nth(1).map_or(1000, |text| text.parse().expect("the number of medians"));
    println!(
        "points    noise           us/side  us worst  steps/side  steps worst  all pairs   ratio  adjacent rms median  >1 deg  found  opposing rms median  >1 deg  found"
    );
    for (name, range_sigma_m, grass) in [
        ("3.5 mm", 0.0035, false),
        ("10 mm", 0.010, false),
        ("3.5 mm grass", 0.0035, true),
        ("10 mm grass", 0.010, true),
    ] {
        let scanned: Vec<_> =
            (0..medians).map(|seed| median(seed, Scanning { beams: 2.0, range_sigma_m, grass })).collect();
        for (kind, spacing_um) in [("raw", None), ("100 mm", Some(100_000))] {
            let sides: Vec<_> = scanned
                .iter()
                .map(|m| spacing_um.map_or_else(|| m.points.clone(), |spacing| resampled(&m.points, spacing)))
                .collect();
            println!("{kind:8}  {name:12}  {}", measured(&scanned, &sides));
        }
    }
    println!("\nthe most steps of {medians} times each unkind set of up to 180 points");
    for kind in UNKIND {
        let mut work = Work::new();
        let worst = (0..medians).map(|seed| {
            work.reset_steps();
            let points = unkind(kind, seed, 180);
            let within = points.iter().take_while(|p| p.y_um.abs().max(p.z_um.abs()) < 1 << 29).count();
            let survey = Survey::default();
            let criterion = seed::Criterion::new(&survey.limits, &survey.seed);
            let start = Instant::now();
            let _ = seed::search(&points[..within], 0, &criterion, &mut work);
            (work.steps(), start.elapsed().as_micros())
        });
        println!("{:12} {:?}", format!("{kind:?}"), worst.max());
    }
}

/// One row of the table.
fn measured(scanned: &[Median], sides: &[Vec<Point>]) -> String {
    let survey = Survey::default();
    let mut work = Work::new();
    let mut surveyed = Vec::new();
    let (mut best_us, mut worst_us) = (f64::MAX, 0.0_f64);
    for _ in 0..5 {
        surveyed.clear();
        let start = Instant::now();
        for points in sides {
            work.reset_steps();
            let side_start = Instant::now();
            let side = seed::survey_side(points, &survey, &mut work);
            worst_us = worst_us.max(side_start.elapsed().as_secs_f64() * 1e6);
            surveyed.push((side, work.steps()));
        }
        best_us = best_us.min(start.elapsed().as_secs_f64() * 1e6 / sides.len() as f64);
    }
    let steps = surveyed.iter().map(|s| u64::from(s.1)).sum::<u64>() / sides.len() as u64;
    let worst_steps = surveyed.iter().map(|s| s.1).max().unwrap_or(0);
    // All pairs are tried on every eighth side only: it takes its time.
    let every = 8;
    let all_pairs: u64 = (sides.iter().zip(&surveyed).step_by(every))
        .map(|(points, (side, _))| {
            let at = |y_um: i32| points.iter().position(|p| p.y_um == y_um).expect("hinges are points");
            let Some(edge) = side.edge else { return 0 };
            let adjacent = oracle::exhaust(points, at(edge.y_um), &survey);
            let opposing = adjacent.best.filter(|b| b.end_seen).map(|b| oracle::exhaust(points, b.end, &survey));
            adjacent.steps + opposing.map_or(0, |o| o.steps)
        })
        .sum();
    let some: u64 = surveyed.iter().step_by(every).map(|s| u64::from(s.1)).sum();
    let adjacent = errors(surveyed.iter().zip(scanned).map(|((side, _), m)| (side.adjacent, m.adjacent_deg)));
    let opposing = errors(surveyed.iter().zip(scanned).map(|((side, _), m)| (side.opposing, m.opposing_deg)));
    format!(
        "{best_us:8.1}  {worst_us:8.1}  {steps:10}  {worst_steps:11}  {:9}  {:6.1}  {adjacent}  {opposing}",
        all_pairs / (sides.len().div_ceil(every)) as u64,
        all_pairs as f64 / some as f64,
    )
}

/// RMS, median, share above one degree and share found.
fn errors(slopes: impl Iterator<Item = (Option<Slope>, f64)>) -> String {
    let (mut errors, mut all) = (Vec::new(), 0);
    for (slope, truth_deg) in slopes {
        all += 1;
        if let Some(slope) = slope {
            errors.push((f64::from(slope.angle.to_microdegrees()) * 1e-6 - truth_deg).abs());
        }
    }
    errors.sort_by(f64::total_cmp);
    let found = errors.len() as f64;
    let rms = (errors.iter().map(|e| e * e).sum::<f64>() / found).sqrt();
    let median = errors.get(errors.len() / 2).copied().unwrap_or(f64::NAN);
    let wrong = errors.iter().filter(|e| **e > 1.0).count() as f64 / found * 100.0;
    format!("{rms:12.3} {median:6.3}  {wrong:5.1}%  {:4.1}%", found / f64::from(all) * 100.0)
}
