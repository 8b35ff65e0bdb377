//! The same bytes make the same log, however a capture cuts them.

use std::path::{Path, PathBuf};

use crossfall::capture::{self, Channel, Chunk};
use crossfall::{log, run};
use crossfall_core::protocol::Config;
use crossfall_tests::recordings;

/// Scans of the example that are enough to cross several pulses.
const CHUNKS: usize = 500;

/// Time of one byte: 500 kbaud for the scanner, 230,400 for the inertial unit, whose frames follow too closely for less.
fn byte_ns(channel: Channel) -> u64 {
    if channel == Channel::Lidar { 20_000 } else { 43_402 }
}

/// A small generator of the tests' own, so that a failure repeats.
struct Draw(u64);

impl Draw {
    fn below(&mut self, end: usize) -> usize {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        ((self.0 >> 33) as usize) % end
    }
}

fn example() -> Option<Vec<Chunk>> {
    let folder = recordings("capture")?;
    let reader = capture::Reader::open(&folder.join("example.mcap")).expect("the capture");
    Some(reader.take(CHUNKS).map(|chunk| chunk.expect("a chunk")).collect())
}

/// The chunks as a capture, through the core, to the bytes of a log.
fn logged(chunks: &[Chunk], folder: &Path, name: &str) -> Vec<u8> {
    let path: PathBuf = folder.join(format!("{name}.mcap"));
    let mut writer = capture::Writer::create(&path).expect("a capture");
    for chunk in chunks {
        writer.write(chunk.channel, chunk.device_time_ns, &chunk.data).expect("room on the disk");
    }
    writer.finish().expect("a whole capture");
    let log_path = folder.join(format!("{name}.log.mcap"));
    let mut reader = capture::Reader::open(&path).expect("the capture");
    let mut log = log::Writer::create(&log_path).expect("a log");
    run::run(&mut reader, &Config::default(), &mut log, |_| ()).expect("a run");
    log.finish().expect("a whole log");
    std::fs::read(log_path).expect("the log")
}

/// Cuts every chunk into pieces of at most `longest` bytes. With `exact`, a piece carries the arrival of its own first byte, else that of the whole.
fn cut(chunks: &[Chunk], longest: usize, exact: bool, draw: &mut Draw) -> Vec<Chunk> {
    let mut pieces = Vec::new();
    for chunk in chunks {
        if chunk.data.is_empty() {
            pieces.push(chunk.clone());
        }
        let mut start = 0;
        while start < chunk.data.len() {
            let end = (start + 1 + draw.below(longest)).min(chunk.data.len());
            let shift = if exact { start as u64 * byte_ns(chunk.channel) } else { 0 };
            let device_time_ns = chunk.device_time_ns + shift;
            pieces.push(Chunk { device_time_ns, data: chunk.data[start..end].to_vec(), ..chunk.clone() });
            start = end;
        }
    }
    pieces
}

#[test]
fn two_runs_make_one_log() {
    let Some(chunks) = example() else { return };
    let scratch = tempfile::tempdir().expect("a scratch folder");
    assert!(logged(&chunks, scratch.path(), "a") == logged(&chunks, scratch.path(), "b"));
}

#[test]
fn cuts_do_not_show_in_the_log() {
    let Some(chunks) = example() else { return };
    let scratch = tempfile::tempdir().expect("a scratch folder");
    let whole = logged(&chunks, scratch.path(), "whole");
    let mut draw = Draw(291);
    for (name, longest, exact) in
        [("bytes", 1, true), ("bytes-same-stamp", 1, false), ("random", 700, true), ("random-same-stamp", 90, false)]
    {
        let pieces = cut(&chunks, longest, exact, &mut draw);
        assert!(pieces.len() > chunks.len());
        assert!(logged(&pieces, scratch.path(), name) == whole, "cut as {name}");
    }
}
