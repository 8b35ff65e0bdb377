//! The core's memory is a constant: what a board has to set aside for the whole instrument.

use core::mem::size_of;

use crossfall_core::instrument::{Decode, Instrument, Survey, WAITING};
use crossfall_core::profile::Workspace;
use crossfall_core::scan::RawScan;
use crossfall_core::sensors::{cola, lms2xx, novatel};

/// Issued to the core on a board with 192 KiB of RAM.
const BUDGET: usize = 48 * 1024;

#[test]
fn the_instrument_fits_its_budget() {
    for (what, bytes) in [
        ("instrument", size_of::<Instrument>()),
        ("  decode layer", size_of::<Decode>()),
        ("    scanner's decoder", size_of::<lms2xx::Decoder>()),
        ("    inertial unit's decoder", size_of::<novatel::Decoder>()),
        ("instrument with the other scanner", size_of::<Instrument<cola::Decoder>>()),
        ("  survey layer", size_of::<Survey>()),
        ("    waiting scans", WAITING * size_of::<RawScan>()),
        ("    profile workspace", size_of::<Workspace>()),
    ] {
        println!("{what:34} {bytes:6} bytes");
    }
    assert!(size_of::<Instrument<cola::Decoder>>() <= BUDGET);
    assert!(size_of::<Instrument>() <= BUDGET, "{} bytes", size_of::<Instrument>());
}
