//! What a screen can show of a scan, and how it is coded for a viewer (docs/live.md has the bytes).
//!
//! Little endian; lengths and angles are 32-bit floats in metres and degrees, NaN = absent; points are pairs of 16-bit integers in steps
//! of 4 mm, a sixth of a pixel when 30 m fill a screen.

use crossfall_core::protocol::message::Profile;
use crossfall_core::scan::Points;

use crate::section::{self, Fitted, Part};
use crate::side::Side;
use crate::units::{degrees, metres_f32 as metres};
use crate::walk::places;

/// First byte of a section.
pub const SECTION: u8 = 1;
/// First byte of a piece of the strip charts.
pub const STRIPS: u8 = 2;
/// First byte of a piece of the track.
pub const TRACK: u8 = 3;
/// Second byte of all.
pub const VERSION: u8 = 1;

/// Size of a point's unit in metres.
const UNIT_M: f64 = 0.004;

/// Lateral distance and height from the sensor, in metres.
pub type Place = (f32, f32);

/// A straight piece of a section.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Piece {
    /// Inclination in degrees, positive = rising outward.
    pub slope_deg: f32,
    /// Half width of its 95 % interval; NaN where there is none.
    pub ci95_deg: f32,
    /// Points that support it; 0 for a road.
    pub points: u16,
    /// Its inner and its outer end.
    pub ends: [Place; 2],
}

impl Piece {
    fn of(line: &Fitted) -> Self {
        Self {
            slope_deg: line.slope_deg as f32,
            ci95_deg: line.ci95_deg.map_or(f32::NAN, |ci95| ci95 as f32),
            points: line.points,
            ends: [single(line.inner), single(line.outer)],
        }
    }
}

/// One side of a section.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct SideView {
    /// The road.
    pub road: Option<Piece>,
    /// The road's edge: lateral distance and half width of its 95 % interval, in metres.
    pub edge: Option<(f32, f32)>,
    /// The adjacent slope.
    pub adjacent: Option<Piece>,
    /// The opposing slope.
    pub opposing: Option<Piece>,
    /// Flags of the scan and of the side.
    pub flags: u16,
}

/// A levelled section.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Section {
    /// Number of the scan.
    pub scan: u32,
    /// Device time in seconds.
    pub time_s: f64,
    /// Roll at straight down, in degrees.
    pub roll_deg: f32,
    /// Left and right.
    pub sides: [SideView; 2],
    /// Levelled points in metres.
    pub points: Vec<Place>,
}

impl Section {
    /// The section of a scan's levelled points and its profile.
    #[must_use]
    pub fn new(profile: &Profile, points: &Points) -> Self {
        let places = places(points);
        let mut sides = Side::BOTH.map(|side| {
            let found = side.of(profile);
            SideView {
                edge: found.edge.map(|edge| (metres(edge.y_um), edge.ci95_um as f32 * 1e-6)),
                flags: found.flags | profile.flags,
                ..SideView::default()
            }
        });
        let [left, right] = &mut sides;
        for line in section::lines(profile, &places) {
            let side = if line.side == Side::Left { &mut *left } else { &mut *right };
            let piece = match line.part {
                Part::Road => &mut side.road,
                Part::Adjacent => &mut side.adjacent,
                Part::Opposing => &mut side.opposing,
            };
            *piece = Some(Piece::of(&line));
        }
        Self {
            scan: profile.scan,
            time_s: profile.time.0 as f64 * 1e-6,
            roll_deg: degrees(profile.roll) as f32,
            sides,
            points: places.into_iter().map(single).collect(),
        }
    }

