//! `crossfall profiles`: the table of profiles, one row per scan and side.
//!
//! Slopes in degrees, positive = rising outward; an empty cell = not found. Without -o, or with `-o -`, the table goes to stdout.

use std::io;
use std::path::{Path, PathBuf};

use crossfall::output::Output;
use crossfall::profiles::{Rows, write_csv};

use super::{Outcome, distinct, tell};

/// Write the table of profiles
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  crossfall profiles drive.log.mcap -o drive.csv
  crossfall profiles drive.log.mcap | head")]
pub struct Args {
    /// The log
    log: PathBuf,
    /// The table to write (CSV); `-` is stdout
    #[arg(short, long, value_name = "FILE", default_value = "-")]
    output: PathBuf,
}

pub fn run(args: &Args) -> anyhow::Result<Outcome> {
    let mut rows = Rows::open(&args.log)?;
    let stop = |_| ();
    if args.output == Path::new("-") {
        write_csv(&mut rows, io::stdout().lock(), stop).map_err(unwrapped)?;
    } else {
        // A name without an extension says nothing else.
        let known = args.output.extension().is_none_or(|extension| extension.eq_ignore_ascii_case("csv"));
        anyhow::ensure!(known, "{}: expected a name that ends in .csv", args.output.display());
        distinct(&[&args.log], &args.output)?;
        let mut output = Output::create(&args.output)?;
        let count = write_csv(&mut rows, &mut output, stop)
            .map_err(|error| unwrapped(error).context(args.output.display().to_string()))?;
        output.commit()?;
        tell!("{}: {count} rows", args.output.display());
    }
    if rows.damage() > 0 {
        tell!(
            "{}: {} damaged, broken or missing parts passed over; see `crossfall verify`",
            args.log.display(),
            rows.damage()
        );
    }
    Ok(Outcome::lost_if(rows.damage() > 0))
}

/// The error within the table writer's: a closed pipe must be known as one.
fn unwrapped(error: csv::Error) -> anyhow::Error {
    if !error.is_io_error() {
        return error.into();
    }
    match error.into_kind() {
        csv::ErrorKind::Io(error) => error.into(),
        other => anyhow::anyhow!("{other:?}"),
    }
}
