//! The seed's search finds what trying all pairs finds, bit for bit.
//!
//! More searches than the normal run's: `CROSSFALL_SEED_SEARCHES=1000000 cargo test --release -p crossfall-core --test seed_search`.

#[path = "seed/oracle.rs"]
mod oracle;
#[path = "seed/scenes.rs"]
mod scenes;

use crossfall_core::profile::seed::{self, Criterion, Work, road};
use crossfall_core::protocol::Angle;
use crossfall_core::protocol::config::{Limits, Seed, Survey};
use crossfall_core::scan::Point;

use oracle::{Best, Line, exhaust};
use scenes::{Draw, Scanning, UNKIND, Unkind, median, resampled, unkind};

/// Searches both slopes as the survey does, and compares each with the exhaustive search. Returns the number of searches.
fn compare(points: &[Point], edge: usize, survey: &Survey, what: &str) -> u64 {
    let criterion = Criterion::new(&survey.limits, &survey.seed);
    let mut work = Work::new();
    let mut from = edge;
    for nth in 1..=2 {
        let found = seed::search(points, from, &criterion, &mut work).map(|s| Best {
            start: s.start,
            through: s.through,
            end: s.end,
            end_seen: s.end_seen,
            points: s.points,
        });
        let wanted = exhaust(points, from, survey).best;
        assert_eq!(found, wanted, "{what}, search {nth} from point {from} of {}, {survey:?}", points.len());
        match wanted {
            Some(best) if best.end_seen => from = best.end,
            _ => return nth,
        }
    }
    2
}

/// How many searches a test makes: its share of those asked for.
fn searches(share_percent: u64) -> u64 {
    let asked = std::env::var("CROSSFALL_SEED_SEARCHES").ok();
    let all = asked.map_or(24_000, |text| text.parse().expect("CROSSFALL_SEED_SEARCHES is a number of searches"));
    all * share_percent / 100
}

/// Limits and thresholds within the criterion's own range, some of them odd.
fn odd_survey(draw: &mut Draw) -> Survey {
    let degrees = |draw: &mut Draw, low, high| Angle::from_microdegrees(draw.whole(low * 1_000_000, high * 1_000_000));
    Survey {
        limits: Limits {
            min_length_um: draw.whole(0, 3_000_000),
            max_length_um: draw.whole(1_000_000, 12_000_000),
            min_slope: degrees(draw, 0, 8),
            max_slope: degrees(draw, 3, 45),
            obstruction_um: draw.whole(0, 500_000),
        },
        seed: Seed {
            spacing_um: 100_000,
            inlier_um: draw.whole(0, 60_000),
            departure_um: draw.whole(0, 120_000),
            departure_points: draw.whole(0, 6) as u8,
            onset_um: draw.whole(0, 100_000),
        },
        ..Survey::default()
    }
}

#[test]
fn unkind_points_give_what_trying_all_pairs_gives() {
    let (mut done, mut seed) = (0, 0);
    while done < searches(45) {
        for kind in UNKIND {
            let points = unkind(kind, seed, 48);
            let within = points.iter().take_while(|p| p.y_um.abs().max(p.z_um.abs()) < 1 << 29).count();
            done += compare(&points[..within], 0, &Survey::default(), &format!("{kind:?} {seed}"));
        }
        seed += 1;
    }
}

#[test]
fn odd_limits_give_what_trying_all_pairs_gives() {
    let (mut done, mut seed) = (0, 1 << 40);
    while done < searches(30) {
        for kind in UNKIND {
            let points = unkind(kind, seed, 36);
            let within = points.iter().take_while(|p| p.y_um.abs().max(p.z_um.abs()) < 1 << 29).count();
            let mut draw = Draw::new(seed);
            let edge = draw.whole(0, 3) as usize;
            let survey = odd_survey(&mut draw);
            done += compare(&points[..within], edge.min(within), &survey, &format!("{kind:?} {seed}"));
        }
        seed += 1;
    }
}

#[test]
fn scanned_medians_give_what_trying_all_pairs_gives() {
    let (mut done, mut seed) = (0, 2 << 40);
    while done < searches(25) {
        for (range_sigma_m, grass) in [(0.0035, false), (0.010, false), (0.010, true)] {
            // One scan in eight at the scanner's own half degree, the others thinned out for the oracle's sake.
            let beams = if seed % 8 == 0 { 2.0 } else { 0.8 };
            let median = median(seed, Scanning { beams, range_sigma_m, grass });
            for points in
                [median.points.clone(), resampled(&median.points, if seed % 8 == 0 { 100_000 } else { 250_000 })]
            {
                let survey = Survey::default();
                let criterion = Criterion::new(&survey.limits, &survey.seed);
                let Some(line) = road::road_line(&points) else { continue };
                let Some(edge) = seed::departure::departure(&points, line, &criterion) else { continue };
                let pins = [0, 1 << 23].map(|y_um| height_on(&line, y_um));
                assert_eq!(Some(edge), oracle::departure(&points, 0, Line(pins[0], pins[1]), &survey), "median {seed}");
                done += compare(&points, edge, &survey, &format!("median {seed}"));
            }
        }
        seed += 1;
    }
}

/// A point of the road line at one of the two places where it is pinned to whole micrometres.
fn height_on(line: &seed::line::Line, y_um: i32) -> Point {
    let below = line.offset(Point { y_um, z_um: 0 }) / i64::from(line.dy_um());
    Point { y_um, z_um: -below as i32 }
}

#[test]
fn a_survey_is_its_road_edge_and_two_searches() {
    for seed in 0..400 {
        let median = median(seed, Scanning { beams: 1.0, range_sigma_m: 0.010, grass: seed % 2 == 0 });
        let survey = Survey::default();
        let side = seed::survey_side(&median.points, &survey, &mut Work::new());
        let Some(edge) = side.edge else { continue };
        let edge = median.points.iter().position(|p| p.y_um == edge.departure_um).expect("the edge is a point");
        let adjacent = exhaust(&median.points, edge, &survey).best;
        assert_eq!(side.adjacent.map(|s| s.points), adjacent.map(|b| b.points as u16));
        let Some(adjacent) = adjacent else { continue };
        let opposing = exhaust(&median.points, adjacent.end, &survey).best;
        let place = |at: usize| median.points[at].y_um;
        let found = side.opposing.map(|s| (s.start.departure_um, s.end.departure_um));
        assert_eq!(found, opposing.map(|b| (place(b.start), place(b.end))), "median {seed}");
    }
}

#[test]
fn points_of_every_kind_and_any_limits_are_survived() {
    let extremes = [i32::MIN, -1, 0, 1, i32::MAX];
    let mut work = Work::new();
    for seed in 0..2_000 {
        for kind in UNKIND {
            let points = unkind(kind, seed, 40);
            let mut draw = Draw::new(seed);
            let mut any = || extremes[draw.whole(0, 4) as usize];
            let survey = Survey {
                limits: Limits {
                    min_length_um: any(),
                    max_length_um: any(),
                    min_slope: Angle(any()),
                    max_slope: Angle(any()),
                    obstruction_um: any(),
                },
                seed: Seed {
                    spacing_um: any(),
                    inlier_um: any(),
                    departure_um: any(),
                    departure_points: any() as u8,
                    onset_um: any(),
                },
                ..Survey::default()
            };
            let side = seed::survey_side(&points, &survey, &mut work);
            assert!(side.opposing.is_none() || side.adjacent.is_some(), "{kind:?} {seed}");
            let _ = seed::survey_side(&points, &Survey::default(), &mut work);
        }
    }
    assert_eq!(unkind(Unkind::Few, 0, 40), []);
}
