//! `crossfall simulate`: the bytes that both sensors would send on a drive whose truth is known, as a capture.
//!
//! The scene (see `host/scenes/`) says what the road and its slopes look like and how the sensors err. The same scene and seed give the same
//! bytes on every platform.

use std::path::PathBuf;

use anyhow::Context;
use crossfall::capture::Writer;
use crossfall::output::Output;
use crossfall::simulate::{self, scene::Scene, truth};

use super::progress::Progress;
use super::{Outcome, distinct, paths, tell, terrain_scene};

/// Simulate a drive: sensor bytes with known truth
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  crossfall simulate -o drive.mcap --truth drive.truth.csv
  crossfall simulate --scene host/scenes/stations.toml --seconds 20 --seed 7 \\
      -o drive.mcap
  crossfall simulate --terrain --seconds 4 -o frames
  crossfall simulate --print-scene > my.toml")]
pub struct Args {
    /// The capture to write
    #[arg(short, long, value_name = "CAPTURE", required_unless_present = "print_scene")]
    output: Option<PathBuf>,
    /// What to simulate (TOML); without it the drive of `crossfall demo`
    #[arg(long, value_name = "FILE")]
    scene: Option<PathBuf>,
    /// Seconds of scanning, instead of the scene's
    #[arg(long, value_parser = super::number(0.1, 86_400.0))]
    seconds: Option<f64>,
    /// Seed of everything random, instead of the scene's
    #[arg(long)]
    seed: Option<u64>,
    /// Also write the truth of every scan (CSV)
    #[arg(long, value_name = "FILE")]
    truth: Option<PathBuf>,
    /// A spinning LiDAR on a road with curbs and bumps instead: OUTPUT is a folder of 3-D frames with its truth
    #[arg(long, conflicts_with = "truth")]
    terrain: bool,
    /// Print the default scene with comments and stop
    #[arg(long)]
    print_scene: bool,
}

/// The scene of a file, or the default one, with the values given on the command line.
pub fn scene(file: Option<&PathBuf>, seconds: Option<f64>, seed: Option<u64>) -> anyhow::Result<Scene> {
    let mut scene = file.map(|path| Scene::read(path)).transpose()?.unwrap_or_default();
    scene.drive.seconds = seconds.unwrap_or(scene.drive.seconds);
    scene.drive.seed = seed.unwrap_or(scene.drive.seed);
    scene.check().context("the scene cannot be simulated")?;
    Ok(scene)
}

pub fn run(args: &Args) -> anyhow::Result<Outcome> {
    let Some(output) = args.output.as_ref().filter(|_| !args.print_scene) else {
        let scene = if args.terrain { terrain_scene::DEFAULT_SCENE } else { include_str!("../../scenes/default.toml") };
        super::say(scene.trim_end())?;
        return Ok(Outcome::Done);
    };
    if args.terrain {
        return terrain_scene::run(args.scene.as_deref(), args.seconds, args.seed, output);
    }
    let scene = scene(args.scene.as_ref(), args.seconds, args.seed)?;
    distinct(&paths(&args.scene), &paths([output].into_iter().chain(&args.truth)))?;
    let mut capture = Writer::create(output)?;
    let mut table = args.truth.as_deref().map(Output::create).transpose()?;
    let progress = Progress::new("simulate", simulate::scans(&scene) as u64);
    let made = simulate::simulate(&scene, &mut capture, |scan| progress.at(scan as u64))?;
    drop(progress);
    if let Some(table) = &mut table {
        truth::write_csv(&made.truth, &mut *table).with_context(|| table.path().display().to_string())?;
    }
    capture.finish()?;
    if let Some(table) = table {
        table.commit()?;
    }
    let (scans, poses, pulses) = (made.truth.len(), made.poses, made.pulses);
    tell!("{}: {scans} scans, {poses} poses, {pulses} pulses (seed {})", output.display(), scene.drive.seed);
    Ok(Outcome::Done)
}
