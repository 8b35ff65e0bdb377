//! Hands the linker the memory map and the scripts of cortex-m-rt and defmt. They are passed here and not in
//! `.cargo/config.toml` so that a `RUSTFLAGS` in the environment cannot lose them.

use std::{env, fs, path::PathBuf};

fn main() {
    let out = PathBuf::from(env::var_os("OUT_DIR").expect("cargo sets OUT_DIR"));
    fs::write(out.join("memory.x"), include_bytes!("memory.x")).expect("OUT_DIR is writable");
    println!("cargo:rustc-link-search={}", out.display());
    println!("cargo:rerun-if-changed=memory.x");
    println!("cargo:rerun-if-changed=build.rs");
    for argument in ["--nmagic", "-Tlink.x", "-Tdefmt.x"] {
        println!("cargo:rustc-link-arg-bins={argument}");
    }
    // The bench keeps its state on the stack, which may be all of the core-coupled RAM there.
    println!("cargo:rustc-link-arg-bin=crossfall-bench=--defsym=_stack_start=0x10010000");
}
