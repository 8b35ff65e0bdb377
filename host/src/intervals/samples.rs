//! What the scans of a stretch say together of one quantity.
//!
//! The value is the mean along the road of the scans' values, of which none counts as further from the level of its fifteen neighbours than 2.5 robust
//! standard deviations of such distances (winsorised, after Tukey and McLaughlin, 1963). A stray is told by its neighbours and not by the whole stretch: ground
//! that falls by a degree more in one half of a tenth of a mile than in the other is no stray, and an estimate that takes it for one errs by half a
//! degree. The level is the neighbours' median; at the two ends of a stretch, where they all lie to one side, it is the line of Theil and Sen through
//! them, as a median would take the ground's change for noise. As precise as the mean for clean scans; a tenth of lone strays moves it by a
//! quarter of the noise. What fills half of the fifteen scans in a row counts as ground.
//!
//! Along the road: a scan speaks for the road halfway to its neighbours on either side, and for five times the mean of that at most. A vehicle that
//! slows down or stops, or slopes that are not found in some scans, do not shift the mean.
//!
//! How much single scans vary is the standard deviation about the value of the same winsorised values: the noise, and what the ground varies along the
//! stretch. (The median deviation from a median would take a steeper third of the stretch for strays.)
//!
//! The interval has two parts. The scans' own intervals are independent and shrink with their number. The inertial unit's roll error is common to
//! neighbouring scans and does not: [`ROLL_SD_DEG`] is added to every interval, so that no number of scans claims more than the unit can give.
//!
//! At most [`HELD`] samples are held; beyond (a vehicle that stands) every second one is let go, and so on.

use crate::statistics::median;

/// One standard deviation of the inertial unit's roll in degrees: SPAN's published accuracy.
pub const ROLL_SD_DEG: f64 = 0.017;

/// Samples held of one quantity of one stretch.
pub const HELD: usize = 8_192;

/// Scans whose level a scan is held against: ten metres of road at 90 km/h, and an odd number.
const NEIGHBOURS: usize = 15;

/// Robust standard deviations beyond which a scan counts as no further off.
const BEND: f64 = 2.5;

/// A scan speaks for so many times the mean spacing at most, of a vehicle that moves.
const MOST_SPACINGS: f64 = 5.0;

/// Half width of a 95 % interval in standard deviations.
pub(super) const WIDTH_95: f64 = 1.959_964;

/// Median absolute deviation to standard deviation, for a normal distribution.
const MAD_TO_SD: f64 = 1.482_6;

/// What one scan says.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sample {
    /// The value.
    pub value: f64,
    /// Its own standard deviation, 0 where it is not known.
    pub sd: f64,
    /// Where along the road, in metres or any other measure of the way.
    pub at: f64,
}

impl Sample {
    /// A value, half the width of its 95 % interval (NaN where it has none), and where along the road it was taken.
    #[must_use]
    pub fn new(value: f64, ci95: f64, at: f64) -> Self {
        Self { value, sd: if ci95.is_finite() { ci95 / WIDTH_95 } else { 0.0 }, at }
    }
}

/// A quantity over a stretch.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Estimate {
    /// Robust location.
    pub value: f64,
    /// Half width of its 95 % interval.
    pub ci95: f64,
    /// Standard deviation of the single scans along the road about it, strays bent as for the value.
    pub sd: f64,
    /// Scans that it rests on.
    pub count: u64,
}

/// The scans of a stretch, in the order in which they were passed.
#[derive(Clone, Debug, Default)]
pub struct Samples {
    held: Vec<Sample>,
    seen: u64,
    /// Every 2^n-th is held.
    thinned: u32,
}

impl Samples {
    /// Takes in a scan.
    pub fn push(&mut self, sample: Sample) {
        if self.seen.trailing_zeros() >= self.thinned {
            self.held.push(sample);
            if self.held.len() == HELD {
                let mut keep = false;
                self.held.retain(|_| {
                    keep = !keep;
                    keep
                });
                self.thinned += 1;
            }
        }
        self.seen += 1;
    }

    /// The median.
    #[must_use]
    pub fn median(&self) -> Option<f64> {
        median(&mut self.values())
    }

    /// The robust estimate of an angle in degrees, see the module.
    #[must_use]
    pub fn estimate(&self) -> Option<Estimate> {
        let values = self.values();
        let levels = levels(&values);
        let off: Vec<f64> = values.iter().zip(&levels).map(|(value, level)| value - level).collect();
        let noise = MAD_TO_SD * median(&mut off.iter().map(|off| off.abs()).collect::<Vec<_>>())?;
        let bend = BEND * noise;
        let bent = levels.iter().zip(&off).map(|(level, off)| level + off.clamp(-bend, bend));
        let shared: Vec<(f64, f64)> = self.shares().into_iter().zip(bent).collect();
        let value: f64 = shared.iter().map(|(share, bent)| share * bent).sum();
        let spread: f64 = shared.iter().map(|(share, bent)| share * (bent - value).powi(2)).sum();
        // The value is the scans' own mean, which lies among them: of two scans, the deviation from it is half of what they vary.
        let free = 1.0 - shared.iter().map(|(share, _)| share * share).sum::<f64>();
        let sd = if free > 0.0 { (spread / free).sqrt() } else { 0.0 };
        // A scan without an interval of its own has that of its kind.
        let own = self.held.iter().map(|sample| if sample.sd > 0.0 { sample.sd } else { noise });
        let variance: f64 = shared.iter().zip(own).map(|((share, _), own)| (share * own).powi(2)).sum();
        let ci95 = WIDTH_95 * (variance + ROLL_SD_DEG * ROLL_SD_DEG).sqrt();
        Some(Estimate { value, ci95, sd, count: self.seen })
    }

