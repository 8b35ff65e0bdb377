//! Accuracy of the measuring mode on simulated sections with fixed seeds: what it has reached, with a margin.
//!
//! The whole table, with the hard scenes, is printed by `cargo run --release -p crossfall-core --example accuracy`.

mod scenes;

use scenes::Family;
use scenes::tally::{Tally, run};

const SECTIONS: u32 = 250;

/// Bounds of one set: degrees RMS, adjacent and opposing, and percent.
struct Bounds {
    adjacent: f64,
    opposing: f64,
    found: f64,
    coverage: (f64, f64),
}

fn assert_within(tally: &Tally, bounds: &Bounds) {
    for (what, errors, rms) in
        [("adjacent", &tally.adjacent, bounds.adjacent), ("opposing", &tally.opposing, bounds.opposing)]
    {
        let name = tally.name;
        assert!(errors.rms() <= rms, "{name}: {what} {:.4} degrees RMS\n{tally}", errors.rms());
        assert!(errors.found() >= bounds.found, "{name}: {what} found {:.2} %\n{tally}", errors.found());
        assert!(errors.far_unflagged == 0, "{name}: {what} confidently wrong\n{tally}");
        let covered = errors.coverage();
        let (least, most) = bounds.coverage;
        assert!((least..=most).contains(&covered), "{name}: {what} intervals cover {covered:.1} %\n{tally}");
    }
}

// 500 sides: the standard error of a coverage of 95 % is 1 %.
const COVERAGE: (f64, f64) = (92.0, 98.5);

#[test]
fn slopes_are_at_the_sensors_limit_at_3_5_mm() {
    let tally = run(&Family::plain("3.5 mm", 0.0035), SECTIONS, 11);
    assert_within(&tally, &Bounds { adjacent: 0.017, opposing: 0.017, found: 100.0, coverage: COVERAGE });
    for (what, place) in [("edge", &tally.edge), ("foot", &tally.foot), ("start", &tally.start), ("top", &tally.top)] {
        assert!(place.rms() <= 20.0, "{what} {:.1} mm RMS\n{tally}", place.rms());
    }
}

#[test]
fn slopes_are_at_the_sensors_limit_at_10_mm() {
    let tally = run(&Family::plain("10 mm", 0.010), SECTIONS, 12);
    assert_within(&tally, &Bounds { adjacent: 0.045, opposing: 0.050, found: 100.0, coverage: COVERAGE });
    assert!(tally.edge.rms() <= 25.0, "edge {:.1} mm RMS\n{tally}", tally.edge.rms());
}

#[test]
fn vegetation_costs_little_at_3_5_mm() {
    let tally = run(&Family::grass("3.5 mm grass", 0.0035), SECTIONS, 13);
    assert_within(&tally, &Bounds { adjacent: 0.030, opposing: 0.035, found: 99.0, coverage: COVERAGE });
}

#[test]
fn vegetation_costs_little_at_10_mm() {
    let tally = run(&Family::grass("10 mm grass", 0.010), SECTIONS, 14);
    assert_within(&tally, &Bounds { adjacent: 0.070, opposing: 0.070, found: 99.0, coverage: COVERAGE });
    assert!(tally.adjacent.median() <= 0.033 && tally.opposing.median() <= 0.033, "{tally}");
}

#[test]
fn no_wild_slope_moves_a_large_set_in_vegetation() {
    // 16,000 sides: one that is off by four degrees would raise their RMS from 0.06 to 0.07.
    let tally = run(&Family::grass("10 mm grass", 0.010), 8000, 31);
    let coverage = (94.0, 96.5);
    for (what, errors) in [("adjacent", &tally.adjacent), ("opposing", &tally.opposing)] {
        assert!(errors.rms() <= 0.066, "{what} {:.4} degrees RMS\n{tally}", errors.rms());
        assert!(errors.median() <= 0.030, "{what} {:.4} degrees in the median\n{tally}", errors.median());
        assert!(errors.found() >= 99.6, "{what} found {:.2} %\n{tally}", errors.found());
        assert!(errors.far <= 4 && errors.far_unflagged <= 1, "{what} above one degree\n{tally}");
        let covered = errors.coverage();
        assert!((coverage.0..=coverage.1).contains(&covered), "{what} intervals cover {covered:.1} %\n{tally}");
    }
}

#[test]
fn intervals_know_of_rough_surfaces() {
    let family = Family { roughness_m: 0.005, ..Family::plain("rough 5 mm", 0.0035) };
    let tally = run(&family, SECTIONS, 15);
    assert_within(&tally, &Bounds { adjacent: 0.080, opposing: 0.070, found: 99.5, coverage: COVERAGE });
}

#[test]
fn slopes_of_all_inclinations_and_lengths_are_found() {
    let steep = Family { slopes_deg: (4.0, 18.0), ..Family::plain("4-18 degrees", 0.010) };
    let lengths = Family { adjacent_m: (1.5, 10.0), opposing_m: (1.5, 10.0), ..Family::plain("1.5-10 m", 0.010) };
    let rolling = Family { roll_deg: 5.0, ..Family::plain("roll", 0.010) };
    for (family, rms) in [(steep, 0.06), (lengths, 0.12), (rolling, 0.055)] {
        let tally = run(&family, SECTIONS, 16);
        assert_within(&tally, &Bounds { adjacent: rms, opposing: rms, found: 99.0, coverage: COVERAGE });
    }
}

#[test]
fn no_slope_is_invented() {
    let embankment = Family { has_opposing: false, ..Family::plain("no opposing slope", 0.010) };
    let tally = run(&embankment, SECTIONS, 17);
    assert_eq!(tally.opposing.invented, 0, "{tally}");
    let flat = Family { slopes_deg: (0.0, 3.0), ..Family::plain("flat", 0.010) };
    let tally = run(&flat, SECTIONS, 18);
    assert_eq!(tally.adjacent.values.len() + tally.opposing.values.len(), 0, "{tally}");
}

#[test]
fn what_hides_a_slope_is_flagged() {
    use crossfall_core::protocol::message::flags;
    let part = |tally: &Tally, flag: u16| tally.flagged[flag.trailing_zeros() as usize] as f64 / tally.sides as f64;
    let rail = run(&Family { guardrail: true, ..Family::plain("guardrail", 0.010) }, SECTIONS, 19);
    assert!(part(&rail, flags::OBSTRUCTED) > 0.9, "{rail}");
    assert_eq!(rail.adjacent.far_unflagged + rail.opposing.far_unflagged, 0, "{rail}");
    let grass = run(&Family::grass("grass", 0.0035), SECTIONS, 20);
    assert!(part(&grass, flags::VEGETATION) > 0.9, "{grass}");
    let clean = run(&Family::plain("clean", 0.0035), SECTIONS, 21);
    let unkind = flags::OBSTRUCTED | flags::VEGETATION | flags::DOUBTFUL | flags::HINGE_ROUNDED | flags::NO_ROAD;
    for bit in 0..16 {
        assert!(unkind >> bit & 1 == 0 || clean.flagged[bit] <= 5, "{clean}");
    }
}
