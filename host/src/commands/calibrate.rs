//! `crossfall calibrate`: the scanner's mounting offset and the delay of its telegrams, with their uncertainty.
//!
//! Best from a rock test: the vehicle stands and is rocked for a minute about its long axis. One log takes the ground under it for level; two from the
//! same spot in opposite directions need no level ground. Any drive tells the delay if it rolls enough; the offset then is no better than what
//! is known of the road's cross slope. What the data cannot tell is refused: without a delay exit 1, and an offset that is too uncertain is not
//! written. `--plot` draws the rock test (`rock.svg`: roll, slope seen, residual; `ground.svg`: the ground before and after).

use std::path::{Path, PathBuf};

use anyhow::Context;
use crossfall::calibrate::{self, DRAWN_SCANS, Drive, Estimate, Sample, Surface};
use crossfall::plot;
use crossfall::{config, output};
use crossfall_core::protocol::message::Pose;

use super::plot::Theme;
use super::{Outcome, distinct, drives, number, paths, say, say_json, tell, usage};

/// Find the scanner's mounting offset and delay, with their uncertainty
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  crossfall calibrate rock-test.log.mcap
  crossfall calibrate rock-test.log.mcap -o my.toml --plot pictures
  crossfall calibrate heading-north.log.mcap heading-south.log.mcap
  crossfall calibrate drive.log.mcap --cross-slope -1.2 --json")]
pub struct Args {
    /// The log of a rock test or of a drive; several of rock tests on one spot in different directions
    #[arg(required = true, value_name = "LOG")]
    logs: Vec<PathBuf>,
    /// The surface's mean slope to the left in degrees, if it is known; of one log [default: level if the vehicle is parked]
    #[arg(long, value_name = "DEG", allow_negative_numbers = true, value_parser = number(-45.0, 45.0))]
    cross_slope: Option<f64>,
    /// Write a configuration with the result, which `crossfall run --config` takes
    #[arg(short, long, value_name = "TOML")]
    output: Option<PathBuf>,
    /// Draw the test into this folder (rock.svg, ground.svg); of several logs the first
    #[arg(long, value_name = "FOLDER")]
    plot: Option<PathBuf>,
    /// Pictures for paper or for a screen
    #[arg(long, value_enum, default_value_t = Theme::Light)]
    theme: Theme,
    /// Print the result for machines
    #[arg(long)]
    json: bool,
}

