//! `crossfall cloud`: the returns of one drive or several as one cloud of points on the map.
//!
//! UTM (WGS 84), ellipsoid heights, GPS time; classes road (11), adjacent slope (64), opposing slope (65), vegetation (3), other (1). The log that a point
//! is from is its source: 1 is the first.

use std::path::PathBuf;

use anyhow::Context;
use crossfall::cloud::{self, Class, Format};

use super::progress::Progress;
use super::{Outcome, distinct, drives, paths, say_json, tell, tell_passed_over};

/// Write the returns as a point cloud on the map (LAS, LAZ, PLY)
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  crossfall cloud drive.log.mcap -o drive.laz
  crossfall cloud up.log.mcap down.log.mcap -o road.laz
  crossfall cloud drive.log.mcap -o drive.ply --json")]
pub struct Args {
    /// The log, or several
    #[arg(required = true)]
    logs: Vec<PathBuf>,
    /// The file to write, its format by its name: .las, .laz, .ply
    #[arg(short, long, value_name = "FILE")]
    output: PathBuf,
    /// Print what was made for machines
    #[arg(long)]
    json: bool,
}

pub fn run(args: &Args) -> anyhow::Result<Outcome> {
    let format = Format::of(&args.output);
    let format = format
        .with_context(|| format!("{}: expected a name that ends in .las, .laz or .ply", args.output.display()))?;
    let logs = drives::of(&args.logs);
    distinct(&paths(&logs), &[&args.output])?;
    let sizes: Vec<u64> = logs.iter().map(|log| drives::size(log)).collect();
    let progress = Progress::new("cloud", sizes.iter().sum());
    let made = cloud::write(&logs, format, &args.output, |log, offset| {
        progress.at(sizes.iter().take(log).sum::<u64>() + offset);
    })?;
    drop(progress);
    let classes = Class::ALL.iter().zip(made.classes);
    if args.json {
        let classes: serde_json::Map<_, _> =
            classes.map(|(class, count)| (class.name().replace(' ', "_"), count.into())).collect();
        say_json(&serde_json::json!({
            "points": made.points, "classes": classes, "epsg": made.epsg, "scans_without_pose": made.unplaced,
            "points_too_far": made.too_far, "damage": made.damage,
        }))?;
    } else {
        let told: Vec<_> = classes.map(|(class, count)| format!("{count} {}", class.name())).collect();
        tell!("{}: {} points, EPSG:{} ({})", args.output.display(), made.points, made.epsg, told.join(", "));
    }
    if made.unplaced > 0 {
        tell!("{} scans without a position or an attitude are not in it", made.unplaced);
    }
    if made.too_far > 0 {
        tell!("{} returns lie more than 2,000 km from the first and are not in it", made.too_far);
    }
    let one = if let [log] = logs.as_slice() { Some(log.as_path()) } else { None };
    let lost = tell_passed_over(one, made.damage);
    Ok(Outcome::lost_if(lost || made.too_far > 0))
}
