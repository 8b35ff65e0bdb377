//! Prints how well the measuring mode does on simulated sections: `cargo run --release --example accuracy [sections]`.

#[path = "../tests/scenes/mod.rs"]
mod scenes;

use scenes::{Family, tally};

fn main() {
    let sections = std::env::args().nth(1).and_then(|a| a.parse().ok()).unwrap_or(1000);
    let families = [
        Family::plain("3.5 mm", 0.0035),
        Family::plain("10 mm", 0.010),
        Family::grass("3.5 mm grass", 0.0035),
        Family::grass("10 mm grass", 0.010),
    ];
    println!("{}", tally::HEADER);
    for family in &families {
        print!("{}", tally::run(family, sections, 1));
    }
    for family in rough().iter().chain(&hard()) {
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
