//! `crossfall reproduce terrain`: the second seed's evaluation, and what lies beyond it, on simulated drives.
//!
//! Prints one table of curbs, one of bumps and one of moving bodies, and writes occupancy against distance (the seed's figure 3) as
//! `occupancy.csv` and `occupancy.svg`.

use std::fmt::Write as _;
use std::fs;
use std::path::PathBuf;

use anyhow::{Context, Result};
use crossfall::output;
use crossfall::terrain::conventional::tuned;
use crossfall::terrain::curve;
use crossfall::terrain::drive::TerrainScene;
use crossfall::terrain::evaluation::{DISTANCES, Judged, judge};
use crossfall::terrain::ghosts::{Passed, ghosts};
use crossfall::terrain::scene::{Bump, GradeKnot};

use super::{Outcome, say};

/// The evaluation of the driving risk map: curbs by distance, bumps, false risk, moving bodies
#[derive(clap::Args)]
pub struct Args {
    /// Folder for occupancy.csv and occupancy.svg; made if there is none
    #[arg(short, long, value_name = "DIR")]
    output: Option<PathBuf>,
    /// Only scenes whose name holds this
    #[arg(long, value_name = "TEXT", default_value = "")]
    only: String,
    /// Seed of all noise
    #[arg(long, default_value_t = 1)]
    seed: u64,
}

/// The scenes, by name.
fn scenes(seed: u64) -> Vec<(String, TerrainScene)> {
    let base = || TerrainScene { seed, frames: 36, ..TerrainScene::default() };
    let mut all = Vec::new();
    for (name, curb, heading, speed) in [
        ("straight, 15 cm curb, 45 deg", 0.15, 45.0, 10.0),
        ("straight, 12 cm curb, 0 deg", 0.12, 0.0, 7.0),
        ("straight, 12 cm curb, 30 deg, 4 m/s", 0.12, 30.0, 4.0),
        ("straight, 10 cm curb, 120 deg", 0.10, 120.0, 7.0),
        ("straight, 8 cm curb, 0 deg", 0.08, 0.0, 7.0),
        ("straight, 8 cm curb, 20 deg", 0.08, 20.0, 10.0),
        ("straight, 5 cm curb, 75 deg", 0.05, 75.0, 7.0),
    ] {
        let mut scene = base();
        scene.road.curb_height_m = curb;
        scene.road.heading_deg = heading;
        scene.speed_mps = speed;
        all.push((name.to_owned(), scene));
    }
    let knots =
        |list: &[(f64, f64)]| list.iter().map(|(at_m, grade)| GradeKnot { at_m: *at_m, grade: *grade }).collect();
    let mut ramp = base();
    ramp.road.profile = knots(&[(0.0, 0.03), (45.0, 0.03), (51.0, 0.12), (200.0, 0.12)]);
    all.push(("ramp +12 % on 3 %".to_owned(), ramp));
    let mut crest = base();
    crest.road.profile = knots(&[(0.0, 0.03), (60.0, 0.03), (80.0, -0.07), (200.0, -0.07)]);
    all.push(("crest 3 % to -7 %".to_owned(), crest));
    let mut bend = base();
    bend.road.curvature_per_m = 0.005;
    all.push(("bend R 200 m, inner curb".to_owned(), bend));
    let mut outer = base();
    outer.road.curvature_per_m = -0.005;
    all.push(("bend R 200 m, outer curb".to_owned(), outer));
    let mut bumps = base();
    // At the last frame the vehicle is at 24.5 m.
    bumps.road.bumps = [(21.0, 0.05), (26.0, 0.03), (31.0, 0.08), (36.0, 0.10)]
        .map(|(ahead, height_m)| Bump { at_m: 24.5 + ahead, length_m: 0.9, height_m })
        .to_vec();
    all.push(("bumps".to_owned(), bumps));
    all
}

pub fn run(args: &Args) -> Result<Outcome> {
    say(&format!(
        "{:<38} {:>9} {:>10} {:>9} {:>10} {:>7} {:>9} {:>5}",
        "scene", "occupied", "impassable", "conv. occ", "conv. imp", "false %", "elev. mm", "curb"
    ))?;
    let mut first: Option<Judged> = None;
    for (name, scene) in scenes(args.seed).into_iter().filter(|(name, _)| name.contains(&args.only)) {
        let judged = judge(&scene, 6, Some(tuned()))?;
        say(&format!(
            "{name:<38} {:>7} m {:>8} m {:>7} m {:>8} m {:>7.3} {:>9.1} {:>4.0}%",
            judged.map.occupied_to(),
            judged.map.impassable_to(),
            judged.conventional.occupied_to(),
            judged.conventional.impassable_to(),
            100.0 * judged.false_cells.0 as f64 / judged.false_cells.1.max(1) as f64,
            judged.elevation_rms_m * 1e3,
            100.0 * judged.curb_told,
        ))?;
        for bump in &judged.bumps {
            say(&format!(
                "    bump of {:.0} cm at {:.0} m: risky over {:.0} % of its length, {:.0} % of that told a bump",
                bump.height_m * 100.0,
                bump.distance_m,
                100.0 * bump.share,
                100.0 * bump.told
            ))?;
        }
        if first.is_none() || name.contains("12 cm curb, 0 deg") {
            first = Some(judged);
        }
    }
    for ghost in ghosts(args.seed, &args.only)? {
        let told = |passed: &Passed| format!("{} of {}", passed.risky, passed.visible);
        say(&format!(
            "{:<38} {} cells still risky to 40 m, {} to 60 m",
            ghost.name,
            told(&ghost.near),
            told(&ghost.far)
        ))?;
    }
    if let (Some(folder), Some(judged)) = (&args.output, &first) {
        fs::create_dir_all(folder).with_context(|| format!("creating {}", folder.display()))?;
        let mut table = String::from("distance_m,occupancy_map,occupancy_conventional\n");
        for ((distance, map), other) in DISTANCES.zip(&judged.map.occupancy).zip(&judged.conventional.occupancy) {
            writeln!(table, "{distance},{map:.4},{other:.4}")?;
        }
        output::write(&folder.join("occupancy.csv"), table.as_bytes())?;
        curve::draw(judged, &folder.join("occupancy.svg"))?;
    }
    Ok(Outcome::Done)
}
