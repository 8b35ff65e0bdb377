//! The seed's mode on roadsides drawn by hand: road, edge, both slopes, and what it says when something is missing.

#[path = "seed/scenes.rs"]
mod scenes;

use crossfall_core::profile::seed::{self, Criterion, Work, departure::departure, road::road_line};
use crossfall_core::protocol::config::Survey;
use crossfall_core::protocol::message::{Side, flags};
use crossfall_core::scan::Point;

use scenes::{Draw, Scanning, median, resampled};

/// A surface through corners (y, z) in metres, sampled every 100 mm.
fn surface(corners: &[(f64, f64)]) -> Vec<Point> {
    let last = corners[corners.len() - 1].0;
    (0..=(last * 10.0).round() as i32)
        .map(|k| {
            let y = f64::from(k) * 0.1;
            let ends = corners.windows(2).find(|w| y <= w[1].0 + 1e-9).expect("y is within the corners");
            let z = ends[0].1 + (y - ends[0].0) * (ends[1].1 - ends[0].1) / (ends[1].0 - ends[0].0);
            Point { y_um: k * 100_000, z_um: (z * 1e6).round() as i32 }
        })
        .collect()
}

fn survey(points: &[Point]) -> Side {
    seed::survey_side(points, &Survey::default(), &mut Work::new())
}

fn degrees(slope: Option<crossfall_core::protocol::message::Slope>) -> f64 {
    f64::from(slope.expect("the slope is found").angle.to_microdegrees()) * 1e-6
}

/// Road to 3.5 m, 1:6 down to 7.5 m, 1:8 up to 13.5 m, flat to 20 m.
const DITCH: [(f64, f64); 5] = [(0.0, -2.5), (3.5, -2.5), (7.5, -3.1667), (13.5, -2.4167), (20.0, -2.4167)];

#[test]
fn a_clean_v_ditch_gives_both_slopes_and_the_departures_at_their_hinges() {
    let side = survey(&surface(&DITCH));
    assert_eq!((side.flags, side.road.map(|a| a.to_microdegrees())), (0, Some(0)));
    // 25 mm below the road is reached 0.15 m past the edge on a slope of 1:6; distances are to the perpendicular.
    assert_eq!(side.edge.map(|e| (e.departure_um, e.y_um, e.ci95_um)), Some((3_700_000, 3_700_000, 0)));
    assert!((degrees(side.adjacent) + 9.462).abs() < 0.005, "{:?}", side.adjacent);
    // The most points within 25 mm are had by a line that is too flat and reaches into the flat beyond: the criterion's bias.
    assert!((6.85..7.125).contains(&degrees(side.opposing)), "{:?}", side.opposing);
    let (adjacent, opposing) = (side.adjacent.unwrap(), side.opposing.unwrap());
    // Every sample of the slope counts, and that past its foot which is still within 25 mm.
    assert_eq!((adjacent.start.departure_um, adjacent.end.departure_um, adjacent.points), (3_700_000, 7_600_000, 39));
    assert_eq!((opposing.start.departure_um, opposing.end.departure_um, opposing.points), (7_600_000, 14_000_000, 64));
    assert!((adjacent.length_um - 3_949_000).abs() < 1_000, "{adjacent:?}");
}

#[test]
fn a_road_that_never_departs_has_no_edge_and_an_empty_side_no_road() {
    let flat = survey(&surface(&[(0.0, -2.5), (20.0, -2.3)]));
    assert_eq!((flat.edge, flat.adjacent, flat.opposing, flat.flags), (None, None, None, 0));
    assert!((f64::from(flat.road.unwrap().to_microdegrees()) * 1e-6 - 0.573).abs() < 0.001);
    assert_eq!(survey(&[]), Side { flags: flags::NO_ROAD, ..Side::default() });
    let far: Vec<_> = surface(&DITCH).into_iter().filter(|p| p.y_um > 2_000_000).collect();
    assert_eq!(survey(&far), Side { flags: flags::NO_ROAD, ..Side::default() });
}

#[test]
fn a_slope_whose_end_is_out_of_sight_is_flagged() {
    let cut = surface(&DITCH[..4]);
    let side = survey(&cut);
    assert_eq!(side.flags, flags::END_UNSEEN);
    assert_eq!(side.opposing.map(|s| s.end.departure_um), Some(13_500_000));
    let side = survey(&cut[..70]);
    assert_eq!((side.flags, side.opposing), (flags::END_UNSEEN, None));
    assert!((degrees(side.adjacent) + 9.462).abs() < 0.005);
}

