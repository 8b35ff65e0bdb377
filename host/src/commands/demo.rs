//! `crossfall demo`: the whole instrument in one go, on a simulated drive whose truth is known.
//!
//! Sensor bytes are simulated, go through the board's own code in process, are logged, proved and turned into the table of
//! profiles. Then the table is held against the truth. Everything that was made stays in a folder to be looked at.

use std::fs;
use std::path::{Path, PathBuf};
use std::time::Instant;

use anyhow::Context;
use crossfall::accuracy::{Accuracy, hold_against};
use crossfall::capture::{Reader, Writer};
use crossfall::drive::Drive;
use crossfall::output::Output;
use crossfall::profiles::{Row, Rows, write_csv};
use crossfall::simulate::scene::Mode;
use crossfall::simulate::{self, truth};
use crossfall::{log, output, report, verify};

use super::progress::Progress;
use super::{Outcome, plot, say, say_json, tell};

/// The whole instrument on a simulated drive with known truth
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  crossfall demo
  crossfall demo --seconds 20 --seed 7 -o /tmp/demo
  crossfall demo --scene host/scenes/random-sections.toml")]
pub struct Args {
    /// The folder for all that is made; made if need be
    #[arg(short, long, value_name = "FOLDER", default_value = "crossfall-demo")]
    output: PathBuf,
    /// What to simulate (TOML, see `crossfall simulate --print-scene`)
    #[arg(long, value_name = "FILE")]
    scene: Option<PathBuf>,
    /// Seconds of scanning, instead of the scene's
    #[arg(long)]
    seconds: Option<f64>,
    /// Seed of everything random, instead of the scene's
    #[arg(long)]
    seed: Option<u64>,
    /// A configuration for the board (TOML, see `crossfall config`)
    #[arg(long, value_name = "FILE")]
    config: Option<PathBuf>,
    /// Pictures for paper or for a screen
    #[arg(long, value_enum, default_value_t = plot::Theme::Light)]
    theme: plot::Theme,
    /// Print the outcome for machines
    #[arg(long)]
    json: bool,
}

pub fn run(args: &Args) -> anyhow::Result<Outcome> {
    let began = Instant::now();
    let config = super::configuration(args.config.as_deref())?;
    let scene = super::simulate::scene(args.scene.as_ref(), args.seconds, args.seed)?;
    let folder = &args.output;
    fs::create_dir_all(folder).with_context(|| folder.display().to_string())?;
    let file = |name: &str| folder.join(name);
    let (capture_path, log_path) = (file("drive.mcap"), file("drive.log.mcap"));

    let mut capture = Writer::create(&capture_path)?;
    let progress = Progress::new("simulate", simulate::scans(&scene) as u64);
    let made = simulate::simulate(&scene, &mut capture, |scan| progress.at(scan as u64))?;
    drop(progress);
    capture.finish()?;
    let mut csv = Vec::new();
    truth::write_csv(&made.truth, &mut csv)?;
    output::write(&file("truth.csv"), &csv)?;
    tell!(
        "simulated  {:>7.1} s: {} scans, {} poses, {} pulses",
        scene.drive.seconds,
        made.truth.len(),
        made.poses,
        made.pulses
    );

    let mut capture = Reader::open(&capture_path)?;
    let (first, last) = capture.span_ns().unwrap_or_default();
    let mut log = log::Writer::create(&log_path)?;
    let progress = Progress::new("run", last.saturating_sub(first));
    let ran = crossfall::run::run(&mut capture, &config, &mut log, |now| progress.at(now.saturating_sub(first)))?;
    drop(progress);
    anyhow::ensure!(!ran.interrupted, "interrupted");
    log.finish()?;
    tell!(
        "logged     {:>7} frames, {:.1} kB a second on the link",
        ran.frames,
        ran.bytes as f64 / 1e3 / ran.seconds.max(1e-3)
    );

    let progress = Progress::new("verify", fs::metadata(&log_path).map_or(0, |metadata| metadata.len()));
    let report = verify::verify(&log_path, |offset| progress.at(offset))?;
    drop(progress);
    for problem in &report.problems {
        tell!("frame {} at byte {}: {}", problem.frame, problem.offset, problem.what);
    }

    let mut table = Output::create(&file("profiles.csv"))?;
    write_csv(&mut Rows::open(&log_path)?, &mut table).context("profiles.csv")?;
    table.commit()?;
    let rows: Vec<Row> = Rows::open(&log_path)?.collect();
    let accuracy = hold_against(&rows, &made.truth);
    let along_road = scene.sections.mode != Mode::RandomPerScan;
    draw(args, if along_road { &made.truth } else { &[] }, &log_path)?;
    tell!(
        "made       {}: drive.mcap, drive.log.mcap, truth.csv, profiles.csv, section-*.svg, slopes.svg, report.html",
        folder.display()
    );

    let whole = report.ok && ran.damage.is_empty() && crossfall::info::losses(&ran.status).is_empty();
    if args.json {
        say_json(&serde_json::json!({
            "ok": whole,
            "seconds": began.elapsed().as_secs_f64(),
            "profiles": report.profiles,
            "profiles_reproduced": report.profiles_reproduced,
            "accuracy": accuracy,
        }))?;
        return Ok(Outcome::lost_if(!whole));
    }
    say(&text(&accuracy))?;
    let (all, same) = (report.profiles, report.profiles_reproduced);
    say(&match all == same {
        true => format!(
            "all {all} profiles reproduced bit for bit from the log ({:.1} s in all)",
            began.elapsed().as_secs_f64()
        ),
        false => format!("{same} of {all} profiles reproduced"),
    })?;
    Ok(Outcome::lost_if(!whole))
}

