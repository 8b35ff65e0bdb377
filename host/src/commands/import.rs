//! `crossfall import`: raw serial dumps to a capture.
//!
//! A dump has no times, so they are made up from what the sensors say: see [`crossfall::import`]. What was assumed is told on stderr. Every byte is
//! kept, whether it decodes or not.

use std::fs;
use std::path::PathBuf;

use anyhow::Context;
use crossfall::capture::Writer;
use crossfall::import::{Ins, Lidar, import};
use crossfall::scanner::Family;

use super::{Outcome, distinct, paths, tell};

/// Turn raw serial dumps into a capture
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  crossfall import --lidar lms.bin -o drive.mcap
  crossfall import --lidar lms.bin --ins span.gps -o drive.mcap")]
pub struct Args {
    /// Bytes of the laser scanner's line
    #[arg(long, value_name = "FILE", required_unless_present = "ins")]
    lidar: Option<PathBuf>,
    /// Bytes of the inertial unit's line
    #[arg(long, value_name = "FILE")]
    ins: Option<PathBuf>,
    /// The capture to write
    #[arg(short, long, value_name = "CAPTURE")]
    output: PathBuf,
    /// A configuration, for the scanner's measuring mode
    #[arg(long, value_name = "FILE")]
    config: Option<PathBuf>,
}

pub fn run(args: &Args) -> anyhow::Result<Outcome> {
    let config = super::configuration(args.config.as_deref())?;
    distinct(&paths(args.lidar.iter().chain(&args.ins).chain(&args.config)), &[&args.output])?;
    let read = |path: &PathBuf| fs::read(path).with_context(|| path.display().to_string());
    let lidar = args.lidar.as_ref().map(read).transpose()?;
    let ins = args.ins.as_ref().map(read).transpose()?;
    let mut capture = Writer::create(&args.output)?;
    let (found_lidar, found_ins) =
        import(lidar.as_deref(), ins.as_deref(), config.scanner.measuring_mode, &mut capture)?;
    // A dump of which nothing at all decodes is another kind of file.
    if let (Some(path), Some(found)) = (&args.lidar, &found_lidar) {
        anyhow::ensure!(found.line.frames > 0, "{}: no LMS telegram in {} bytes", path.display(), found.line.bytes);
    }
    if let (Some(path), Some(found)) = (&args.ins, &found_ins) {
        anyhow::ensure!(found.line.frames > 0, "{}: no NovAtel frame in {} bytes", path.display(), found.line.bytes);
    }
    capture.finish()?;
    if let Some(Lidar { family, line, scans, replies, missing, seconds }) = found_lidar {
        tell!(
            "lidar: {} bytes, {scans} scans, {replies} other telegrams, {} failed their CRC, {} bytes between telegrams",
            line.bytes,
            line.bad_frames,
            line.skipped
        );
        match family {
            Family::Lms2xx => tell!(
                "lidar: no times in a dump; assumed that a scan follows the other (13.32 ms a mirror turn): {seconds:.2} s"
            ),
            Family::Cola => tell!("lidar: {}; times by the scanner's own clock: {seconds:.2} s", family.name()),
        }
        if missing > 0 {
            tell!("lidar: the telegrams' numbers show {missing} scans missing; their time is left free");
        }
    }
    if let Some(Ins { line, poses, untimed, seconds }) = found_ins {
        tell!(
            "ins: {} bytes, {} frames, {poses} poses, {} failed their CRC, {} bytes between frames",
            line.bytes,
            line.frames,
            line.bad_frames,
            line.skipped
        );
        tell!("ins: times from the frames' GPS time, taken to arrive 20 ms later: {seconds:.2} s; no pulses");
        if untimed > 0 {
            tell!("ins: {untimed} frames of unknown GPS time are placed right behind the ones before");
        }
    }
    if lidar.is_some() && ins.is_some() {
        tell!("assumed that both dumps begin together");
    }
    Ok(Outcome::Done)
}
