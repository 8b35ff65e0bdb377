//! `crossfall plot`: pictures of one log, or of several over each other.
//!
//! `slopes` has the slopes along the drive with their 95 % intervals, `section-N` one section: raw and levelled points, road, edges, slopes,
//! `variation-N` the slope of small pieces along that section, `view-N` the returns of the stretch that begins there in perspective. With several logs of one road, `runs` has their returns at one place over each other, and
//! `slopes` has all of them by where they were. With the truth of a simulated drive, `errors` has histograms of the slopes' errors.

use std::path::{Component, Path, PathBuf};

use anyhow::Context;
use clap::ValueEnum;
use crossfall::cloud::Stretch;
use crossfall::drive::{Drive, Scan, Unit};
use crossfall::plot::{self, Series, TruthAt};
use crossfall::section::Section;
use crossfall::side::WhichSlope;
use crossfall::{output, section};

use super::progress::Progress;
use super::{Outcome, drives, tell, tell_passed_over};

/// Metres of road in the picture of the cloud.
const VIEW_M: f64 = 60.0;

/// A scan further away than this is not at a place, in metres.
const NEAR_M: f64 = 30.0;

/// Draw a section, the slopes along the drive, runs over each other (SVG, PNG)
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  crossfall plot drive.log.mcap -o pictures
  crossfall plot drive.log.mcap --scan 120 --theme dark --format png -o pictures
  crossfall plot run1.log.mcap run2.log.mcap --station 250 -o pictures
  crossfall plot drive.log.mcap --truth truth.csv -o pictures")]
pub struct Args {
    /// The log, or several of one road
    #[arg(required = true)]
    logs: Vec<PathBuf>,
    /// The folder for the pictures; made if need be
    #[arg(short, long, value_name = "FOLDER")]
    output: PathBuf,
    /// Number of the scan (of the first log) whose section is drawn; without it the middle
    /// one of the scans with most slopes found
    #[arg(long, value_name = "N", conflicts_with = "station")]
    scan: Option<u32>,
    /// The section nearest to this station of the first log, in metres, as the table and the
    /// pictures have it
    #[arg(long, value_name = "METRES", value_parser = super::number(-1e9, 1e9))]
    station: Option<f64>,
    /// Scalable, in pixels, or both
    #[arg(long, value_enum, default_value_t = Format::Svg)]
    format: Format,
    /// The truth of a simulated drive (CSV, see `crossfall simulate --truth`)
    #[arg(long, value_name = "FILE")]
    truth: Option<PathBuf>,
    /// For paper or for a screen
    #[arg(long, value_enum, default_value_t = Theme::Light)]
    theme: Theme,
}

/// Scalable, in pixels, or both.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Format {
    Svg,
    Png,
    Both,
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
    let logs = drives::of(&args.logs);
    let mut read = Vec::new();
    for log in &logs {
        let progress = Progress::new("read", drives::size(log));
        let drive = Drive::read(log, |offset| progress.at(offset))?;
        anyhow::ensure!(!drive.scans.is_empty(), "{}: the log has no profile", log.display());
        read.push(drive);
    }
    let drives = read;
    let (first, log) = (&drives[0], &logs[0]);
    let number = match args.station {
        Some(station) => at_station(first, station).with_context(|| log.display().to_string())?,
        None => args.scan.unwrap_or_else(|| typical(first)),
    };
    let canvas = Canvas { folder: &args.output, format: args.format, theme: args.theme.into() };
    // What may not be there is looked for before the first picture is made.
    let kinds = args.truth.as_deref().map(|truth| errors(first, truth)).transpose()?;
    let mut paths = Vec::new();
    let found = one_section(&canvas, log, number, &mut paths)?;
    paths.extend(slopes(&canvas, &drives, &names(&logs), &Default::default())?);
    let title = format!("Variation of the slope along the section of scan {number}");
    paths.extend(canvas.write(&format!("variation-{number}"), &plot::variation(&found, &title, canvas.theme)?)?);
    paths.extend(view(&canvas, log, first, number)?);
    if drives.len() > 1 {
        paths.extend(runs(&canvas, &logs, &drives, number, found)?);
    }
    if let Some(kinds) = kinds {
        let svg = plot::errors(&kinds, "Slopes against the truth, every scan", canvas.theme)?;
        paths.extend(canvas.write("errors", &svg)?);
    }
    for path in paths {
        tell!("{}", path.display());
    }
    let mut lost = false;
    for (drive, log) in drives.iter().zip(&logs) {
        lost |= tell_passed_over(Some(log), drive.health.passed_over());
    }
    Ok(Outcome::lost_if(lost))
}

/// Where pictures go; the folder is made for the first one.
pub struct Canvas<'a> {
    pub folder: &'a Path,
    pub format: Format,
    pub theme: plot::Theme,
}

