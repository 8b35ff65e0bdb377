//! Profiles: from one levelled scan to road line, road edge, adjacent and opposing slope on both sides.

pub mod measuring;
pub mod seed;

use crossfall_protocol::Config;
use crossfall_protocol::config::{Method, Survey};
use crossfall_protocol::message::{Hinge, Side, flags};

use crate::scan::resample::Samples;
use crate::scan::{self, Point, Points, RawScan, RollTrack};

/// Everything that measuring a scan needs besides its input. Owned by the caller, reused from scan to scan.
#[derive(Debug, Default)]
pub struct Workspace {
    points: Points,
    measuring: measuring::Workspace,
    samples: Samples,
    seed: seed::Work,
}

impl Workspace {
    /// An empty workspace.
    #[must_use]
    pub const fn new() -> Self {
        Self {
            points: Points::new(),
            measuring: measuring::Workspace::new(),
            samples: Samples::new(),
            seed: seed::Work::new(),
        }
    }
}

/// Measures one scan: the sections to the left and to the right of the vehicle, and the flags that concern both.
///
/// The result depends on nothing but the arguments: what was in `work` before does not matter.
pub fn measure(scan: &RawScan, track: &RollTrack, config: &Config, work: &mut Workspace) -> (Side, Side, u16) {
    scan::level(scan, track, &config.scanner, &mut work.points);
    let (left, right) = match config.survey.method {
        Method::Measuring => {
            let input = measuring::Scan { points: &work.points, unit_um: scan.unit_um() };
            let left = measuring::measure(&input, measuring::Outward::Left, &config.survey, &mut work.measuring);
            (left, measuring::measure(&input, measuring::Outward::Right, &config.survey, &mut work.measuring))
        }
        Method::Seed => {
            let Workspace { points, samples, seed, .. } = work;
            let left = points.iter().map(|echo| echo.point);
            let left = seed_side(left, &config.survey, samples, seed);
            let right = points.iter().rev().map(|echo| Point { y_um: -echo.point.y_um, ..echo.point });
            (left, mirrored(seed_side(right, &config.survey, samples, seed)))
        }
    };
    (left, right, scan_flags(scan))
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
    // TL, status byte. Bits 0-2: 0 is good and 1 information; bit 6: an implausible value; bit 7: pollution.
    if scan.status & 7 > 1 || scan.status & 0xc0 != 0 {
        set |= flags::SCANNER_STATUS;
    }
    set
}
