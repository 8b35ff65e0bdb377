//! From the bytes of the link to the frames of the log.

use std::collections::BTreeMap;
use std::time::Instant;

use crossfall_core::protocol::frame::{Event, Gap, HostDecoder, MAX_MESSAGE_FRAME, Sequence};
use crossfall_core::protocol::message::Message;

use super::{Keeper, Notice, Summary, Tape};
use crate::log::metadata::{self, Entries};
use crate::output;

/// The host's end of the link.
pub struct Link {
    decoder: HostDecoder,
    sequence: Sequence,
    /// The metadata written so far, by name.
    described: BTreeMap<&'static str, Entries>,
    /// Who sees to the board's configuration.
    pub keeper: Keeper,
    /// Receive time of the last bytes.
    latest_ns: u64,
}

impl Link {
    /// One that has received nothing.
    pub fn new(keeper: Keeper) -> Self {
        Self {
            decoder: HostDecoder::new(),
            sequence: Sequence::new(),
            described: BTreeMap::new(),
            keeper,
            latest_ns: 0,
        }
    }

    /// The next bytes.
    pub fn take(
        &mut self,
        receive_ns: u64,
        mut bytes: &[u8],
        log: &mut impl Tape,
        summary: &mut Summary,
        notice: &mut impl FnMut(Notice),
    ) -> Result<(), output::Error> {
        self.latest_ns = receive_ns;
        while !bytes.is_empty() {
            // No more than fills the longest frame: the decoder keeps nothing beyond it, the log everything.
            let pending = usize::try_from(self.decoder.pending()).unwrap_or(usize::MAX);
            let room = MAX_MESSAGE_FRAME.saturating_sub(pending).max(1);
            let (mut part, rest) = bytes.split_at(room.min(bytes.len()));
            bytes = rest;
            while let Some(event) = self.decoder.next(&mut part) {
                match event {
                    Event::Frame(frame) => {
                        count(summary, frame.raw);
                        let gap = self.sequence.observe_message(frame.sequence, &frame.body);
                        if gap == Gap::Restarted {
                            summary.totals.restart();
                            let why = match &frame.body {
                                Message::Hello(hello) => hello.restart.to_owned(),
                                _ => "its numbers begin again".to_owned(),
                            };
                            let number = (summary.totals.restarts() + 1).to_string();
                            let entries = [("number".to_owned(), number), ("why".to_owned(), why.clone())].into();
                            log.metadata(metadata::SEGMENT, entries)?;
                            notice(Notice::Restarted { why });
                        }
                        describe(&frame.body, &mut self.described, log, notice)?;
                        // Before the tape, which may have something to say as well.
                        self.keeper.hear(&frame.body, gap, Instant::now(), notice);
                        match frame.body {
                            Message::Profile(_) => summary.profiles += 1,
                            Message::Status(status) => summary.totals.status(&status),
                            _ => {}
                        }
                        log.frame(receive_ns, frame.raw, Some(&frame.body))?;
                    }
                    Event::Rejected(rejected) => {
                        count(summary, rejected.raw);
                        summary.bad_frames += 1;
                        if let Some(sequence) = rejected.sequence {
                            self.sequence.observe(sequence);
                        }
                        log.frame(receive_ns, rejected.raw, None)?;
                    }
                }
                summary.missing_frames = self.sequence.missing();
                summary.unknown_gaps = self.sequence.unknown();
            }
            if self.decoder.pending() >= MAX_MESSAGE_FRAME as u64 {
                self.cut(log, summary)?;
            }
        }
        Ok(())
    }

    /// The stream is broken here: what there is of a frame is logged.
    pub fn cut(&mut self, log: &mut impl Tape, summary: &mut Summary) -> Result<(), output::Error> {
        let Some(rejected) = self.decoder.finish() else { return Ok(()) };
        count(summary, rejected.raw);
        summary.bad_frames += 1;
        log.frame(self.latest_ns, rejected.raw, None)
    }
}

fn count(summary: &mut Summary, raw: &[u8]) {
    summary.frames += 1;
    summary.bytes += raw.len() as u64;
}

/// Metadata for readers that know no frames, whenever they change: who the board is and how it is configured.
fn describe(
    message: &Message<'_>,
    described: &mut BTreeMap<&'static str, Entries>,
    log: &mut impl Tape,
    notice: &mut impl FnMut(Notice),
) -> Result<(), output::Error> {
    let Some((name, entries)) = metadata::of(message).filter(|(name, entries)| described.get(name) != Some(entries))
    else {
        return Ok(());
    };
    log.metadata(name, entries.clone())?;
    described.insert(name, entries);
    if let Message::Hello(hello) = message {
        let (firmware, board) = (hello.firmware.to_owned(), hello.board.to_owned());
        notice(Notice::Board { firmware, board, schema: hello.schema });
    }
    Ok(())
}
