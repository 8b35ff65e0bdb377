//! Cost of the link: the range code alone, and a scan from message to frame and back.
//!
//! `cargo bench -p crossfall-protocol`. One iteration is one scan of 361 values; sizes are those of the test `sizes`.

#[path = "../tests/sections/mod.rs"]
mod sections;

use std::hint::black_box;

use criterion::{BatchSize, Criterion, criterion_group, criterion_main};
use crossfall_protocol::DeviceTime;
use crossfall_protocol::frame::{HostDecoder, MAX_MESSAGE_FRAME};
use crossfall_protocol::message::{Message, Scan};
use crossfall_protocol::ranges::{MAX_CODE, MAX_VALUES, decode, encode};
use sections::{Cover, LAYOUT, MODE};

fn ranges(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("ranges");
    for sigma_mm in [3.5, 10.0] {
        let scans = sections::scans(64, sigma_mm, Cover::Bare, 88_172_645_463_325_252);
        let codes: Vec<Vec<u8>> =
            scans.iter().map(|scan| encode(LAYOUT, MODE, scan, &mut [0; MAX_CODE]).to_vec()).collect();
        let mut next = 0;
        let mut turn = || {
            next = (next + 1) % scans.len();
            next
        };
        group.bench_function(format!("encode {sigma_mm} mm"), |bencher| {
            let mut code = [0; MAX_CODE];
            bencher.iter_batched(
                &mut turn,
                |i| encode(LAYOUT, MODE, black_box(&scans[i]), &mut code).len(),
                BatchSize::SmallInput,
            );
        });
        group.bench_function(format!("decode {sigma_mm} mm"), |bencher| {
            let mut values = [0; MAX_VALUES];
            bencher.iter_batched(
                &mut turn,
                |i| decode(LAYOUT, MODE, black_box(&codes[i]), &mut values).is_ok(),
                BatchSize::SmallInput,
            );
        });
    }
    group.finish();
}

fn frames(criterion: &mut Criterion) {
    let scan = &sections::scans(1, 3.5, Cover::Bare, 1)[0];
    let mut code = [0; MAX_CODE];
    let code = encode(LAYOUT, MODE, scan, &mut code);
    let message = Message::Scan(Scan {
        index: 135_135,
        stx: DeviceTime(3_600_000_000),
        layout: LAYOUT,
        mode: MODE,
        status: 0x10,
        counters: None,
        code,
    });
    let mut group = criterion.benchmark_group("frame");
    let mut frame = [0; MAX_MESSAGE_FRAME];
    let len = message.encode(50_000, &mut frame).expect("a scan fits");
    group.bench_function("encode a scan's frame", |bencher| {
        let mut out = [0; MAX_MESSAGE_FRAME];
        bencher.iter(|| black_box(&message).encode(50_000, &mut out));
    });
    group.bench_function("decode a scan's frame", |bencher| {
        let mut decoder = HostDecoder::new();
        bencher.iter(|| decoder.next(&mut black_box(&frame[..len])).is_some());
    });
    group.finish();
}

criterion_group!(benches, ranges, frames);
criterion_main!(benches);
