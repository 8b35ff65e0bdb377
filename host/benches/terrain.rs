//! A frame of a 64-ring sensor through the map, beside the naive way: accumulate every point in `f64` and difference the whole window with
//! plain loops.

use std::collections::HashMap;
use std::hint::black_box;

use criterion::{Criterion, criterion_group, criterion_main};
use crossfall::terrain::drive::{SimulatedFrame, TerrainScene};
use crossfall::terrain::mapper::Workshop;
use crossfall_core::terrain::TerrainConfig;

fn frames() -> Vec<SimulatedFrame> {
    let scene = TerrainScene::default();
    (0..12).map(|index| scene.frame(index).expect("the default scene is sound")).collect()
}

/// Mean height a cell, then the largest difference over 5 x 5 cells of everything known.
#[derive(Default)]
struct Naive(HashMap<(i32, i32), (f64, f64)>);

impl Naive {
    fn integrate(&mut self, frame: &SimulatedFrame) -> usize {
        for point in &frame.points {
            let turned = frame.reported.turn([0, 1, 2].map(|axis| f64::from(point[axis])));
            let at = |axis: usize| turned[axis] + frame.reported.position[axis];
            let key = ((at(0) * 10.0).floor() as i32, (at(1) * 10.0).floor() as i32);
            let cell = self.0.entry(key).or_default();
            *cell = (cell.0 + at(2), cell.1 + 1.0);
        }
        let level = |x: i32, y: i32| self.0.get(&(x, y)).map(|cell| cell.0 / cell.1);
        self.0
            .keys()
            .filter(|(x, y)| {
                let near = (-2..=2).flat_map(|dy| (-2..=2).filter_map(move |dx| level(x + dx, y + dy)));
                let (low, high) =
                    near.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), z| (low.min(z), high.max(z)));
                high - low > 0.034
            })
            .count()
    }
}

fn bench(criterion: &mut Criterion) {
    let frames = frames();
    let mut group = criterion.benchmark_group("terrain");
    group.sample_size(20);
    group.bench_function("map, 12 frames of 110,000 points", |bencher| {
        let mut workshop = Workshop::for_range(TerrainConfig::default(), 60.0, 150_000);
        bencher.iter(|| {
            let mut mapper = workshop.open().expect("the default configuration is sound");
            for frame in &frames {
                let report = mapper.integrate(&frame.points, &frame.reported, 100_000, &[]);
                black_box(report.expect("tiles are kept in memory"));
            }
        });
    });
    group.bench_function("naive, 1 frame", |bencher| {
        bencher.iter(|| black_box(Naive::default().integrate(&frames[0])));
    });
    group.finish();
}

criterion_group!(benches, bench);
criterion_main!(benches);
