//! `crossfall simulate --terrain`: a drive with a spinning LiDAR, as a folder of frames with its truth.

use std::path::Path;

use anyhow::Context;
use crossfall::terrain::drive::TerrainScene;

use super::progress::Progress;
use super::{Outcome, tell};

/// The scene of `simulate --terrain` without a file, with comments.
pub const DEFAULT_SCENE: &str = include_str!("../../scenes/terrain.toml");

/// Simulates the scene of a file, or the default one, into a folder.
pub fn run(file: Option<&Path>, seconds: Option<f64>, seed: Option<u64>, output: &Path) -> anyhow::Result<Outcome> {
    let named = file.map_or_else(|| "the default scene".to_owned(), |path| path.display().to_string());
    let text = match file {
        Some(path) => std::fs::read_to_string(path).with_context(|| named.clone())?,
        None => DEFAULT_SCENE.to_owned(),
    };
    let mut scene: TerrainScene = toml::from_str(&text).with_context(|| named.clone())?;
    if let Some(seconds) = seconds {
        anyhow::ensure!(seconds > 0.0 && seconds <= 10_000.0, "--seconds must be above 0, at most 10000");
        scene.frames = (seconds * scene.lidar.rate_hz).ceil() as u32;
    }
    scene.seed = seed.unwrap_or(scene.seed);
    scene.check().context(named)?;
    let progress = Progress::new("simulate", u64::from(scene.frames));
    scene.write(output, |frame| progress.at(u64::from(frame)))?;
    drop(progress);
    tell!("{}: {} frames of {} rings (seed {})", output.display(), scene.frames, scene.lidar.rings, scene.seed);
    Ok(Outcome::Done)
}
