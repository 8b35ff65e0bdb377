//! Drives the terrain commands on their own.
use clap::{Parser, Subcommand};
use std::process::ExitCode;
#[derive(Parser)]
struct Cli { #[command(subcommand)] what: What }
#[derive(Subcommand)]
enum What { Risk(crossfall::commands::risk::RiskArgs), Reproduce(crossfall::commands::reproduce_terrain::ReproduceTerrainArgs), Simulate { scene: Option<std::path::PathBuf>, #[arg(short)] output: std::path::PathBuf, #[arg(long)] frames: Option<u32> } }
fn main() -> anyhow::Result<ExitCode> {
    match Cli::parse().what {
        What::Risk(args) => crossfall::commands::risk::run(&args),
        What::Reproduce(args) => crossfall::commands::reproduce_terrain::run(&args),
        What::Simulate { scene, output, frames } => {
            let mut s: crossfall::terrain::drive::TerrainScene = match scene { Some(p) => toml::from_str(&std::fs::read_to_string(p)?)?, None => Default::default() };
            if let Some(f) = frames { s.frames = f; }
            s.write(&output, |_| {})?;
            Ok(ExitCode::SUCCESS)
        }
    }
}
