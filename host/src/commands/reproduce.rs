//! `crossfall reproduce`: the published evaluations again, on simulated drives with known truth.

use super::{Outcome, reproduce_terrain};

/// Repeat a published evaluation on simulated drives
#[derive(clap::Args)]
pub struct Args {
    #[command(subcommand)]
    what: What,
}

#[derive(clap::Subcommand)]
enum What {
    Terrain(reproduce_terrain::Args),
}

pub fn run(args: &Args) -> anyhow::Result<Outcome> {
    match &args.what {
        What::Terrain(args) => reproduce_terrain::run(args),
    }
}
