//! Two drives of one road as one table of slopes, each slope from the side that measures it better.
//!
//! Where a median lies between two carriageways, the slope next to one of them is the far one from the other. Both drives measure both; returns of the
//! far slope are fewer and flatter. For each stretch of the first drive's way and each slope, **the rule** is: of the two drives' values take the one
//! with the narrower 95 % interval, of equal ones the nearer. The other value is told as well: their difference checks both drives.
//!
//! A drive the other way has the same slope on the same side of the vehicle (the left one where traffic keeps right) but as the other one of the two, and
//! rising where it fell; a drive the same way has it as the same one. Slopes are signed as the first drive sees them. Places join the drives ([`crate::way`]). Sections of either drive
//! that say themselves [unreliable](crate::profiles::UNRELIABLE) have no part in it.

use crate::drive::{Drive, Scan};
use crate::geodesy::Geodetic;
use crate::intervals::{Estimate, Every, Sample, Samples};
use crate::side::Side;
use crate::table::{Column, Kind, Record, Shape, Value};

/// A slope of a stretch, from both drives.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Both {
    /// From the first drive.
    pub first: Option<Estimate>,
    /// From the second, signed as the first sees it.
    pub second: Option<Estimate>,
    /// Whether the slope is next to the first drive's road.
    pub near_first: bool,
}

impl Both {
    /// The value by the rule, and the number of the drive that it is from.
    #[must_use]
    pub fn better(&self) -> Option<(Estimate, i64)> {
        match (self.first, self.second) {
            (Some(one), Some(other)) if one.ci95 < other.ci95 || (one.ci95 == other.ci95 && self.near_first) => {
                Some((one, 1))
            }
            (_, Some(other)) => Some((other, 2)),
            (Some(one), None) => Some((one, 1)),
            (None, None) => None,
        }
    }
}

/// A stretch of the first drive's way.
#[derive(Clone, Debug, PartialEq)]
pub struct Fused {
    /// Where it begins, by the first drive's stations.
    pub from_m: f64,
    /// Where it ends.
    pub to_m: f64,
    /// Where the first drive's scanner was in it, where it was.
    pub place: Option<Geodetic>,
    /// The slope that is next to the first drive's road, on the side that was asked for.
    pub adjacent: Both,
    /// The one beyond.
    pub opposing: Both,
}

/// Joins the slopes on a side of two drives in stretches of a length; nothing when the first has no positions or the second was
/// never near it.
#[must_use]
pub fn fuse(first: &Drive, second: &Drive, every: Every, side: Side) -> Option<Vec<Fused>> {
    let way = first.way()?;
    let (from_m, to_m) = first.span_m()?;
    let begin = (from_m / every.metres).floor() as i64;
    let count = ((to_m / every.metres).floor() as i64 - begin + 1).max(1) as usize;
    let mut stretches: Vec<Stretch> = vec![Stretch::default(); count];
    let number = |station_m: f64| usize::try_from((station_m / every.metres).floor() as i64 - begin).ok();
    for scan in first.scans.iter().filter(|scan| scan.station_m.is_finite()) {
        let Some(stretch) = number(scan.station_m).and_then(|number| stretches.get_mut(number)) else { continue };
        stretch.place = stretch.place.or(scan.place[0].is_finite().then_some(scan.place));
        add(&mut stretch.first, scan.station_m, of_side(scan, side), 1.0);
    }
    let stations: Vec<Option<f64>> = second.scans.iter().map(|scan| way.station_m(scan.place)).collect();
    let mut known = stations.iter().flatten();
    let (start, end) = (*known.next()?, known.next_back().copied()?);
    let opposite = end < start;
    for (scan, station) in second.scans.iter().zip(&stations) {
        let Some(at_m) = *station else { continue };
        let Some(stretch) = number(at_m).and_then(|number| stretches.get_mut(number)) else { continue };
        let [adjacent, opposing] = of_side(scan, side);
        match opposite {
            true => add(&mut stretch.second, at_m, [opposing, adjacent], -1.0),
            false => add(&mut stretch.second, at_m, [adjacent, opposing], 1.0),
        }
    }
    let fused = stretches.into_iter().enumerate().map(|(i, stretch)| {
        let at = (begin + i as i64) as f64 * every.metres;
        let both = |slope: usize, near_first: bool| Both {
            first: stretch.first[slope].estimate(),
            second: stretch.second[slope].estimate(),
            near_first: near_first || !opposite,
        };
        Fused {
            from_m: at,
            to_m: at + every.metres,
            place: stretch.place,
            adjacent: both(0, true),
            opposing: both(1, false),
        }
    });
    Some(fused.collect())
}