#[test]
fn slopes_outside_the_limits_are_none() {
    let gentle = [(0.0, -2.5), (3.5, -2.5), (7.5, -2.73), (20.0, -2.73)];
    assert_eq!(survey(&surface(&gentle)).adjacent, None, "3.3 degrees");
    let short = [(0.0, -2.5), (3.5, -2.5), (4.6, -2.7), (6.0, -3.6), (20.0, -3.6)];
    assert_eq!(survey(&surface(&short)).adjacent, None, "1.1 m, then 33 degrees");
    let rising = [(0.0, -2.5), (3.5, -2.5), (7.5, -1.9), (20.0, -1.9)];
    assert!((8.0..8.6).contains(&degrees(survey(&surface(&rising)).adjacent)), "in a cut the adjacent slope rises");
}

#[test]
fn a_post_between_edge_and_slope_obstructs() {
    let mut points = surface(&DITCH);
    // One point 0.3 m above the slope vetoes every line past it; the run of T2 points for a departure is not reached.
    points[45].z_um += 300_000;
    let adjacent = survey(&points).adjacent;
    assert!(adjacent.is_none(), "{adjacent:?}");
    points[45].z_um -= 60_000;
    assert!((degrees(survey(&points).adjacent) + 9.462).abs() < 0.005, "0.24 m above: it only does not count");
}

#[test]
fn the_road_line_is_the_least_squares_line_to_a_micrometre() {
    for seed in 0..500 {
        let mut draw = Draw::new(seed);
        let slope = draw.within(-0.2, 0.2);
        let points: Vec<_> = (0..draw.whole(5, 180))
            .map(|_| {
                let y_um = draw.whole(-2_500_000, 2_500_000);
                Point { y_um, z_um: (-2.5e6 + slope * f64::from(y_um) + 1e4 * draw.normal()) as i32 }
            })
            .collect();
        let under: Vec<_> = points.iter().filter(|p| p.y_um.abs() <= 2_000_000).collect();
        let Some(line) = road_line(&points) else {
            assert!(under.len() < 5, "seed {seed}: {} points", under.len());
            continue;
        };
        let n = under.len() as f64;
        let mean_y = under.iter().map(|p| f64::from(p.y_um)).sum::<f64>() / n;
        let mean_z = under.iter().map(|p| f64::from(p.z_um)).sum::<f64>() / n;
        let (mut spread, mut rise) = (0.0, 0.0);
        for p in under {
            spread += (f64::from(p.y_um) - mean_y).powi(2);
            rise += (f64::from(p.y_um) - mean_y) * (f64::from(p.z_um) - mean_z);
        }
        for y_um in [0, 1 << 23] {
            let height = mean_z + rise / spread * (f64::from(y_um) - mean_y);
            let above = line.offset(Point { y_um, z_um: 0 }) as f64 / f64::from(line.dy_um());
            // Half a micrometre of rounding, and up to one of the means rounded down.
            assert!((height + above).abs() < 1.6, "seed {seed}, {y_um}: {height} and {}", -above);
        }
    }
}

#[test]
fn departure_needs_every_one_of_its_points() {
    let survey = Survey::default();
    let criterion = Criterion::new(&survey.limits, &survey.seed);
    let mut points = surface(&[(0.0, -2.5), (8.0, -2.5)]);
    let road = road_line(&points).expect("a road");
    for k in [40, 41, 42] {
        points[k].z_um -= 50_001;
    }
    assert_eq!(departure(&points, road, &criterion), None, "three points beyond T1");
    points[43].z_um -= 50_000;
    assert_eq!(departure(&points, road, &criterion), None, "the fourth at T1 is not beyond it");
    points[43].z_um -= 1;
    assert_eq!(departure(&points, road, &criterion), Some(40));
    points[39].z_um -= 25_001;
    points[38].z_um -= 25_000;
    assert_eq!(departure(&points, road, &criterion), Some(39), "back as far as T3 is exceeded");
}

#[test]
fn medians_are_measured_as_well_as_the_paper_measured_them() {
    for (range_sigma_m, resample_um) in [(0.0035, Some(100_000)), (0.010, Some(100_000)), (0.010, None)] {
        let (mut errors, mut missing) = (Vec::new(), 0);
        for seed in 0..300 {
            let median = median(seed, Scanning { beams: 2.0, range_sigma_m, grass: false });
            let points = resample_um.map_or_else(|| median.points.clone(), |um| resampled(&median.points, um));
            let side = survey(&points);
            for (slope, truth_deg) in [(side.adjacent, median.adjacent_deg), (side.opposing, median.opposing_deg)] {
                match slope {
                    Some(slope) => errors.push((f64::from(slope.angle.to_microdegrees()) * 1e-6 - truth_deg).powi(2)),
                    None => missing += 1,
                }
            }
        }
        let rms = (errors.iter().sum::<f64>() / errors.len() as f64).sqrt();
        assert!(rms < 0.6 && missing <= 3, "{range_sigma_m} m: {rms} degrees RMS, {missing} missing");
    }
}
