//! A simulated road with known truth: alignment, gradient, cross slope, curbs, bumps, potholes, roughness.
//!
//! The ground is a height field `z(x, y)` in the world frame, built in road coordinates: `s` along the centre line
//! and `lateral` to its left. The centre line is straight or an arc of one radius, so both conversions are closed
//! formulas. All trigonometry goes through `libm`, so a scene gives the same bytes on every platform.

use serde::{Deserialize, Serialize};

/// A point of the longitudinal profile: from one knot to the next the gradient changes linearly.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct GradeKnot {
    /// Station along the centre line, m.
    pub at_m: f64,
    /// Gradient there, rise over run; positive climbs.
    pub grade: f64,
}

/// A bump across the whole carriageway, of raised-cosine profile.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Bump {
    /// Station of its crown, m.
    pub at_m: f64,
    /// Length along the road, m.
    pub length_m: f64,
    /// Height of its crown, m.
    pub height_m: f64,
}

/// A round pothole with a steep wall.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Pothole {
    /// Station of its centre, m.
    pub at_m: f64,
    /// Lateral position of its centre, m, positive left.
    pub lateral_m: f64,
    /// Radius, m.
    pub radius_m: f64,
    /// Depth, m.
    pub depth_m: f64,
}

/// The shape of the ground.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Road {
    /// Heading of the road at its origin in the world frame, degrees from x towards y.
    pub heading_deg: f64,
    /// Curvature, 1/m; positive bends to the left, 0 is straight.
    pub curvature_per_m: f64,
    /// Longitudinal profile; empty is level.
    pub profile: Vec<GradeKnot>,
    /// Fall of the carriageway from its centre line to both sides, rise over run (0.02 falls 2 %).
    pub cross_fall: f64,
    /// Lateral position of the left curb's face, m.
    pub left_curb_m: f64,
    /// Lateral position of the right curb's face, m (negative).
    pub right_curb_m: f64,
    /// Height of both curbs, m; 0 is none.
    pub curb_height_m: f64,
    /// Width of the pavements behind the curbs, m. Rough verge lies beyond.
    pub pavement_width_m: f64,
    /// Half amplitude of the carriageway's roughness, m.
    pub roughness_m: f64,
    /// Half amplitude of the verge's roughness, m.
    pub verge_roughness_m: f64,
    /// Bumps across the carriageway.
    pub bumps: Vec<Bump>,
    /// Potholes.
    pub potholes: Vec<Pothole>,
}

impl Default for Road {
    fn default() -> Self {
        Self {
            heading_deg: 0.0,
            curvature_per_m: 0.0,
            profile: Vec::new(),
            cross_fall: 0.02,
            left_curb_m: 3.5,
            right_curb_m: -3.5,
            curb_height_m: 0.12,
            pavement_width_m: 2.0,
            roughness_m: 0.002,
            verge_roughness_m: 0.04,
            bumps: Vec::new(),
            potholes: Vec::new(),
        }
    }
}

/// What the ground is at a place, for the truth map.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Surface {
    /// Carriageway without any feature.
    Road,
    /// Within 5 cm of a curb's face.
    Curb,
    /// On a bump.
    Bump,
    /// In a pothole.
    Pothole,
    /// Pavement behind a curb.
    Pavement,
    /// Beyond the pavement.
    Verge,
}

impl Surface {
    /// The name used in the truth map.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Road => "road",
            Self::Curb => "curb",
            Self::Bump => "bump",
            Self::Pothole => "pothole",
            Self::Pavement => "pavement",
            Self::Verge => "verge",
        }
    }
}

/// Horizontal run of a curb's battered face, m.
const CURB_RUN: f64 = 0.02;

