//! From relief to driving risk, by what a wheel takes.
//!
//! A wheel of radius R that meets a step of height h touches its edge where the radius leans by the contact angle:
//! cos = 1 - h / R. Rolling over it takes a horizontal force of tan(angle) times the wheel load, so the
//! risk is min(1, tan(angle)): with R = 0.32 m a step of 3.4 cm is 0.5, 5 cm 0.64, 9.4 cm 1. At half the load a wheel
//! is pushed back as hard as by full braking on a wet road: slow down. At the full load it stops.

use super::relief::Relief;
use super::tile::TILE_CELLS;

/// Risk from which to slow down: 0.5.
pub const SLOW: u8 = 128;
/// Risk from which to stop: 0.98, a 9 cm step with the default wheel.
pub const STOP: u8 = 250;

/// What the driver, or the machine, should do about a place.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Decision {
    /// Drive on.
    Free,
    /// Pass slowly.
    Slow,
    /// Do not pass.
    Stop,
}

impl Decision {
    /// The decision for a risk.
    #[must_use]
    pub const fn of(risk: u8) -> Self {
        match risk {
            0..SLOW => Self::Free,
            SLOW..STOP => Self::Slow,
            STOP.. => Self::Stop,
        }
    }
}

/// Steps of the table, one for each half millimetre of relief: the last is 25.6 cm, and every larger one.
const STEPS: usize = 512;

/// Relief to risk, tabulated for one wheel.
pub(crate) struct RiskTable([u8; STEPS]);

impl RiskTable {
    pub(crate) fn new(wheel_radius_mm: f32) -> Self {
        let mut table = [255; STEPS];
        for (step, entry) in table.iter_mut().enumerate() {
            let relief_mm = step as f32 * 0.5;
            *entry = (risk_of_step(relief_mm, wheel_radius_mm) * 255.0 + 0.5) as u8;
        }
        Self(table)
    }

    /// Risks of reliefs in quarter millimetres.
    #[inline(always)]
    pub(crate) fn tell(&self, reliefs: &Relief, risks: &mut [u8; TILE_CELLS]) {
        let mut steps = [0; TILE_CELLS];
        step(reliefs, &mut steps);
        for (risk, step) in risks.iter_mut().zip(steps) {
            *risk = self.0[usize::from(step) & (STEPS - 1)];
        }
    }
}

/// Entries of the table by relief: all at once, as vectors can.
#[inline(always)]
fn step(reliefs: &Relief, steps: &mut [u16; TILE_CELLS]) {
    for (step, relief) in steps.iter_mut().zip(reliefs.as_flattened()) {
        *step = ((*relief).max(0) >> 1).min(STEPS as i16 - 1) as u16;
    }
}

/// Risk of a step for a wheel, 0 to 1.
#[must_use]
pub fn risk_of_step(step_mm: f32, wheel_radius_mm: f32) -> f32 {
    let cosine = 1.0 - step_mm / wheel_radius_mm;
    if cosine.is_nan() || cosine <= 0.0 {
        return 1.0;
    }
    let tangent = libm::sqrtf((1.0 - cosine * cosine).max(0.0)) / cosine;
    if tangent < 1.0 { tangent } else { 1.0 }
}

/// Standard deviation of a cell's risk when its relief has one of `sigma_mm` on each end: the slope of the risk
/// curve there times the spread of a difference of two.
#[must_use]
pub fn risk_sigma(risk: f32, sigma_mm: f32, wheel_radius_mm: f32) -> f32 {
    // tan a with cos a = 1 - h / R: d(tan a)/dh = 1 / (R sin a cos^2 a).
    let tangent2 = (risk * risk).max(1e-4);
    let cosine2 = 1.0 / (1.0 + tangent2);
    let sine = libm::sqrtf(1.0 - cosine2);
    let slope = 1.0 / (wheel_radius_mm * sine * cosine2);
    (slope * sigma_mm * core::f32::consts::SQRT_2).min(0.5)
}

/// Speed at which a bump is felt no harder than `limit_mps2` of vertical acceleration, m/s.
///
/// A body that follows a raised-cosine bump of height h and length L at speed v is accelerated by
/// (h / 2)(2 pi v / L)^2. None where the bump demands nothing.
#[must_use]
pub fn advised_speed_mps(height_m: f32, length_m: f32, limit_mps2: f32) -> Option<f32> {
    if !(height_m > 0.0 && length_m > 0.0 && limit_mps2 > 0.0) {
        return None;
    }
    Some(length_m / core::f32::consts::TAU * libm::sqrtf(2.0 * limit_mps2 / height_m))
}

#[cfg(test)]
mod tests {
    use super::super::tile::TILE_SIDE;
    use super::*;

    #[test]
    fn the_steps_that_the_criterion_names() {
        for (step, wanted) in [(34.0, 0.5), (50.0, 0.64), (70.0, 0.8), (94.0, 1.0), (0.0, 0.0), (400.0, 1.0)] {
            assert!((risk_of_step(step, 320.0) - wanted).abs() < 0.011, "{step}: {}", risk_of_step(step, 320.0));
        }
    }

    #[test]
    fn risk_never_falls_as_a_step_grows() {
        let table = RiskTable::new(320.0);
        let of = |relief| {
            let mut risks = [0; TILE_CELLS];
            table.tell(&[[relief; TILE_SIDE]; TILE_SIDE], &mut risks);
            risks[0]
        };
        assert!((-10..1000i16).zip(-9..).all(|(low, high)| of(low) <= of(high)));
        assert_eq!((of(-5), of(i16::MAX)), (0, 255));
    }

    #[test]
    fn a_higher_or_shorter_bump_is_passed_more_slowly() {
        let speed = |h, l| advised_speed_mps(h, l, 2.5).unwrap();
        assert!(speed(0.08, 0.9) < speed(0.05, 0.9) && speed(0.08, 0.9) < speed(0.08, 3.7));
        assert_eq!(advised_speed_mps(0.0, 1.0, 2.5), None);
    }
}
