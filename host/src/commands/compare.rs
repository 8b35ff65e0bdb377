//! `crossfall compare`: repeat drives against each other, a drive against measurements by hand, two attitude sources on one drive.
//!
//! Logs of one road are matched by station on the first one's track; the table gives the mean absolute variation of adjacent, opposing and all
//! slopes, as the positions have it and, without `--over`, after shifting the drives by what makes the slopes agree best. `--manual` holds each
//! log against a table with the columns side, slope, slope_deg and station_m (or latitude_deg and longitude_deg). A capture with a second
//! inertial unit (channel `ins2`) gives the mean and RMS difference of the two. Exit 1 when nothing could be matched.

use std::path::{Path, PathBuf};

use anyhow::Context;
use crossfall::compare::attitude::{self, Comparison};
use crossfall::compare::manual::{self, Manual};
use crossfall::compare::{Agreement, Drive, Options, Repeat, Sides, repeat};
use crossfall::container::Error;
use crossfall::output;
use crossfall::plot::{self, Words};

use super::plot::Theme;
use super::{Outcome, drives, number, say, say_json, tell, tell_passed_over};

/// Compare repeat drives, a drive with hand measurements, or two inertial units
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  crossfall compare monday.log.mcap tuesday.log.mcap wednesday.log.mcap
  crossfall compare drive.log.mcap --manual inclinometer.csv --within 2 \\
      -o pictures
  crossfall compare monday.log.mcap tuesday.log.mcap --over 10 --side left \\
      --json
  crossfall compare two-units.mcap -o pictures")]
pub struct Args {
    /// Logs of one road, the first gives the stations; or one capture with a second inertial unit
    #[arg(required = true, value_name = "LOG")]
    files: Vec<PathBuf>,
    /// Measurements by hand (CSV: side, slope, slope_deg, and station_m or latitude_deg, longitude_deg)
    #[arg(long, value_name = "FILE")]
    manual: Option<PathBuf>,
    /// Compare magnitudes with --manual: for tables whose slopes have no sign
    #[arg(long, requires = "manual")]
    magnitudes: bool,
    /// Greatest distance along the road between slopes that are taken as the same place
    #[arg(long, value_name = "METRES", default_value_t = 1.0, value_parser = number(0.001, 1e4))]
    within: f64,
    /// Compare medians over stretches of this length instead of single scans
    #[arg(long, value_name = "METRES", value_parser = number(0.1, 1e5))]
    over: Option<f64>,
    /// Which sides of the road
    #[arg(long, value_enum, default_value = "both")]
    side: Sides,
    /// Draw what was compared into this folder (repeat.svg, manual.svg, attitude.svg)
    #[arg(short, long, value_name = "FOLDER")]
    output: Option<PathBuf>,
    /// Pictures for paper or for a screen
    #[arg(long, value_enum, default_value_t = Theme::Light)]
    theme: Theme,
    /// Print the outcome for machines
    #[arg(long)]
    json: bool,
}

pub fn run(args: &Args) -> anyhow::Result<Outcome> {
    if let [file] = &args.files[..]
        && args.manual.is_none()
    {
        return units(args, file);
    }
    drives(args)
}

/// Two inertial units of one capture.
fn units(args: &Args, file: &Path) -> anyhow::Result<Outcome> {
    let found = match attitude::compare(file) {
        Err(error @ Error::Content { .. }) => {
            anyhow::bail!("{error}; one log alone has nothing to be held against: name a second one, or --manual")
        }
        other => other?,
    };
    anyhow::ensure!(found.poses > 0, "{}: no instant at which both units are timed by pulses", file.display());
    for damage in &found.damage {
        tell!("{damage}");
    }
    if args.json {
        say_json(&serde_json::json!({ "attitude": found }))?;
    } else {
        say(&attitude_text(&found))?;
    }
    if found.untimed > 0 {
        tell!("{} poses without a pulse to time them were left out", found.untimed);
    }
    if found.unusable > 0 {
        tell!("{} poses of a unit that had no attitude were left out", found.unusable);
    }
    if let Some(folder) = &args.output {
        draw_attitude(&found, &picture(folder, "attitude.svg")?, args.theme.into())?;
    }
    Ok(Outcome::lost_if(!found.damage.is_empty()))
}

