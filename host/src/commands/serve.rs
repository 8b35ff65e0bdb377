//! `crossfall serve`: the operator's live page.
//!
//! Shows a board, or a drive that has been, in any number of browsers; one of them steers: records, drops markers, configures. On a loopback
//! address it is there for this computer alone; on another one only with the token that is printed, and over plain HTTP:
//! for a network in the car, not for the internet. Recordings go to the folder of `--into`.

use std::net::SocketAddr;
use std::path::PathBuf;
use std::sync::Arc;

use anyhow::Context;
use crossfall::live::player::MAX_SPEED;
use crossfall::live::{Live, Logs, Source};
use crossfall::record::Device;
use crossfall::serve::{Access, is_token, random_token, serve};
use crossfall_core::protocol::Config;

use super::log_args::LogArgs;
use super::{Outcome, drives, number, tell};

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
    #[arg(long, value_name = "TOKEN", value_parser = token)]
    token: Option<String>,
    #[command(flatten)]
    into: IntoArgs,
}

/// Where recordings go.
#[derive(clap::Args)]
pub struct IntoArgs {
    /// Folder for recordings; made if need be
    #[arg(long, value_name = "FOLDER", default_value = ".")]
    into: PathBuf,
    #[command(flatten)]
    logs: LogArgs,
}

impl IntoArgs {
    /// The folder, and how recordings are written to it.
    pub fn logs(&self) -> Logs {
        Logs { folder: self.into.clone(), options: self.logs.options(), min_free: self.logs.min_free }
    }
}

/// Where frames come from.
#[derive(clap::Args)]
#[command(group(clap::ArgGroup::new("source").args(["file", "device"]).required(true)))]
pub struct SourceArgs {
    /// A log or a capture to replay
    #[arg(value_name = "FILE")]
    file: Option<PathBuf>,
    /// The board: serial:PATH, serial:PATH@BAUD (1,000,000 unless told), tcp:HOST:PORT or
    /// emulated (the board's image in QEMU, on a simulated drive)
    #[arg(short, long)]
    device: Option<Device>,
    /// Speed of a replay, times real time
    #[arg(long, value_name = "X", default_value = "1", value_parser = number(0.1, MAX_SPEED))]
    speed: f64,
    /// A configuration (TOML, see `crossfall config`): put in force on the board, again whenever it
    /// restarts; a replay is measured with it
    #[arg(long, value_name = "FILE")]
    config: Option<PathBuf>,
}

impl SourceArgs {
    /// The configuration that is to be in force; to be read before the board is disturbed.
    pub fn config(&self) -> anyhow::Result<Option<Config>> {
        Ok(self.config.as_deref().map(crossfall::config::read).transpose()?)
    }

    /// Begins to look.
    pub fn start(&self, logs: Logs, config: Option<Config>) -> anyhow::Result<Live> {
        let source = match (&self.device, &self.file) {
            (Some(device), _) => Source::Device(device.clone()),
            (None, Some(file)) => {
                drives::of(std::slice::from_ref(file));
                Source::File(file.clone())
            }
            (None, None) => anyhow::bail!("neither a file nor a device"),
        };
        Ok(Live::start(&source, logs, self.speed, config)?)
    }
}

fn token(text: &str) -> Result<String, String> {
    if is_token(text) { Ok(text.to_owned()) } else { Err("expected at least 16 letters and digits".to_owned()) }
}

pub fn run(args: &Args) -> anyhow::Result<Outcome> {
    let (logs, config) = (args.into.logs(), args.source.config()?);
    let token = match (&args.token, args.listen.ip().is_loopback()) {
        (Some(token), _) => Some(token.clone()),
        (None, true) => None,
        (None, false) => Some(random_token().context("cannot make a token")?),
    };
    let live = Arc::new(args.source.start(logs, config)?);
    let access = token.clone().map_or(Access::ThisComputer, Access::Token);
    let ready = |address: SocketAddr| match &token {
        None => tell!("open http://{address}/ (Ctrl-C ends)"),
        Some(token) => tell!("open http://{address}/?token={token} (Ctrl-C ends)"),
    };
    let served = serve(Arc::clone(&live), args.listen, access, ready, || !crossfall::interrupt::requested());
    live.finish();
    served.with_context(|| format!("cannot serve on {}", args.listen))?;
    Ok(verdict(&live))
}

/// Tells what is amiss with recordings, and whether anything is.
pub fn verdict(live: &Live) -> Outcome {
    let broken = live.broken();
    for recording in &broken {
        for said in recording.amiss() {
            tell!("{}: {said}", recording.file);
        }
    }
    Outcome::lost_if(!broken.is_empty())
}
