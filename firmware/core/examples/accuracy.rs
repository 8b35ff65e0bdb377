//! Prints how well the measuring mode does on simulated sections: `cargo run --release --example accuracy [sections] [word]`.

#[path = "../tests/scenes/mod.rs"]
mod scenes;

use scenes::{Family, tally};

fn main() {
    let sections = std::env::args().nth(1).and_then(|a| a.parse().ok()).unwrap_or(1000);
    // The sets whose names hold a word, or all.
    let word = std::env::args().nth(2).unwrap_or_default();
    let families = [
        Family::plain("3.5 mm", 0.0035),
        Family::plain("10 mm", 0.010),
        Family::grass("3.5 mm grass", 0.0035),
        Family::grass("10 mm grass", 0.010),
    ];
    println!("{}", tally::HEADER);
    for family in families.iter().filter(|family| family.name.contains(&word)) {
        print!("{}", tally::run(family, sections, 1));
    }
    for family in rough().iter().chain(&hard()).chain(&uneven()).filter(|family| family.name.contains(&word)) {
        print!("{}", tally::run(family, sections, 2));
    }
}

/// The plain sets on rough surfaces.
fn rough() -> Vec<Family> {
    let set = |name, noise_m, roughness_m| Family { roughness_m, ..Family::plain(name, noise_m) };
    vec![
        set("3.5 mm, rough 2 mm", 0.0035, 0.002),
        set("3.5 mm, rough 5 mm", 0.0035, 0.005),
        set("10 mm, rough 2 mm", 0.010, 0.002),
        set("10 mm, rough 5 mm", 0.010, 0.005),
    ]
}

/// Ground that is not straight, and roads in a cut.
fn uneven() -> Vec<Family> {
    let waves = |name, noise_m, undulation_m| Family {
        undulation_m,
        adjacent_m: (5.0, 8.0),
        opposing_m: (5.0, 8.0),
        ..Family::plain(name, noise_m)
    };
    vec![
        waves("3.5 mm, waves 4 mm", 0.0035, 0.004),
        waves("3.5 mm, waves 8 mm", 0.0035, 0.008),
        waves("3.5 mm, waves 15 mm", 0.0035, 0.015),
        waves("10 mm, waves 8 mm", 0.010, 0.008),
        waves("10 mm, waves 15 mm", 0.010, 0.015),
        Family { grass: 0.3, strays: 0.01, ..waves("10 mm, waves 8, grass", 0.010, 0.008) },
        Family { cut: true, ..Family::plain("cut, 3.5 mm", 0.0035) },
        Family { cut: true, ..Family::plain("cut, 10 mm", 0.010) },
        Family { cut: true, ..Family::grass("cut, 10 mm grass", 0.010) },
    ]
}

/// Sections that a survey meets and would rather not.
fn hard() -> Vec<Family> {
    let plain = |name| Family::plain(name, 0.010);
    vec![
        Family { slopes_deg: (4.0, 18.0), ..plain("4-18 degrees") },
        Family { adjacent_m: (1.5, 10.0), opposing_m: (1.5, 10.0), ..plain("1.5-10 m") },
        Family { ditch_m: (0.0, 0.0), ..plain("V ditch") },
        Family { rounded_m: 0.5, ..plain("rounded edge 0.5 m") },
        Family { rounded_m: 0.5, ..Family::plain("rounded, 3.5 mm", 0.0035) },
        Family { guardrail: true, ..plain("guardrail") },
        Family { grass: 0.5, ..Family::grass("grass 50 %", 0.010) },
        Family { grass: 0.7, ..Family::grass("grass 70 %", 0.010) },
        Family { dropouts: 0.1, ..plain("dropouts 10 %") },
        Family { roll_deg: 5.0, ..plain("roll 5 degrees") },
        Family { has_opposing: false, ..plain("no opposing slope") },
        Family { has_opposing: false, ..Family::grass("no opposing, grass", 0.010) },
        Family { slopes_deg: (0.0, 3.0), ..plain("flat, below limits") },
        Family { slopes_deg: (0.0, 3.0), ..Family::grass("flat, grass", 0.010) },
        Family { unit_um: 10_000, ..plain("centimetre mode") },
    ]
}
