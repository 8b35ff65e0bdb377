//! Reproducible randomness: the same numbers for a seed on every platform.
//!
//! ChaCha with 8 rounds is specified bit for bit, and what is made of its bits uses exact arithmetic or `libm`, whose results do not
//! depend on the platform's C library. Each purpose draws from a stream of its own, so that a change of one
//! (more range noise) leaves the others (the sections) as they were.

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};

/// What a stream of random numbers is for.
#[derive(Clone, Copy, Debug)]
pub enum Purpose {
    /// The road's sections.
    Sections = 1,
    /// Ranges: noise, dropouts, vegetation.
    Ranges = 2,
    /// Attitude and position of the inertial unit.
    Inertial = 3,
    /// When its frames arrive.
    Latency = 4,
    /// The vehicle's motion.
    Motion = 5,
    /// Attitude and position of a second inertial unit.
    SecondInertial = 6,
    /// When its frames arrive.
    SecondLatency = 7,
    /// Errors of position.
    Position = 8,
    /// Errors of the second unit's position.
    SecondPosition = 9,
    /// Undulations of the ground.
    Undulation = 10,
    /// Roughness of the ground, beam by beam.
    Roughness = 11,
}

/// A stream of random numbers.
#[derive(Clone, Debug)]
pub struct Noise(ChaCha8Rng);

impl Noise {
    /// The stream of a seed for a purpose.
    #[must_use]
    pub fn new(seed: u64, purpose: Purpose) -> Self {
        let mut generator = ChaCha8Rng::seed_from_u64(seed);
        generator.set_stream(purpose as u64);
        Self(generator)
    }

    /// Uniform in [0, 1), with 53 bits.
    pub fn unit(&mut self) -> f64 {
        (self.0.next_u64() >> 11) as f64 / (1_u64 << 53) as f64
    }

    /// Uniform between two bounds.
    pub fn between(&mut self, [low, high]: [f64; 2]) -> f64 {
        low + (high - low) * self.unit()
    }

    /// Whether an event of this probability happens.
    pub fn chance(&mut self, probability: f64) -> bool {
        self.unit() < probability
    }

    /// Normal with mean 0 and standard deviation 1 (Box and Muller, the cosine branch).
    pub fn normal(&mut self) -> f64 {
        let radius = libm::sqrt(-2.0 * libm::log(1.0 - self.unit()));
        radius * libm::cos(core::f64::consts::TAU * self.unit())
    }

    /// Exponential with the given mean.
    pub fn exponential(&mut self, mean: f64) -> f64 {
        -mean * libm::log(1.0 - self.unit())
    }
}

/// A slowly drifting quantity: first-order Gauss-Markov with standard deviation 1.
#[derive(Clone, Debug)]
pub struct Drift {
    value: f64,
    keep: f64,
    renew: f64,
}

impl Drift {
    /// A drift with a time constant, looked at in equal steps (both in seconds); a time constant of 0 is white noise.
    pub fn new(time_constant_s: f64, step_s: f64, noise: &mut Noise) -> Self {
        let keep = if time_constant_s > 0.0 { libm::exp(-step_s / time_constant_s) } else { 0.0 };
        Self { value: noise.normal(), keep, renew: libm::sqrt(1.0 - keep * keep) }
    }

    /// Its value now; moves on by one step.
    pub fn step(&mut self, noise: &mut Noise) -> f64 {
        let now = self.value;
        self.value = self.keep * now + self.renew * noise.normal();
        now
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn moments(values: &[f64]) -> (f64, f64) {
        let n = values.len() as f64;
        let mean = values.iter().sum::<f64>() / n;
        (mean, (values.iter().map(|v| (v - mean) * (v - mean)).sum::<f64>() / n).sqrt())
    }

    #[test]
    fn normal_and_exponential_have_their_moments() {
        let mut noise = Noise::new(1, Purpose::Ranges);
        let (mean, sd) = moments(&(0..40_000).map(|_| noise.normal()).collect::<Vec<_>>());
        assert!(mean.abs() < 0.02 && (sd - 1.0).abs() < 0.02, "{mean} {sd}");
        let (mean, sd) = moments(&(0..40_000).map(|_| noise.exponential(3.0)).collect::<Vec<_>>());
        assert!((mean - 3.0).abs() < 0.06 && (sd - 3.0).abs() < 0.1, "{mean} {sd}");
    }

    #[test]
    fn a_drift_keeps_its_deviation_and_its_memory() {
        let mut noise = Noise::new(2, Purpose::Inertial);
        let mut drift = Drift::new(1.0, 0.01, &mut noise);
        let values: Vec<_> = (0..400_000).map(|_| drift.step(&mut noise)).collect();
        let (_, sd) = moments(&values);
        assert!((sd - 1.0).abs() < 0.05, "{sd}");
        // One time constant apart the correlation is 1/e.
        let products: f64 = values.iter().zip(&values[100..]).map(|(a, b)| a * b).sum();
        let correlation = products / (values.len() - 100) as f64 / (sd * sd);
        assert!((correlation - 0.368).abs() < 0.06, "{correlation}");
    }

    #[test]
    fn the_bits_are_the_same_everywhere() {
        let mut noise = Noise::new(42, Purpose::Sections);
        let bits: Vec<_> = (0..3).map(|_| noise.normal().to_bits()).collect();
        assert_eq!(bits, [4605309943060694111, 4604053511211543893, 4588109501430644355]);
    }
}
