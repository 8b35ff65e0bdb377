//! `crossfall info`: what a capture or a log holds.

use std::path::PathBuf;

use super::{Outcome, drives, say, say_json, tell};

/// Look at a capture or a log
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  crossfall info drive.mcap
  crossfall info drive.log.mcap --json")]
pub struct Args {
    /// The file
    file: PathBuf,
    /// Print it for machines
    #[arg(long)]
    json: bool,
}

pub fn run(args: &Args) -> anyhow::Result<Outcome> {
    drives::of(std::slice::from_ref(&args.file));
    let info = crossfall::info::look(&args.file)?;
    if args.json {
        say_json(&info)?;
    } else {
        let mut text = format!(
            "{}: {}, {:.2} s, {} scans, {} poses, {} pulses",
            args.file.display(),
            info.kind,
            info.seconds,
            info.scans,
            info.poses,
            info.pulses
        );
        for (name, value) in &info.about {
            text += &format!("\n  {name:<24} {value}");
        }
        for (name, count) in &info.counters {
            text += &format!("\n  {name:<24} {count}");
        }
        say(&text)?;
        for damage in &info.damage {
            tell!("{damage}");
        }
    }
    Ok(Outcome::lost_if(!info.is_whole()))
}
