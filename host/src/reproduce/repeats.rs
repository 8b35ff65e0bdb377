//! Three drives over one road (the paper's figure 7b), with the errors of their positions.
//!
//! The road of the medians with grass, driven at 30 m/s from three different places, each drive with its own noise, its own way in the lane (0.2 m) and
//! positions that err by 2 m (one sigma, north and east, drifting over ten minutes), as the paper states of its unit. The limit holds drives of a perfect
//! evaluation against each other in the same way: the true slopes at the true places with the unit's roll error and the bound of the ranges' noise.

use super::medians;
use super::pipeline::{BOTH_METHODS, Bench, Captured};
use super::surface_truth::{TrueSlope, surface};
use super::{Error, Line, Picture, RANGE_NOISE_MM, Report, limit};
use crate::compare::{Drive, Kind, Options, Repeat, Sides, repeat};
use crate::plot::{self, Words};
use crate::side::Side;
use crate::simulate::motion::Attitude;
use crate::simulate::noise::{Noise, Purpose};
use crate::simulate::scene::{Scene, Wander};

/// Where on the road the drives begin, in metres.
const STARTS_M: [f64; 3] = [0.0, 7.3, 15.9];

const SPEED_M_S: f64 = 30.0;
const SECONDS: f64 = 60.0;

/// One sigma of a position, north and east.
const POSITION_M: f64 = 2.0;

/// Share of off-road returns from the ground itself.
const GROUND_SHARE: f64 = 0.69;

fn scene(bench: &Bench, number: usize, range_noise_mm: f64) -> Scene {
    let mut scene = medians::scene(bench, SECONDS, range_noise_mm);
    scene.drive.seed = bench.seed + 100 * (number as u64 + 1);
    scene.drive.speed_m_s = SPEED_M_S;
    scene.drive.start_m = STARTS_M[number];
    scene.ins.position_drift_m = POSITION_M;
    scene.vehicle.wander =
        vec![Wander { amplitude_m: 0.2, frequency_hz: 0.03 }, Wander { amplitude_m: 0.05, frequency_hz: 0.2 }];
    scene
}

pub fn run(bench: &Bench, report: &mut Report) -> Result<(), Error> {
    let options = Options { sides: Sides::One(Side::Left), ..Options::default() };
    for range_noise_mm in RANGE_NOISE_MM {
        let (mut by_method, mut perfect) = ([Vec::new(), Vec::new()], Vec::new());
        for number in 0..STARTS_M.len() {
            let scene = scene(bench, number, range_noise_mm);
            let captured = bench.drive("repeat", &scene)?;
            for (drives, method) in by_method.iter_mut().zip(BOTH_METHODS) {
                drives.push(bench.profiles("repeat", &captured, method)?);
            }
            let measured = by_method[0].last().cloned().unwrap_or_default();
            perfect.push(ideal(&scene, &captured, measured, range_noise_mm));
        }
        let [measuring, searched] = by_method.map(|drives| repeat(&drives, &options));
        let (Some(measuring), Some(searched), Some(ideal)) = (measuring, searched, repeat(&perfect, &options)) else {
            continue;
        };
        let mut line = |quantity: &str, paper, of: &dyn Fn(&Repeat) -> f64| {
            report.lines.push(Line {
                experiment: "three drives",
                quantity: quantity.to_owned(),
                range_noise_mm: Some(range_noise_mm),
                paper,
                crossfall: of(&measuring),
                seed_search: Some(of(&searched)),
                limit: Some(of(&ideal)),
                unit: "deg",
            });
        };
        line("mean variation, adjacent slope", Some(0.56), &|r| r.adjacent.mean_absolute_deg);
        line("mean variation, opposing slope", Some(0.29), &|r| r.opposing.mean_absolute_deg);
        line("mean variation, all", Some(0.42), &|r| r.all.mean_absolute_deg);
        let shifted = |r: &Repeat| r.aligned.map_or(r.all.mean_absolute_deg, |a| a.all.mean_absolute_deg);
        line("mean variation, all, shifted along the road", None, &shifted);
        if range_noise_mm == RANGE_NOISE_MM[1] {
            picture(&measuring, report)?;
        }
    }
    Ok(())
}

/// What a perfect evaluation would have in the place of a drive's slopes.
fn ideal(scene: &Scene, captured: &Captured, mut drive: Drive, range_noise_mm: f64) -> Drive {
    let surface = surface(scene);
    let attitude = Attitude::new(&scene.vehicle, &mut Noise::new(scene.drive.seed, Purpose::Motion));
    let mut noise = Noise::new(scene.drive.seed, Purpose::Roughness);
    for row in &mut drive.rows {
        let Some(truth) = captured.made.truth.get(row.scan as usize).filter(|_| row.side == Side::Left) else {
            continue;
        };
        let seconds = (truth.station_m - scene.drive.start_m) / scene.drive.speed_m_s;
        // A roll that is read too large turns the left side down, and with it what rises outward there.
        let roll_error = row.roll_deg - truth.roll_deg;
        for kind in Kind::BOTH {
            let slope = TrueSlope { lateral_m: attitude.lateral_m(seconds), ..TrueSlope::of(truth, &surface, kind) };
            let sigma_m = range_noise_mm * 1e-3;
            let bound = limit::slope_deg(&truth.section, Side::Left, kind, sigma_m, GROUND_SHARE);
            let slope_deg = slope.whole_deg() - roll_error + bound * noise.normal();
            let place = if kind == Kind::Adjacent { &mut row.adjacent } else { &mut row.opposing };
            if let Some(found) = place {
                found.slope_deg = slope_deg;
            }
        }
    }
    drive
}

fn picture(found: &Repeat, report: &mut Report) -> Result<(), Error> {
    let note = format!(
        "10 mm range noise, grass, positions of 2 m; mean variation {:.2}\u{b0} adjacent, {:.2}\u{b0} opposing (paper: 0.56\u{b0}, 0.29\u{b0})",
        found.adjacent.mean_absolute_deg, found.opposing.mean_absolute_deg
    );
    let words = Words {
        title: "Three drives over one road",
        note: &note,
        first: "first drive, one scan, \u{b0}",
        other: "second and third drive, one scan, \u{b0}",
    };
    report.pictures.push(Picture::new(
        "validation-repeats",
        "Slopes of the second and third drive against those of the first, scan by scan",
        |theme| plot::agreement(&found.dots, &words, theme),
    )?);
    Ok(())
}
