//! `crossfall report`: one HTML page of a drive, which needs nothing else.
//!
//! Slopes along the road with their intervals, the section at any place, the trace on a map, a summary by the mile, the instrument's health and the
//! calibration that was used.

use std::path::{Path, PathBuf};

use crossfall::drive::Drive;
use crossfall::{dataset, output, report};

use super::progress::Progress;
use super::{Outcome, distinct, drives, table_format, tell, tell_passed_over};

/// Write the report of a drive: one self-contained HTML page
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  crossfall report drive.log.mcap -o drive.html
  crossfall report drive.log.mcap -o i80.html \\
      --title \"I-80 westbound, mile 147 to 161\"
  crossfall report drive.log.mcap --profiles drive.parquet -o drive.html")]
pub struct Args {
    /// The log
    log: PathBuf,
    /// The page to write
    #[arg(short, long, value_name = "FILE")]
    output: PathBuf,
    /// Its title; without it the log's name
    #[arg(long)]
    title: Option<String>,
    /// Also write the table of profiles, in the same reading of the log (.csv, .parquet, .geojson)
    #[arg(long, value_name = "FILE")]
    profiles: Option<PathBuf>,
}

pub fn run(args: &Args) -> anyhow::Result<Outcome> {
    let outputs: Vec<&Path> = args.profiles.iter().map(PathBuf::as_path).chain([args.output.as_path()]).collect();
    distinct(&[&args.log], &outputs)?;
    let table = args.profiles.as_deref().map(|to| anyhow::Ok((to, table_format(to)?))).transpose()?;
    drives::of(std::slice::from_ref(&args.log));
    let progress = Progress::new("report", drives::size(&args.log));
    let (drive, written) = match table {
        None => (Drive::read(&args.log, |offset| progress.at(offset))?, None),
        Some((to, format)) => {
            let (written, drive) = dataset::write_from(None, format, to, |sink| {
                let progress = |offset| progress.at(offset);
                Drive::read_with(&args.log, progress, |rows| {
                    for row in rows {
                        sink.push(row);
                    }
                })
            })?;
            (drive, Some(written))
        }
    };
    drop(progress);
    anyhow::ensure!(!drive.scans.is_empty(), "{}: the log has no profile", args.log.display());
    let name = args.log.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
    let title = args.title.as_deref().unwrap_or(&name);
    output::write(&args.output, report::page(&drive, title).as_bytes())?;
    tell!("{}: {} sections", args.output.display(), drive.scans.len());
    if let Some(written) = written {
        tell!("{}: {} rows", written.path.display(), written.rows.unwrap_or_default());
    }
    Ok(Outcome::lost_if(tell_passed_over(Some(&args.log), drive.health.passed_over())))
}
