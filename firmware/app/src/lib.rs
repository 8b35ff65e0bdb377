//! The embassy tasks of a crossfall board, generic over its lines, lights and stamps.
#![no_std]
#![forbid(unsafe_code)]

pub mod line;
