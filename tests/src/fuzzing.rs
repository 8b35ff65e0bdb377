//! Everything that reads bytes from outside, as functions that a fuzzer drives: any input at all, and what must hold for it.
//!
//! `tests/fuzz` runs them under libFuzzer (`cargo xtask fuzz`), `tests/tests/fuzzing.rs` over the corpus and seeded mutations of it on a
//! stable compiler with every run of the suite. A target panics when an invariant breaks; inputs come from [`corpus`].

mod bytes;
pub mod corpus;
mod files;
mod frames;
mod instrument;
pub mod mutate;

/// A target: what to do with one input.
pub type Target = fn(&[u8]);

/// Every target by its name.
pub const TARGETS: [(&str, Target); 10] = [
    ("lms", bytes::lms),
    ("novatel", bytes::novatel),
    ("link", bytes::link),
    ("ranges", bytes::ranges),
    ("commands", bytes::commands),
    ("log_reader", files::log_reader),
    ("scene_toml", files::scene_toml),
    ("config_toml", files::config_toml),
    ("instrument", instrument::instrument),
    ("frames", frames::frames),
];

/// Runs the target of a name.
///
/// # Panics
/// When there is none, or an invariant does not hold for the input.
pub fn run(name: &str, input: &[u8]) {
    let (_, target) = TARGETS.iter().find(|(known, _)| *known == name).expect("a target of this name");
    target(input);
}