    /// For the wire.
    #[must_use]
    pub fn encode(&self) -> Vec<u8> {
        let mut out = Vec::with_capacity(200 + 4 * self.points.len());
        out.extend([SECTION, VERSION]);
        // A scan has at most 401 points.
        out.extend((self.points.len() as u16).to_le_bytes());
        out.extend(self.scan.to_le_bytes());
        out.extend(self.time_s.to_le_bytes());
        out.extend(self.roll_deg.to_le_bytes());
        for side in &self.sides {
            out.extend(u32::from(side.flags).to_le_bytes());
            let (edge, edge_ci) = side.edge.unwrap_or((f32::NAN, f32::NAN));
            floats(&mut out, &[edge, edge_ci]);
            for piece in [side.road, side.adjacent, side.opposing] {
                let nan = f32::NAN;
                let absent = Piece { slope_deg: nan, ci95_deg: nan, points: 0, ends: [(nan, nan); 2] };
                let Piece { slope_deg, ci95_deg, points, ends: [a, b] } = piece.unwrap_or(absent);
                floats(&mut out, &[slope_deg, ci95_deg, f32::from(points), a.0, a.1, b.0, b.1]);
            }
        }
        for &(y, z) in &self.points {
            for value in [y, z] {
                // `as` saturates: what lies beyond 131 m is drawn there, off the screen.
                out.extend(((f64::from(value) / UNIT_M).round() as i16).to_le_bytes());
            }
        }
        out
    }
}

fn single((y, z): section::Place) -> Place {
    (y as f32, z as f32)
}

/// One moment of the strip charts.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Strip {
    /// Device time in seconds.
    pub time_s: f64,
    /// Roll, left adjacent and opposing slope, right adjacent and opposing slope, all in degrees; tilt of the levelled road to the left
    /// in degrees; speed in metres a second.
    pub values: [f32; 7],
}

/// Several for the wire; `epoch` changes when what came before is to be forgotten.
#[must_use]
pub fn encode_strips<'a>(epoch: u32, strips: impl ExactSizeIterator<Item = &'a Strip>) -> Vec<u8> {
    let mut out = Vec::with_capacity(8 + 36 * strips.len());
    out.extend([STRIPS, VERSION]);
    // The hub keeps fewer than 65,536.
    out.extend((strips.len() as u16).to_le_bytes());
    out.extend(epoch.to_le_bytes());
    for strip in strips {
        out.extend(strip.time_s.to_le_bytes());
        floats(&mut out, &strip.values);
    }
    out
}

/// A piece of the track for the wire: metres east and north of its beginning, station in metres.
#[must_use]
pub fn encode_track<'a>(epoch: u32, knots: impl ExactSizeIterator<Item = &'a [f32; 3]>) -> Vec<u8> {
    let mut out = Vec::with_capacity(8 + 12 * knots.len());
    out.extend([TRACK, VERSION]);
    out.extend((knots.len() as u16).to_le_bytes());
    out.extend(epoch.to_le_bytes());
    for knot in knots {
        floats(&mut out, knot);
    }
    out
}

fn floats(out: &mut Vec<u8>, values: &[f32]) {
    for value in values {
        out.extend(value.to_le_bytes());
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_layout_is_that_of_the_documentation() {
        let piece = Piece { slope_deg: -8.0, ci95_deg: 0.25, points: 26, ends: [(3.5, -2.0), (7.5, -2.5)] };
        let left = SideView { adjacent: Some(piece), edge: Some((3.5, 0.0)), flags: 5, ..SideView::default() };
        let section = Section {
            scan: 7,
            time_s: 1.5,
            roll_deg: 0.5,
            sides: [left, SideView::default()],
            points: vec![(1.0, -2.0), (1_000.0, 0.0)],
        };
        let bytes = section.encode();
        assert_eq!(bytes.len(), 20 + 2 * (4 + 8 + 3 * 28) + 2 * 4);
        assert_eq!(bytes[..8], [1, 1, 2, 0, 7, 0, 0, 0]);
        let float = |at: usize| f32::from_le_bytes(bytes[at..at + 4].try_into().unwrap());
        assert_eq!((float(16), float(24)), (0.5, 3.5));
        assert!(float(32).is_nan(), "no road");
        assert_eq!((float(60), float(64), float(68), float(84)), (-8.0, 0.25, 26.0, -2.5));
        let point = |at: usize| i16::from_le_bytes(bytes[at..at + 2].try_into().unwrap());
        let points = bytes.len() - 8;
        assert_eq!([point(points), point(points + 2), point(points + 4)], [250, -500, i16::MAX]);
    }
}
