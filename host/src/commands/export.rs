//! `crossfall export`: a log for other viewers.

use std::path::PathBuf;

use super::progress::Progress;
use super::{Outcome, distinct, drives, tell, tell_passed_over};

/// Write a log for other viewers (Foxglove)
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  crossfall export drive.log.mcap --foxglove drive.foxglove.mcap")]
pub struct Args {
    /// The log
    log: PathBuf,
    /// The MCAP file to write, with Foxglove's schemas: laser scan, point cloud, transform, location, and the profile as JSON
    #[arg(long, value_name = "FILE")]
    foxglove: PathBuf,
}

pub fn run(args: &Args) -> anyhow::Result<Outcome> {
    distinct(&[&args.log], &[&args.foxglove])?;
    drives::of(std::slice::from_ref(&args.log));
    let progress = Progress::new("export", drives::size(&args.log));
    let made = crossfall::export::foxglove(&args.log, &args.foxglove, |offset| progress.at(offset))?;
    drop(progress);
    tell!("{}: {} profiles", args.foxglove.display(), made.profiles);
    Ok(Outcome::lost_if(tell_passed_over(Some(&args.log), made.damage)))
}
