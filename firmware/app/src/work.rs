//! The queue from the acquisition to the survey: inputs in order, the scans' values in places of their own.
//!
//! A scan is eight times as large as anything else. Held apart, three scans and sixteen inputs take 4 KiB, and a burst of poses
//! finds room. Both halves are first in, first out, so that the scan at the head belongs to the first [`Work::Scan`].

use crossfall_core::instrument::Event;
use crossfall_core::scan::RawScan;
use crossfall_protocol::Config;
use crossfall_protocol::message::{Message, Pose, Session};
use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;
use embassy_sync::zerocopy_channel::{Channel, Receiver, Sender};

/// Inputs that may wait: 130 ms of poses at 100 a second beside the scans.
pub const INPUTS: usize = 16;

/// Scans that may wait: 80 ms at 37.5 a second.
pub const SCANS: usize = 3;

/// One input of the survey. Of a stated layout, so that empty places are nothing but zeros: the board's image holds none of them.
#[derive(Clone, Copy, Debug)]
#[repr(u8)]
pub enum Work {
    /// The next scan of the other half.
    Scan,
    /// A pose for the attitude's history.
    Pose(Pose),
    /// A configuration that holds from here on.
    Config(Config),
    /// A border of the survey.
    Session(Session),
}

/// Places for the queue, owned by the board.
pub struct Places {
    inputs: [Work; INPUTS],
    scans: [RawScan; SCANS],
}

impl Default for Places {
    fn default() -> Self {
        Self::new()
    }
}

impl Places {
    /// Empty places.
    #[must_use]
    pub const fn new() -> Self {
        Self { inputs: [Work::Scan; INPUTS], scans: [RawScan::EMPTY; SCANS] }
    }
}

/// The queue.
pub struct WorkQueue<'q> {
    inputs: Channel<'q, CriticalSectionRawMutex, Work>,
    scans: Channel<'q, CriticalSectionRawMutex, RawScan>,
}

impl<'q> WorkQueue<'q> {
    /// A queue over its places.
    pub fn new(places: &'q mut Places) -> Self {
        Self { inputs: Channel::new(&mut places.inputs), scans: Channel::new(&mut places.scans) }
    }

    /// The acquisition's end and the survey's.
    pub fn split(&mut self) -> (WorkSender<'_>, WorkReceiver<'_>) {
        let (inputs, next) = self.inputs.split();
        let (scans, next_scan) = self.scans.split();
        (WorkSender { inputs, scans }, WorkReceiver { inputs: next, scans: next_scan })
    }
}

/// The acquisition's end.
pub struct WorkSender<'q> {
    inputs: Sender<'q, CriticalSectionRawMutex, Work>,
    scans: Sender<'q, CriticalSectionRawMutex, RawScan>,
}

impl WorkSender<'_> {
    /// Whether two inputs other than scans would find room: no command brings about more.
    #[must_use]
    pub fn has_room(&self) -> bool {
        self.inputs.len() + 2 <= INPUTS
    }

    /// Queues a scan; false when there is no room.
    pub fn scan(&mut self, scan: &RawScan) -> bool {
        if self.inputs.is_full() {
            return false;
        }
        let Some(place) = self.scans.try_send() else { return false };
        place.clone_from(scan);
        self.scans.send_done();
        self.input(Work::Scan)
    }

    /// Queues any other input; false when there is no room.
    pub fn input(&mut self, work: Work) -> bool {
        let Some(place) = self.inputs.try_send() else { return false };
        *place = work;
        self.inputs.send_done();
        true
    }
}

/// The survey's end.
pub struct WorkReceiver<'q> {
    inputs: Receiver<'q, CriticalSectionRawMutex, Work>,
    scans: Receiver<'q, CriticalSectionRawMutex, RawScan>,
}

impl WorkReceiver<'_> {
    /// Waits for the next input and hands it to `take`, whose answer it returns.
    pub async fn next<T>(&mut self, take: impl FnOnce(&Event<'_>) -> T) -> T {
        let work = *self.inputs.receive().await;
        self.inputs.receive_done();
        let message = match work {
            Work::Scan => {
                // There before its marker: it is queued first.
                let answer = take(&Event::Scan(self.scans.receive().await));
                self.scans.receive_done();
                return answer;
            }
            Work::Pose(pose) => Message::Pose(pose),
            Work::Config(config) => Message::Config(config),
            Work::Session(session) => Message::Session(session),
        };
        take(&Event::Message(message))
    }
}
