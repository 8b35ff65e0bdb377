//! What the instrument produces, before it is coded for the link.

use crossfall_protocol::message::{Message, Scan};
use crossfall_protocol::ranges::{self, MAX_CODE, RangeError};

use crate::scan::{MAX_BEAMS, RawScan};

/// One thing that happened. Everything but a scan is a message already; a scan's ranges are coded only where they leave the core.
#[derive(Clone, Copy, Debug)]
#[expect(clippy::large_enum_variant, reason = "events are passed on as they occur and never stored")]
pub enum Event<'a> {
    /// A scan was decoded.
    Scan(&'a RawScan),
    /// Anything else.
    Message(Message<'a>),
}

impl<'a> Event<'a> {
    /// The message that carries this event over the link. `room` takes the code of a scan's ranges.
    #[must_use]
    pub fn message(&self, room: &'a mut [u8; MAX_CODE]) -> Message<'a> {
        match *self {
            Self::Message(message) => message,
            Self::Scan(scan) => Message::Scan(Scan {
                index: scan.index,
                stx: scan.stx,
                layout: scan.layout,
                mode: scan.mode,
                status: scan.status,
                counters: scan.counters,
                code: ranges::encode(scan.layout, scan.mode, scan.ranges(), room),
            }),
        }
    }

    /// The event that a message carried. `room` takes a scan.
    ///
    /// # Errors
    /// When the code of a scan's ranges is not one that the board makes.
    pub fn of(message: &Message<'a>, room: &'a mut RawScan) -> Result<Self, RangeError> {
        let Message::Scan(scan) = message else { return Ok(Self::Message(*message)) };
        let mut values = [0; MAX_BEAMS];
        scan.values(&mut values)?;
        *room = RawScan {
            index: scan.index,
            stx: scan.stx,
            layout: scan.layout,
            mode: scan.mode,
            status: scan.status,
            counters: scan.counters,
            values,
        };
        Ok(Self::Scan(room))
    }
}
