//! How much a slope varies within one section and along a road (the paper's figure 9).
//!
//! The undulating road of the medians without its grass, passed at 5 m/s. Within a section, an instrument of 1.22 m reads something else in every place;
//! the scanner shows the same from the points of nine scans (1.1 m of road). Along the road, single scans follow what the whole slope does.

use super::medians::{self, Judged};
use super::pipeline::{BOTH_METHODS, Bench};
use super::surface_truth::{INCLINOMETER_M, TrueSlope, surface};
use super::{Error, Line, Picture, Report};
use crate::calibrate::statistics::line_slope;
use crate::compare::{Drive, Kind};
use crate::plot::{self, Across};
use crate::section;
use crate::side::Side;
use crate::simulate::scene::Vegetation;
use crate::statistics::{deviation, rms};
use crossfall_core::protocol::Config;

const RANGE_NOISE_MM: f64 = 3.5;
const SPEED_M_S: f64 = 5.0;

/// Scans whose points are taken together, and the number of the one in their middle.
const TOGETHER: u32 = 9;
const MIDDLE: u32 = 40;

/// From one place of the instrument to the next, scanned and by hand.
const STEP_M: f64 = 0.4;
const HAND_STEP_M: f64 = 1.2;

pub fn run(bench: &Bench, report: &mut Report) -> Result<(), Error> {
    let mut scene = medians::scene(bench, 20.0, RANGE_NOISE_MM);
    scene.drive.speed_m_s = SPEED_M_S;
    scene.vegetation = Vegetation::default();
    let surface = surface(&scene);
    let captured = bench.drive("variation", &scene)?;
    let log = bench.log("variation", &captured, &Config::default())?;
    let drive = Drive::read(&log)?;
    let truth = &captured.made.truth;
    let Some(middle) = truth.get(MIDDLE as usize) else { return Ok(()) };

    // Within one section.
    let mut points = Vec::new();
    for number in MIDDLE - TOGETHER / 2..=MIDDLE + TOGETHER / 2 {
        if let Some(found) = section::of_scan(&log, number)? {
            points.extend(found.levelled);
        }
    }
    let slope = TrueSlope::of(middle, &surface, Kind::Adjacent);
    let (from, to) = slope.ends();
    let half = INCLINOMETER_M / 2.0;
    let places = |step: f64| {
        let count = ((to - from - INCLINOMETER_M) / step) as usize;
        (0..=count).map(move |i| from + half + i as f64 * step)
    };
    let scanned = |at: f64| {
        let near: Vec<_> = points.iter().filter(|(y, _)| (y - at).abs() <= half).copied().collect();
        (near.len() >= 8).then(|| (at, line_slope(&near).atan().to_degrees()))
    };
    let whole = drive.rows.iter().find(|row| row.side == Side::Left && row.scan == MIDDLE).and_then(|row| row.adjacent);
    let mut shown = Across {
        truth: places(0.05).map(|at| (at, slope.between_deg(at - half, at + half))).collect(),
        measured: places(STEP_M).filter_map(scanned).collect(),
        manual: places(HAND_STEP_M).map(|at| (at, slope.by_hand_deg(at))).collect(),
        whole: whole.map(|found| (from, to, found.slope_deg)),
        ..Across::default()
    };
    let whole_error = whole.map_or(f64::NAN, |found| (found.slope_deg - slope.whole_deg()).abs());

    // Along the road.
    let whole_deg = |scan: u32| Some(TrueSlope::of(truth.get(scan as usize)?, &surface, Kind::Adjacent).whole_deg());
    let found = |row: &crate::profiles::Row| Some((row.scan, row.position.station_m?, row.adjacent?.slope_deg));
    let along: Vec<_> = drive.rows.iter().filter(|row| row.side == Side::Left).filter_map(found).collect();
    shown.along = along.iter().map(|(_, station, slope)| (*station, *slope)).collect();
    shown.along_truth = along.iter().filter_map(|(scan, station, _)| Some((*station, whole_deg(*scan)?))).collect();
    let errors = along.iter().filter_map(|(scan, _, slope)| Some(slope - whole_deg(*scan)?));

    let spread = |list: &[(f64, f64)]| {
        let (low, high) = list.iter().fold((f64::MAX, f64::MIN), |(low, high), at| (low.min(at.1), high.max(at.1)));
        high - low
    };
    let mut line = |quantity: &str, crossfall, limit| {
        report.lines.push(Line {
            experiment: "variation",
            quantity: quantity.to_owned(),
            range_noise_mm: Some(RANGE_NOISE_MM),
            paper: None,
            crossfall,
            seed_search: None,
            limit,
            unit: "deg",
        });
    };
    line(
        "within one section, over 1.22 m: greatest less least; limit is the truth",
        spread(&shown.measured),
        Some(spread(&shown.truth)),
    );
    line("the whole slope of that section by one scan: error", whole_error, Some(0.0));
    let sd = |list: &[(f64, f64)]| deviation(list.iter().map(|at| at.1));
    line("along 100 m of road: sd; limit is the truth", sd(&shown.along), Some(sd(&shown.along_truth)));
    line("along 100 m of road: RMS error of one scan", rms(errors), None);
    let judged = Judged::of(&drive, truth, &surface);
    line("the same over the stretch that is reported, both slopes", rms(judged.stretch.iter().copied()), None);
    strong(bench, report)?;
    let note = "undulating ground without grass, 3.5 mm range noise; above: one slope in pieces of an inclinometer\u{2019}s length";
    report.pictures.push(Picture::new(
        "validation-variation",
        "The slope within one section by pieces of 1.22 m, and the slope along a hundred metres of road",
        |theme| plot::across(&shown, "How a slope varies within a section and along the road", note, theme),
    )?);
    Ok(())
}

/// Ground that undulates twice as much, in shorter waves: what then becomes of single scans.
fn strong(bench: &Bench, report: &mut Report) -> Result<(), Error> {
    for range_noise_mm in super::RANGE_NOISE_MM {
        let mut scene = medians::scene(bench, 20.0, range_noise_mm);
        scene.sections.surface.undulation_mm = 15.0;
        scene.sections.surface.wavelength_m = [2.0, 12.0];
        scene.vegetation = Vegetation::default();
        let captured = bench.drive("strong", &scene)?;
        let [measuring, searched] = BOTH_METHODS.map(|method| bench.profiles("strong", &captured, method));
        let of_all = (2 * captured.made.truth.len()) as f64;
        let found = |drive: &Drive| {
            let judged = Judged::of(drive, &captured.made.truth, &surface(&scene));
            judged.whole.len() as f64 / of_all
        };
        report.lines.push(Line {
            experiment: "variation",
            quantity: "undulation of 15 mm in waves of 2 to 12 m: found and not doubtful".to_owned(),
            range_noise_mm: Some(range_noise_mm),
            paper: None,
            crossfall: found(&measuring?),
            seed_search: Some(found(&searched?)),
            limit: Some(1.0),
            unit: "share",
        });
    }
    Ok(())
}