#[derive(Clone, Debug, Default)]
struct Stretch {
    place: Option<Geodetic>,
    first: [Samples; 2],
    second: [Samples; 2],
}

/// The adjacent and the opposing slope of a side, where they were found and can be relied on.
fn of_side(scan: &Scan, side: Side) -> [Option<(f64, f64)>; 2] {
    side.slopes().map(|slope| scan.reliable(slope))
}

fn add(into: &mut [Samples; 2], at_m: f64, slopes: [Option<(f64, f64)>; 2], sign: f64) {
    for (samples, slope) in into.iter_mut().zip(slopes) {
        slope.into_iter().for_each(|(value, ci95)| samples.push(Sample::new(sign * value, ci95, at_m)));
    }
}

impl Record for Fused {
    const COLUMNS: &'static [Column] = &[
        ("station_from_m", Kind::Real(3)),
        ("station_to_m", Kind::Real(3)),
        ("latitude_deg", Kind::Real(9)),
        ("longitude_deg", Kind::Real(9)),
        ("height_m", Kind::Real(3)),
        ("adjacent_slope_deg", Kind::Real(5)),
        ("adjacent_slope_ci95_deg", Kind::Real(5)),
        ("adjacent_scans", Kind::Integer),
        ("adjacent_from_drive", Kind::Integer),
        ("adjacent_difference_deg", Kind::Real(5)),
        ("opposing_slope_deg", Kind::Real(5)),
        ("opposing_slope_ci95_deg", Kind::Real(5)),
        ("opposing_scans", Kind::Integer),
        ("opposing_from_drive", Kind::Integer),
        ("opposing_difference_deg", Kind::Real(5)),
    ];

    fn cells(&self, into: &mut Vec<Value>) {
        into.extend([Value::Real(self.from_m), Value::Real(self.to_m)]);
        into.extend((0..3).map(|axis| Value::from(self.place.map(|place| place[axis]))));
        for both in [self.adjacent, self.opposing] {
            let better = both.better();
            let difference = both.first.zip(both.second).map(|(one, other)| other.value - one.value);
            into.extend([
                better.map(|(value, _)| value.value).into(),
                better.map(|(value, _)| value.ci95).into(),
                Value::Integer(better.map_or(0, |(value, _)| value.count as i64)),
                better.map(|(_, drive)| drive).into(),
                difference.into(),
            ]);
        }
    }

    fn shapes(&self) -> Vec<(&'static str, Shape)> {
        self.place.map(|place| ("stretch", Shape::Point(place))).into_iter().collect()
    }

    fn vertex(&self) -> Option<(&'static str, Geodetic)> {
        Some(("way", self.place?))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geodesy::shifted;
    use crossfall_core::protocol::message::flags;

    /// A scan a second, with left slopes and half widths.
    fn scan(number: u32, station_m: f64, place: [f64; 3], [adjacent, opposing]: [(f32, f32); 2]) -> Scan {
        let none = (f32::NAN, f32::NAN);
        let slopes = [adjacent, opposing, none, none];
        Scan { gps_seconds: f64::from(number), place, slopes, ..Scan::at(number, station_m) }
    }

    /// A drive along a road to the east or back, with given left slopes and half widths.
    fn drive(eastward: bool, slopes: [(f32, f32); 2]) -> Drive {
        let start = [40.8, -77.86, 350.0];
        let scans = (0..500).map(|i| {
            let way = f64::from(i);
            let east = if eastward { way } else { 499.0 - way };
            scan(i, way, shifted(start, [east, if eastward { 0.0 } else { 16.0 }, 0.0]), slopes)
        });
        Drive { scans: scans.collect(), ..Drive::default() }
    }

    #[test]
    fn each_slope_is_taken_from_the_side_that_measures_it_better() {
        let up = drive(true, [(-8.0, 0.05), (7.1, 0.3)]);
        let down = drive(false, [(-7.0, 0.05), (8.2, 0.3)]);
        let fused = fuse(&up, &down, Every { metres: 50.0 }, Side::Left).unwrap();
        assert_eq!(fused.len(), 10);
        for stretch in &fused {
            let (adjacent, from) = stretch.adjacent.better().unwrap();
            assert!((adjacent.value + 8.0).abs() < 1e-6 && from == 1, "{stretch:?}");
            let (opposing, from) = stretch.opposing.better().unwrap();
            assert!((opposing.value - 7.0).abs() < 1e-6 && from == 2, "{stretch:?}");
            // What the far side said of the same slope, with the sign of the near one.
            assert!((stretch.adjacent.second.unwrap().value + 8.2).abs() < 1e-6);
        }
    }

    #[test]
    fn where_traffic_keeps_left_the_median_is_on_the_right() {
        let [up, down] =
            [(true, [(-8.0, 0.05), (7.1, 0.3)]), (false, [(-7.0, 0.05), (8.2, 0.3)])].map(|(east, slopes)| {
                let mut drive = drive(east, slopes);
                for scan in &mut drive.scans {
                    scan.slopes.rotate_left(2);
                    // What is on the left has nothing to do with the median.
                    (scan.slopes[0], scan.flags[0]) = ((-3.0, 0.01), flags::DOUBTFUL);
                }
                drive
            });
        let every = Every { metres: 50.0 };
        let fused = fuse(&up, &down, every, Side::Right).unwrap();
        assert_eq!(fused.len(), 10);
        for stretch in &fused {
            let [near, far] = [stretch.adjacent, stretch.opposing].map(|both| both.better().unwrap());
            assert!((near.0.value + 8.0).abs() < 1e-6 && near.1 == 1, "{stretch:?}");
            assert!((far.0.value - 7.0).abs() < 1e-6 && far.1 == 2, "{stretch:?}");
        }
        let left = fuse(&up, &down, every, Side::Left).unwrap();
        assert!(left.iter().all(|stretch| stretch.adjacent.better().is_none()), "nothing there can be relied on");
    }

    fn estimate(value: f64, ci95: f64) -> Estimate {
        Estimate { value, ci95, sd: 0.1, count: 10 }
    }

    #[test]
    fn the_rule_takes_the_narrower_interval_and_of_equal_ones_the_nearer() {
        let (narrow, wide) = (estimate(-8.0, 0.05), estimate(-7.0, 0.2));
        for near_first in [false, true] {
            let better = |first, second| Both { first, second, near_first }.better();
            assert_eq!(better(Some(narrow), Some(wide)), Some((narrow, 1)));
            assert_eq!(better(Some(wide), Some(narrow)), Some((narrow, 2)));
            assert_eq!(better(Some(wide), None), Some((wide, 1)));
            assert_eq!(better(None, Some(wide)), Some((wide, 2)));
            assert_eq!(better(None, None), None);
            let same = estimate(-6.0, 0.05);
            let expected = if near_first { (narrow, 1) } else { (same, 2) };
            assert_eq!(better(Some(narrow), Some(same)), Some(expected));
        }
    }

    /// A drive round a bend of 300 m, on one carriageway or back on the other, 16 m further out; the slopes of the median change along the road.
    fn bend(there: bool, metres: std::ops::Range<u32>) -> Drive {
        const RADIUS_M: f64 = 300.0;
        let start = [40.8, -77.86, 350.0];
        let (near, far) = (|along: f64| -8.0 - along / 100.0, |along: f64| 7.0 - along / 200.0);
        let radius = if there { RADIUS_M } else { RADIUS_M - 16.0 };
        let count = metres.len() as u32;
        let scans = (0..count).map(|i| {
            let along = f64::from(if there { metres.start + i } else { metres.end - 1 - i });
            // Along the first drive's line; the bend is to the left, and the other carriageway on its inside.
            let turned = along / RADIUS_M;
            let place = shifted(start, [radius * turned.sin(), RADIUS_M - radius * turned.cos(), 0.0]);
            let slopes = match there {
                true => [(near(along) as f32, 0.05), (far(along) as f32, 0.3)],
                // Its own slope is the far one of the first, and what fell from there rises from here.
                false => [(-far(along) as f32, 0.05), (-near(along) as f32 + 0.2, 0.3)],
            };
            scan(i, f64::from(i) * radius / RADIUS_M, place, slopes)
        });
        Drive { scans: scans.collect(), ..Drive::default() }
    }

    #[test]
    fn drives_are_joined_by_where_they_were_round_a_bend() {
        let fused = fuse(&bend(true, 0..400), &bend(false, 0..400), Every { metres: 20.0 }, Side::Left).unwrap();
        assert_eq!(fused.len(), 20);
        for stretch in &fused {
            let middle = f64::midpoint(stretch.from_m, stretch.to_m);
            let (adjacent, from) = stretch.adjacent.better().unwrap();
            assert!((adjacent.value - (-8.0 - middle / 100.0)).abs() < 0.03 && from == 1, "{stretch:?}");
            let (opposing, from) = stretch.opposing.better().unwrap();
            // Two metres off the place at most: a station found is good to that.
            assert!((opposing.value - (7.0 - middle / 200.0)).abs() < 0.03 && from == 2, "{stretch:?}");
            let [near, far] =
                [stretch.adjacent, stretch.opposing].map(|both| both.second.unwrap().value - both.first.unwrap().value);
            assert!((near + 0.2).abs() < 0.03 && far.abs() < 0.03, "{near} {far}");
        }
        let mut cells = Vec::new();
        fused[3].cells(&mut cells);
        assert_eq!(cells.len(), Fused::COLUMNS.len());
        assert_eq!((&cells[8], &cells[13]), (&Value::Integer(1), &Value::Integer(2)));
    }

    #[test]
    fn what_says_itself_unreliable_has_no_part() {
        let up = drive(true, [(-8.0, 0.05), (7.1, 0.3)]);
        let mut down = drive(false, [(-7.0, 0.05), (8.2, 0.3)]);
        // Without attitude for half of a stretch, with a tight interval all the same; what is doubtful on the right has nothing to do with the left.
        for scan in &mut down.scans {
            let lost = (100.0..125.0).contains(&scan.station_m);
            scan.flags = if lost { [flags::NO_ATTITUDE; 2] } else { [0, flags::DOUBTFUL] };
            scan.slopes[0].0 += if lost { 2.5 } else { 0.0 };
        }
        let fused = fuse(&up, &down, Every { metres: 50.0 }, Side::Left).unwrap();
        for stretch in &fused {
            let (opposing, from) = stretch.opposing.better().unwrap();
            assert!((opposing.value - 7.0).abs() < 1e-6 && from == 2, "{stretch:?}");
        }
        let count = |stretch: &Fused| stretch.opposing.second.unwrap().count;
        assert!(count(&fused[7]) < 27 && count(&fused[5]) > 48, "{fused:?}");
        assert_eq!((down.unreliable(Side::Left), down.unreliable(Side::Right)), (25, 500));
    }

    #[test]
    fn where_one_drive_was_not_the_other_speaks_alone() {
        let (whole, part) = (bend(true, 0..400), bend(false, 102..198));
        let fused = fuse(&whole, &part, Every { metres: 20.0 }, Side::Left).unwrap();
        for stretch in &fused {
            let both = (99.0..181.0).contains(&stretch.from_m);
            assert_eq!(stretch.opposing.second.is_some(), both, "{stretch:?}");
            assert_eq!(stretch.opposing.better().map(|(_, from)| from), Some(if both { 2 } else { 1 }));
        }
        // Never near, or nowhere at all.
        let mut elsewhere = bend(false, 0..400);
        elsewhere.scans.iter_mut().for_each(|scan| scan.place[0] += 0.01);
        assert!(fuse(&whole, &elsewhere, Every { metres: 20.0 }, Side::Left).is_none());
        let mut nowhere = bend(true, 0..400);
        nowhere.scans.iter_mut().for_each(|scan| scan.place = [f64::NAN; 3]);
        assert!(fuse(&nowhere, &part, Every { metres: 20.0 }, Side::Left).is_none());
        assert!(fuse(&whole, &nowhere, Every { metres: 20.0 }, Side::Left).is_none());
        assert!(fuse(&Drive::default(), &part, Every { metres: 20.0 }, Side::Left).is_none());
    }

    #[test]
    fn a_second_drive_the_same_way_measures_the_same_slopes() {
        let fused = fuse(
            &drive(true, [(-8.0, 0.3), (7.0, 0.1)]),
            &drive(true, [(-8.1, 0.1), (7.2, 0.3)]),
            Every { metres: 100.0 },
            Side::Left,
        );
        let fused = fused.unwrap();
        assert_eq!(fused[0].adjacent.better().map(|(_, from)| from), Some(2));
        assert!((fused[0].opposing.better().unwrap().0.value - 7.0).abs() < 1e-6);
    }
}
