//! `crossfall verify`: proves a log.
//!
//! Frames whole and none missing, time going forward, the clock plausible, every profile recomputed bit for bit from the scans, poses and
//! pulses of the log itself. What is wrong is told with the number of the frame and the offset in the file. A recording of several files,
//! named by its first, is verified as the one stream that it is; of several that are named, these and no others.

use std::path::PathBuf;

use crossfall::container;

use super::progress::Progress;
use super::{Outcome, drives, say, say_json, tell, tell_growing};

/// Prove that a log is whole and its profiles are right
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  crossfall verify drive.log.mcap
  crossfall verify drive.log.mcap --json
  crossfall verify drive.log.mcap drive.log.part0002.mcap")]
pub struct Args {
    /// The log. Naming the first file of a recording includes the files that follow it; if you name
    /// several, exactly those are read, in this order
    #[arg(required = true, value_name = "LOG")]
    logs: Vec<PathBuf>,
    /// Print the verdict for machines
    #[arg(long)]
    json: bool,
}

pub fn run(args: &Args) -> anyhow::Result<Outcome> {
    let logs = match &args.logs[..] {
        [log] => drives::recording(log),
        given => drives::each_once("verify", given)?,
    };
    let Some((first, others)) = logs.split_first() else { anyhow::bail!("no log to verify") };
    tell_growing(&logs, "verified");
    let sizes: Vec<u64> = logs.iter().map(|log| container::size(log)).collect();
    let progress = Progress::new("verify", sizes.iter().sum());
    let report = crossfall::verify::verify_all(first, others, |file, offset| {
        progress.at(sizes[..file].iter().sum::<u64>() + offset);
    })?;
    drop(progress);
    if args.json {
        say_json(&report)?;
        return Ok(Outcome::lost_if(!report.ok));
    }
    for problem in &report.problems {
        let file = problem.file.as_ref().map_or(String::new(), |file| format!("{}: ", file.display()));
        tell!("{file}frame {} at byte {}: {}", problem.frame, problem.offset, problem.what);
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
    let unknown = match report.unknown_gaps {
        0 => String::new(),
        1 => ", and nobody knows how many in a gap".to_owned(),
        gaps => format!(", and nobody knows how many in {gaps} gaps"),
    };
    let files = if logs.len() > 1 { format!("{} files, ", logs.len()) } else { String::new() };
    say(&format!(
        "{files}{} frames, {} bad, {} missing{unknown}; {verdict}{}",
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
