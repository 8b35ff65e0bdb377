//! `crossfall calibrate`: the scanner's mounting offset and the delay of its telegrams, with their uncertainty.
//!
//! Best from a rock test: the vehicle stands on level ground and is rocked for a minute, about its long axis. Any drive tells the delay if it rolls
//! enough; the offset then is no better than what is known of the road's cross slope. What the data cannot tell is refused: exit 1.

use std::path::PathBuf;

use anyhow::Context;
use crossfall::calibrate::{self, Surface};
use crossfall::config;

use super::{Outcome, say, say_json, tell};

/// Find the scanner's mounting offset and delay, with their uncertainty
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  crossfall calibrate rock-test.log.mcap
  crossfall calibrate rock-test.log.mcap -o my.toml
  crossfall calibrate drive.log.mcap --cross-slope -1.2 --json")]
pub struct Args {
    /// The log of a rock test or of a drive
    log: PathBuf,
    /// The surface's mean slope to the left in degrees, if it is known [default: level if the vehicle is parked]
    #[arg(long, value_name = "DEG", allow_negative_numbers = true)]
    cross_slope: Option<f64>,
    /// Write a configuration with the result, which `crossfall run --config` takes
    #[arg(short, long, value_name = "TOML")]
    output: Option<PathBuf>,
    /// Print the result for machines
    #[arg(long)]
    json: bool,
}

pub fn run(args: &Args) -> anyhow::Result<Outcome> {
    let surface = args.cross_slope.map_or(Surface::Assumed, Surface::Known);
    let drive = calibrate::read(&args.log)?;
    let (found, _) = calibrate::estimate(&drive, surface).with_context(|| args.log.display().to_string())?;
    if args.json {
        say_json(&found)?;
    } else {
        say(&format!(
            "mounting offset  {:+.4} degrees, standard error {:.4}\nLiDAR delay      {:+.0} us, standard error {:.0}",
            found.roll_offset_deg, found.roll_offset_se_deg, found.lidar_delay_us, found.lidar_delay_se_us
        ))?;
        say(&format!(
            "ground slope from scan to scan: {:.4} degrees before, {:.4} after, over {} scans with {:.2} degrees/s RMS of roll rate",
            found.residual_before_deg, found.residual_after_deg, found.scans, found.roll_rate_rms_deg_s
        ))?;
    }
    for remark in &found.remarks {
        tell!("{remark}");
    }
    anyhow::ensure!(found.delay_determined, "{}: the data cannot tell the delay", args.log.display());
    if let Some(path) = &args.output {
        let mut calibrated = drive.config;
        calibrated.scanner.mounting_offset = config::angle_of(found.roll_offset_deg);
        calibrated.scanner.delay_us = found.lidar_delay_us.round() as i32;
        calibrated.check().context("the result is out of range")?;
        crossfall::output::write(path, config::to_toml(&calibrated).as_bytes())?;
    }
    Ok(Outcome::lost_if(drive.damage > 0))
}
