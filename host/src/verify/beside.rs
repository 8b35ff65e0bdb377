//! The second survey on a thread of its own, fed in the order of the log.
//!
//! Frames are decoded where the log is read, ranges included; the survey is the longer half of the work. Some hundreds of messages change hands at a time, of
//! which a few batches may wait, so memory is constant.

use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::thread::{Scope, ScopedJoinHandle};

use crossfall_core::instrument::Event;
use crossfall_core::protocol::message::Message;
use crossfall_core::protocol::{Config, DeviceTime};
use crossfall_core::scan::RawScan;

use super::Told;
use super::replay::Replay;
use crate::stream::Place;

/// Messages of a batch, and batches that may wait.
const BATCH: usize = 512;
const WAITING: usize = 8;

/// How many profiles came out the same, could not be recomputed, and could not for no loss; see [`Replay`].
#[derive(Clone, Copy, Debug)]
pub struct Verdict {
    pub reproduced: u64,
    pub unverifiable: u64,
    pub joined: u64,
}

/// What the survey is told.
enum What {
    Message(Message<'static>),
    /// The next of the batch's scans.
    Scan,
    /// One whose ranges do not decode.
    Undecodable(u32, DeviceTime),
    Gap,
    Restart,
    BeginMidway(Option<Config>),
    /// Nothing: the place is where the log ended.
    End,
}

#[derive(Default)]
struct Batch {
    items: Vec<(Place, What)>,
    scans: Vec<RawScan>,
}

/// The survey's feeder.
pub struct Beside<'scope> {
    batch: Batch,
    place: Place,
    room: Box<RawScan>,
    sender: SyncSender<Batch>,
    survey: ScopedJoinHandle<'scope, (Told, Verdict)>,
}

impl<'scope> Beside<'scope> {
    /// Starts the survey's thread.
    pub fn start<'env>(scope: &'scope Scope<'scope, 'env>) -> Self {
        let (sender, receiver) = sync_channel(WAITING);
        let survey = scope.spawn(move || survey(&receiver));
        Self { batch: Batch::default(), place: Place::default(), room: Box::new(RawScan::EMPTY), sender, survey }
    }

    /// Where what follows is in the log.
    pub fn at(&mut self, place: Place) {
        self.place = place;
    }

    /// Something was lost here.
    pub fn gap(&mut self) {
        self.tell(What::Gap);
    }

    /// The board has booted.
    pub fn restart(&mut self) {
        self.tell(What::Restart);
    }

    /// See [`Replay::begin_midway`].
    pub fn begin_midway(&mut self, config: Option<&Config>) {
        self.tell(What::BeginMidway(config.copied()));
    }

    /// The next message of the log.
    pub fn take(&mut self, message: &Message<'_>) {
        let what = match *message {
            Message::Scan(scan) => match Event::of(message, &mut self.room) {
                Ok(_) => {
                    self.batch.scans.push((*self.room).clone());
                    What::Scan
                }
                Err(_) => What::Undecodable(scan.index, scan.stx),
            },
            Message::Config(it) => What::Message(Message::Config(it)),
            Message::Pose(it) => What::Message(Message::Pose(it)),
            Message::Pulse(it) => What::Message(Message::Pulse(it)),
            Message::Clock(it) => What::Message(Message::Clock(it)),
            Message::Profile(it) => What::Message(Message::Profile(it)),
            Message::Session(it) => What::Message(Message::Session(it)),
            Message::Skip(it) => What::Message(Message::Skip(it)),
            // No input of the survey, and nothing that it says.
            Message::Hello(_) | Message::Status(_) | Message::Log(_) | Message::Reply(_) | Message::Marker(_) => return,
        };
        self.tell(what);
    }

    fn tell(&mut self, what: What) {
        self.batch.items.push((self.place, what));
        if self.batch.items.len() >= BATCH {
            self.hand_over();
        }
    }

    fn hand_over(&mut self) {
        // The survey's thread takes everything; if it has panicked, joining it says so.
        let _ = self.sender.send(std::mem::take(&mut self.batch));
    }

    /// The log has ended at the last place told.
    pub fn finish(mut self) -> (Told, Verdict) {
        self.tell(What::End);
        self.hand_over();
        drop(self.sender);
        self.survey.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic))
    }
}

fn survey(receiver: &Receiver<Batch>) -> (Told, Verdict) {
    let mut replay = Replay::default();
    let mut told = Told::default();
    let mut problems = Vec::new();
    for Batch { items, scans } in receiver {
        let mut scans = scans.iter();
        for (place, what) in items {
            match what {
                What::Message(message) => replay.take(&message, &mut problems),
                What::Scan => {
                    if let Some(scan) = scans.next() {
                        replay.scan(Ok(scan), &mut problems);
                    }
                }
                What::Undecodable(index, stx) => replay.scan(Err((index, stx)), &mut problems),
                What::Gap => replay.gap(),
                What::Restart => replay.restart(),
                What::BeginMidway(config) => replay.begin_midway(config.as_ref()),
                What::End => problems.extend(replay.finish()),
            }
            told.note(place, problems.drain(..));
        }
    }
    let Replay { reproduced, unverifiable, joined, .. } = replay;
    (told, Verdict { reproduced, unverifiable, joined })
}