pub fn run(args: &Args) -> anyhow::Result<Outcome> {
    let surface = args.cross_slope.map_or(Surface::Assumed, Surface::Known);
    if let Some(output) = &args.output {
        distinct(&paths(&args.logs), &[output])?;
    }
    let (mut estimates, mut first, mut damage) = (Vec::new(), None, 0);
    // A pose of each log, by which a copy of it is known.
    let mut pivots: Vec<(&PathBuf, Pose)> = Vec::new();
    let logs = drives::of(&args.logs);
    if args.cross_slope.is_some() && logs.len() > 1 {
        let what = "--cross-slope is the slope in one direction; of several logs their directions tell the ground's";
        return Err(usage("calibrate", what));
    }
    for path in &logs {
        let drive = calibrate::read(path)?;
        let (found, samples) = calibrate::estimate(&drive, surface).with_context(|| path.display().to_string())?;
        damage += drive.damage;
        anyhow::ensure!(
            logs.len() == 1 || found.parked,
            "{}: nothing tells that the vehicle stood; only rock tests can be joined",
            path.display()
        );
        let scanner = drive.config.scanner;
        let twin = pivots.iter().find(|(_, pose)| drive.poses.contains(pose)).map(|(path, _)| *path);
        pivots.extend(drive.poses.get(drive.poses.len() / 2).map(|pose| (path, *pose)));
        let (old, ..) = first.get_or_insert((drive, samples, found.clone()));
        let same = scanner == old.config.scanner;
        anyhow::ensure!(same, "{}: made with another offset or delay than the first log", path.display());
        if let Some(twin) = twin {
            anyhow::bail!("{}: is the same test as {}, and one test counts once", path.display(), twin.display());
        }
        estimates.push(found);
    }
    let (drive, samples, alone) = first.context("no log")?;
    let old_offset_deg = crossfall::units::degrees(drive.config.scanner.mounting_offset);
    let found = calibrate::join(estimates, old_offset_deg).context("the logs cannot be joined")?;
    if args.json {
        say_json(&found)?;
    } else {
        say(&text(&found))?;
    }
    for remark in &found.remarks {
        tell!("{remark}");
    }
    if let Some(folder) = &args.plot {
        std::fs::create_dir_all(folder).with_context(|| folder.display().to_string())?;
        // The picture is that of the first log: so are its residuals.
        let Estimate { residual_before_deg, residual_after_deg, .. } = alone;
        let drawn = Estimate { residual_before_deg, residual_after_deg, ..found.clone() };
        draw_rock(&drawn, &samples, &folder.join("rock.svg"), args.theme.into())?;
        draw_ground(&drive, &found, &folder.join("ground.svg"), args.theme.into())?;
    }
    let name = logs.iter().map(|path| path.display().to_string()).collect::<Vec<_>>().join(", ");
    anyhow::ensure!(found.delay_determined, "{name}: the data cannot tell the delay");
    if let Some(path) = &args.output {
        let mut calibrated = drive.config;
        calibrated.scanner = found.scanner(&calibrated.scanner)?;
        calibrated.check().context("the result is out of range")?;
        output::write(path, config::to_toml(&calibrated).as_bytes())?;
        if !found.offset_determined {
            tell!("{}: the mounting offset in it is the old one", path.display());
        }
    }
    Ok(Outcome::lost_if(damage > 0))
}

fn text(found: &Estimate) -> String {
    format!(
        "mounting offset  {:+.4} degrees, standard error {:.4}\n\
         LiDAR delay      {:+.0} us, standard error {:.0}\n\
         ground slope from scan to scan: {:.4} degrees before, {:.4} after, over {} scans with {:.2} degrees/s RMS of roll rate\n\
         of the latter the noise of the ranges makes {:.4}, the inertial unit and the processing {:.4}",
        found.roll_offset_deg,
        found.roll_offset_se_deg,
        found.lidar_delay_us,
        found.lidar_delay_se_us,
        found.residual_before_deg,
        found.residual_after_deg,
        found.scans,
        found.roll_rate_rms_deg_s,
        found.residual_ranges_deg,
        found.residual_rest_deg,
    )
}

/// Draws roll, slope seen and residual as the paper's figure 5.
pub fn draw_rock(found: &Estimate, samples: &[Sample], path: &Path, theme: plot::Theme) -> anyhow::Result<()> {
    let note = format!(
        "offset {:+.4}\u{b0} \u{b1} {:.4}\u{b0}, delay {:.0} \u{b1} {:.0} us (standard errors); residual {:.4}\u{b0} before, {:.4}\u{b0} after",
        found.roll_offset_deg,
        found.roll_offset_se_deg,
        found.lidar_delay_us,
        found.lidar_delay_se_us,
        found.residual_before_deg,
        found.residual_after_deg
    );
    let picture =
        calibrate::picture(samples, "Roll by the inertial unit and slope of the ground by the scanner", &note, theme)?;
    Ok(output::write(path, picture.as_bytes())?)
}

/// Draws the ground before and after as the paper's figure 6.
pub fn draw_ground(drive: &Drive, found: &Estimate, path: &Path, theme: plot::Theme) -> anyhow::Result<()> {
    let layers = calibrate::layers(drive, found)?;
    let note = format!("{DRAWN_SCANS} scans spread over the log, within three metres of the sensor, seen from behind");
    let picture = plot::layers(&layers, "The ground under the vehicle", &note, theme)?;
    Ok(output::write(path, picture.as_bytes())?)
}
