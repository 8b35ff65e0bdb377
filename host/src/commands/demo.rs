//! `crossfall demo`: the whole instrument in one go, on a simulated drive whose truth is known.
//!
//! Sensor bytes are simulated, go through the board's own code - in process, or in the image that a user flashes, booted in QEMU -, are
//! logged, proved and turned into the table of profiles. Then the table is held against the truth. Everything that was
//! made stays in a folder to be looked at.

use std::fs;
use std::path::{Path, PathBuf};
use std::time::Instant;

use anyhow::Context;
use crossfall::accuracy::{Accuracy, hold_against};
use crossfall::capture::{Reader, Writer};
use crossfall::drive::Drive;
use crossfall::output::Output;
use crossfall::profiles::{Row, Rows, write_csv};
use crossfall::simulate::scene::{Mode, Scene};
use crossfall::simulate::{self, truth};
use crossfall::{container, counters, emulated, log, output, report, verify};
use crossfall_core::protocol::Config;

use super::progress::Progress;
use super::{Outcome, plot, say, say_json, tell};

/// The whole instrument on a simulated drive with known truth
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  crossfall demo
  crossfall demo --seconds 20 --seed 7 -o /tmp/demo
  crossfall demo --scene host/scenes/random-sections.toml
  crossfall demo --device emulated --seconds 20")]
pub struct Args {
    /// The folder for all that is made; made if need be
    #[arg(short, long, value_name = "FOLDER", default_value = "crossfall-demo")]
    output: PathBuf,
    /// What to simulate (TOML, see `crossfall simulate --print-scene`)
    #[arg(long, value_name = "FILE")]
    scene: Option<PathBuf>,
    /// Seconds of scanning, instead of the scene's
    #[arg(long, value_parser = super::number(0.1, 86_400.0))]
    seconds: Option<f64>,
    /// Seed of everything random, instead of the scene's
    #[arg(long)]
    seed: Option<u64>,
    /// A configuration for the board (TOML, see `crossfall config`)
    #[arg(long, value_name = "FILE")]
    config: Option<PathBuf>,
    /// What the drive goes through
    #[arg(long, value_enum, default_value_t = Device::InProcess)]
    device: Device,
    /// The board's image for `--device emulated`, instead of the one that cargo has built
    #[arg(long, value_name = "ELF")]
    image: Option<PathBuf>,
    /// Pictures for paper or for a screen
    #[arg(long, value_enum, default_value_t = plot::Theme::Light)]
    theme: plot::Theme,
    /// Print the outcome for machines
    #[arg(long)]
    json: bool,
}

/// What a demo's drive goes through.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
enum Device {
    /// The board's code, in this program
    InProcess,
    /// The board's image, in QEMU: in real time and at half the scanner's rate
    Emulated,
}

