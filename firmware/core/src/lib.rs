//! The crossfall instrument as pure state machines: no I/O, no clock of its own, no heap.
//!
//! In the order of the data: [`sensors`] finds telegrams and frames in bytes that may be damaged, [`clock`] ties the inertial unit's time to the board's by
//! the pulse per second, [`attitude`] keeps the poses and interpolates them, [`scan`] levels a scan beam by beam, [`profile`] finds road, edges and
//! slopes in it. [`instrument`] is all of it behind one door, bytes and instants in and messages out; a board and a desk run the same. [`trig`] has
//! the angles' functions in integers. [`terrain`] stands by itself: the map of elevation and driving risk, from 3-D frames or from scans.
//!
//! Nothing here can panic, by a link-time proof; everything but the map computes in integers, to the same bits everywhere.
#![no_std]
#![forbid(unsafe_code)]

pub mod attitude;
pub mod clock;
pub mod instrument;
pub mod profile;
pub mod scan;
pub mod sensors;
pub mod terrain;
pub mod trig;

pub use crossfall_protocol as protocol;
