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
}
