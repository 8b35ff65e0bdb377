//! Profiles: from one levelled scan to road line, road edge, adjacent and opposing slope on both sides.

pub mod measuring;

use crossfall_protocol::Config;
use crossfall_protocol::message::{Side, flags};

use crate::scan::{self, Points, RawScan, RollTrack};

/// Everything that measuring a scan needs besides its input. Owned by the caller, reused from scan to scan.
#[derive(Debug, Default)]
pub struct Workspace {
    points: Points,
    measuring: measuring::Workspace,
}

impl Workspace {
    /// An empty workspace.
    #[must_use]
    pub const fn new() -> Self {
        Self { points: Points::new(), measuring: measuring::Workspace::new() }
    }
}

/// Measures one scan: the sections to the left and to the right of the vehicle, and the flags that concern both.
///
/// The result depends on nothing but the arguments: what was in `work` before does not matter.
pub fn measure(scan: &RawScan, track: &RollTrack, config: &Config, work: &mut Workspace) -> (Side, Side, u16) {
    scan::level(scan, track, &config.scanner, &mut work.points);
    let input = measuring::Scan { points: &work.points, down_beam: down_beam(scan), unit_um: scan.unit_um() };
    let left = measuring::measure(&input, measuring::Outward::Left, &config.survey, &mut work.measuring);
    let right = measuring::measure(&input, measuring::Outward::Right, &config.survey, &mut work.measuring);
    (left, right, scan_flags(scan))
}

/// Number of the beam that looks straight down.
fn down_beam(scan: &RawScan) -> u16 {
    (scan.beams() / 2) as u16
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
