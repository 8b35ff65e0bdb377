//! Medians, root mean squares and standard deviations, as all of the host takes them.
//!
//! Two medians, which differ for an even number of values. [`median`] is the mean of the middle two, as statistics has it: for what is
//! estimated. [`upper_median`] is the upper of the middle two, a value that was measured: for what is told of data as they are, such as one scan of
//! a stretch.
//!
//! A deviation is divided by n: it describes these values. What single scans vary along a road is an estimate of what others would, and has its own
//! formula where it is made ([`Samples::estimate`](crate::intervals::Samples::estimate)), with the weights' like of n - 1.

/// The median, which leaves the values in another order; the mean of the middle two of an even number, nothing of none.
pub fn median(values: &mut [f64]) -> Option<f64> {
    let half = values.len() / 2;
    if values.is_empty() {
        return None;
    }
    let odd = values.len() % 2 == 1;
    let (below, &mut middle, _) = values.select_nth_unstable_by(half, f64::total_cmp);
    Some(if odd { middle } else { (below.iter().copied().fold(f64::MIN, f64::max) + middle) / 2.0 })
}

/// The median, which leaves the values in another order; the upper of the middle two of an even number, nothing of none.
pub fn upper_median(values: &mut [f64]) -> Option<f64> {
    let half = values.len() / 2;
    (!values.is_empty()).then(|| *values.select_nth_unstable_by(half, f64::total_cmp).1)
}

/// Root of the mean square; 0 of nothing.
pub fn rms(values: impl Iterator<Item = f64>) -> f64 {
    let (count, sum) = values.fold((0.0, 0.0), |(count, sum), value| (count + 1.0, sum + value * value));
    if count > 0.0 { (sum / count).sqrt() } else { 0.0 }
}

/// Standard deviation; 0 of nothing.
pub fn deviation(values: impl Iterator<Item = f64> + Clone) -> f64 {
    let count = values.clone().count() as f64;
    let mean = values.clone().sum::<f64>() / count.max(1.0);
    rms(values.map(|value| value - mean))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn medians_differ_for_an_even_number() {
        assert_eq!((median(&mut []), upper_median(&mut [])), (None, None));
        assert_eq!((median(&mut [3.0, 1.0, 2.0]), upper_median(&mut [3.0, 1.0, 2.0])), (Some(2.0), Some(2.0)));
        assert_eq!(
            (median(&mut [4.0, 1.0, 2.0, 3.0]), upper_median(&mut [4.0, 1.0, 2.0, 3.0])),
            (Some(2.5), Some(3.0))
        );
    }

    #[test]
    fn a_deviation_is_divided_by_the_number_of_values() {
        assert_eq!((rms([3.0, -3.0].into_iter()), deviation([1.0, 3.0].into_iter())), (3.0, 1.0));
        assert_eq!((rms(std::iter::empty()), deviation(std::iter::empty())), (0.0, 0.0));
    }
}