impl Canvas<'_> {
    fn write(&self, name: &str, svg: &str) -> anyhow::Result<Vec<PathBuf>> {
        std::fs::create_dir_all(self.folder).with_context(|| self.folder.display().to_string())?;
        let mut paths = Vec::new();
        if self.format != Format::Png {
            paths.push(self.folder.join(format!("{name}.svg")));
            output::write(&self.folder.join(format!("{name}.svg")), svg.as_bytes())?;
        }
        if self.format != Format::Svg {
            paths.push(self.folder.join(format!("{name}.png")));
            output::write(&self.folder.join(format!("{name}.png")), &plot::png(svg)?)?;
        }
        Ok(paths)
    }
}

/// Logs' names without their endings; those of one name with as many of their folders as it takes to tell them apart.
fn names(logs: &[PathBuf]) -> Vec<String> {
    let name = |log: &Path, folders: usize| {
        let parts: Vec<_> = log.components().filter(|part| matches!(part, Component::Normal(_))).collect();
        let shown = &parts[parts.len().saturating_sub(folders + 1)..];
        let path = shown.iter().collect::<PathBuf>().to_string_lossy().into_owned();
        path.trim_end_matches(".mcap").trim_end_matches(".log").to_owned()
    };
    let mut names: Vec<_> = logs.iter().map(|log| name(log, 0)).collect();
    for folders in 1..logs.iter().map(|log| log.components().count()).max().unwrap_or_default() {
        let before = names.clone();
        let alike = |name: &String| before.iter().filter(|other| *other == name).count() > 1;
        for (log, shown) in logs.iter().zip(&mut names).filter(|(_, shown)| alike(shown)) {
            *shown = name(log, folders);
        }
    }
    names
}

/// The scan in the middle of those that have most to show.
pub fn typical(drive: &Drive) -> u32 {
    let found = |slopes: &[(f32, f32); 4]| slopes.iter().filter(|slope| slope.0.is_finite()).count();
    let most = drive.scans.iter().map(|scan| found(&scan.slopes)).max().unwrap_or_default();
    let best: Vec<_> = drive.scans.iter().filter(|scan| found(&scan.slopes) == most).collect();
    best.get(best.len() / 2).map_or(0, |scan| scan.number)
}

/// The scan nearest to a station.
fn at_station(drive: &Drive, station_m: f64) -> anyhow::Result<u32> {
    let (from_m, to_m) = drive.span_m().context("no station known")?;
    let known = drive.scans.iter().filter(|scan| scan.station_m.is_finite());
    let off = |scan: &&Scan| (scan.station_m - station_m).abs();
    let nearest = known.min_by(|a, b| off(a).total_cmp(&off(b))).filter(|scan| off(scan) <= NEAR_M);
    let nearest =
        nearest.with_context(|| format!("station {station_m} m: the drive has {from_m:.0} to {to_m:.0} m"))?;
    Ok(nearest.number)
}

/// Draws the stretch that begins at a scan; nothing where no position is known or the vehicle stood.
fn view(canvas: &Canvas<'_>, log: &Path, drive: &Drive, number: u32) -> anyhow::Result<Vec<PathBuf>> {
    let station = drive.scans.iter().find(|scan| scan.number == number).map(|scan| scan.station_m);
    let Some(from_m) = station.filter(|station| station.is_finite()) else { return Ok(Vec::new()) };
    if drive.unit() != Unit::Metres {
        tell!("{}: the vehicle stood: no view of the road", log.display());
        return Ok(Vec::new());
    }
    let stretch = Stretch::read(log, from_m, from_m + VIEW_M)?;
    if stretch.returns.is_empty() {
        tell!("{}: no position at scan {number}, so no view of the cloud", log.display());
        return Ok(Vec::new());
    }
    let title = format!("The road from scan {number} on");
    canvas.write(&format!("view-{number}"), &plot::view(&stretch, &title, canvas.theme))
}

/// Draws one section.
pub fn one_section(canvas: &Canvas<'_>, log: &Path, number: u32, paths: &mut Vec<PathBuf>) -> anyhow::Result<Section> {
    let found = section::of_scan(log, number)?;
    let found = found.with_context(|| format!("{}: no profile of a scan {number}", log.display()))?;
    let roll = crossfall::units::degrees(found.profile.roll);
    let title = format!("Section of scan {number}, roll {roll:.2}\u{b0}").replace('-', "\u{2212}");
    paths.extend(canvas.write(&format!("section-{number}"), &plot::section(&found, &title, canvas.theme)?)?);
    Ok(found)
}

/// Truth of the four slopes: left adjacent and opposing, right adjacent and opposing.
pub type Truth = [Vec<TruthAt>; 4];