fn draw(args: &Args, truth: &[truth::Row], log: &Path) -> anyhow::Result<()> {
    // Sections of a drive vary along the road and can be drawn over it; independent ones cannot.
    let start = truth.first().map_or(0.0, |row| row.station_m);
    let along = |slope: fn(&truth::Row) -> f64| truth.iter().map(|row| (row.station_m - start, slope(row))).collect();
    let truth = [
        along(|row| row.section.left.adjacent_slope_deg),
        along(|row| row.section.left.opposing_slope_deg),
        along(|row| row.section.right.adjacent_slope_deg),
        along(|row| row.section.right.opposing_slope_deg),
    ];
    // Pictures of an earlier demo in the same folder would be taken for this one's.
    for entry in fs::read_dir(&args.output)?.flatten() {
        let name = entry.file_name().to_string_lossy().into_owned();
        if name.starts_with("section-") && name.ends_with(".svg") {
            fs::remove_file(entry.path())?;
        }
    }
    let drive = Drive::read(log, |_| ())?;
    let canvas = plot::Canvas { folder: &args.output, format: plot::Format::Svg, theme: args.theme.into() };
    plot::slopes(&canvas, std::slice::from_ref(&drive), &[], &truth)?;
    if !drive.scans.is_empty() {
        plot::one_section(&canvas, log, plot::typical(&drive), &mut Vec::new())?;
    }
    let page = report::page(&drive, "A simulated drive");
    Ok(output::write(&args.output.join("report.html"), page.as_bytes())?)
}

/// The table for people.
fn text(accuracy: &[Accuracy]) -> String {
    let mut text = format!(
        "\n{:<22}{:>9}{:>14}{:>16}{:>22}",
        "against the truth", "found", "RMS error", "median |error|", "95 % interval holds"
    );
    for row in accuracy {
        let digits = if row.unit == "m" { 3 } else { 4 };
        let unit = if row.unit == "deg" { "\u{b0}" } else { " m" };
        text += &format!("\n{:<22}{:>7.1} %", row.what, 100.0 * row.found);
        text += &format!(
            "{:>w$.digits$}{unit}{:>v$.digits$}{unit}",
            row.rms,
            row.median,
            w = 14 - unit.chars().count(),
            v = 16 - unit.chars().count()
        );
        text += &row.coverage.map_or_else(|| format!("{:>22}", "-"), |share| format!("{:>20.1} %", 100.0 * share));
    }
    text + "\n"
}