    fn values(&self) -> Vec<f64> {
        self.held.iter().map(|sample| sample.value).collect()
    }

    /// Which share of the way each scan speaks for; equal ones where there is no way, or none known.
    fn shares(&self) -> Vec<f64> {
        let step = |i: usize| self.held.get(i..i + 2).map_or(f64::NAN, |pair| (pair[1].at - pair[0].at).abs());
        let count = self.held.len();
        let steps: Vec<f64> = (0..count.saturating_sub(1)).map(step).collect();
        let moved = steps.iter().filter(|step| **step > 0.0).count();
        let most = MOST_SPACINGS * steps.iter().sum::<f64>() / moved as f64;
        let mut shares: Vec<f64> = (0..count)
            .map(|i| match (i.checked_sub(1).and_then(|before| steps.get(before)), steps.get(i)) {
                (Some(before), Some(behind)) => ((before + behind) / 2.0).min(most),
                // At an end the road goes on.
                (Some(only), None) | (None, Some(only)) => only.min(most),
                (None, None) => f64::NAN,
            })
            .collect();
        let way: f64 = shares.iter().sum();
        for share in &mut shares {
            *share = if way.is_finite() && way > 0.0 { *share / way } else { 1.0 / count as f64 };
        }
        shares
    }
}

/// The level of each value's neighbours, itself among them.
fn levels(values: &[f64]) -> Vec<f64> {
    let (count, half) = (values.len(), NEIGHBOURS / 2);
    if count <= NEIGHBOURS {
        return line(values);
    }
    let mut levels = line(&values[..NEIGHBOURS]);
    levels.truncate(half);
    let mut room = [0.0; NEIGHBOURS];
    levels.extend(values.windows(NEIGHBOURS).filter_map(|window| {
        room.copy_from_slice(window);
        median(&mut room)
    }));
    levels.extend(&line(&values[count - NEIGHBOURS..])[NEIGHBOURS - half..]);
    levels
}

