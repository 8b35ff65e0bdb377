//! One file a subcommand; its first comment is its manual.

mod calibrate;
mod cloud;
mod compare;
mod completions;
mod config;
mod demo;
mod drives;
mod export;
mod import;
mod info;
mod log_args;
mod messages;
mod monitor;
mod plot;
mod profiles;
mod progress;
mod record;
mod recover;
mod replay;
mod report;
mod reproduce;
mod reproduce_terrain;
mod risk;
mod run;
mod serve;
mod simulate;
mod terminal;
mod terrain_scene;
mod verify;

use std::io::{self, Write};
use std::path::{Path, PathBuf};

use anyhow::Context;
use clap::error::ErrorKind;
use clap::{CommandFactory, Parser, Subcommand};
use crossfall::{output, table};
use crossfall_core::protocol::Config;

pub use terminal::visible;

/// Measures the slopes beside a road from a moving vehicle.
///
/// A board timestamps a laser scanner and an inertial unit, takes the vehicle's roll out of every scan and finds the road, its edge
/// and the slopes beyond. This program logs what the board sends, proves the log, and turns drives into tables and pictures; it also
/// runs the board's own code over captures and simulates drives.
#[derive(Parser)]
#[command(
    version,
    max_term_width = 100,
    after_help = "\
Begin with: crossfall demo

Exit status: 0 done, 1 failed, 2 usage, 3 done but data was lost or did not verify."
)]
pub struct Cli {
    #[command(subcommand)]
    pub command: Option<Command>,
}

#[derive(Subcommand)]
pub enum Command {
    Demo(demo::Args),
    Simulate(simulate::Args),
    Import(import::Args),
    Run(run::Args),
    Record(record::Args),
    Replay(replay::Args),
    Recover(recover::Args),
    Serve(serve::Args),
    Monitor(monitor::Args),
    Verify(verify::Args),
    Profiles(profiles::Args),
    Calibrate(calibrate::Args),
    Compare(compare::Args),
    Plot(plot::Args),
    Cloud(cloud::Args),
    Report(report::Args),
    Export(export::Args),
    Risk(risk::Args),
    Reproduce(reproduce::Args),
    Info(info::Args),
    Messages(messages::Args),
    Config(config::Args),
    Completions(completions::Args),
}

/// How a command that did its work ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Outcome {
    /// With everything whole.
    Done,
    /// With data lost on the way, or not verified.
    Lost,
}

impl Outcome {
    fn lost_if(lost: bool) -> Self {
        if lost { Self::Lost } else { Self::Done }
    }
}

impl Command {
    pub fn run(self) -> anyhow::Result<Outcome> {
        // These end whole and well by Ctrl-C.
        let endless = matches!(self, Self::Record(_) | Self::Serve(_) | Self::Monitor(_));
        let outcome = self.carry_out()?;
        anyhow::ensure!(endless || !crossfall::interrupt::requested(), "interrupted");
        Ok(outcome)
    }

    fn carry_out(self) -> anyhow::Result<Outcome> {
        match self {
            Self::Demo(args) => demo::run(&args),
            Self::Simulate(args) => simulate::run(&args),
            Self::Import(args) => import::run(&args),
            Self::Run(args) => run::run(&args),
            Self::Record(args) => record::run(&args),
            Self::Replay(args) => replay::run(&args),
            Self::Recover(args) => recover::run(&args),
            Self::Serve(args) => serve::run(&args),
            Self::Monitor(args) => monitor::run(&args),
            Self::Verify(args) => verify::run(&args),
            Self::Profiles(args) => profiles::run(&args),
            Self::Calibrate(args) => calibrate::run(&args),
            Self::Compare(args) => compare::run(&args),
            Self::Plot(args) => plot::run(&args),
            Self::Cloud(args) => cloud::run(&args),
            Self::Report(args) => report::run(&args),
            Self::Export(args) => export::run(&args),
            Self::Risk(args) => risk::run(&args),
            Self::Reproduce(args) => reproduce::run(&args),
            Self::Info(args) => info::run(&args),
            Self::Messages(args) => messages::run(&args),
            Self::Config(args) => config::run(&args),
            Self::Completions(args) => completions::run(&args),
        }
    }
}

/// The configuration of a file, or the defaults.
fn configuration(file: Option<&Path>) -> anyhow::Result<Config> {
    Ok(file.map(crossfall::config::read).transpose()?.unwrap_or_default())
}

