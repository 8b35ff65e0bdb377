//! The ground beside the vehicle: one cross section, and how it varies along the road.

use super::noise::Noise;
use super::scene::{self, Interpolation, Sections};

/// One side of a cross section, from the vehicle outward. Slopes in degrees, positive = rising outward; lengths are horizontal.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Side {
    /// From the sensor to the road's edge.
    pub edge_m: f64,
    /// Slope beside the road.
    pub adjacent_slope_deg: f64,
    /// Its horizontal length.
    pub adjacent_length_m: f64,
    /// Flat between the two slopes.
    pub ditch_m: f64,
    /// Slope beyond the ditch.
    pub opposing_slope_deg: f64,
    /// Its horizontal length; beyond it the ground is flat.
    pub opposing_length_m: f64,
}

/// A cross section under the sensor.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Section {
    /// Height of the sensor above the road under it.
    pub height_m: f64,
    /// Slope of the road, positive = rising to the left.
    pub cross_slope_deg: f64,
    /// To the left of the vehicle.
    pub left: Side,
    /// To the right of it.
    pub right: Side,
}

impl Side {
    /// Lateral distance at which the adjacent slope ends.
    #[must_use]
    pub fn adjacent_end_m(&self) -> f64 {
        self.edge_m + self.adjacent_length_m
    }

    /// Lateral distance at which the opposing slope begins.
    #[must_use]
    pub fn opposing_start_m(&self) -> f64 {
        self.adjacent_end_m() + self.ditch_m
    }

    /// Lateral distance at which the opposing slope ends.
    #[must_use]
    pub fn opposing_end_m(&self) -> f64 {
        self.opposing_start_m() + self.opposing_length_m
    }

    fn mix(a: &Self, b: &Self, w: f64) -> Self {
        let mix = |a: f64, b: f64| a + (b - a) * w;
        Self {
            edge_m: mix(a.edge_m, b.edge_m),
            adjacent_slope_deg: mix(a.adjacent_slope_deg, b.adjacent_slope_deg),
            adjacent_length_m: mix(a.adjacent_length_m, b.adjacent_length_m),
            ditch_m: mix(a.ditch_m, b.ditch_m),
            opposing_slope_deg: mix(a.opposing_slope_deg, b.opposing_slope_deg),
            opposing_length_m: mix(a.opposing_length_m, b.opposing_length_m),
        }
    }
}

/// How far the flat ground beyond the opposing slope reaches.
const HORIZON_M: f64 = 1_000.0;

/// Points of one side's ground: under the sensor, the four hinges, the horizon.
pub const GROUND_POINTS: usize = 6;

impl Section {
    /// The section between two others: `w` = 0 is `a`, 1 is `b`.
    #[must_use]
    pub fn mix(a: &Self, b: &Self, w: f64) -> Self {
        let mix = |a: f64, b: f64| a + (b - a) * w;
        Self {
            height_m: mix(a.height_m, b.height_m),
            cross_slope_deg: mix(a.cross_slope_deg, b.cross_slope_deg),
            left: Side::mix(&a.left, &b.left, w),
            right: Side::mix(&a.right, &b.right, w),
        }
    }

    /// The section as seen from a place further to the left on the road, the sensor as high above it.
    #[must_use]
    pub fn from_further_left(&self, by_m: f64) -> Self {
        let mut seen = *self;
        seen.left.edge_m -= by_m;
        seen.right.edge_m += by_m;
        seen
    }

    /// The ground of one side as points (lateral distance from the sensor, height above the sensor), from under the sensor outward.
    #[must_use]
    pub fn ground(&self, left: bool) -> [(f64, f64); GROUND_POINTS] {
        let tan = |degrees: f64| libm::tan(degrees.to_radians());
        let (side, road) = if left { (&self.left, self.cross_slope_deg) } else { (&self.right, -self.cross_slope_deg) };
        let under = (0.0, -self.height_m);
        let edge = (side.edge_m, under.1 + side.edge_m * tan(road));
        let adjacent = (side.adjacent_end_m(), edge.1 + side.adjacent_length_m * tan(side.adjacent_slope_deg));
        let ditch = (side.opposing_start_m(), adjacent.1);
        let opposing = (side.opposing_end_m(), ditch.1 + side.opposing_length_m * tan(side.opposing_slope_deg));
        [under, edge, adjacent, ditch, opposing, (opposing.0 + HORIZON_M, opposing.1)]
    }
}

/// Distance along a ray from the sensor to ground that is raised by `raised_m`, if it meets it.
///
/// The ray goes outward by `out` and upward by `up` a metre (`out` >= 0, a unit vector).
#[must_use]
pub fn cast(ground: &[(f64, f64)], out: f64, up: f64, raised_m: f64) -> Option<f64> {
    ground.windows(2).find_map(|pair| {
        let [(y0, z0), (y1, z1)] = *pair else { return None };
        let (dy, dz) = (y1 - y0, z1 - z0);
        // r (out, up) = (y0, z0 + raised) + s (dy, dz), by Cramer's rule.
        let determinant = dy * up - dz * out;
        if determinant == 0.0 {
            return None;
        }
        let z0 = z0 + raised_m;
        let s = (y0 * up - z0 * out) / -determinant;
        let r = (dy * z0 - dz * y0) / determinant;
        ((0.0..=1.0).contains(&s) && r > 0.0).then_some(r)
    })
}

