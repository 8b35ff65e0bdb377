//! `crossfall replay`: plays a capture into a board, emulated or on a bench, each byte at its time.
//!
//! The board's lines are TCP servers (an emulator's serial ports, a serial server) or serial ports; a byte on the pulse's line stands
//! for an edge. A board sets its scanner up before it listens to it, so the replay answers as a scanner would, and the drive begins when the
//! board has started it. Where nobody asks, the drive begins after 2.5 s all the same.

use std::path::PathBuf;

use crossfall::capture::{Channel, Reader};
use crossfall::faults::{Faulty, Spec};
use crossfall::record::Device;
use crossfall::replay::{Lines, Options, Played, Replay};

use super::progress::Progress;
use super::{Outcome, say_json, tell};

/// Play a capture into a board's lines with true timing
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  crossfall replay drive.mcap --lidar tcp:localhost:4001 \\
      --ins tcp:localhost:4002 --pps tcp:localhost:4003
  crossfall replay drive.mcap --lidar serial:/dev/ttyUSB1@500000 \\
      --ins serial:/dev/ttyUSB2@115200
  crossfall replay drive.mcap --lidar tcp:bench:4001 --ins tcp:bench:4002 \\
      --speed 0.5
  crossfall replay drive.mcap --lidar tcp:bench:4001 --ins tcp:bench:4002 \\
      --faults flip=1e-5,seed=7

Record the board's link meanwhile with `crossfall record`. Ctrl-C ends the replay.")]
pub struct Args {
    /// The capture
    capture: PathBuf,
    /// The scanner's line: tcp:HOST:PORT or serial:PATH@BAUD
    #[arg(long, value_name = "LINE", value_parser = sensor_line)]
    lidar: Device,
    /// The inertial unit's line, likewise
    #[arg(long, value_name = "LINE", value_parser = sensor_line)]
    ins: Device,
    /// The pulse per second: tcp:HOST:PORT; each edge is one byte
    #[arg(long, value_name = "LINE", value_parser = pulse_line)]
    pps: Option<Device>,
    /// Seconds of the drive in a second
    #[arg(long, value_name = "X", default_value_t = 1.0, value_parser = super::number(0.01, 100.0))]
    speed: f64,
    /// Do not answer as a scanner: play at once
    #[arg(long)]
    mute: bool,
    /// A configuration, for the lines' rates (TOML, see `crossfall config`)
    #[arg(long, value_name = "FILE")]
    config: Option<PathBuf>,
    /// Faults of the lines on the way, such as flip=1e-5,drop=1e-5 or lidar:burst=1e-6:200;pps:drop=0.1
    #[arg(long, value_name = "SPEC")]
    faults: Option<Spec>,
    /// Print what was played for machines
    #[arg(long)]
    json: bool,
}

pub fn run(args: &Args) -> anyhow::Result<Outcome> {
    let config = super::configuration(args.config.as_deref())?;
    let capture = Reader::open(&args.capture)?;
    capture.require(Channel::Lidar)?;
    let (first, last) = capture.span_ns().unwrap_or_default();
    let extent = last.saturating_sub(first);
    let lines = Lines { lidar: args.lidar.clone(), ins: args.ins.clone(), pps: args.pps.clone() };
    let mut replay = Replay::open(&lines, Options { speed: args.speed, answer: !args.mute, config })?;
    if !args.mute {
        let waiting = Progress::spinner();
        waiting.say(|| format!("{}: waiting for the board to start its scanner", args.lidar));
        let asked = replay.set_up()?;
        drop(waiting);
        if !asked {
            tell!("{}: nobody asks for scans; playing all the same", args.lidar);
        }
    }
    let progress = Progress::new("replay", extent);
    let mut counts = Vec::new();
    let played = match &args.faults {
        None => replay.play(capture, |now| progress.at(now))?,
        Some(spec) => {
            let mut faulty = Faulty::new(capture, spec);
            let played = replay.play(faulty.by_ref(), |now| progress.at(now))?;
            counts.extend(faulty.counts());
            played
        }
    };
    drop(progress);
    for (line, counts) in counts {
        tell!("faults on {}: {counts}", line.topic());
    }
    for damage in &played.damage {
        tell!("{damage}");
    }
    tell!("{}", line(&played, args.speed));
    if played.lidar_bytes_unsent > 0 {
        tell!("not sent: {} bytes of the scanner, which the board had stopped", played.lidar_bytes_unsent);
    }
    if args.json {
        say_json(&played)?;
    }
    Ok(Outcome::lost_if(!played.damage.is_empty() || played.lidar_bytes_unsent > 0))
}

/// A replay in one line.
fn line(played: &Played, speed: f64) -> String {
    let Played { seconds, lidar_bytes, ins_bytes, pulses, worst_late_us, mean_late_us, .. } = played;
    let speed = if speed == 1.0 { String::new() } else { format!(" at {speed} times its speed") };
    format!(
        "{seconds:.1} s played{speed}: {lidar_bytes} bytes of the scanner, {ins_bytes} of the unit, {pulses} pulses; {mean_late_us:.0} us late in the mean, {worst_late_us} us at worst"
    )
}

/// A serial port of the link has a rate that goes without saying; a sensor's has not.
fn sensor_line(text: &str) -> Result<Device, String> {
    match text.parse()? {
        Device::Serial { .. } if !text.contains('@') => {
            Err("expected serial:PATH@BAUD: a sensor's line needs its rate".to_owned())
        }
        Device::Emulated { .. } => {
            Err("expected tcp:HOST:PORT or serial:PATH@BAUD: an emulated board has its own sensors".to_owned())
        }
        line => Ok(line),
    }
}

fn pulse_line(text: &str) -> Result<Device, String> {
    match text.parse()? {
        Device::Serial { .. } => Err("expected tcp:HOST:PORT: a serial port has no line for a pulse".to_owned()),
        Device::Emulated { .. } => Err("expected tcp:HOST:PORT: an emulated board has its own pulse".to_owned()),
        line => Ok(line),
    }
}
