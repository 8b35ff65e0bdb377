//! Simulated drives as files.

use std::path::Path;

use crossfall::simulate::scene::Scene;
use crossfall::{capture, log, run, simulate};
use crossfall_core::protocol::Config;

/// Writes the capture of a scene.
///
/// # Panics
/// When it cannot be written.
pub fn capture(scene: &Scene, path: &Path) {
    let mut writer = capture::Writer::create(path).expect("a capture");
    simulate::simulate(scene, &mut writer, |_| ()).expect("a drive");
    writer.finish().expect("a whole capture");
}

/// Writes the log of a capture, by the default configuration.
///
/// # Panics
/// When the one cannot be read or the other not be written.
pub fn log(capture: &Path, path: &Path) {
    let mut reader = capture::Reader::open(capture).expect("the capture");
    let mut writer = log::Writer::create(path).expect("a log");
    run::run(&mut reader, &Config::default(), &mut writer, |_| ()).expect("a run");
    writer.finish().expect("a whole log");
}
