//! Writes `docs/scenes.md`: `cargo run --release -p crossfall-core --example second_family [SECTIONS] > docs/scenes.md`.

#[path = "../tests/families/mod.rs"]
mod families;
#[path = "../tests/scenes/mod.rs"]
mod scenes;

use crossfall_core::protocol::message::flags;
use scenes::tally::{Errors, Tally, run};

const SEED: u64 = 41;

const HEAD: &str = "\
# Hard sections

The second family of scenes: the sections of [performance.md](performance.md), each set with one thing that makes it hard. Written by
`cargo run --release -p crossfall-core --example second_family > docs/scenes.md`; `firmware/core/tests/hard_sections.rs` holds other seeds to bounds.
Every cell is adjacent / opposing. *Found*: reported of those there are. *Above 1 degree*: of those found, and in brackets those of them that carry none of the
flags `doubtful` and `obstructed`. *False*: reported slopes where there is none, and in brackets those without these flags, of so many sides.
";

fn main() {
    let sections = std::env::args().nth(1).and_then(|text| text.parse().ok()).unwrap_or(1000);
    println!("{HEAD}");
    for (name, noise_m) in [("3.5 mm", 0.0035), ("10 mm", 0.010)] {
        println!("## {name} range noise, {sections} sections a set, both sides\n");
        println!(
            "| set | found, % | RMS, degrees | median, degrees | above 1 degree | 95 % interval holds, % | false | flags on more than 2 % of the sides |"
        );
        println!("|---|---|---|---|---|---|---|---|");
        for family in families::second(noise_m) {
            let tally = run(&family, sections, SEED);
            println!("{}", row(&tally, has_slopes(&family)));
        }
        println!();
    }
    print!("{FOOT}");
}

const FOOT: &str = "\
What the table says: inclinations, lengths, V ditches, dropouts, roll and cuts are no trouble; the bank of a cut is an adjacent slope above zero. Where a rail hides the edge of the slope, or half of what is seen is
grass, slopes are lost and some of those found are off by more than a degree; the sections that do it say so in their flags, but for the share in brackets. At a rounded edge slope and edge are right, the edge being where the
two lines meet; `hinge_rounded` says so where the rounding, nine millimetres at its deepest, stands out of the noise. Ground that undulates is measured against the best line over the whole of each slope: 8 mm (one sigma, waves
of 2 to 12 m) are followed; at 15 mm one slope in twelve is still measured by a piece of it, mostly flagged, and intervals are too narrow.
";

fn row(tally: &Tally, has_slopes: bool) -> String {
    let pair = |of: &dyn Fn(&Errors) -> String| format!("{} / {}", of(&tally.adjacent), of(&tally.opposing));
    let found = |e: &Errors| if has_slopes && e.expected > 0 { format!("{:.1}", e.found()) } else { "-".to_owned() };
    let of_found = |e: &Errors, text: String| if e.values.is_empty() || !has_slopes { "-".to_owned() } else { text };
    let false_ones = if has_slopes {
        format!("{} ({}) / {} ({})", 0, 0, tally.opposing.invented, tally.opposing.invented_unflagged)
    } else {
        // Nothing of these sections counts as a slope, so what was found was made up.
        format!("{} / {}", tally.adjacent.values.len(), tally.opposing.values.len())
    };
    let part = |count: usize| 100.0 * count as f64 / tally.sides as f64;
    let named = flags::NAMES.iter().zip(tally.flagged).filter(|(_, count)| part(*count) > 2.0);
    let flagged: Vec<String> = named.map(|(name, count)| format!("`{name}` {:.0} %", part(count))).collect();
    format!(
        "| {} | {} | {} | {} | {} | {} | {false_ones} of {} | {} |",
        tally.name,
        pair(&found),
        pair(&|e| of_found(e, format!("{:.3}", e.rms()))),
        pair(&|e| of_found(e, format!("{:.3}", e.median()))),
        pair(&|e| of_found(e, format!("{} ({})", e.far, e.far_unflagged))),
        pair(&|e| of_found(e, format!("{:.1}", e.coverage()))),
        tally.sides,
        flagged.join(", ")
    )
}

/// Whether the sections of a set have slopes that count as such.
fn has_slopes(family: &scenes::Family) -> bool {
    family.slopes_deg.1 >= 4.0
}
