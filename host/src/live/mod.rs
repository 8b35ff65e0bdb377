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

mod commands;
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

use crossfall_core::protocol::DeviceTime;
use crossfall_core::protocol::message::ScanMode;
use crossfall_core::scan::{MAX_BEAMS, RawScan};

pub use commands::{Refusal, Request};
pub use hub::{Cursor, Hub, News};
pub use lamps::{Lamp, Light};
pub use session::{Error, Live, Source};
pub use state::{Lamps, Phase, Recording, State};
pub use tape::drive_name;
pub use view::{Piece, Section, SideView, Strip};

/// Room for a scan that is about to be decoded.
fn empty_scan() -> RawScan {
    RawScan {
        index: 0,
        stx: DeviceTime(0),
        layout: 0,
        mode: ScanMode { span_deg: 180, step_cdeg: 50, measuring: 6 },
        status: 0,
        counters: None,
        values: [0; MAX_BEAMS],
    }
}
