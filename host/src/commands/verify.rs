//! `crossfall verify`: proves a log.
//!
//! Frames whole and none missing, time going forward, the clock plausible, every profile recomputed bit for bit from the scans, poses and
//! pulses of the log itself. What is wrong is told with the number of the frame and the offset in the file.

use std::fs;
use std::path::PathBuf;

use super::progress::Progress;
use super::{Outcome, say, say_json, tell};

/// Prove that a log is whole and its profiles are right
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  crossfall verify drive.log.mcap
  crossfall verify drive.log.mcap --json")]
pub struct Args {
    /// The log
    log: PathBuf,
    /// Print the verdict for machines
    #[arg(long)]
    json: bool,
}

pub fn run(args: &Args) -> anyhow::Result<Outcome> {
    let size = fs::metadata(&args.log).map_or(0, |metadata| metadata.len());
    let progress = Progress::new("verify", size);
    let report = crossfall::verify::verify(&args.log, |offset| progress.at(offset))?;
    drop(progress);
    if args.json {
        say_json(&report)?;
        return Ok(Outcome::lost_if(!report.ok));
    }
    for problem in &report.problems {
        tell!("frame {} at byte {}: {}", problem.frame, problem.offset, problem.what);
    }
    let untold = report.problem_count.saturating_sub(report.problems.len() as u64);
    if untold > 0 {
        tell!("... and {untold} more");
    }
    let (all, same) = (report.profiles, report.profiles_reproduced);
    let verdict = if all == same {
        format!("all {all} profiles reproduced")
    } else {
        format!("{same} of {all} profiles reproduced")
    };
    say(&format!(
        "{} frames, {} bad, {} missing; {verdict}{}",
        report.frames,
        report.bad_frames,
        report.missing_frames,
        if report.profiles_unverifiable > 0 {
            format!(", {} cannot be", report.profiles_unverifiable)
        } else {
            String::new()
        }
    ))?;
    Ok(Outcome::lost_if(!report.ok))
}
