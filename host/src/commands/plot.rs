//! `crossfall plot`: pictures of a log.
//!
//! `slopes.svg` has the slopes along the drive with their 95 % intervals, `section-N.svg` one section: raw and levelled points, road, edges,
//! slopes.

use std::path::{Path, PathBuf};

use anyhow::Context;
use clap::ValueEnum;
use crossfall::plot::{self, Series, TruthAt};
use crossfall::profiles::{Row, Rows, SlopeRow};
use crossfall::{output, section};

use super::{Outcome, tell};

/// Draw a section and the slopes along the drive (SVG)
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  crossfall plot drive.log.mcap -o pictures
  crossfall plot drive.log.mcap --scan 120 --theme dark -o pictures")]
pub struct Args {
    /// The log
    log: PathBuf,
    /// The folder for the pictures; made if need be
    #[arg(short, long, value_name = "FOLDER")]
    output: PathBuf,
    /// Number of the scan whose section is drawn; without it one in the middle of the drive
    #[arg(long, value_name = "N")]
    scan: Option<u32>,
    /// For paper or for a screen
    #[arg(long, value_enum, default_value_t = Theme::Light)]
    theme: Theme,
}

/// For paper or for a screen.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Theme {
    Light,
    Dark,
}

impl From<Theme> for plot::Theme {
    fn from(theme: Theme) -> Self {
        match theme {
            Theme::Light => Self::Light,
            Theme::Dark => Self::Dark,
        }
    }
}

pub fn run(args: &Args) -> anyhow::Result<Outcome> {
    std::fs::create_dir_all(&args.output).with_context(|| args.output.display().to_string())?;
    let mut rows = Rows::open(&args.log)?;
    let all: Vec<Row> = rows.by_ref().collect();
    anyhow::ensure!(!all.is_empty(), "{}: the log has no profile", args.log.display());
    let number = args.scan.unwrap_or_else(|| typical(&all));
    let pictures = [
        slopes(&all, &[], args.theme.into(), &args.output)?,
        one_section(&args.log, number, args.theme.into(), &args.output)?,
    ];
    for picture in pictures {
        tell!("{}", picture.display());
    }
    Ok(Outcome::lost_if(rows.damage() > 0))
}

/// The scan in the middle of those that have most to show.
pub fn typical(rows: &[Row]) -> u32 {
    let found = |row: &Row| u8::from(row.adjacent.is_some()) + u8::from(row.opposing.is_some());
    let sections = rows.chunk_by(|a, b| a.scan == b.scan).map(|sides| (sides.iter().map(found).sum::<u8>(), sides));
    let most = sections.clone().map(|(count, _)| count).max().unwrap_or_default();
    let best: Vec<_> = sections.filter(|(count, _)| *count == most).filter_map(|(_, sides)| sides.first()).collect();
    best.get(best.len() / 2).map_or(0, |row| row.scan)
}

/// Draws one section into a folder.
pub fn one_section(log: &Path, number: u32, theme: plot::Theme, folder: &Path) -> anyhow::Result<PathBuf> {
    let found = section::of_scan(log, number)?;
    let found = found.with_context(|| format!("{}: no profile of a scan {number}", log.display()))?;
    let roll = crossfall::profiles::degrees(found.profile.roll);
    let title = format!("Section of scan {number}, roll {roll:.2}\u{b0}").replace('-', "\u{2212}");
    let path = folder.join(format!("section-{number}.svg"));
    output::write(&path, plot::section(&found, &title, theme)?.as_bytes())?;
    Ok(path)
}

/// One of a row's slopes.
type SlopeOf = fn(&Row) -> Option<SlopeRow>;

/// Truth of the four slopes: left adjacent and opposing, right adjacent and opposing.
pub type Truth = [Vec<TruthAt>];

/// Draws the slopes along the drive into a folder.
pub fn slopes(rows: &[Row], truth: &Truth, theme: plot::Theme, folder: &Path) -> anyhow::Result<PathBuf> {
    let panels: [(&str, bool, SlopeOf); 4] = [
        ("left adjacent", true, |row| row.adjacent),
        ("left opposing", true, |row| row.opposing),
        ("right adjacent", false, |row| row.adjacent),
        ("right opposing", false, |row| row.opposing),
    ];
    let start = rows.iter().find_map(|row| row.position.station_m).unwrap_or_default();
    let series: Vec<Series> = panels
        .iter()
        .enumerate()
        .map(|(i, (name, left, slope))| {
            let measured = rows.iter().filter(|row| row.left == *left).filter_map(|row| {
                let slope = slope(row)?;
                Some((row.position.station_m? - start, slope.slope_deg, slope.ci95_deg.unwrap_or_default()))
            });
            let truth = truth.get(i).cloned().unwrap_or_default();
            Series { name: (*name).to_owned(), measured: measured.collect(), truth }
        })
        .collect();
    let path = folder.join("slopes.svg");
    output::write(&path, plot::drive(&series, "Slopes along the drive", theme)?.as_bytes())?;
    Ok(path)
}
