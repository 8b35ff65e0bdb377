//! Where fuzzing begins: real inputs of every target, from a simulated drive.

use std::path::Path;

use crossfall::capture::{self, Channel};
use crossfall::simulate::scene::Scene;
use crossfall::{config, log};
use crossfall_core::protocol::Config;
use crossfall_core::protocol::frame::{Event, HostDecoder, MAX_COMMAND_FRAME};
use crossfall_core::protocol::message::{Command, Message};

use crate::drives;

use super::mutate::Draw;
use super::{TARGETS, frames};

/// Seconds of the drive.
const SECONDS: f64 = 1.5;

/// Inputs by the name of their target, in the order of [`TARGETS`].
pub type Corpus = Vec<(&'static str, Vec<Vec<u8>>)>;

/// Makes the corpus; `scratch` is a folder for files on the way.
///
/// # Panics
/// When the folder cannot be written.
#[must_use]
pub fn make(scratch: &Path) -> Corpus {
    let (capture_path, log_path) = (scratch.join("c.mcap"), scratch.join("l.mcap"));
    let mut scene = Scene::default();
    scene.drive.seconds = SECONDS;
    drives::capture(&scene, &capture_path);
    drives::log(&capture_path, &log_path);

    let line = |wanted: Channel| -> Vec<Vec<u8>> {
        let reader = capture::Reader::open(&capture_path).expect("the capture");
        let pieces = reader.map(|chunk| chunk.expect("a chunk")).filter(|chunk| chunk.channel == wanted);
        pieces.map(|chunk| chunk.data).collect()
    };
    let frames: Vec<Vec<u8>> =
        log::Reader::open(&log_path).expect("the log").map(|frame| frame.expect("a frame").bytes).collect();
    let joined = |pieces: &[Vec<u8>], each: usize| -> Vec<Vec<u8>> {
        pieces.chunks(each).take(12).map(<[Vec<u8>]>::concat).collect()
    };
    let files = [&capture_path, &log_path].map(|path| std::fs::read(path).expect("a file"));
    // Not whole: mutations of kilobytes find more than those of a hundred.
    let short = |bytes: &Vec<u8>| bytes[..bytes.len().min(6_000)].to_vec();
    let inputs = |name: &str| -> Vec<Vec<u8>> {
        match name {
            "lms" => joined(&line(Channel::Lidar), 2),
            "novatel" => joined(&line(Channel::Ins), 5),
            "link" => joined(&frames, 6),
            "ranges" => frames.iter().filter_map(|frame| range_code(frame)).take(12).collect(),
            "commands" => commands(),
            "log_reader" => files.iter().cloned().chain(files.iter().map(short)).collect(),
            "scene_toml" => {
                ["host/scenes/default.toml", "host/scenes/stations.toml"].map(|path| text(path).into_bytes()).into()
            }
            "config_toml" => vec![config::to_toml(&Config::default()).into_bytes()],
            // Steps drawn by their bytes: any bytes are steps.
            "instrument" => (0..12).map(|seed| noise(seed, 400 + 200 * seed as usize)).collect(),
            "frames" => frames::corpus(scratch),
            _ => Vec::new(),
        }
    };
    TARGETS.iter().map(|(name, _)| (*name, inputs(name))).collect()
}

fn text(path: &str) -> String {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    std::fs::read_to_string(root.join(path)).expect("a scene of the repository")
}

/// Layout, mode and code, as the target takes them.
fn range_code(frame: &[u8]) -> Option<Vec<u8>> {
    let mut decoder = HostDecoder::new();
    let Some(Event::Frame(frame)) = decoder.next(&mut &frame[..]) else { return None };
    let Message::Scan(scan) = frame.body else { return None };
    let [low, high] = scan.layout.to_le_bytes();
    let head = [low, high, scan.mode.span_deg, scan.mode.step_cdeg, scan.mode.measuring];
    Some([&head, scan.code].concat())
}

fn commands() -> Vec<Vec<u8>> {
    let all =
        [Command::Identify, Command::Ping(291), Command::Configure(Config::default()), Command::Start, Command::Stop];
    let encoded = all.iter().zip(0..).map(|(command, sequence)| {
        let mut out = [0; MAX_COMMAND_FRAME];
        let length = command.encode(sequence, &mut out).expect("room");
        out[..length].to_vec()
    });
    let all: Vec<Vec<u8>> = encoded.collect();
    std::iter::once(all.concat()).chain(all.iter().cloned()).collect()
}

fn noise(seed: u64, length: usize) -> Vec<u8> {
    let mut draw = Draw::new(seed);
    (0..length).map(|_| draw.bits() as u8).collect()
}
