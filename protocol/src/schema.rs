//! The identity of the wire: a hash over everything that a receiver must know to read a frame.
//!
//! `postcard-schema` derives a description of every type from its definition and hashes it (FNV-1a, 64 bits): names
//! and order of fields and variants, and the types of all. It is computed by the compiler. What the types do not show -
//! the framing, the code of the ranges, how a scan's format is packed - has version numbers of its own in [`WIRE`].
//!
//! A host compares [`HASH`] with the one in a board's hello. Where they differ it says so, and logs all the same.

use postcard_schema::key::hash::fnv1a64::hash_ty_path;

use crate::message::{Command, Message};

/// The parts of the wire that no type shows. A change of any of them must change this text.
pub const WIRE: &str = "crossfall/frame 1/ranges 1/format 1";

/// Hash of the link's schema, both directions.
pub const HASH: u64 = {
    let to_host = u64::from_le_bytes(hash_ty_path::<Message<'static>>(WIRE));
    let to_board = u64::from_le_bytes(hash_ty_path::<Command>(WIRE));
    // Rotated so that the two directions cannot change places.
    to_host ^ to_board.rotate_left(32)
};
