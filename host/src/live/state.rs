//! What viewers are told a few times a second, as JSON (docs/live.md).

use std::collections::BTreeMap;

use serde::Serialize;

use super::faults::Fault;
use super::lamps::Lamp;
use super::player::Transport;
use super::rock_test::RockTest;
use crate::record::{Amiss, Lost};

/// Everything but sections, charts and track.
#[derive(Clone, Debug, Default, Serialize)]
pub struct State {
    /// Always `state`.
    pub kind: &'static str,
    /// Where it comes from: `device`, `log` or `capture`, and its name.
    pub source: SourceState,
    /// Who the board is.
    pub board: Option<BoardState>,
    /// The lamps.
    pub lamps: Lamps,
    /// The recording.
    pub recording: Recording,
    /// The one before, when it has ended.
    pub last_recording: Option<Recording>,
    /// In words: what the recording has lost so far or, while there is none, what is amiss with the one before.
    pub recording_amiss: Vec<String>,
    /// The replay, when it is one.
    pub replay: Option<Transport>,
    /// Counters of losses, those that are 0 too.
    pub losses: BTreeMap<String, u64>,
    /// What went wrong lately, the latest first.
    pub faults: Vec<Fault>,
    /// Faults in all.
    pub fault_count: u64,
    /// Where the vehicle is and how it moves.
    pub motion: Motion,
    /// Markers since the server began, the latest last; at most the last 50.
    pub markers: Vec<MarkerState>,
    /// Markers in all.
    pub marker_count: u64,
    /// Grows with every configuration that the board has put in force.
    pub config_number: u64,
    /// The calibrated values of the one in force, in words.
    pub configuration: Option<String>,
    /// The rock test under way, or its result.
    pub rock_test: Option<RockTest>,
    /// Frames that the viewers' model had no time for; the log has them.
    pub unviewed_frames: u64,
}

/// Where it comes from.
#[derive(Clone, Debug, Default, Serialize)]
pub struct SourceState {
    /// `device`, `log` or `capture`.
    pub kind: &'static str,
    /// Port or file.
    pub name: String,
    /// Folder that logs are written to.
    pub folder: String,
}

/// Who the board is.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize)]
pub struct BoardState {
    /// Name and version of its firmware.
    pub firmware: String,
    /// Its name.
    pub board: String,
    /// Whether it speaks the messages that this program knows.
    pub schema_known: bool,
}

/// The lamps.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Lamps {
    /// The scanner.
    pub lidar: Lamp,
    /// The inertial unit.
    pub ins: Lamp,
    /// The pulse per second.
    pub pulse: Lamp,
    /// The disk.
    pub disk: Lamp,
    /// The link to the board.
    pub link: Lamp,
}

/// What the recording does.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Phase {
    /// Nothing is recorded.
    #[default]
    Idle,
    /// The old session is brought to its end and a new one begins: half a second.
    Starting,
    /// Every frame goes to the log.
    Recording,
    /// The session is brought to its end: half a second.
    Ending,
}

/// A recording.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Recording {
    /// What it does.
    pub phase: Phase,
    /// The drive's name.
    pub name: String,
    /// The log.
    pub file: String,
    /// How long it has lasted.
    pub seconds: f64,
    /// Frames in it.
    pub frames: u64,
    /// Bytes of these frames; the file has a few percent more.
    pub bytes: u64,
    /// Profiles among them.
    pub profiles: u64,
    /// Markers among them.
    pub markers: u64,
    /// What was lost between board and log.
    #[serde(flatten)]
    pub lost: Lost,
    /// What the board has counted as lost meanwhile: known when the recording has ended.
    pub lost_on_board: u64,
    /// Times that the board booted within it: what was under way is lost, and nobody knows how much that is.
    pub restarts: u64,
    /// Whether nothing was connected when it ended: what the board sent since is not known.
    pub disconnected: bool,
    /// Whether a configuration was to be in force when it ended and was not, or was not known to be.
    pub unconfigured: bool,
    /// Why it ended early.
    pub error: Option<String>,
}

impl Recording {
    /// What is amiss with it, in words; nothing when all that the board sent meanwhile is in it, as far as it is known.
    #[must_use]
    pub fn amiss(&self) -> Vec<String> {
        let Self { frames, lost, lost_on_board, restarts, disconnected, unconfigured, ref error, .. } = *self;
        let early = error.as_ref().map(|error| format!("ended early: {error}"));
        let on_board = (lost_on_board > 0).then(|| format!("{lost_on_board} lost on the board"));
        let end = Amiss { frames, restarts, disconnected, unconfigured };
        early.into_iter().chain(lost.words()).chain(on_board).chain(end.words()).collect()
    }

    /// What viewers are told: while it lasts what it has lost so far, and else what is amiss with the one before.
    pub(super) fn told(&self, before: Option<&Self>) -> Vec<String> {
        match (self.phase, before) {
            (Phase::Idle, before) => before.map(Self::amiss).unwrap_or_default(),
            _ => self.lost.words().collect(),
        }
    }

    /// Whether nothing is [`amiss`](Self::amiss).
    #[must_use]
    pub fn is_whole(&self) -> bool {
        self.amiss().is_empty()
    }
}

/// Where the vehicle is and how it moves.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Motion {
    /// Horizontal speed in metres a second.
    pub speed_m_s: Option<f64>,
    /// Way since the first pose, in metres.
    pub station_m: Option<f64>,
    /// Sections a mile at this speed.
    pub points_per_mile: Option<f64>,
    /// Scans a second.
    pub scan_hz: f64,
    /// Metres east and north of the track's beginning.
    pub place_m: Option<[f32; 2]>,
    /// Direction of travel in degrees from north.
    pub heading_deg: f64,
    /// GPS week and seconds.
    pub gps: Option<(u16, f64)>,
    /// Scans measured since the server began.
    pub profiles: u64,
}

/// A marker.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct MarkerState {
    /// The board's number of it.
    pub number: u32,
    /// Its name.
    pub label: String,
    /// Device time in seconds.
    pub time_s: f64,
    /// Station in metres.
    pub station_m: Option<f64>,
    /// Metres east and north of the track's beginning.
    pub place_m: Option<[f32; 2]>,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn viewers_are_told_of_the_recording_under_way_or_of_the_one_before() {
        let lost = |frames_lost| Lost { frames_lost, ..Lost::default() };
        let last = Recording { frames: 9, lost: lost(1), disconnected: true, ..Recording::default() };
        let idle = Recording::default();
        assert_eq!(idle.told(None), [""; 0]);
        let told = idle.told(Some(&last));
        assert_eq!((told.len(), &*told[0]), (2, "1 frame lost"));
        assert!(told[1].starts_with("not connected at the end"), "{told:?}");
        // What has no frame yet is nothing amiss while it lasts.
        for phase in [Phase::Starting, Phase::Recording, Phase::Ending] {
            assert_eq!(Recording { phase, ..Recording::default() }.told(Some(&last)), [""; 0]);
        }
        let now = Recording { phase: Phase::Recording, lost: lost(2), ..Recording::default() };
        assert_eq!(now.told(Some(&last)), ["2 frames lost"]);
    }
}
