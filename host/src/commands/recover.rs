//! `crossfall recover`: a whole, indexed log from a damaged one.
//!
//! Every frame that can be read or found in the damaged places goes into the new log, which is then read again and proved. What is lost is told
//! exactly - frames, seconds, bytes, and where - and the exit status is 3 if anything is. A recording of several files, named by its first, becomes
//! one log; of several that are named, these and no others.

use std::path::PathBuf;

use crossfall::container;
use crossfall::recover::{Loss, Report, recover};

use super::progress::Progress;
use super::{Outcome, distinct, drives, paths, say, say_json, tell, tell_growing};

/// Rebuild a damaged log and tell exactly what is lost
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  crossfall recover torn.log.mcap -o drive.log.mcap
  crossfall recover drive.log.mcap drive.log.part0003.mcap -o whole.log.mcap")]
pub struct Args {
    /// The log. Naming the first file of a recording includes the files that follow it; if you name
    /// several, exactly those are read, in this order
    #[arg(required = true, value_name = "LOG")]
    logs: Vec<PathBuf>,
    /// The log to write
    #[arg(short, long, value_name = "LOG")]
    output: PathBuf,
    /// Print the account for machines
    #[arg(long)]
    json: bool,
}

pub fn run(args: &Args) -> anyhow::Result<Outcome> {
    let (logs, missing) = match &args.logs[..] {
        [log] => drives::files(log),
        given => (drives::each_once("recover", given)?, false),
    };
    distinct(&paths(&logs), &[&args.output])?;
    tell_growing(&logs, "recovered");
    let sizes: Vec<u64> = logs.iter().map(|log| container::size(log)).collect();
    let progress = Progress::new("recover", sizes.iter().sum());
    let report = recover(&logs, &args.output, |file, offset| {
        progress.at(sizes[..file].iter().sum::<u64>() + offset);
    })?;
    drop(progress);
    if args.json {
        say_json(&report)?;
        return Ok(Outcome::lost_if(report.lost || missing));
    }
    for loss in &report.losses {
        tell!("{}", line(loss));
    }
    let untold = report.loss_count.saturating_sub(report.losses.len() as u64);
    if untold > 0 {
        tell!("... and {untold} more");
    }
    for text in summary(&report) {
        tell!("{text}");
    }
    let verdict = if report.lost { format!("lost: {}", lost(&report)) } else { "nothing is lost".to_owned() };
    say(&format!(
        "{}: {} frames, {:.1} s, proved by reading it again; {verdict}",
        args.output.display(),
        report.frames,
        report.seconds
    ))?;
    Ok(Outcome::lost_if(report.lost || missing))
}

fn line(loss: &Loss) -> String {
    let frames = loss.frames.map_or("frames not known".to_owned(), |frames| format!("{frames} frames"));
    let seconds = loss.seconds.map_or(String::new(), |seconds| format!(", at most {seconds:.3} s"));
    let Loss { bytes, offset, what, .. } = loss;
    format!("{} at byte {offset}: {frames}{seconds}, {bytes} bytes: {what}", loss.file.display())
}

fn lost(report: &Report) -> String {
    let Report { frames_lost, unknown_gaps, open_ends, files_missing, restarts, seconds_lost, bytes_lost, .. } = report;
    let bytes = format!("{bytes_lost} bytes of damaged places");
    if unknown_gaps + open_ends + files_missing + restarts == 0 {
        return format!("{frames_lost} frames, at most {seconds_lost:.3} s, {bytes}");
    }
    // What has but one end has no length.
    format!("{frames_lost} frames in {seconds_lost:.3} s, and more that nobody can count, {bytes}")
}

/// What numbers cannot tell.
fn summary(report: &Report) -> Vec<String> {
    let mut said = Vec::new();
    if report.open_ends > 0 {
        said.push(format!(
            "files that were not closed: {}; what came after their last frame, at most 1 s, is not known",
            report.open_ends
        ));
    }
    if report.files_missing > 0 {
        said.push(format!(
            "files of the recording that are not there or cannot be read: {}; what was in them is not known",
            report.files_missing
        ));
    }
    if report.unknown_gaps > 0 {
        said.push(format!(
            "gaps too long for the frames' numbers to count: {}; how many are missing there is not known",
            report.unknown_gaps
        ));
    }
    if report.restarts > 0 {
        said.push(format!("restarts of the board: {}; what it had not sent before is not known", report.restarts));
    }
    if report.frames_twice > 0 {
        let twice = report.frames_twice;
        said.push(format!(
            "frames that stood twice, as of a block that the disk has written twice: {twice}; each is kept once"
        ));
    }
    let elsewhere = report.frames_lost - report.frames_lost_in_file;
    if elsewhere > 0 {
        said.push(format!("of the frames lost, {elsewhere} never reached the log: the link, or the board, lost them"));
    }
    said
}
