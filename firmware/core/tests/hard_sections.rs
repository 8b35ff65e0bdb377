//! The second family of scenes: what is hard is found and right, or says of itself that it may not be.
//!
//! The whole table is `docs/scenes.md`, written by the example `second_family`.

mod families;
mod scenes;

use crossfall_core::protocol::message::flags;
use scenes::Family;
use scenes::tally::{Errors, Tally, run};

const SECTIONS: u32 = 200;

/// A set by the name that the table gives it.
fn set(name: &str, noise_m: f64) -> Family {
    families::second(noise_m).into_iter().find(|family| family.name == name).expect("a set of that name")
}

fn share(count: usize, of: usize) -> f64 {
    100.0 * count as f64 / of.max(1) as f64
}

fn flagged(tally: &Tally, flag: u16) -> f64 {
    share(tally.flagged[flag.trailing_zeros() as usize], tally.sides)
}

fn both(tally: &Tally) -> [(&'static str, &Errors); 2] {
    [("adjacent", &tally.adjacent), ("opposing", &tally.opposing)]
}

#[test]
fn what_is_only_unusual_is_found_and_right() {
    for (seed, name) in
        ["4 to 18 degrees", "1.5 to 10 m", "V ditch", "edge rounded over 0.5 m", "dropouts 10 %", "roll to 5 degrees"]
            .into_iter()
            .enumerate()
    {
        for noise_m in [0.0035, 0.010] {
            let tally = run(&set(name, noise_m), SECTIONS, 500 + seed as u64);
            for (slope, errors) in both(&tally) {
                assert!(errors.found() >= 99.0, "{name}: {slope} found {:.1} %\n{tally}", errors.found());
                assert_eq!(errors.far_unflagged, 0, "{name}: {slope} off by more than a degree, unflagged\n{tally}");
                assert!(errors.rms() <= 0.12, "{name}: {slope} {:.3} degrees RMS\n{tally}", errors.rms());
            }
        }
    }
}

#[test]
fn what_is_not_there_is_not_reported() {
    for name in ["no opposing slope", "no opposing slope, grass"] {
        for noise_m in [0.0035, 0.010] {
            let tally = run(&set(name, noise_m), SECTIONS, 600);
            // One side in a hundred at most, and none of these unflagged but in grass.
            let invented = share(tally.opposing.invented, tally.sides);
            assert!(invented <= 1.0, "{name}: {invented:.1} %\n{tally}");
            assert!(share(tally.opposing.invented_unflagged, tally.sides) <= 0.5, "{name}\n{tally}");
        }
    }
    for name in ["flat, below the limits", "flat, grass"] {
        for noise_m in [0.0035, 0.010] {
            let tally = run(&set(name, noise_m), SECTIONS, 601);
            let made_up = tally.adjacent.values.len() + tally.opposing.values.len();
            assert!(share(made_up, tally.sides) <= 0.5, "{name}: {made_up}\n{tally}");
        }
    }
}

#[test]
fn undulating_ground_is_one_slope() {
    // Heights of 15 mm in waves of two metres and more tilt pieces of a slope by more than a degree: what cannot be followed is doubtful.
    for (name, rms, silent, doubtful) in [("undulation 8 mm", 0.2, 0.3, 8.0), ("undulation 15 mm", 0.5, 2.5, 25.0)] {
        for noise_m in [0.0035, 0.010] {
            let tally = run(&set(name, noise_m), SECTIONS, 900);
            for (slope, errors) in both(&tally) {
                assert!(errors.found() >= 86.0, "{name}: {slope} found {:.1} %\n{tally}", errors.found());
                assert!(errors.rms() <= rms, "{name}: {slope} {:.3} degrees RMS\n{tally}", errors.rms());
                let wrong = share(errors.far_unflagged, errors.values.len());
                assert!(wrong <= silent, "{name}: {slope}: {wrong:.2} % wrong in silence\n{tally}");
            }
            assert!(flagged(&tally, flags::DOUBTFUL) <= doubtful, "{tally}");
        }
    }
}

#[test]
fn a_road_in_a_cut_has_an_adjacent_slope_that_rises() {
    for name in ["cut", "cut, grass"] {
        for noise_m in [0.0035, 0.010] {
            let tally = run(&set(name, noise_m), SECTIONS, 901);
            let adjacent = &tally.adjacent;
            // Errors are signed: a slope that was reported as falling would be off by ten degrees.
            assert!(adjacent.found() >= 99.0 && adjacent.far == 0, "{tally}");
            assert!(adjacent.rms() <= 0.1, "{tally}");
            assert!((90.0..99.0).contains(&adjacent.coverage()), "{tally}");
            assert!(tally.edge.rms() <= 40.0, "{tally}");
            assert_eq!(tally.opposing.invented, 0, "nothing faces a bank\n{tally}");
        }
    }
}

#[test]
fn flags_tell_what_is_wrong_with_a_section() {
    for noise_m in [0.0035, 0.010] {
        let rail = run(&set("guardrail", noise_m), SECTIONS, 700);
        assert!(flagged(&rail, flags::OBSTRUCTED) >= 90.0, "{rail}");
        let grass = run(&set("grass 50 %", noise_m), SECTIONS, 701);
        assert!(flagged(&grass, flags::VEGETATION) >= 90.0, "{grass}");
        let clean = run(&set("V ditch", noise_m), SECTIONS, 703);
        for flag in [flags::OBSTRUCTED, flags::VEGETATION, flags::DOUBTFUL, flags::NO_ROAD] {
            assert!(flagged(&clean, flag) <= 1.0, "{clean}");
        }
    }
    // Half a metre of rounding lies nine millimetres below the corner: seen where beams are close, and harmless where they are not.
    let rounded = run(&set("edge rounded over 0.5 m", 0.0035), 2 * SECTIONS, 702);
    assert!(flagged(&rounded, flags::HINGE_ROUNDED) >= 5.0, "{rounded}");
    assert!(rounded.edge.rms() <= 20.0, "where the lines meet is found all the same\n{rounded}");
    assert!(rounded.adjacent.rms() <= 0.022, "the slope is not pulled down to its rounded end\n{rounded}");
    let sharp = run(&set("4 to 18 degrees", 0.0035), SECTIONS, 704);
    assert!(flagged(&sharp, flags::HINGE_ROUNDED) <= 2.0, "{sharp}");
}

#[test]
fn what_is_off_by_more_than_a_degree_says_so() {
    for (seed, name) in ["guardrail", "grass 50 %"].into_iter().enumerate() {
        for noise_m in [0.0035, 0.010] {
            let tally = run(&set(name, noise_m), 2 * SECTIONS, 800 + seed as u64);
            for (slope, errors) in both(&tally) {
                let silent = share(errors.far_unflagged, errors.values.len());
                assert!(silent <= 0.4, "{name}: {slope}: {silent:.2} % wrong in silence\n{tally}");
            }
        }
    }
}
