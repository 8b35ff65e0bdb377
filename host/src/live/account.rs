//! What recordings have come to: shared by the thread that records and those that show it.

use super::state::{Phase, Recording};
use crate::output;
use crate::record::{Lost, Summary};

/// What the recorder's thread and the viewers share.
#[derive(Debug, Default)]
pub struct Shared {
    /// The recording.
    pub recording: Recording,
    /// The one before.
    pub last: Option<Recording>,
    /// All that have ended and are not whole.
    pub broken: Vec<Recording>,
    /// Why a log could not be written.
    pub disk_error: Option<String>,
    /// What the connection has come to.
    pub summary: Summary,
}

impl Shared {
    /// The recording has ended, its file as `finished` says; `before` is what the connection had lost when it began.
    pub(super) fn end(&mut self, finished: Result<(), output::Error>, before: Losses) {
        let mut ended = std::mem::take(&mut self.recording);
        ended.phase = Phase::Idle;
        if let Err(error) = finished {
            // What went wrong first is the cause, and what follows from it says nothing.
            self.disk_error.get_or_insert(error.to_string());
            ended.error.get_or_insert(error.to_string());
        }
        let now = Losses::of(&self.summary);
        ended.lost = now.on_the_way.since(before.on_the_way);
        ended.lost_on_board = now.on_board.saturating_sub(before.on_board);
        // A boot that shows in the board's time alone begins no segment.
        ended.restarts = ended.restarts.max(now.restarts.saturating_sub(before.restarts));
        (ended.disconnected, ended.unconfigured) = (self.summary.disconnected, self.summary.unconfigured);
        if !ended.is_whole() {
            self.broken.push(ended.clone());
        }
        self.last = Some(ended);
    }
}

/// What a connection has lost.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Losses {
    /// On the way from the board.
    pub on_the_way: Lost,
    /// By the board's own count.
    on_board: u64,
    restarts: u64,
}

impl Losses {
    pub fn of(summary: &Summary) -> Self {
        Self {
            on_the_way: Lost::of(summary),
            on_board: summary.totals.losses_since().values().sum(),
            restarts: summary.totals.restarts(),
        }
    }
}
