//! `crossfall reproduce`: the published evaluations again, on simulated drives with known truth.
//!
//! Alone it does the median-slope paper's experiments: two inertial units, the rock test, boards, medians with grass, three repeat drives,
//! variation along a section. It prints paper, crossfall and limit beside each other and writes `validation.md` with its pictures, in two to three minutes.
//! `reproduce terrain` is the evaluation of the driving risk map.

use std::fs;
use std::path::PathBuf;
use std::time::Instant;

use anyhow::Context;
use clap::ValueEnum;
use crossfall::output;
use crossfall::reproduce::{self, Experiment, Report};

use super::progress::Progress;
use super::{Outcome, reproduce_terrain, say, say_json, tell};

/// Repeat the published evaluations on simulated drives
#[derive(clap::Args)]
#[command(
    args_conflicts_with_subcommands = true,
    after_help = "\
Examples:
  crossfall reproduce
  crossfall reproduce --only rock -o /tmp/validation
  crossfall reproduce --seed 2 --json -o /tmp/validation
  crossfall reproduce terrain -o /tmp/terrain"
)]
pub struct Args {
    #[command(subcommand)]
    what: Option<What>,
    #[command(flatten)]
    slopes: Slopes,
}

#[derive(clap::Subcommand)]
enum What {
    Terrain(reproduce_terrain::Args),
}

#[derive(clap::Args)]
struct Slopes {
    /// Folder for validation.md and images/; made if there is none
    #[arg(short, long, value_name = "FOLDER", default_value = "docs")]
    output: PathBuf,
    /// Only this experiment: prints its lines and draws its pictures, without validation.md
    #[arg(long, value_enum, value_name = "NAME")]
    only: Option<Name>,
    /// Seed of everything random
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Shorten every drive to so many seconds, for a look at it
    #[arg(long, value_name = "S", default_value_t = 60.0, value_parser = super::number(10.0, 60.0))]
    seconds: f64,
    /// Print the table for machines
    #[arg(long)]
    json: bool,
}

/// The experiments by name.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Name {
    TwoUnits,
    Rock,
    Boards,
    Medians,
    Repeats,
    Variation,
}

impl From<Name> for Experiment {
    fn from(name: Name) -> Self {
        match name {
            Name::TwoUnits => Self::TwoUnits,
            Name::Rock => Self::Rock,
            Name::Boards => Self::Boards,
            Name::Medians => Self::Medians,
            Name::Repeats => Self::Repeats,
            Name::Variation => Self::Variation,
        }
    }
}

pub fn run(args: &Args) -> anyhow::Result<Outcome> {
    match &args.what {
        Some(What::Terrain(args)) => reproduce_terrain::run(args),
        None => slopes(&args.slopes),
    }
}

fn slopes(args: &Slopes) -> anyhow::Result<Outcome> {
    let began = Instant::now();
    let chosen: Vec<Experiment> = match args.only {
        Some(name) => vec![name.into()],
        None => Experiment::ALL.to_vec(),
    };
    let mut report = Report::default();
    let progress = Progress::new("reproduce", chosen.len() as u64);
    for (done, experiment) in chosen.iter().enumerate() {
        let at = Instant::now();
        experiment.run(args.seed, args.seconds, &mut report).context(experiment.name())?;
        progress.at(done as u64 + 1);
        progress.aside(|| tell!("{:<10} {:>5.1} s", experiment.name(), at.elapsed().as_secs_f64()));
    }
    drop(progress);
    let images = args.output.join("images");
    fs::create_dir_all(&images).with_context(|| images.display().to_string())?;
    for picture in &report.pictures {
        for (name, svg) in picture.files() {
            output::write(&images.join(name), svg.as_bytes())?;
        }
    }
    if args.only.is_none() {
        let page = args.output.join("validation.md");
        output::write(&page, reproduce::markdown(&report, args.seed).as_bytes())?;
        tell!("{} and {} pictures, {:.0} s", page.display(), 2 * report.pictures.len(), began.elapsed().as_secs_f64());
    }
    match args.json {
        true => say_json(&serde_json::json!({ "seed": args.seed, "lines": report.lines }))?,
        false => say(&reproduce::table(&report.lines))?,
    }
    Ok(Outcome::Done)
}
