//! The `crossfall` command.
#![forbid(unsafe_code)]

fn main() {}