/// Where a picture goes; the folder is made for the first one, so that a comparison that fails leaves none.
fn picture(folder: &Path, name: &str) -> anyhow::Result<PathBuf> {
    std::fs::create_dir_all(folder).with_context(|| folder.display().to_string())?;
    Ok(folder.join(name))
}

fn attitude_text(found: &Comparison) -> String {
    let mut text = format!("{:<8}{:>12}{:>12}{:>12}", "", "mean", "RMS", "most");
    for (name, difference) in [("roll", found.roll), ("pitch", found.pitch)] {
        text += &format!(
            "\n{name:<8}{:>11.4}\u{b0}{:>11.4}\u{b0}{:>11.4}\u{b0}",
            difference.mean_deg, difference.rms_deg, difference.most_deg
        );
    }
    text += &format!("\nsecond unit less the first, RMS and most about the mean, at {} instants", found.poses);
    if let (Some(lag), Some(se)) = (found.lag_us, found.lag_se_us) {
        text += &format!("\nthe second unit's roll follows by {lag:.0} us, standard error {se:.0}");
    }
    text
}

/// Draws two units' roll and their difference.
pub fn draw_attitude(found: &Comparison, path: &Path, theme: plot::Theme) -> anyhow::Result<()> {
    let note = format!("{}, {} instants", found.said(), found.poses);
    let picture = found.picture("Roll by two inertial units", &note, theme)?;
    Ok(output::write(path, picture.as_bytes())?)
}

/// Repeat drives and measurements by hand.
fn drives(args: &Args) -> anyhow::Result<Outcome> {
    let options = Options { sides: args.side, within_m: args.within, over_m: args.over };
    let measurements = args.manual.as_deref().map(manual::read).transpose()?;
    let logs = drives::of(&args.files);
    let drives = logs.iter().map(|path| Drive::read(path)).collect::<Result<Vec<_>, _>>()?;
    let [first, others @ ..] = &drives[..] else { anyhow::bail!("no log") };
    anyhow::ensure!(
        !others.is_empty() || measurements.is_some(),
        "{}: has nothing to be held against: name another log, or --manual",
        first.name
    );
    let repeated = repeat(&drives, &options);
    let way = first.way();
    let by_station = measurements.iter().flatten().any(|one| matches!(one.place, manual::Place::Station(_)));
    anyhow::ensure!(
        way.is_some() || others.is_empty() || !by_station,
        "stations are those of the first drive, and nothing places the others on it: {} stood, or has no positions",
        first.name
    );
    let by_hand: Vec<Manual> = measurements
        .iter()
        .flat_map(|list| drives.iter().map(|drive| manual::hold(drive, way.as_ref(), list, &options, args.magnitudes)))
        .collect();
    if args.json {
        say_json(&serde_json::json!({ "repeat": repeated, "manual": by_hand }))?;
    }
    if let Some(repeated) = &repeated {
        if !args.json {
            say(&repeat_text(repeated))?;
        }
        for remark in &repeated.remarks {
            tell!("{remark}");
        }
        if let Some(folder) = &args.output {
            draw_repeat(repeated, &picture(folder, "repeat.svg")?, args.theme.into())?;
        }
    }
    if !by_hand.is_empty() {
        if !args.json {
            say(&manual_text(&by_hand))?;
        }
        if let Some(folder) = &args.output {
            draw_manual(&by_hand, &picture(folder, "manual.svg")?, args.theme.into())?;
        }
    }
    for held in by_hand.iter().filter(|held| held.other_way) {
        tell!("{}: goes the other way along the road, where left is right: nothing of it is held", held.drive);
    }
    for held in by_hand.iter().filter(|held| held.unmatched > 0 && !held.other_way) {
        tell!("{}: {} measurements by hand have no slope within {} m", held.drive, held.unmatched, args.within);
    }
    let unmatched = repeated.as_ref().is_some_and(|repeated| repeated.all.matched == 0);
    anyhow::ensure!(!unmatched, "no section of the drives is at the same place as one of {}", drives[0].name);
    let none_by_hand = !by_hand.is_empty() && by_hand.iter().all(|held| held.all.matched == 0);
    anyhow::ensure!(!none_by_hand, "no measurement by hand is at a place with a slope");
    let damage: u64 = drives.iter().map(|drive| drive.damage).sum();
    Ok(Outcome::lost_if(tell_passed_over(None, damage)))
}

