//! The true slope of undulating ground: of a whole slope, and of what an instrument's length covers.

use crate::calibrate::statistics::line_slope;
use crate::compare::Kind;
use crate::simulate::noise::{Noise, Purpose};
use crate::simulate::scene::Scene;
use crate::simulate::section::Section;
use crate::simulate::surface::Surface;
use crate::simulate::truth;

/// Length of the paper's inclinometer: four feet.
pub const INCLINOMETER_M: f64 = 1.219;

/// Its resolution, in degrees.
pub const RESOLUTION_DEG: f64 = 0.1;

/// Heights along a line of this many places.
const PLACES: usize = 80;

/// The undulations of a scene's road.
pub fn surface(scene: &Scene) -> Surface {
    let seed = scene.sections.seed.unwrap_or(scene.drive.seed);
    Surface::new(&scene.sections.surface, &mut Noise::new(seed, Purpose::Undulation))
}

/// One slope on the left of a section, undulations included.
#[derive(Clone, Copy)]
pub struct TrueSlope<'a> {
    pub section: &'a Section,
    pub surface: &'a Surface,
    pub station_m: f64,
    /// Where the vehicle was, to the left of the lane's middle.
    pub lateral_m: f64,
    pub kind: Kind,
}

impl<'a> TrueSlope<'a> {
    /// The slope under a scan of a vehicle in the middle of its lane.
    pub fn of(row: &'a truth::Row, surface: &'a Surface, kind: Kind) -> Self {
        Self { section: &row.section, surface, station_m: row.station_m, lateral_m: 0.0, kind }
    }

    /// Where the slope begins and ends, in metres from the sensor.
    pub fn ends(&self) -> (f64, f64) {
        let side = &self.section.left;
        match self.kind {
            Kind::Adjacent => (side.edge_m, side.adjacent_end_m()),
            Kind::Opposing => (side.opposing_start_m(), side.opposing_end_m()),
        }
    }

    /// The best line over the whole slope, in degrees.
    pub fn whole_deg(&self) -> f64 {
        let (from, to) = self.ends();
        self.between_deg(from, to)
    }

    /// What an inclinometer shows that is laid on the slope at a place: with its length and its resolution.
    pub fn by_hand_deg(&self, middle_m: f64) -> f64 {
        let (from, to) = self.ends();
        let half = (INCLINOMETER_M / 2.0).min((to - from) / 2.0);
        let middle = middle_m.clamp(from + half, to - half);
        // It rests on the ground: the line through what it covers, to its resolution.
        (self.between_deg(middle - half, middle + half) / RESOLUTION_DEG).round() * RESOLUTION_DEG
    }

    /// The best line between two places, in degrees.
    pub fn between_deg(&self, from: f64, to: f64) -> f64 {
        let side = &self.section.left;
        let design = match self.kind {
            Kind::Adjacent => side.adjacent_slope_deg,
            Kind::Opposing => side.opposing_slope_deg,
        };
        let tangent = design.to_radians().tan();
        let points: Vec<(f64, f64)> = (0..PLACES)
            .map(|i| {
                let y = from + (to - from) * i as f64 / (PLACES - 1) as f64;
                let undulation = self.surface.height_m(self.station_m, self.lateral_m + y, y - side.edge_m);
                (y, tangent * y + undulation)
            })
            .collect();
        line_slope(&points).atan().to_degrees()
    }
}
