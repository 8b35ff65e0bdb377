//! `crossfall report`: one HTML page of a drive, which needs nothing else.
//!
//! Slopes along the road with their intervals, the section at any place, the trace on a map, a summary by the mile, the instrument's health and the
//! calibration that was used.

use std::path::PathBuf;

use crossfall::drive::Drive;
use crossfall::{output, report};

use super::progress::Progress;
use super::{Outcome, distinct, tell};

/// Write the report of a drive: one self-contained HTML page
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  crossfall report drive.log.mcap -o drive.html
  crossfall report drive.log.mcap --title \"I-80 westbound, mile 147 to 161\" -o i80.html")]
pub struct Args {
    /// The log
    log: PathBuf,
    /// The page to write
    #[arg(short, long, value_name = "FILE")]
    output: PathBuf,
    /// Its title; without it the log's name
    #[arg(long)]
    title: Option<String>,
}

pub fn run(args: &Args) -> anyhow::Result<Outcome> {
    distinct(&[&args.log], &args.output)?;
    let progress = Progress::new("report", std::fs::metadata(&args.log).map_or(0, |metadata| metadata.len()));
    let drive = Drive::read(&args.log, |offset| progress.at(offset))?;
    drop(progress);
    anyhow::ensure!(!drive.scans.is_empty(), "{}: the log has no profile", args.log.display());
    let name = args.log.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
    let title = args.title.as_deref().unwrap_or(&name);
    output::write(&args.output, report::page(&drive, title).as_bytes())?;
    tell!("{}: {} sections", args.output.display(), drive.scans.len());
    let lost = drive.health.damage + drive.health.unmatched;
    if lost > 0 {
        tell!("{}: {lost} damaged, broken or missing parts passed over; see `crossfall verify`", args.log.display());
    }
    Ok(Outcome::lost_if(lost > 0))
}
