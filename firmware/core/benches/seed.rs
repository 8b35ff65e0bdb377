//! Time of the seed's mode for one side: road, edge and both slopes, from points.

#[path = "../tests/seed/scenes.rs"]
mod scenes;

use std::hint::black_box;

use criterion::{Criterion, criterion_group, criterion_main};
use crossfall_core::profile::seed::{Work, survey_side};
use crossfall_core::protocol::config::Survey;

use scenes::{Scanning, median, resampled};

fn sides(criterion: &mut Criterion) {
    let survey = Survey::default();
    let mut group = criterion.benchmark_group("seed/side");
    for (name, range_sigma_m, grass) in
        [("3.5 mm", 0.0035, false), ("10 mm", 0.010, false), ("10 mm grass", 0.010, true)]
    {
        let raw: Vec<_> =
            (0..200).map(|seed| median(seed, Scanning { beams: 2.0, range_sigma_m, grass }).points).collect();
        let spaced: Vec<_> = raw.iter().map(|points| resampled(points, 100_000)).collect();
        for (kind, sides) in [("raw", raw), ("100 mm", spaced)] {
            let mut work = Work::new();
            let mut turn = sides.iter().cycle();
            group.bench_function(format!("{kind}, {name}"), |bench| {
                bench.iter(|| survey_side(black_box(turn.next().expect("sides never end")), &survey, &mut work));
            });
        }
    }
    group.finish();
}

criterion_group!(benches, sides);
criterion_main!(benches);