fn repeat_text(found: &Repeat) -> String {
    let mut text = format!(
        "{:<34}{:>10}{:>10}{:>10}{:>10}{:>10}{:>9}",
        "mean absolute variation", "adjacent", "opposing", "all", "expected", "pairs", "shift"
    );
    let mut line = |name: &str, [adjacent, opposing, all]: [&Agreement; 3], shift: Option<f64>| {
        let expected = all.expected_deg.map_or_else(|| "-".to_owned(), |value| format!("{value:.3}\u{b0}"));
        let shift = shift.map_or_else(String::new, |metres| format!("{metres:+.2} m"));
        text += &format!(
            "\n{name:<34}{:>10}{:>10}{:>10}{expected:>10}{:>10}{shift:>9}",
            degrees(adjacent),
            degrees(opposing),
            degrees(all),
            all.matched
        );
    };
    for pair in &found.pairs {
        line(&shortened(&pair.drive), [&pair.adjacent, &pair.opposing, &pair.all], None);
        if let Some(aligned) = &pair.aligned {
            let values = [&aligned.adjacent, &aligned.opposing, &aligned.all];
            line("  shifted along the road", values, Some(aligned.shift_m));
        }
    }
    if found.pairs.len() > 1 {
        line("all drives", [&found.adjacent, &found.opposing, &found.all], None);
        if let Some(aligned) = &found.aligned {
            line("  shifted along the road", [&aligned.adjacent, &aligned.opposing, &aligned.all], None);
        }
    }
    text + &format!("\nagainst {}", found.reference)
}

/// The mean magnitude, where anything was matched.
fn degrees(agreement: &Agreement) -> String {
    match agreement.matched {
        0 => "-".to_owned(),
        _ => format!("{:.3}\u{b0}", agreement.mean_absolute_deg),
    }
}

fn manual_text(found: &[Manual]) -> String {
    let mut text = format!(
        "{:<34}{:>10}{:>10}{:>10}{:>10}{:>10}",
        "mean absolute error against hand", "adjacent", "opposing", "all", "mean", "matched"
    );
    for held in found {
        let mean = match held.all.matched {
            0 => "-".to_owned(),
            _ => format!("{:+.3}\u{b0}", held.all.mean_deg),
        };
        text += &format!(
            "\n{:<34}{:>10}{:>10}{:>10}{mean:>10}{:>10}",
            shortened(&held.drive),
            degrees(&held.adjacent),
            degrees(&held.opposing),
            degrees(&held.all),
            held.all.matched
        );
    }
    text
}

/// The end of a long name, where names of files differ.
fn shortened(name: &str) -> String {
    let length = name.chars().count();
    if length <= 33 {
        name.to_owned()
    } else {
        format!("\u{2026}{}", name.chars().skip(length - 32).collect::<String>())
    }
}

/// Draws repeat drives as the paper's figure 7b.
pub fn draw_repeat(found: &Repeat, path: &Path, theme: plot::Theme) -> anyhow::Result<()> {
    let note = format!(
        "mean absolute variation: adjacent {:.2}\u{b0}, opposing {:.2}\u{b0}, all {:.2}\u{b0}, {} pairs",
        found.adjacent.mean_absolute_deg,
        found.opposing.mean_absolute_deg,
        found.all.mean_absolute_deg,
        found.all.matched
    );
    let words = Words {
        title: "Slopes of repeat drives",
        note: &note,
        first: "first drive, \u{b0}",
        other: "other drives, \u{b0}",
    };
    Ok(output::write(path, plot::agreement(&found.dots, &words, theme)?.as_bytes())?)
}

/// Draws measurements by hand as the paper's figure 7a.
pub fn draw_manual(found: &[Manual], path: &Path, theme: plot::Theme) -> anyhow::Result<()> {
    let dots = found.iter().flat_map(|manual| &manual.held);
    let matched: usize = found.iter().map(|manual| manual.all.matched).sum();
    let sum: f64 = found.iter().map(|manual| manual.all.mean_absolute_deg * manual.all.matched as f64).sum();
    let note = format!("mean absolute error {:.2}\u{b0}, {matched} measurements", sum / matched.max(1) as f64);
    let words = Words {
        title: "Slopes by hand and by the scanner",
        note: &note,
        first: "by hand, \u{b0}",
        other: "by the scanner, \u{b0}",
    };
    Ok(output::write(path, plot::agreement(dots, &words, theme)?.as_bytes())?)
}
