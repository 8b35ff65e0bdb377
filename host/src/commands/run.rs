//! `crossfall run`: the board's firmware core, in process, over a capture.
//!
//! The log holds what a board on these pins would have streamed; its receive times are device times. The same capture and configuration give the
//! same log, byte for byte.

use std::path::PathBuf;

use crossfall::capture::{Channel, Reader};
use crossfall::faults::{Faulty, Spec};
use crossfall::log;
use crossfall::scanner::Family;

use super::progress::Progress;
use super::{Outcome, distinct, paths, tell};

/// Run the board's own code over a capture
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  crossfall run drive.mcap -o drive.log.mcap
  crossfall run drive.mcap --config my.toml -o drive.log.mcap
  crossfall run drive.mcap --faults flip=1e-5,burst=1e-6:200,seed=7 \\
      -o faulty.log.mcap")]
pub struct Args {
    /// The capture
    capture: PathBuf,
    /// The log to write
    #[arg(short, long, value_name = "LOG")]
    output: PathBuf,
    /// A configuration (TOML, see `crossfall config`)
    #[arg(long, value_name = "FILE")]
    config: Option<PathBuf>,
    /// Faults of the sensor lines on the way, such as flip=1e-5,drop=1e-5 or lidar:burst=1e-6:200;pps:drop=0.1
    #[arg(long, value_name = "SPEC")]
    faults: Option<Spec>,
}

pub fn run(args: &Args) -> anyhow::Result<Outcome> {
    let config = super::configuration(args.config.as_deref())?;
    distinct(&paths([&args.capture].into_iter().chain(&args.config)), &[&args.output])?;
    let mut capture = Reader::open(&args.capture)?;
    capture.require(Channel::Lidar)?;
    let mut absent = false;
    for (channel, means) in
        [(Channel::Ins, "every section is measured with roll 0"), (Channel::Pps, "poses are timed by their arrival")]
    {
        if let Err(error) = capture.require(channel) {
            tell!("{error}: {means}, and flagged");
            absent = true;
        }
    }
    let (first, last) = capture.span_ns().unwrap_or_default();
    let mut log = log::Writer::create(&args.output)?;
    let progress = Progress::new("run", last.saturating_sub(first));
    let at = |now: u64| progress.at(now.saturating_sub(first));
    let ran = match &args.faults {
        None => crossfall::run::run(&mut capture, &config, &mut log, at)?,
        Some(spec) => {
            let mut faulty = Faulty::new(capture.by_ref(), spec);
            let ran = crossfall::run::run_over(faulty.by_ref(), first, &config, &mut log, at)?;
            // A log of faults made on purpose says so.
            log.metadata("faults", [("spec".to_owned(), spec.to_string())].into())?;
            for (line, counts) in faulty.counts() {
                tell!("faults on {}: {counts}", line.topic());
            }
            ran
        }
    };
    drop(progress);
    anyhow::ensure!(!ran.interrupted && !crossfall::interrupt::requested(), "interrupted, nothing was written");
    log.finish()?;
    for damage in &ran.damage {
        tell!("{damage}");
    }
    let status = &ran.status;
    if ran.family != Family::Lms2xx {
        tell!("scanner: {}", ran.family.name());
    }
    tell!(
        "{}: {} scans, {} poses, {} pulses; {} profiles in {} frames, {:.1} kB a second",
        args.output.display(),
        status.scans,
        status.poses,
        status.pulses,
        ran.profiles,
        ran.frames,
        ran.bytes as f64 / 1e3 / ran.seconds.max(1e-3)
    );
    let losses = crossfall::counters::losses(status);
    for (name, count) in &losses {
        tell!("lost: {name} = {count}");
    }
    let lost = absent || !ran.damage.is_empty() || !losses.is_empty();
    Ok(Outcome::lost_if(lost))
}
