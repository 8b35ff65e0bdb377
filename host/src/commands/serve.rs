//! `crossfall serve`: the operator's live page.
//!
//! Shows a board, or a drive that has been, in any number of browsers; one of them steers: records, drops markers, configures. On a loopback
//! address it is there for this computer alone; on another one only with the token that is printed, and over plain HTTP:
//! for a network in the car, not for the internet. Recordings go to the folder of `--into`.

use std::net::SocketAddr;
use std::path::PathBuf;
use std::sync::Arc;

use anyhow::Context;
use crossfall::live::{Live, Source};
use crossfall::record::Device;
use crossfall::serve::{Access, is_token, random_token, serve};

use super::{Outcome, tell};

/// Show a drive live in the browser and control the board
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  crossfall serve --device serial:/dev/ttyUSB0 --config my.toml --into drives
  crossfall serve drive.mcap --speed 5
  crossfall serve --device emulated
  crossfall serve --device tcp:192.168.0.7:4000 --listen 0.0.0.0:8080")]
pub struct Args {
    #[command(flatten)]
    source: SourceArgs,
    /// Address to listen on; other than loopback, a token is asked for
    #[arg(long, value_name = "ADDRESS", default_value = "127.0.0.1:8080")]
    listen: SocketAddr,
    /// The token, at least 16 letters and digits; a random one unless told
    #[arg(long, value_name = "TOKEN")]
    token: Option<String>,
    /// Folder for recordings
    #[arg(long, value_name = "FOLDER", default_value = ".")]
    into: PathBuf,
}

/// Where frames come from.
#[derive(clap::Args)]
pub struct SourceArgs {
    /// A log or a capture to replay
    #[arg(value_name = "FILE", required_unless_present = "device", conflicts_with = "device")]
    file: Option<PathBuf>,
    /// The board: serial:PATH, serial:PATH@BAUD (1,000,000 unless told), tcp:HOST:PORT or
    /// emulated (the board's image in QEMU, on a simulated drive)
    #[arg(short, long)]
    device: Option<Device>,
    /// Speed of a replay, times real time
    #[arg(long, value_name = "X", default_value = "1", value_parser = speed)]
    speed: f64,
    /// A configuration (TOML, see `crossfall config`): put in force on the board, again whenever it
    /// restarts; a replay is measured with it
    #[arg(long, value_name = "FILE")]
    config: Option<PathBuf>,
}

impl SourceArgs {
    /// Begins to look.
    pub fn start(&self, folder: &std::path::Path) -> anyhow::Result<Live> {
        // Before the board is disturbed.
        let config = self.config.as_deref().map(crossfall::config::read).transpose()?;
        let source = match (&self.device, &self.file) {
            (Some(device), _) => Source::Device(device.clone()),
            (None, Some(file)) => Source::File(file.clone()),
            (None, None) => anyhow::bail!("neither a file nor a device"),
        };
        Ok(Live::start(&source, folder, self.speed, config)?)
    }
}

fn speed(text: &str) -> Result<f64, String> {
    let most = crossfall::live::player::MAX_SPEED;
    match text.parse() {
        Ok(speed) if (0.1..=most).contains(&speed) => Ok(speed),
        _ => Err(format!("expected a number from 0.1 to {most}")),
    }
}

pub fn run(args: &Args) -> anyhow::Result<Outcome> {
    anyhow::ensure!(args.into.is_dir(), "{}: not a folder", args.into.display());
    if let Some(token) = &args.token {
        anyhow::ensure!(is_token(token), "a token has at least 16 letters and digits");
    }
    let token = match (&args.token, args.listen.ip().is_loopback()) {
        (Some(token), _) => Some(token.clone()),
        (None, true) => None,
        (None, false) => Some(random_token().context("cannot make a token")?),
    };
    let live = Arc::new(args.source.start(&args.into)?);
    let access = token.clone().map_or(Access::ThisComputer, Access::Token);
    let ready = |address: SocketAddr| match &token {
        None => tell!("open http://{address}/ (Ctrl-C ends)"),
        Some(token) => tell!("open http://{address}/?token={token} (Ctrl-C ends)"),
    };
    let served = serve(Arc::clone(&live), args.listen, access, ready, || !crossfall::interrupt::requested());
    live.finish();
    served.with_context(|| format!("cannot serve on {}", args.listen))?;
    let state = live.hub().state();
    Ok(Outcome::lost_if(state.last_recording.as_ref().is_some_and(|last| last.error.is_some() || last.lost > 0)))
}
