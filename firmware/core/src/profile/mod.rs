//! Profiles: from one levelled scan to road line, road edge, adjacent and opposing slope on both sides.

pub mod measuring;
pub mod seed;

use crossfall_protocol::Config;
use crossfall_protocol::config::{Method, Survey};
use crossfall_protocol::message::{Hinge, Side, flags};

use crate::scan::resample::Samples;
use crate::scan::{self, MAX_BEAMS, Point, RawScan, RollTrack};
use crate::sensors::lms2xx::Status;
use heapless::Vec;

/// Everything that measuring a scan needs besides its input. Owned by the caller, reused from scan to scan.
///
/// Both modes share one place: only one of them is at work.
#[derive(Debug)]
pub struct Workspace(Held);

#[derive(Debug)]
#[expect(clippy::large_enum_variant, reason = "one place of constant size is what it is for; there is no heap")]
enum Held {
    Measuring(measuring::Samples),
    Seed { points: Vec<Point, MAX_BEAMS>, samples: Samples, work: seed::Work },
}

impl Default for Workspace {
    fn default() -> Self {
        Self::new()
    }
}

impl Workspace {
    /// An empty workspace.
    #[must_use]
    pub const fn new() -> Self {
        Self(Held::Measuring(measuring::Samples::new()))
    }
}

/// Measures one scan: the sections to the left and to the right of the vehicle, and the flags that concern both.
///
/// The result depends on nothing but the arguments: what was in `work` before does not matter.
pub fn measure(scan: &RawScan, track: &RollTrack, config: &Config, work: &mut Workspace) -> (Side, Side, u16) {
    let (left, right) = match config.survey.method {
        Method::Measuring => by_measuring(scan, track, config, &mut work.0),
        Method::Seed => by_seed(scan, track, config, &mut work.0),
    };
    (left, right, scan_flags(scan))
}

fn by_measuring(scan: &RawScan, track: &RollTrack, config: &Config, held: &mut Held) -> (Side, Side) {
    if !matches!(held, Held::Measuring(_)) {
        *held = Held::Measuring(measuring::Samples::new());
    }
    let Held::Measuring(samples) = held else { return Default::default() };
    measuring::measure(scan, track, config, samples)
}

fn by_seed(scan: &RawScan, track: &RollTrack, config: &Config, held: &mut Held) -> (Side, Side) {
    if !matches!(held, Held::Seed { .. }) {
        *held = Held::Seed { points: Vec::new(), samples: Samples::new(), work: seed::Work::new() };
    }
    let Held::Seed { points, samples, work } = held else { return Default::default() };
    points.clear();
    scan::for_each_return(scan, track, &config.scanner, i32::MAX, |echo| {
        // Never full: a scan has at most as many beams as there are places.
        let _ = points.push(echo.point);
    });
    if config.scanner.mirrored {
        points.reverse();
    }
    let left = seed_side(points.iter().copied(), &config.survey, samples, work);
    let right = points.iter().rev().map(|point| Point { y_um: -point.y_um, ..*point });
    (left, mirrored(seed_side(right, &config.survey, samples, work)))
}

/// The paper's search over one side's points, which count outward, resampled as the paper has them.
fn seed_side(
    outward: impl Iterator<Item = Point>,
    survey: &Survey,
    samples: &mut Samples,
    work: &mut seed::Work,
) -> Side {
    scan::resample(outward.filter(|point| point.y_um >= 0), survey.seed.spacing_um, samples);
    seed::survey_side(samples, survey, work)
}

/// A side that was measured outward, with its lateral distances counted leftward: that of the right side.
fn mirrored(mut side: Side) -> Side {
    let turn = |hinge: &mut Hinge| (hinge.y_um, hinge.departure_um) = (-hinge.y_um, -hinge.departure_um);
    side.edge.iter_mut().for_each(turn);
    for slope in side.adjacent.iter_mut().chain(&mut side.opposing) {
        turn(&mut slope.start);
        turn(&mut slope.end);
    }
    side
}

/// What is to be said of the scan itself.
fn scan_flags(scan: &RawScan) -> u16 {
    let whole = scan.mode.span_deg == 180 && scan.step_cdeg() == 50 && scan.partial().is_none() && scan.beams() == 361;
    let mut set = if whole { 0 } else { flags::PARTIAL_SCAN };
    if Status(scan.status).is_of_concern() {
        set |= flags::SCANNER_STATUS;
    }
    set
}