impl Road {
    /// Road coordinates (station, lateral) of a world position.
    #[must_use]
    pub fn locate(&self, x: f64, y: f64) -> (f64, f64) {
        let heading = self.heading_deg.to_radians();
        let (sin, cos) = (libm::sin(heading), libm::cos(heading));
        let (along, left) = (x * cos + y * sin, y * cos - x * sin);
        if self.curvature_per_m == 0.0 {
            return (along, left);
        }
        let radius = 1.0 / self.curvature_per_m;
        let outward = radius - left;
        let sign = radius.signum();
        let angle = libm::atan2(along, outward * sign);
        (angle * radius.abs(), sign * (radius.abs() - libm::sqrt(along * along + outward * outward)))
    }

    /// World position and heading (radians) of a place given in road coordinates.
    #[must_use]
    pub fn place(&self, station: f64, lateral: f64) -> (f64, f64, f64) {
        let heading = self.heading_deg.to_radians();
        let turn = station * self.curvature_per_m;
        let (along, left) = if self.curvature_per_m == 0.0 {
            (station, lateral)
        } else {
            let radius = 1.0 / self.curvature_per_m;
            ((radius - lateral) * libm::sin(turn), radius - (radius - lateral) * libm::cos(turn))
        };
        let (sin, cos) = (libm::sin(heading), libm::cos(heading));
        (along * cos - left * sin, along * sin + left * cos, heading + turn)
    }

    /// Height of the centre line's profile at a station, m.
    #[must_use]
    pub fn profile_height(&self, station: f64) -> f64 {
        let Some(first) = self.profile.first() else { return 0.0 };
        if station <= first.at_m {
            return (station - first.at_m) * first.grade;
        }
        let mut height = 0.0;
        for pair in self.profile.windows(2) {
            let length = pair[1].at_m - pair[0].at_m;
            if station <= pair[1].at_m {
                let into = station - pair[0].at_m;
                let change = (pair[1].grade - pair[0].grade) / length;
                return height + into * pair[0].grade + 0.5 * into * into * change;
            }
            height += 0.5 * length * (pair[0].grade + pair[1].grade);
        }
        let last = self.profile[self.profile.len() - 1];
        height + (station - last.at_m) * last.grade
    }

    /// Gradient of the centre line at a station, rise over run.
    #[must_use]
    pub fn grade(&self, station: f64) -> f64 {
        (self.profile_height(station + 0.05) - self.profile_height(station - 0.05)) / 0.1
    }

    /// Height of the ground in road coordinates, roughness left out, m.
    #[must_use]
    pub fn smooth_height(&self, station: f64, lateral: f64) -> f64 {
        let mut z = self.profile_height(station);
        if lateral > self.left_curb_m {
            z += self.beside(lateral - self.left_curb_m, self.left_curb_m);
        } else if lateral < self.right_curb_m {
            z += self.beside(self.right_curb_m - lateral, -self.right_curb_m);
        } else {
            z -= self.cross_fall * lateral.abs();
            for bump in &self.bumps {
                let along = station - bump.at_m;
                if 2.0 * along.abs() < bump.length_m {
                    z += 0.5 * bump.height_m * (1.0 + libm::cos(2.0 * core::f64::consts::PI * along / bump.length_m));
                }
            }
            for hole in &self.potholes {
                let (u, v) = (station - hole.at_m, lateral - hole.lateral_m);
                let inside = hole.radius_m - libm::sqrt(u * u + v * v);
                if inside > 0.0 {
                    z -= hole.depth_m * (inside / 0.05).min(1.0);
                }
            }
        }
        z
    }

    fn beside(&self, out: f64, half_width: f64) -> f64 {
        let foot = -self.cross_fall * half_width;
        foot + self.curb_height_m * (out / CURB_RUN).min(1.0) + 0.02 * out.min(self.pavement_width_m)
    }

    /// Height of the ground at a world position, roughness included, m.
    #[must_use]
    pub fn height(&self, x: f64, y: f64) -> f64 {
        let (station, lateral) = self.locate(x, y);
        let off = self.outside(lateral);
        let roughness = if off > self.pavement_width_m {
            self.verge_roughness_m * lattice_noise(x / 0.35, y / 0.35, 7)
        } else {
            self.roughness_m * lattice_noise(x / 0.25, y / 0.25, 3)
        };
        self.smooth_height(station, lateral) + roughness
    }