pub fn run(args: &Args) -> anyhow::Result<Outcome> {
    let began = Instant::now();
    let config = super::configuration(args.config.as_deref())?;
    let mut scene = super::simulate::scene(args.scene.as_ref(), args.seconds, args.seed)?;
    let image = match args.device {
        Device::InProcess => None,
        Device::Emulated => {
            emulated::require_qemu()?;
            emulated::at_line_rates(&mut scene);
            Some(emulated::find_image(args.image.as_deref())?)
        }
    };
    let folder = &args.output;
    fs::create_dir_all(folder).with_context(|| folder.display().to_string())?;
    let file = |name: &str| folder.join(name);
    let (capture_path, log_path) = (file("drive.mcap"), file("drive.log.mcap"));

    // Pictures of sections are the demo's own only where it has been before.
    let again = log_path.exists();
    let mut capture = Writer::create(&capture_path)?;
    let progress = Progress::new("simulate", simulate::scans(&scene) as u64);
    let mut made = simulate::simulate(&scene, &mut capture, |scan| progress.at(scan as u64))?;
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

    let mut log = log::Writer::create(&log_path)?;
    let lost = match &image {
        None => in_process(&capture_path, &config, &mut log)?,
        Some(image) => {
            made.truth = made.truth.into_iter().step_by(2).collect();
            in_emulator(image, &capture_path, &scene, &config, &mut log)?
        }
    };
    log.finish()?;

    let progress = Progress::new("verify", container::size(&log_path));
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
    if again {
        remove_sections(folder)?;
    }
    draw(args, if along_road { &made.truth } else { &[] }, &log_path)?;
    tell!(
        "made       {}: drive.mcap, drive.log.mcap, truth.csv, profiles.csv, section-*.svg, slopes.svg, report.html",
        folder.display()
    );

    let whole = report.ok && !lost;
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

/// The drive through the board's code in this program; whether anything was lost.
fn in_process(capture: &Path, config: &Config, log: &mut log::Writer) -> anyhow::Result<bool> {
    let mut capture = Reader::open(capture)?;
    let (first, last) = capture.span_ns().unwrap_or_default();
    let progress = Progress::new("run", last.saturating_sub(first));
    let ran = crossfall::run::run(&mut capture, config, log, |now| progress.at(now.saturating_sub(first)))?;
    drop(progress);
    anyhow::ensure!(!ran.interrupted, "interrupted");
    tell!(
        "logged     {:>7} frames, {:.1} kB a second on the link",
        ran.frames,
        ran.bytes as f64 / 1e3 / ran.seconds.max(1e-3)
    );
    Ok(!ran.damage.is_empty() || !counters::losses(&ran.status).is_empty())
}

/// The drive through the board's image in QEMU; whether anything was lost.
fn in_emulator(
    image: &Path,
    capture: &Path,
    scene: &Scene,
    config: &Config,
    log: &mut log::Writer,
) -> anyhow::Result<bool> {
    tell!("boots      {}", image.display());
    // What a board has sent is a recording, unless the log says that the drive can be made again.
    log.metadata(log::metadata::SIMULATED, [("seed".to_owned(), scene.drive.seed.to_string())].into())?;
    let drive: Vec<_> = Reader::open(capture)?.collect::<Result<_, _>>()?;
    let progress = Progress::new("drive", (scene.drive.seconds * 1e6) as u64);
    let surveyed =
        emulated::survey(image, emulated::half_the_scans(drive), config, log, |played_us| progress.at(played_us))?;
    drop(progress);
    let emulated::Surveyed { played, status, frames, bytes, missing_frames, rejected, stack } = surveyed;
    tell!(
        "logged     {frames:>7} frames, {:.1} kB a second on the link, from {} scans and {} poses; {} of {} bytes of stack used",
        bytes as f64 / 1e3 / scene.drive.seconds,
        status.scans,
        status.poses,
        stack.0,
        stack.1
    );
    // What a telegram is late, its roll is late: half a degree for 70 ms on a vehicle that rolls at 7 degrees a second.
    tell!("           this machine sent its bytes {:.1} ms late at worst", played.latest.as_secs_f64() * 1e3);
    let losses = counters::losses(&status);
    for (name, count) in &losses {
        tell!("lost: {name} = {count}");
    }
    if missing_frames + rejected + u64::from(played.unsent) > 0 {
        tell!("lost: {missing_frames} frames missing, {rejected} damaged, {} scans unsent", played.unsent);
    }
    Ok(!losses.is_empty() || missing_frames + rejected > 0 || played.unsent > 0)
}

/// Removes the pictures of an earlier demo, which would be taken for this one's.
fn remove_sections(folder: &Path) -> anyhow::Result<()> {
    for entry in fs::read_dir(folder)?.flatten() {
        let name = entry.file_name().to_string_lossy().into_owned();
        if name.starts_with("section-") && name.ends_with(".svg") {
            fs::remove_file(entry.path())?;
        }
    }
    Ok(())
}

fn draw(args: &Args, truth: &[truth::Row], log: &Path) -> anyhow::Result<()> {
    // Sections of a drive vary along the road and can be drawn over it; independent ones cannot.
    let drive = Drive::read(log, |_| ())?;
    // The truth counts from the first scan, the log from the first pose.
    let start = truth.first().map_or(0.0, |row| row.station_m) - drive.span_m().map_or(0.0, |span| span.0);
    let along = |slope: fn(&truth::Row) -> f64| truth.iter().map(|row| (row.station_m - start, slope(row))).collect();
    let truth = [
        along(|row| row.section.left.adjacent_slope_deg),
        along(|row| row.section.left.opposing_slope_deg),
        along(|row| row.section.right.adjacent_slope_deg),
        along(|row| row.section.right.opposing_slope_deg),
    ];
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
