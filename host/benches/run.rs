//! The whole of `run` and of `verify` over ten seconds of a simulated drive: `cargo bench -p crossfall --bench run`.

use std::hint::black_box;
use std::path::Path;

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use crossfall::simulate::scene::Scene;
use crossfall::{capture, log, run, simulate, verify};
use crossfall_core::protocol::Config;

const SECONDS: f64 = 10.0;

fn logged(capture_path: &Path, log_path: &Path) -> u64 {
    let mut reader = capture::Reader::open(capture_path).expect("the capture");
    let mut writer = log::Writer::create(log_path).expect("a log");
    let summary = run::run(&mut reader, &Config::default(), &mut writer, |_| ()).expect("a run");
    writer.finish().expect("a whole log");
    summary.profiles
}

fn whole_run(criterion: &mut Criterion) {
    let scratch = tempfile::tempdir().expect("a scratch folder");
    let (capture_path, log_path) = (scratch.path().join("drive.mcap"), scratch.path().join("drive.log.mcap"));
    let mut scene = Scene::default();
    scene.drive.seconds = SECONDS;
    let mut writer = capture::Writer::create(&capture_path).expect("a capture");
    simulate::simulate(&scene, &mut writer, |_| ()).expect("a simulation");
    writer.finish().expect("a whole capture");
    let scans = logged(&capture_path, &log_path);

    let mut group = criterion.benchmark_group("drive");
    group.throughput(Throughput::Elements(scans)).sample_size(20);
    group.bench_function("run", |bencher| bencher.iter(|| black_box(logged(&capture_path, &log_path))));
    group.bench_function("verify", |bencher| {
        bencher.iter(|| black_box(verify::verify(&log_path, |_| ()).expect("a log").profiles_reproduced));
    });
    group.finish();
}

criterion_group!(benches, whole_run);
criterion_main!(benches);
