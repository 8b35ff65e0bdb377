#![no_main]

libfuzzer_sys::fuzz_target!(|input: &[u8]| crossfall_tests::fuzzing::run("frames", input));
