//! The fuzz targets over their corpus and seeded mutations of it, on a stable compiler. libFuzzer itself: `cargo xtask fuzz`.

use std::panic::{AssertUnwindSafe, catch_unwind};

use crossfall_tests::fuzzing::mutate::{Draw, mutate};
use crossfall_tests::fuzzing::{corpus, run};

/// Mutations of each target.
const MUTATIONS: u64 = 300;

/// The same under `cargo xtask test --long`.
const LONG: u64 = 30_000;

#[test]
fn every_target_holds_over_its_corpus_and_mutations_of_it() {
    let scratch = tempfile::tempdir().expect("a scratch folder");
    let mutations = if std::env::var_os("CROSSFALL_LONG").is_some() { LONG } else { MUTATIONS };
    for (name, inputs) in corpus::make(scratch.path()) {
        assert!(!inputs.is_empty(), "{name} has a corpus");
        for input in &inputs {
            run(name, input);
        }
        for seed in 0..mutations {
            let mut draw = Draw::new(seed);
            let mut input = inputs[draw.below(inputs.len())].clone();
            // Damages come together.
            for _ in 0..=seed % 4 {
                mutate(&mut input, &inputs[draw.below(inputs.len())], &mut draw);
            }
            let kept = input.clone();
            let held = catch_unwind(AssertUnwindSafe(|| run(name, &input)));
            assert!(
                held.is_ok(),
                "target {name}, seed {seed}: {} bytes: {:02X?}",
                kept.len(),
                &kept[..kept.len().min(64)]
            );
        }
    }
}