/// The line of Theil (1950) and Sen (1968) through values at equal distances, at each of them: strays do not move it that are less than 29 % of them.
fn line(values: &[f64]) -> Vec<f64> {
    let mut rises: Vec<f64> = Vec::with_capacity(values.len() * values.len() / 2);
    for (i, from) in values.iter().enumerate() {
        rises.extend(values[i + 1..].iter().zip(1..).map(|(to, apart)| (to - from) / f64::from(apart)));
    }
    let rise = median(&mut rises).unwrap_or_default();
    let mut bases: Vec<f64> = values.iter().zip(0..).map(|(value, i)| value - rise * f64::from(i)).collect();
    let base = median(&mut bases).unwrap_or_default();
    (0..).take(values.len()).map(|i| base + rise * f64::from(i)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn samples(values: impl IntoIterator<Item = f64>) -> Samples {
        let mut samples = Samples::default();
        values.into_iter().zip(0..).for_each(|(value, i)| samples.push(Sample::new(value, 0.06, f64::from(i))));
        samples
    }

    /// Between -0.5 and 0.5, like nothing in particular.
    fn noise(i: i32) -> f64 {
        f64::from((i * 37) % 100) / 100.0 - 0.495
    }

    #[test]
    fn strays_hardly_move_the_estimate() {
        let estimate =
            samples((0..100).map(|i| if i % 10 == 0 { 12.0 } else { -8.0 + 0.1 * noise(i) })).estimate().unwrap();
        assert!((estimate.value + 8.0).abs() < 0.02, "{estimate:?}");
        assert_eq!(estimate.count, 100);
    }

    #[test]
    fn ground_that_changes_along_a_stretch_has_the_mean_of_its_slopes() {
        // A quarter of the stretch is four degrees steeper, and every twentieth scan is a stray.
        let ground = |i: i32| if i < 60 { -12.0 } else { -8.0 + f64::from(i) * 0.002 };
        let estimate =
            samples((0..240).map(|i| ground(i) + if i % 20 == 7 { 9.0 } else { 0.1 * noise(i) })).estimate().unwrap();
        let mean = (0..240).map(ground).sum::<f64>() / 240.0;
        assert!((estimate.value - mean).abs() < 0.02, "{estimate:?} {mean}");
        let sd = ((0..240).map(|i| (ground(i) - mean).powi(2)).sum::<f64>() / 239.0).sqrt();
        assert!((estimate.sd / sd - 1.0).abs() < 0.02, "{estimate:?} {sd}");
    }

    /// Slopes that swing by two degrees every 120 scans, cut anywhere: the ends of the stretch are no strays.
    #[test]
    fn ground_that_is_under_way_at_the_ends_has_the_mean_of_its_slopes() {
        for phase in 0..24 {
            let ground = |i: i32| -8.0 + 2.0 * (f64::from(i + 5 * phase) * std::f64::consts::TAU / 120.0).sin();
            let estimate = samples((0..225).map(|i| ground(i) + 0.06 * noise(i))).estimate().unwrap();
            let mean = (0..225).map(ground).sum::<f64>() / 225.0;
            assert!((estimate.value - mean).abs() < 0.004, "cut at {phase}: {estimate:?} {mean}");
        }
    }

    #[test]
    fn single_scans_vary_by_their_noise_and_by_the_ground() {
        // Uniform noise of one degree.
        let level = samples((0..400).map(|i| -8.0 + noise(i))).estimate().unwrap();
        assert!((level.sd - 1.0 / 12_f64.sqrt()).abs() < 0.01, "{level:?}");
        // Twice as steep in the last third, of which a median sees nothing.
        let steeper = samples((0..300).map(|i| if i < 200 { -6.0 } else { -12.0 })).estimate().unwrap();
        assert!((steeper.sd - 2.83).abs() < 0.02, "{steeper:?}");
        // Strays count as noise at most: of alternate signs, so that no line leads through them.
        let strays = samples((0..400).map(|i| noise(i) + if i % 40 == 7 { f64::from(i % 80 - 27) } else { 0.0 }));
        assert!((strays.estimate().unwrap().sd - 0.3).abs() < 0.05, "{:?}", strays.estimate());
        // Of two, half of their squared difference; of one, nothing is known.
        assert!((samples([-7.0, -9.0]).estimate().unwrap().sd - 2_f64.sqrt()).abs() < 1e-9);
        assert_eq!(samples([-7.0]).estimate().unwrap().sd, 0.0);
    }

    #[test]
    fn every_piece_of_road_counts_alike() {
        // The second half is passed at a third of the speed; of the first, a tenth was not found.
        let places = (0..100)
            .map(f64::from)
            .filter(|at| !(30.0..40.0).contains(at))
            .chain((0..300).map(|i| 100.0 + f64::from(i) / 3.0));
        let mut samples = Samples::default();
        places.for_each(|at| samples.push(Sample::new(if at < 100.0 { -10.0 } else { -6.0 }, 0.06, at)));
        let estimate = samples.estimate().unwrap();
        assert!((estimate.value + 8.0).abs() < 0.15, "{estimate:?}");
        // A vehicle that stands at the end, or whose way is not known.
        (0..1_000).for_each(|_| samples.push(Sample::new(-6.0, 0.06, 199.7)));
        assert!((samples.estimate().unwrap().value + 8.0).abs() < 0.15);
        let mut lost = Samples::default();
        [-7.0, -8.0, -9.0].iter().for_each(|value| lost.push(Sample::new(*value, f64::NAN, f64::NAN)));
        assert!((lost.estimate().unwrap().value + 8.0).abs() < 1e-9);
    }

    #[test]
    fn levels_are_the_medians_of_the_nearest_fifteen_and_lines_at_the_ends() {
        let values: Vec<f64> = (0..40).map(|i| f64::from(i * i % 17)).collect();
        let found = levels(&values);
        assert_eq!(found.len(), 40);
        for (i, level) in found.iter().enumerate().take(33).skip(7) {
            assert_eq!(Some(*level), median(&mut values[i - 7..i + 8].to_vec()), "at {i}");
        }
        // On a line with a stray in each end, the line.
        let straight = |i: usize| 3.0 - 0.25 * i as f64;
        let mut values: Vec<f64> = (0..40).map(straight).collect();
        (values[1], values[36]) = (9.0, -40.0);
        for (i, level) in levels(&values).into_iter().enumerate() {
            assert!((level - straight(i)).abs() <= if (7..33).contains(&i) { 0.25 } else { 1e-9 }, "at {i}: {level}");
        }
        assert_eq!(levels(&[0.0, 1.0, 2.0, 3.0]), [0.0, 1.0, 2.0, 3.0]);
        assert_eq!((levels(&[5.0]), levels(&[])), (vec![5.0], vec![]));
        assert_eq!(Samples::default().estimate(), None);
    }

    #[test]
    fn no_number_of_scans_claims_more_than_the_inertial_unit_gives() {
        let many = samples((0..100_000).map(|_| -8.0));
        let estimate = many.estimate().unwrap();
        assert!(many.held.len() < HELD, "memory is bounded");
        assert_eq!(estimate.count, 100_000);
        assert!(estimate.ci95 >= WIDTH_95 * ROLL_SD_DEG && estimate.ci95 < 0.034, "{estimate:?}");
    }
}
