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
mod inputs;
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
mod say;
mod serve;
mod simulate;
mod terminal;
mod terrain_scene;
mod values;
mod verify;

use clap::error::ErrorKind;
use clap::{CommandFactory, Parser, Subcommand};

use inputs::{configuration, distinct, paths, table_format};
use say::{has_read_enough, print, print_json_line, say, say_json, tell, tell_growing, tell_passed_over};
pub use terminal::visible;
use values::{number, size};

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

/// A wrong use that no single option shows: told as clap tells its own, and `main` makes the same exit status of it.
fn usage(command: &str, what: &str) -> anyhow::Error {
    let mut all = Cli::command();
    all.build();
    all.find_subcommand(command).unwrap_or(&all).clone().error(ErrorKind::ArgumentConflict, what).into()
}
