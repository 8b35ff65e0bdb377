//! What lies on the straight lines of a section: undulations of the ground and its roughness.
//!
//! Undulations are a sum of plane waves in random directions, with wavelengths spread evenly in their logarithm and the
//! same share of the variance each: smooth, the same from every drive over the road, with a known deviation. They fade in over
//! half a metre from the road's edge, as the road itself is even.

use core::f64::consts::{SQRT_2, TAU};

use super::noise::Noise;
use super::scene;

/// Number of waves: enough for heights to be about normal.
const WAVES: usize = 24;

/// From the road's edge to full height.
const FADE_M: f64 = 0.5;

/// The ground's departure from its section.
#[derive(Clone, Debug)]
pub struct Surface {
    /// Standard deviation of a height that is new for every beam.
    pub roughness_m: f64,
    amplitude_m: f64,
    /// Angular wave number along and across the road, phase.
    waves: Vec<[f64; 3]>,
}

impl Surface {
    /// Draws the undulations.
    #[must_use]
    pub fn new(surface: &scene::Surface, noise: &mut Noise) -> Self {
        let [shortest, longest] = surface.wavelength_m;
        let wave = |i: usize| {
            let part = (i as f64 + 0.5) / WAVES as f64;
            let number = TAU / (shortest * libm::pow(longest / shortest, part));
            let direction = TAU * noise.unit();
            [number * libm::cos(direction), number * libm::sin(direction), TAU * noise.unit()]
        };
        Self {
            roughness_m: surface.roughness_mm * 1e-3,
            amplitude_m: surface.undulation_mm * 1e-3 * SQRT_2 / (WAVES as f64).sqrt(),
            waves: (0..WAVES).map(wave).collect(),
        }
    }

    /// Whether there is anything on the lines at all.
    #[must_use]
    pub fn is_rough(&self) -> bool {
        self.roughness_m > 0.0 || self.amplitude_m > 0.0
    }

    /// Height of the undulation, in metres, at a place along the road and to the left of the lane's middle, so far beyond the road's edge.
    #[must_use]
    pub fn height_m(&self, station_m: f64, left_m: f64, beyond_edge_m: f64) -> f64 {
        if self.amplitude_m == 0.0 || beyond_edge_m <= 0.0 {
            return 0.0;
        }
        let fade = (beyond_edge_m / FADE_M).min(1.0);
        let smooth = fade * fade * (3.0 - 2.0 * fade);
        let sum: f64 = self.waves.iter().map(|[x, y, phase]| libm::sin(x * station_m + y * left_m + phase)).sum();
        smooth * self.amplitude_m * sum
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::simulate::noise::Purpose;

    #[test]
    fn undulations_have_the_deviation_asked_for_and_leave_the_road_even() {
        let scene = scene::Surface { undulation_mm: 20.0, ..scene::Surface::default() };
        let surface = Surface::new(&scene, &mut Noise::new(1, Purpose::Undulation));
        let squares: f64 = (0..40_000).map(|i| surface.height_m(f64::from(i) * 0.37, 6.0, 3.0).powi(2)).sum();
        let sd = (squares / 40_000.0).sqrt();
        assert!((sd - 0.02).abs() < 0.001, "{sd}");
        assert_eq!(surface.height_m(10.0, 2.0, -0.1), 0.0);
        assert!(!Surface::new(&scene::Surface::default(), &mut Noise::new(1, Purpose::Undulation)).is_rough());
    }
}
