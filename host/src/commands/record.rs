//! `crossfall record`: logs a board.
//!
//! Every frame is logged as it is received, with the time of its receipt. A board that is unplugged or restarts is waited for, and the
//! recording goes on in the same log. Connecting does not restart the survey; the board is only asked who it is and how it is configured.
//! Ctrl-C and SIGTERM end the recording with a whole log; a power cut costs at most its last second.

use std::path::PathBuf;
use std::time::{Duration, Instant};

use anyhow::Context;
use crossfall::log;
use crossfall::record::{self, Device, Summary};

use super::progress::Progress;
use super::{Outcome, tell};

/// How often the status line changes.
const STATUS: Duration = Duration::from_millis(200);

/// Log a board
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  crossfall record --device serial:/dev/ttyUSB0 -o drive.log.mcap
  crossfall record --device tcp:192.168.0.7:4000 -o drive.log.mcap

Ctrl-C ends the recording; a lost connection does not.")]
pub struct Args {
    /// The board: serial:PATH, serial:PATH@BAUD (1,000,000 unless told) or tcp:HOST:PORT
    #[arg(short, long)]
    device: Device,
    /// The log to write; it must not exist
    #[arg(short, long, value_name = "LOG")]
    output: PathBuf,
    /// Stop after so many seconds
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..))]
    seconds: Option<u64>,
}

pub fn run(args: &Args) -> anyhow::Result<Outcome> {
    let output = args.output.display();
    // Before the board is disturbed; `create_live` makes sure of it.
    anyhow::ensure!(!args.output.exists(), "{output}: exists, and a recording is never written over");
    let port = args.device.connect().with_context(|| format!("{}: cannot connect", args.device))?;
    let mut log = log::Writer::create_live(&args.output)?;
    let progress = Progress::spinner();
    let mut shown = Instant::now();
    let recorded = record::record(
        &args.device,
        port,
        &mut log,
        |notice| progress.aside(|| tell!("{}: {notice}", args.device)),
        |summary| {
            if shown.elapsed() >= STATUS {
                shown = Instant::now();
                progress.say(|| line(summary));
            }
            !crossfall::interrupt::requested() && args.seconds.is_none_or(|limit| summary.seconds < limit as f64)
        },
    )?;
    log.finish()?;
    drop(progress);
    tell!("{output}: {}", line(&recorded));
    if recorded.frames == 0 {
        tell!("no frame came: is the board powered, and is the baud rate right?");
    }
    if recorded.bytes_lost > 0 {
        tell!("lost: {} bytes, because the log could not be written fast enough", recorded.bytes_lost);
    }
    if recorded.restarts > 0 {
        tell!("restarts of the board: {}; what it had not sent before is not known", recorded.restarts);
    }
    if recorded.disconnected {
        tell!("not connected at the end: what the board has sent since is not known");
    }
    for (name, count) in crossfall::info::losses(&recorded.status) {
        tell!("lost on the board since it booted: {name} = {count}");
    }
    Ok(Outcome::lost_if(recorded.lost()))
}

/// A recording in one line.
fn line(summary: &Summary) -> String {
    let Summary { seconds, frames, profiles, bad_frames, missing_frames, reconnects, .. } = summary;
    format!(
        "{seconds:.1} s, {frames} frames, {profiles} profiles, {bad_frames} bad, {missing_frames} missing, {reconnects} reconnects"
    )
}