/// Prints data for people that a command does nothing but stream; an error as of [`has_read_enough`] tells it to stop.
fn print(text: &str) -> io::Result<()> {
    put(&visible(text))
}

/// The same of data for machines, a line each.
fn print_json_line(value: &impl serde::Serialize) -> anyhow::Result<()> {
    Ok(put(&serde_json::to_string(value)?)?)
}

fn put(text: &str) -> io::Result<()> {
    let mut out = io::stdout().lock();
    out.write_all(text.as_bytes())?;
    out.write_all(b"\n")?;
    out.flush()
}

/// Whether printing failed because whoever read stdout has closed it.
fn has_read_enough(error: &io::Error) -> bool {
    error.kind() == io::ErrorKind::BrokenPipe
}

/// What was printed, or that nobody reads on: the work that is left and the verdict are the same.
fn heard_or_not(printed: io::Result<()>) -> io::Result<()> {
    printed.or_else(|error| if has_read_enough(&error) { Ok(()) } else { Err(error) })
}

/// Prints data for people.
fn say(text: &str) -> io::Result<()> {
    heard_or_not(print(text))
}

/// Prints data for machines.
fn say_json(value: &impl serde::Serialize) -> anyhow::Result<()> {
    Ok(heard_or_not(put(&serde_json::to_string_pretty(value)?))?)
}

/// Tells the user something that is not data.
macro_rules! tell {
    ($($arg:tt)*) => {{
        use std::io::Write;
        // A closed stderr must not end the work.
        let _ = writeln!(std::io::stderr(), "{}", $crate::commands::visible(&format!($($arg)*)));
    }};
}
use tell;

/// Tells how much of a log, or of several, was passed over; true when it was any.
fn tell_passed_over(log: Option<&Path>, parts: u64) -> bool {
    if parts > 0 {
        let log = log.map(|log| format!("{}: ", log.display())).unwrap_or_default();
        tell!("{log}{parts} damaged, broken or missing parts passed over; see `crossfall verify`");
    }
    parts > 0
}

/// Says that a log is being recorded, since what is `done` with it ends where the recording is now.
fn tell_growing(logs: &[PathBuf], done: &str) {
    for log in logs.iter().filter(|log| crossfall::log::is_being_written(log)) {
        tell!("{}: is being recorded: what is {done} ends with its last closed chunk", log.display());
    }
}

/// A wrong use that no single option shows: told as clap tells its own, and `main` makes the same exit status of it.
fn usage(command: &str, what: &str) -> anyhow::Error {
    let mut all = Cli::command();
    all.build();
    all.find_subcommand(command).unwrap_or(&all).clone().error(ErrorKind::ArgumentConflict, what).into()
}

/// A parser of numbers within bounds, both included.
fn number(low: f64, high: f64) -> impl Fn(&str) -> Result<f64, String> + Clone {
    move |text| match text.parse() {
        Ok(value) if (low..=high).contains(&value) => Ok(value),
        _ => Err(format!("expected a number from {low} to {high}")),
    }
}

/// The format of a table by its name.
fn table_format(path: &Path) -> anyhow::Result<table::Format> {
    let format = table::Format::of(path);
    format.with_context(|| format!("{}: expected a name that ends in .csv, .parquet or .geojson", path.display()))
}

/// Paths, as [`distinct`] takes them.
fn paths<'a>(all: impl IntoIterator<Item = &'a PathBuf>) -> Vec<&'a Path> {
    all.into_iter().map(PathBuf::as_path).collect()
}

/// Refuses to write a file over one that is read, or two into one.
fn distinct(inputs: &[&Path], outputs: &[&Path]) -> anyhow::Result<()> {
    // A file that is not there yet is known by its folder. What is no file (`/dev/null`) takes all there is.
    let real = |path: &Path| {
        path.canonicalize().ok().or_else(|| Some(output::folder_of(path).canonicalize().ok()?.join(path.file_name()?)))
    };
    let inputs: Vec<_> = inputs.iter().filter_map(|input| real(input)).collect();
    let mut written = Vec::new();
    for output in outputs.iter().filter(|output| !output.exists() || output.is_file()) {
        let Some(place) = real(output) else { continue };
        anyhow::ensure!(!inputs.contains(&place), "{}: is read, and cannot be written as well", output.display());
        anyhow::ensure!(!written.contains(&place), "{}: cannot be two outputs at once", output.display());
        written.push(place);
    }
    Ok(())
}