    /// How far a lateral position lies outside the curbs, m; negative on the carriageway.
    #[must_use]
    pub fn outside(&self, lateral: f64) -> f64 {
        (lateral - self.left_curb_m).max(self.right_curb_m - lateral)
    }

    /// What the ground is at a place given in road coordinates.
    #[must_use]
    pub fn surface(&self, station: f64, lateral: f64) -> Surface {
        let off = self.outside(lateral);
        if self.curb_height_m != 0.0 && (off - 0.5 * CURB_RUN).abs() <= 0.05 + 0.5 * CURB_RUN {
            Surface::Curb
        } else if off > self.pavement_width_m {
            Surface::Verge
        } else if off > 0.0 {
            Surface::Pavement
        } else if self.bumps.iter().any(|bump| 2.0 * (station - bump.at_m).abs() < bump.length_m) {
            Surface::Bump
        } else if self.potholes.iter().any(|hole| {
            let (u, v) = (station - hole.at_m, lateral - hole.lateral_m);
            u * u + v * v < hole.radius_m * hole.radius_m
        }) {
            Surface::Pothole
        } else {
            Surface::Road
        }
    }

    /// A bound on the slope of bumps, for the ray caster's step.
    #[must_use]
    pub fn steepest_bump(&self) -> f64 {
        self.bumps.iter().map(|bump| core::f64::consts::PI * bump.height_m / bump.length_m).fold(0.0, f64::max)
    }
}

/// Smooth noise between -1 and 1 on a unit lattice: hashed corner values, bilinear in between.
fn lattice_noise(x: f64, y: f64, seed: u64) -> f64 {
    let (fx, fy) = (libm::floor(x), libm::floor(y));
    let (ix, iy) = (fx as i64, fy as i64);
    let (u, v) = (x - fx, y - fy);
    let corner = |dx: i64, dy: i64| {
        let mut h = (ix + dx) as u64;
        h = h.wrapping_mul(0x9E37_79B9_7F4A_7C15) ^ (iy + dy) as u64;
        h = h.wrapping_mul(0xBF58_476D_1CE4_E5B9) ^ seed;
        h ^= h >> 29;
        h = h.wrapping_mul(0x94D0_49BB_1331_11EB);
        (h >> 11) as f64 / (1u64 << 52) as f64 - 1.0
    };
    let near = corner(0, 0) + (corner(1, 0) - corner(0, 0)) * u;
    let far = corner(0, 1) + (corner(1, 1) - corner(0, 1)) * u;
    near + (far - near) * v
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn places_and_stations_are_inverse_in_bends_of_either_hand() {
        for curvature in [0.0, 0.005, -0.005, 0.02] {
            let road = Road { heading_deg: 37.0, curvature_per_m: curvature, ..Road::default() };
            for (station, lateral) in [(0.0, 0.0), (30.0, 3.0), (60.0, -3.5), (-10.0, 1.0)] {
                let (x, y, _) = road.place(station, lateral);
                let (s, l) = road.locate(x, y);
                assert!((s - station).abs() < 1e-9 && (l - lateral).abs() < 1e-9, "{curvature}: {s} {l}");
            }
        }
    }

    #[test]
    fn the_profile_integrates_its_gradient() {
        let road = Road {
            profile: vec![GradeKnot { at_m: 20.0, grade: 0.03 }, GradeKnot { at_m: 26.0, grade: 0.12 }],
            ..Road::default()
        };
        assert!((road.profile_height(26.0) - 0.45).abs() < 1e-12);
        assert!((road.profile_height(36.0) - 1.65).abs() < 1e-12);
        assert!((road.grade(40.0) - 0.12).abs() < 1e-9);
    }
}