/// Draws the slopes along the road, of several drives by where they were.
pub fn slopes(canvas: &Canvas<'_>, drives: &[Drive], names: &[String], truth: &Truth) -> anyhow::Result<Vec<PathBuf>> {
    let Some(first) = drives.first() else { return Ok(Vec::new()) };
    let unit = first.unit();
    let mut series: Vec<Series> = WhichSlope::ALL
        .iter()
        .zip(truth)
        .map(|(slope, truth)| Series { name: slope.name().to_owned(), drives: Vec::new(), truth: truth.clone() })
        .collect();
    // Several are drawn by where they were, at the stations of the first.
    let way = (drives.len() > 1 && unit == Unit::Metres).then(|| first.way()).flatten();
    for (number, drive) in drives.iter().enumerate() {
        let place = |(i, scan): (usize, &Scan)| match (&way, number) {
            (Some(way), 1..) => way.station_m(scan.place),
            _ => drive.at(unit, i),
        };
        let places: Vec<Option<f64>> = drive.scans.iter().enumerate().map(place).collect();
        for (slope, series) in WhichSlope::ALL.into_iter().zip(&mut series) {
            let measured = drive.scans.iter().zip(&places).filter_map(|(scan, place)| {
                let (value, ci95) = scan.reliable(slope)?;
                let half = if ci95.is_finite() { ci95 } else { 0.0 };
                Some(((*place)?, value, half))
            });
            let mut measured: Vec<_> = measured.collect();
            measured.sort_by(|a, b| a.0.total_cmp(&b.0));
            series.drives.push(measured);
        }
    }
    canvas.write("slopes", &plot::drive(&series, names, unit, first.least_place(), canvas.theme)?)
}

/// Draws the returns of all runs nearest to a scan of the first.
fn runs(
    canvas: &Canvas<'_>,
    logs: &[PathBuf],
    drives: &[Drive],
    number: u32,
    found: Section,
) -> anyhow::Result<Vec<PathBuf>> {
    let names = names(logs);
    let place = drives[0].scans.iter().find(|scan| scan.number == number).map(|scan| scan.place);
    let place = place.filter(|place| place[0].is_finite());
    let place = place.with_context(|| format!("{}: scan {number} has no position", logs[0].display()))?;
    let mut list = vec![(names[0].clone(), found)];
    for ((drive, log), name) in drives.iter().zip(logs).zip(&names).skip(1) {
        let distance = |scan: &Scan| {
            let [east, north] = crossfall::geodesy::between(place, scan.place);
            east.hypot(north)
        };
        let known = drive.scans.iter().filter(|scan| scan.place[0].is_finite());
        let nearest = known.min_by(|a, b| distance(a).total_cmp(&distance(b))).filter(|scan| distance(scan) < NEAR_M);
        let Some(nearest) = nearest else {
            tell!("{}: was not within {NEAR_M} m of scan {number} of the first log", log.display());
            continue;
        };
        let of = section::of_scan(log, nearest.number)?;
        list.extend(of.map(|section| (format!("{name}, {:.1} m off", distance(nearest)), section)));
    }
    let title = format!("{} runs at one place", list.len());
    canvas.write("runs", &plot::runs(&list, &title, canvas.theme)?)
}

/// Errors of the slopes against a table of truth, joined by the scan's number: the left side's, and the right's where the table has that.
fn errors(drive: &Drive, truth: &Path) -> anyhow::Result<Vec<(String, Vec<f64>)>> {
    const COLUMNS: [&str; 4] = ["adjacent_deg", "opposing_deg", "right_adjacent_deg", "right_opposing_deg"];
    let mut table = csv::Reader::from_path(truth).with_context(|| truth.display().to_string())?;
    let header = table.headers().with_context(|| truth.display().to_string())?.clone();
    let find = |name: &str| header.iter().position(|one| one == name);
    let needed = |name: &str| find(name).with_context(|| format!("{}: has no column `{name}`", truth.display()));
    let scan_column = needed("scan")?;
    let (mut columns, mut kinds) = (Vec::new(), Vec::new());
    for (slope, column) in WhichSlope::ALL.into_iter().zip(COLUMNS) {
        let found = if column.starts_with("right_") { find(column) } else { Some(needed(column)?) };
        if let Some(column) = found {
            columns.push((slope, column));
            kinds.push((slope.name().to_owned(), Vec::new()));
        }
    }
    let mut scans = drive.scans.iter().peekable();
    for (line, record) in table.records().enumerate() {
        let record = record.with_context(|| truth.display().to_string())?;
        let cell = |column: usize| {
            let text = record.get(column).unwrap_or_default();
            let number = text.parse::<f64>();
            number.with_context(|| format!("{}: row {}: `{text}` is no number", truth.display(), line + 2))
        };
        let number = cell(scan_column)? as u32;
        while scans.next_if(|scan| scan.number < number).is_some() {}
        let Some(scan) = scans.peek().filter(|scan| scan.number == number) else { continue };
        for (&(slope, column), (_, errors)) in columns.iter().zip(&mut kinds) {
            let (measured, _) = scan.slopes[slope.index()];
            if measured.is_finite() {
                errors.push(f64::from(measured) - cell(column)?);
            }
        }
    }
    Ok(kinds)
}
