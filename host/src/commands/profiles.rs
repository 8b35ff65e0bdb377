//! `crossfall profiles`: the table of profiles, one row per scan and side, or per stretch of road and side.
//!
//! Slopes in degrees, positive = rising outward; an empty cell = not found. Without -o, or with `-o -`, the table goes to stdout as CSV.
//! Several logs, or a folder for them, make a data set: `road=NAME/date=YYYY-MM-DD/DRIVE.parquet`.

use std::io;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};

use anyhow::Context;
use crossfall::dataset::{self, Stopped, Written};
use crossfall::drive::Drive;
use crossfall::intervals::{Every, Gather, Interval, MILE_M};
use crossfall::output::Output;
use crossfall::profiles::{Rows, left_out};
use crossfall::side::Side;
use crossfall::table::{self, Format, Table};
use crossfall::{fuse, interrupt};

use super::progress::Progress;
use super::{Outcome, distinct, drives, has_read_enough, say, say_json, table_format, tell, tell_passed_over, usage};

/// Write the table of profiles (CSV, Parquet, GeoJSON), of one drive or of many
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  crossfall profiles drive.log.mcap -o drive.csv
  crossfall profiles drive.log.mcap --every 0.1mi -o drive.geojson
  crossfall profiles drive.log.mcap --summary
  crossfall profiles up.log.mcap down.log.mcap --fuse -o road.csv
  crossfall profiles logs/*.log.mcap --road I-80 -o DATASET/
  crossfall profiles drive.log.mcap | head")]
pub struct Args {
    /// The log, or several
    #[arg(required = true)]
    logs: Vec<PathBuf>,
    /// The table to write, its format by its name (.csv, .parquet, .geojson); `-` is stdout; a folder, or a name that ends
    /// in /, becomes a data set
    #[arg(short, long, value_name = "FILE", default_value = "-")]
    output: PathBuf,
    /// One row for each stretch of this length: 1m, 10m, 100ft, 0.1mi
    #[arg(long, value_name = "LENGTH")]
    every: Option<Every>,
    /// Name of the road in a data set; without it the name of each log's folder
    #[arg(long, value_name = "NAME", conflicts_with_all = ["fuse", "summary"])]
    road: Option<String>,
    /// Join two drives of one road: each slope of the median from the drive that measures it better, by stretches (10m without --every)
    #[arg(long)]
    fuse: bool,
    /// With --fuse: the side of the vehicle that the median is on
    #[arg(long, value_enum, default_value_t = Side::Left, requires = "fuse")]
    side: Side,
    /// Print a summary for each mile instead of the table
    #[arg(long, conflicts_with_all = ["output", "every", "fuse"])]
    summary: bool,
    /// With --summary: for machines
    #[arg(long, requires = "summary")]
    json: bool,
}

pub fn run(args: &Args) -> anyhow::Result<Outcome> {
    let folder = args.output.is_dir() || args.output.as_os_str().to_string_lossy().ends_with('/');
    match &*drives::of(&args.logs) {
        [up, down] if args.fuse => fused(args, up, down),
        _ if args.fuse => Err(usage("profiles", "--fuse takes two logs")),
        _ if args.road.is_some() && !folder => Err(usage(
            "profiles",
            "--road names the road of a data set: the output must be a folder, whose name ends in /",
        )),
        logs if folder => many(args, logs),
        [log] if args.summary => summary(log, args.json),
        [log] => one(args, log),
        _ if args.summary => Err(usage("profiles", "--summary takes one log")),
        _ => Err(usage("profiles", "several logs need a folder to go to, whose name ends in /")),
    }
}

fn one(args: &Args, log: &Path) -> anyhow::Result<Outcome> {
    let written = if args.output == Path::new("-") {
        let rows = Rows::open(log)?;
        match dataset::stream(rows, args.every, Format::Csv, io::stdout(), |_| ()) {
            Ok((_, written)) => written,
            Err(Stopped::Table(error)) => return ended(error.into_io()),
            Err(interrupted @ Stopped::Interrupted) => return Err(interrupted.into()),
        }
    } else {
        let format = table_format(&args.output)?;
        distinct(&[log], &[&args.output])?;
        let progress = Progress::new("profiles", drives::size(log));
        let written = dataset::write(log, args.every, format, &args.output, |at| progress.at(at))?;
        drop(progress);
        tell!("{}: {} rows", args.output.display(), written.rows.unwrap_or_default());
        written
    };
    Ok(Outcome::lost_if(losses(log, &written)))
}

fn fused(args: &Args, first: &Path, second: &Path) -> anyhow::Result<Outcome> {
    let format = table_format(&args.output)?;
    distinct(&[first, second], &[&args.output])?;
    let read = |log: &Path| {
        let progress = Progress::new("read", drives::size(log));
        Drive::read(log, |at| progress.at(at))
    };
    let (one, other) = (read(first)?, read(second)?);
    let stretches = fuse::fuse(&one, &other, args.every.unwrap_or(Every { metres: 10.0 }), args.side);
    let stretches = stretches
        .with_context(|| format!("{} was never within 30 m of {}'s way", second.display(), first.display()))?;
    if args.output == Path::new("-") {
        if let Err(error) = write_all(&stretches, Format::Csv, io::stdout()) {
            return ended(error);
        }
    } else {
        let output = write_all(&stretches, format, Output::create(&args.output)?)?;
        output.commit()?;
        tell!("{}: {} stretches", args.output.display(), stretches.len());
    }
    let mut lost = false;
    for (drive, log) in [(&one, first), (&other, second)] {
        let unreliable = drive.unreliable(args.side);
        if unreliable > 0 {
            tell!("{}: {} on the {}", log.display(), left_out(unreliable, "section"), args.side.name());
        }
        lost |= tell_passed_over(Some(log), drive.health.damage);
    }
    Ok(Outcome::lost_if(lost))
}

fn write_all<W: io::Write + Send>(stretches: &[fuse::Fused], format: Format, out: W) -> io::Result<W> {
    let mut table = Table::new(format, out).map_err(table::Error::into_io)?;
    for stretch in stretches {
        table.row(stretch).map_err(table::Error::into_io)?;
    }
    table.finish().map_err(table::Error::into_io)
}

fn many(args: &Args, logs: &[PathBuf]) -> anyhow::Result<Outcome> {
    let read: Vec<AtomicU64> = logs.iter().map(|_| AtomicU64::new(0)).collect();
    let (lost, failed) = (AtomicBool::new(false), AtomicBool::new(false));
    let progress = Progress::new("profiles", logs.iter().map(|log| drives::size(log)).sum());
    let advance = |number: usize, at: u64| {
        read[number].store(at, Ordering::Relaxed);
        progress.at(read.iter().map(|at| at.load(Ordering::Relaxed)).sum());
    };
    let done = |number: usize, outcome: Result<Written, dataset::Error>| {
        advance(number, drives::size(&logs[number]));
        progress.aside(|| match outcome {
            Ok(written) => {
                match written.rows {
                    Some(rows) => tell!("{}: {rows} rows", written.path.display()),
                    None => tell!("{}: is there, of this log and as asked for", written.path.display()),
                }
                if losses(&logs[number], &written) {
                    lost.store(true, Ordering::Relaxed);
                }
            }
            Err(error) => {
                tell!("{error}");
                failed.store(true, Ordering::Relaxed);
            }
        });
    };
    dataset::take_in(logs, args.road.as_deref(), args.every, &args.output, advance, done)?;
    drop(progress);
    anyhow::ensure!(!interrupt::requested(), "interrupted; the same command goes on where this one was");
    anyhow::ensure!(!failed.into_inner(), "some logs could not be taken in; the others are");
    Ok(Outcome::lost_if(lost.into_inner()))
}

/// Tells what was passed over; true when data was lost.
fn losses(log: &Path, written: &Written) -> bool {
    if written.unplaced > 0 {
        let rows = if written.unplaced == 1 { "row" } else { "rows" };
        tell!("{}: left out for want of a station: {} {rows}", log.display(), written.unplaced);
    }
    if written.unreliable > 0 {
        tell!("{}: {}", log.display(), left_out(written.unreliable, "row"));
    }
    tell_passed_over(Some(log), written.damage)
}

/// How a table on stdout that ended early has ended: well, if its reader has read enough.
fn ended(error: io::Error) -> anyhow::Result<Outcome> {
    if has_read_enough(&error) { Ok(Outcome::Done) } else { Err(error.into()) }
}

fn summary(log: &Path, json: bool) -> anyhow::Result<Outcome> {
    let mut rows = Rows::open(log)?;
    let progress = Progress::new("summary", drives::size(log));
    let mut gather = Gather::new(Every { metres: MILE_M });
    let mut miles: Vec<Interval> = Vec::new();
    while let Some(row) = rows.next() {
        miles.extend(gather.row(&row));
        if row.scan.is_multiple_of(4_096) {
            progress.at(rows.offset());
        }
    }
    interrupt::check()?;
    miles.extend(gather.finish());
    drop(progress);
    miles.sort_by(|a, b| a.from_m.total_cmp(&b.from_m).then(a.side.cmp(&b.side)));
    if json {
        let miles: Vec<_> = miles.iter().map(as_json).collect();
        say_json(&serde_json::json!({
            "miles": miles, "unplaced": gather.unplaced(), "unreliable": gather.unreliable(), "damage": rows.damage()
        }))?;
    } else {
        say(&as_text(&miles))?;
    }
    let written = Written {
        damage: rows.damage(),
        unplaced: gather.unplaced(),
        unreliable: gather.unreliable(),
        ..Written::default()
    };
    Ok(Outcome::lost_if(losses(log, &written)))
}

fn as_json(mile: &Interval) -> serde_json::Value {
    let slope = |slope: Option<crossfall::intervals::SlopeOver>| {
        slope.map(|s| {
            let over = s.slope_deg;
            serde_json::json!({ "slope_deg": over.value, "ci95_deg": over.ci95, "sd_deg": over.sd, "scans": over.count })
        })
    };
    serde_json::json!({
        "mile": (mile.from_m / MILE_M).round() as i64,
        "side": mile.side.name(),
        "scans": mile.scans,
        "unreliable_scans": mile.unreliable,
        "adjacent": slope(mile.adjacent),
        "opposing": slope(mile.opposing),
    })
}

/// One line a mile and side: what its slopes are, and in how many scans they were found.
fn as_text(miles: &[Interval]) -> String {
    let mut text = format!(
        "{:>5} {:<6}{:>8}{:>10}{:>20}{:>7}{:>9}{:>20}{:>7}{:>9}",
        "mile", "side", "scans", "left out", "adjacent", "sd", "found", "opposing", "sd", "found"
    );
    for mile in miles {
        let side = mile.side.name();
        text += &format!("\n{:>5.0} {side:<6}{:>8}{:>10}", mile.from_m / MILE_M, mile.scans, mile.unreliable);
        for slope in [mile.adjacent, mile.opposing] {
            text += &match slope.map(|slope| slope.slope_deg) {
                Some(over) => format!(
                    "{:>20}{:>6.2}\u{b0}{:>9}",
                    format!("{:.2}\u{b0} \u{b1} {:.2}\u{b0}", over.value, over.ci95),
                    over.sd,
                    over.count
                ),
                None => format!("{:>20}{:>7}{:>9}", "-", "-", 0),
            };
        }
    }
    text
}
