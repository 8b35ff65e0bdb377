//! A drive as it happens, for any number of viewers: the page of `serve` and the terminal of `monitor` look at this.
//!
//! ```text
//! port or film ── record::converse ──> Tape: log, when recording ──> channel ──> Model ──> Hub <── viewers
//!                        ^                                                                  │
//!                        └───────────────────── Outbox <──────── commands ──────────────────┘
//! ```
//!
//! The recording never waits for a viewer: the channel to the model is bounded and what finds no room in it is counted, not waited for;
//! viewers fetch from the hub what is new to them when they can take it. A slow one gets fewer sections and the same charts.

mod account;
mod commands;
mod drive_name;
mod faults;
pub mod film;
mod hub;
mod lamps;
mod model;
pub mod player;
mod rock_test;
mod session;
mod state;
mod tape;
mod track_sketch;
mod view;

pub use commands::{Refusal, Request};
pub use drive_name::DriveName;
pub use hub::{Cursor, Hub, News};
pub use lamps::{Lamp, Light};
pub use session::{Error, Live, Source};
pub use state::{Lamps, Phase, Recording, State};
pub use tape::Logs;
pub use view::{Piece, Section, SideView, Strip};
