//! Profiles: from points of one side to road line, road edge, adjacent and opposing slope.

pub mod seed;
