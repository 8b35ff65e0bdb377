//! Time to measure one scan, both sides, from ranges to intervals: `cargo bench -p crossfall-core --bench survey`.

#[path = "../tests/scenes/mod.rs"]
mod scenes;

use std::hint::black_box;

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use crossfall_core::profile::{Workspace, measure};
use crossfall_core::protocol::Config;
use scenes::{Family, Random, scene};

/// Scenes a set; one iteration measures them all.
const SCENES: u32 = 100;

fn survey(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("survey");
    group.throughput(Throughput::Elements(u64::from(SCENES)));
    let sets = [Family::plain("3.5 mm", 0.0035), Family::plain("10 mm", 0.010), Family::grass("10 mm grass", 0.010)];
    for family in &sets {
        let mut random = Random::new(1);
        let scenes: Vec<_> = (0..SCENES).map(|index| scene(family, &mut random, index)).collect();
        let config = Config::default();
        let mut work = Workspace::new();
        group.bench_function(family.name, |bencher| {
            bencher.iter(|| {
                for scene in &scenes {
                    black_box(measure(black_box(&scene.scan), &scene.track, &config, &mut work));
                }
            });
        });
    }
    group.finish();
}

criterion_group!(benches, survey);
criterion_main!(benches);
