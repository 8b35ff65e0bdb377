//! What the end-to-end tests share.
#![forbid(unsafe_code)]

pub mod emulator;
pub mod lms_emulator;
