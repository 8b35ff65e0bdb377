//! Decoding speed: `cargo bench -p crossfall-core --bench sensors`.
//!
//! Clean streams as sent on a drive, the same with a bit flipped every 500 bytes, and the worst that a line can carry:
//! nothing but headers, each claiming a long frame. Throughput is that of the bytes.

use std::hint::black_box;

use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use crossfall_core::protocol::DeviceTime;
use crossfall_core::sensors::{lms2xx, novatel};

/// A stream of telegrams of 361 ranges with indices, and the number of telegrams.
fn telegrams() -> (Vec<u8>, usize) {
    let mut stream = Vec::new();
    for n in 0..64u16 {
        let mut telegram = vec![0x02, 0x80, 0xd8, 0x02, 0xb0, 0x69, 0x41];
        (0..361u16).for_each(|beam| telegram.extend((2_500 + ((beam * 37) ^ (n * 11)) % 6_000).to_le_bytes()));
        telegram.extend([n as u8 * 2, n as u8, 0x10]);
        telegram.extend(lms2xx::crc(&telegram).to_le_bytes());
        stream.extend(telegram);
    }
    (stream, 64)
}

/// A stream of INSPVAS frames, and their number.
fn frames() -> (Vec<u8>, usize) {
    let mut stream = Vec::new();
    for n in 0..512u32 {
        let mut frame = vec![0xaa, 0x44, 0x13, 88, 0xfc, 0x01, 0xa1, 0x08, 0, 0, 0, 0];
        frame.extend(2_209u32.to_le_bytes());
        frame.extend((490_000.0 + f64::from(n) * 0.01).to_le_bytes());
        for value in [51.116, -114.038, 1_048.5, 12.5, -0.25, 0.05, -2.5, 0.75, 158.0] {
            frame.extend((value + f64::from(n) * 1e-4).to_le_bytes());
        }
        frame.extend(3u32.to_le_bytes());
        frame.extend(novatel::crc32(&frame).to_le_bytes());
        stream.extend(frame);
    }
    (stream, 512)
}

fn flipped(mut stream: Vec<u8>) -> Vec<u8> {
    stream.iter_mut().step_by(500).for_each(|byte| *byte ^= 0x20);
    stream
}

fn sensors(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("lms2xx");
    let (clean, count) = telegrams();
    println!("{} bytes a telegram", clean.len() / count);
    let dense = [0x02, 0x80, 0xff].into_iter().cycle().take(clean.len()).collect();
    for (name, stream) in [("clean", clean.clone()), ("flipped", flipped(clean)), ("headers only", dense)] {
        group.throughput(Throughput::Bytes(stream.len() as u64));
        group.bench_with_input(BenchmarkId::from_parameter(name), &stream, |bencher, stream| {
            let mut decoder = lms2xx::Decoder::new(6);
            bencher.iter(|| {
                for (i, &byte) in stream.iter().enumerate() {
                    decoder.push(byte, DeviceTime(i as u64), &mut |event| _ = black_box(&event));
                }
            });
        });
    }
    group.finish();

    let mut group = criterion.benchmark_group("novatel");
    let (clean, count) = frames();
    println!("{} bytes a frame", clean.len() / count);
    let dense = [0xaa, 0x44, 0x13].into_iter().cycle().take(clean.len()).collect();
    for (name, stream) in [("clean", clean.clone()), ("flipped", flipped(clean)), ("headers only", dense)] {
        group.throughput(Throughput::Bytes(stream.len() as u64));
        group.bench_with_input(BenchmarkId::from_parameter(name), &stream, |bencher, stream| {
            let mut decoder = novatel::Decoder::new();
            bencher.iter(|| {
                for (i, &byte) in stream.iter().enumerate() {
                    decoder.push(byte, DeviceTime(i as u64), &mut |event| _ = black_box(&event));
                }
            });
        });
    }
    group.finish();
}

criterion_group!(benches, sensors);
criterion_main!(benches);
