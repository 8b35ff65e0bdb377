//! Levelled points to a regular spacing in the lateral distance, as the median-slope paper's search wants them.
//!
//! Rule: going outward, only points further out than every point before them count (what overhangs is behind the
//! visible surface). Samples lie at the whole multiples of the spacing from the first of those points to the last;
//! their height is linear between the two neighbours, rounded down. No sample bridges a gap above [`MAX_GAP_UM`]:
//! nothing was seen there.

use heapless::Vec;

use super::Point;

/// The widest gap between neighbouring points across which heights are interpolated.
pub const MAX_GAP_UM: i32 = 2_000_000;

/// Most samples a side: 40 m at the default spacing of 100 mm.
pub const MAX_SAMPLES: usize = 400;

/// Samples of one side, going outward: `y_um` is the distance outward, positive on both sides.
pub type Samples = Vec<Point, MAX_SAMPLES>;

/// Resamples `outward`, whose `y_um` counts outward from the sensor. `samples` is overwritten; what has no place in it
/// any more lies furthest out and is left away. A spacing below 1 mm is taken as 1 mm.
pub fn resample(outward: impl Iterator<Item = Point>, spacing_um: i32, samples: &mut Samples) {
    samples.clear();
    let spacing_um = spacing_um.max(1_000);
    let mut inner: Option<Point> = None;
    for point in outward {
        let Some(last) = inner else {
            inner = Some(point);
            continue;
        };
        let gap_um = point.y_um - last.y_um;
        if gap_um <= 0 {
            continue;
        }
        inner = Some(point);
        if gap_um > MAX_GAP_UM {
            continue;
        }
        // First multiple at or beyond the inner point; the outer one belongs to the next pair.
        let mut y_um = last.y_um + (-last.y_um).rem_euclid(spacing_um);
        while y_um < point.y_um {
            let rise = i64::from(point.z_um - last.z_um) * i64::from(y_um - last.y_um);
            let z_um = last.z_um + rise.div_euclid(i64::from(gap_um)) as i32;
            if samples.push(Point { y_um, z_um }).is_err() {
                return;
            }
            y_um += spacing_um;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn resampled(points: &[(i32, i32)], spacing_um: i32) -> Samples {
        let mut samples = Samples::new();
        resample(points.iter().map(|&(y_um, z_um)| Point { y_um, z_um }), spacing_um, &mut samples);
        samples
    }

    #[test]
    fn heights_are_linear_between_neighbours_at_whole_multiples() {
        let samples = resampled(&[(-150_000, -2_000_000), (250_000, -1_600_000)], 100_000);
        let expected = [(-100_000, -1_950_000), (0, -1_850_000), (100_000, -1_750_000), (200_000, -1_650_000)];
        assert!(samples.iter().map(|p| (p.y_um, p.z_um)).eq(expected));
    }

    #[test]
    fn a_point_at_a_multiple_is_its_own_sample_once() {
        let samples = resampled(&[(0, 5), (100_000, 7), (200_001, 9)], 100_000);
        assert!(samples.iter().map(|p| (p.y_um, p.z_um)).eq([(0, 5), (100_000, 7), (200_000, 8)]));
    }

    #[test]
    fn an_overhang_is_behind_the_surface_and_a_wide_gap_stays_empty() {
        let samples = resampled(&[(0, 0), (250_000, 0), (150_000, 900_000), (350_000, 0), (2_400_000, 0)], 100_000);
        assert!(samples.iter().map(|p| (p.y_um, p.z_um)).eq([(0, 0), (100_000, 0), (200_000, 0), (300_000, 0)]));
    }

    #[test]
    fn what_has_no_room_lies_furthest_out() {
        let samples = resampled(&[(0, 0), (1_000_000, 0), (2_000_000, 0)], 0);
        assert_eq!((samples.len(), samples.last().map(|p| p.y_um)), (MAX_SAMPLES, Some(399_000)));
    }
}
