//! `crossfall messages`: what the board has said in words during a recording: how its sensors came up, what went wrong, and, against the image
//! that ran on it, its bench messages.

use std::path::PathBuf;

use crossfall::board_words;

use super::{Outcome, drives, has_read_enough, print, print_json_line, tell};

/// Print the board's log lines and bench messages
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  crossfall messages drive.log.mcap
  crossfall messages drive.log.mcap --image crossfall-board")]
pub struct Args {
    /// The log
    log: PathBuf,
    /// The image that ran on the board: its bench messages (defmt) become readable. Cargo builds it
    /// as `target/thumbv7em-none-eabihf/release/crossfall-board` in the board's folder
    #[arg(long, value_name = "ELF", alias = "elf")]
    image: Option<PathBuf>,
    /// Print a JSON object a line for machines
    #[arg(long)]
    json: bool,
}

pub fn run(args: &Args) -> anyhow::Result<Outcome> {
    let table = args.image.as_deref().map(board_words::table).transpose()?;
    drives::of(std::slice::from_ref(&args.log));
    let mut lines = 0_u64;
    let untold = board_words::read(&args.log, table.as_ref(), |line| -> anyhow::Result<()> {
        lines += 1;
        if args.json {
            return print_json_line(&line);
        }
        let bench = if line.defmt { " (bench)" } else { "" };
        Ok(print(&format!("{:12.6} s  {:5} {}{bench}", line.device_time_us as f64 * 1e-6, line.level, line.text))?)
    });
    let untold = match untold {
        Err(error) if error.downcast_ref().is_some_and(has_read_enough) => return Ok(Outcome::Done),
        other => other?,
    };
    if lines == 0 && untold.is_nothing() {
        tell!("{}: the board has said nothing", args.log.display());
    }
    if untold.defmt_bytes > 0 {
        tell!("{} bytes of bench messages; --image, with the board's image, makes them readable", untold.defmt_bytes);
    }
    if untold.malformed > 0 {
        tell!("{} bench messages do not decode: is this the image that ran?", untold.malformed);
    }
    if untold.broken > 0 {
        tell!("{} broken frames, which may have held more", untold.broken);
    }
    if untold.gaps > 0 {
        tell!("{} gaps where frames are missing, which may have held more", untold.gaps);
    }
    Ok(Outcome::lost_if(untold.malformed > 0 || untold.broken > 0 || untold.gaps > 0))
}