/// The sections of a drive.
#[derive(Clone, Debug)]
pub enum Road {
    /// One for each scan.
    PerScan(Vec<Section>),
    /// At places along the road (metres, ascending), with a passage between them.
    Stations(Vec<(f64, Section)>, Interpolation),
}

impl Road {
    /// The sections that a scene describes, for a drive of a length and a number of scans.
    #[must_use]
    pub fn new(sections: &Sections, length_m: f64, scans: usize, noise: &mut Noise) -> Self {
        match sections.mode {
            scene::Mode::RandomPerScan => Self::PerScan((0..scans).map(|_| random(&sections.random, noise)).collect()),
            scene::Mode::RandomStations => {
                let count = libm::ceil(length_m / sections.spacing_m) as usize + 2;
                let stations =
                    (0..count).map(|i| (i as f64 * sections.spacing_m, random(&sections.random, noise))).collect();
                Self::Stations(stations, sections.interpolation)
            }
            scene::Mode::Stations => {
                let stations = sections.station.iter().map(|station| (station.at_m, station.section())).collect();
                Self::Stations(stations, sections.interpolation)
            }
        }
    }

    /// The section at a place along the road, seen by a scan.
    #[must_use]
    pub fn at(&self, station_m: f64, scan: usize) -> Section {
        match self {
            Self::PerScan(sections) => sections.get(scan).copied().unwrap_or_default(),
            Self::Stations(stations, interpolation) => {
                let after = stations.partition_point(|&(at, _)| at <= station_m);
                let before = after.saturating_sub(1);
                match (stations.get(before), stations.get(after)) {
                    (Some((from, a)), Some((to, b))) if after > before => {
                        let linear = (station_m - from) / (to - from);
                        let w = match interpolation {
                            Interpolation::Linear => linear,
                            Interpolation::Cosine => 0.5 - 0.5 * libm::cos(core::f64::consts::PI * linear),
                        };
                        Section::mix(a, b, w)
                    }
                    (Some((_, only)), _) => *only,
                    _ => Section::default(),
                }
            }
        }
    }
}

fn random(ranges: &scene::Random, noise: &mut Noise) -> Section {
    let height_m = noise.between(ranges.height_m);
    let cross_slope_deg = noise.between(ranges.cross_slope_deg);
    let left_edge = noise.between(ranges.left_edge_m);
    let width = noise.between(ranges.road_width_m);
    let mut side = |edge_m: f64| Side {
        edge_m,
        adjacent_slope_deg: noise.between(ranges.adjacent_slope_deg),
        adjacent_length_m: noise.between(ranges.adjacent_length_m),
        ditch_m: noise.between(ranges.ditch_m),
        opposing_slope_deg: noise.between(ranges.opposing_slope_deg),
        opposing_length_m: noise.between(ranges.opposing_length_m),
    };
    let left = side(left_edge);
    let right = side(width - left_edge);
    Section { height_m, cross_slope_deg, left, right }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn section() -> Section {
        let side = Side {
            edge_m: 3.5,
            adjacent_slope_deg: -9.0,
            adjacent_length_m: 4.0,
            ditch_m: 1.0,
            opposing_slope_deg: 8.0,
            opposing_length_m: 6.0,
        };
        Section { height_m: 2.5, cross_slope_deg: 1.0, left: side, right: side }
    }

    #[test]
    fn a_ray_ends_on_the_ground() {
        let section = section();
        for left in [false, true] {
            let ground = section.ground(left);
            for step in 0..80 {
                let angle = f64::from(step).to_radians();
                let (out, up) = (angle.sin(), -angle.cos());
                let r = cast(&ground, out, up, 0.0).unwrap();
                let (y, z) = (r * out, r * up);
                let pair = ground.windows(2).find(|pair| y <= pair[1].0).unwrap();
                let w = (y - pair[0].0) / (pair[1].0 - pair[0].0);
                let expected = pair[0].1 + w * (pair[1].1 - pair[0].1);
                assert!((z - expected).abs() < 1e-9, "{step} degrees: {z} at {y}, expected {expected}");
            }
        }
    }

    #[test]
    fn raised_ground_is_met_sooner_and_the_sky_never() {
        let ground = section().ground(true);
        let (out, up) = (0.6, -0.8);
        assert!(cast(&ground, out, up, 0.1).unwrap() < cast(&ground, out, up, 0.0).unwrap());
        assert_eq!(cast(&ground, 0.6, 0.8, 0.0), None);
    }

    #[test]
    fn sections_pass_smoothly_between_stations() {
        let mut far = section();
        far.left.adjacent_slope_deg = -7.0;
        let road = Road::Stations(vec![(0.0, section()), (100.0, far)], Interpolation::Cosine);
        assert_eq!(road.at(0.0, 0).left.adjacent_slope_deg, -9.0);
        assert!((road.at(50.0, 0).left.adjacent_slope_deg + 8.0).abs() < 1e-12);
        assert!((road.at(10.0, 0).left.adjacent_slope_deg + 9.0).abs() < 0.06, "level at the station");
        assert_eq!(road.at(500.0, 0), far);
        assert_eq!(road.at(-5.0, 0), section());
    }
}
