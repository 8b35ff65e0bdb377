//! `crossfall record`: logs a board.
//!
//! Every frame is logged as it is received, with the time of its receipt. A board that is unplugged or restarts is waited for, and the
//! recording goes on in the same log. Connecting does not restart the survey; the board is only asked who it is and how it is configured.
//! With `--config` it is told what to measure with, and told again whenever it restarts, since it comes up with the defaults; that is in
//! the log as the board's echo, from which on it holds. Without, a board that comes back otherwise configured is told.
//! Ctrl-C, SIGTERM and a terminal that is closed end the recording with a whole log; a power cut costs at most its last second. A file that grows too
//! large or too long is followed by another (`drive.log.part0002.mcap`). When the disk runs out of room, that is told long before, and
//! the recording ends, with a whole log, while there is some left.

use std::iter;
use std::path::PathBuf;
use std::time::{Duration, Instant};

use anyhow::Context;
use crossfall::log;
use crossfall::record::space::{Space, Watch};
use crossfall::record::{self, Device, Lost, Outbox, Summary};

use super::log_args::LogArgs;
use super::progress::Progress;
use super::{Outcome, tell};

/// How often the status line changes.
const STATUS: Duration = Duration::from_millis(200);

/// Log a board
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  crossfall record --device serial:/dev/ttyUSB0 -o drive.log.mcap
  crossfall record -d serial:/dev/ttyUSB0 --config my.toml -o drive.log.mcap
  crossfall record --device tcp:192.168.0.7:4000 -o drive.log.mcap

Ctrl-C ends the recording; a lost connection does not.")]
pub struct Args {
    /// The board: serial:PATH, serial:PATH@BAUD (1,000,000 unless told), tcp:HOST:PORT or
    /// emulated (the board's image in QEMU, on a simulated drive)
    #[arg(short, long)]
    device: Device,
    /// The log to write; it must not exist
    #[arg(short, long, value_name = "LOG")]
    output: PathBuf,
    /// A configuration (TOML, see `crossfall config` and `calibrate`): put in force on the board, again
    /// whenever it restarts
    #[arg(long, value_name = "FILE")]
    config: Option<PathBuf>,
    /// Stop after so many seconds
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..))]
    seconds: Option<u64>,
    #[command(flatten)]
    logs: LogArgs,
}

pub fn run(args: &Args) -> anyhow::Result<Outcome> {
    let output = args.output.display();
    let config = args.config.as_deref().map(crossfall::config::read).transpose()?;
    // Before the board is disturbed; `create_live` makes sure of it.
    anyhow::ensure!(!args.output.exists(), "{output}: exists, and a recording is never written over");
    let port = args.device.connect().with_context(|| format!("{}: cannot connect", args.device))?;
    let mut log = log::Writer::create_with(&args.output, args.logs.options())?;
    let mut watch = Watch::new(&args.output, args.logs.min_free);
    let mut full = None;
    let progress = Progress::spinner();
    let mut shown = Instant::now();
    let recorded = record::converse(
        &args.device,
        port,
        &mut log,
        &Outbox::default(),
        config,
        |notice| progress.aside(|| tell!("{}: {notice}", args.device)),
        |summary| {
            if shown.elapsed() >= STATUS {
                shown = Instant::now();
                progress.say(|| line(summary));
            }
            match watch.look(summary.log_bytes, summary.seconds) {
                None => {}
                Some(Space::Low { minutes }) => {
                    progress.aside(|| tell!("{output}: the disk has room for {minutes} minutes more"));
                }
                Some(Space::Full { free }) => full = Some(free),
            }
            if full.is_some() {
                return false;
            }
            !crossfall::interrupt::requested() && args.seconds.is_none_or(|limit| summary.seconds < limit as f64)
        },
    );
    let parts = log.parts();
    let ended = recorded.map_err(anyhow::Error::from).and_then(|recorded| {
        log.finish()?;
        Ok(recorded)
    });
    drop(progress);
    let recorded = match ended {
        Ok(recorded) => recorded,
        Err(error) => {
            tell!(
                "{output}: what was written before is there: `crossfall recover {output} -o FILE` tells what is lost"
            );
            return Err(error);
        }
    };
    tell!("{output}: {}", line(&recorded));
    if parts > 1 {
        tell!("{parts} files of one drive: every command takes them all when it is given the first");
    }
    if let Some(free) = full {
        tell!(
            "ended because the disk is full: {:.1} MB are left free; what the board sends now is not recorded",
            free as f64 / 1e6
        );
    }
    for said in recorded.amiss() {
        tell!("{said}");
    }
    for (name, count) in recorded.totals.losses_before() {
        tell!("lost on the board before it was recorded: {name} = {count}");
    }
    Ok(Outcome::lost_if(recorded.lost() || recorded.unconfigured || full.is_some()))
}

/// A recording in one line.
fn line(summary: &Summary) -> String {
    let Summary { seconds, frames, profiles, bad_frames, missing_frames, reconnects, .. } = summary;
    let counts = format!(
        "{seconds:.1} s, {frames} frames, {profiles} profiles, {bad_frames} bad, {missing_frames} missing, {reconnects} reconnects"
    );
    // Its frames are counted already, the damaged apart from the missing.
    iter::once(counts).chain(Lost::of(summary).uncounted()).collect::<Vec<_>>().join(", ")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_line_tells_what_no_number_of_frames_does_behind_the_frames() {
        let whole = Summary { seconds: 2.04, frames: 90, profiles: 80, reconnects: 1, ..Summary::default() };
        assert_eq!(line(&whole), "2.0 s, 90 frames, 80 profiles, 0 bad, 0 missing, 1 reconnects");
        let torn = Summary { bad_frames: 1, missing_frames: 2, bytes_lost: 70_000, unknown_gaps: 1, ..whole };
        let frames = "2.0 s, 90 frames, 80 profiles, 1 bad, 2 missing, 1 reconnects";
        assert_eq!(line(&torn), format!("{frames}, 70000 bytes lost, 1 gap of unknown length"));
    }
}
