//! What was lost between board and log: one count and one wording for `record`, `serve`, its page and `monitor`.

use serde::Serialize;

use super::Summary;

/// What was lost between board and log, each in its own unit.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Lost {
    /// Frames that are damaged, or missing by their numbers.
    pub frames_lost: u64,
    /// Bytes that found no room, because the log could not be written fast enough.
    pub bytes_lost: u64,
    /// Gaps too long for the numbers to count.
    pub unknown_gaps: u64,
}

impl Lost {
    /// What a connection has lost so far.
    #[must_use]
    pub fn of(summary: &Summary) -> Self {
        Self {
            frames_lost: summary.bad_frames + summary.missing_frames,
            bytes_lost: summary.bytes_lost,
            unknown_gaps: summary.unknown_gaps,
        }
    }

    /// What was lost since.
    #[must_use]
    pub fn since(self, before: Self) -> Self {
        Self {
            frames_lost: self.frames_lost.saturating_sub(before.frames_lost),
            bytes_lost: self.bytes_lost.saturating_sub(before.bytes_lost),
            unknown_gaps: self.unknown_gaps.saturating_sub(before.unknown_gaps),
        }
    }

    /// In words, each with its unit; none where nothing was lost.
    pub fn words(self) -> impl Iterator<Item = String> + use<> {
        counted(self.frames_lost, "frame lost", "frames lost").into_iter().chain(self.uncounted())
    }

    /// [`words`](Self::words) without the frames: bytes without room are no frames yet, and gaps without a count no number of them.
    pub fn uncounted(self) -> impl Iterator<Item = String> + use<> {
        let bytes = counted(self.bytes_lost, "byte lost", "bytes lost");
        bytes.into_iter().chain(counted(self.unknown_gaps, "gap of unknown length", "gaps of unknown length"))
    }
}

fn counted(count: u64, one: &str, many: &str) -> Option<String> {
    (count > 0).then(|| format!("{count} {}", if count == 1 { one } else { many }))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_loss_is_told_in_its_own_unit_and_none_where_there_is_none() {
        let words = |frames_lost, bytes_lost, unknown_gaps| {
            let lost = Lost { frames_lost, bytes_lost, unknown_gaps };
            (lost.words().collect::<Vec<_>>().join(", "), lost.uncounted().collect::<Vec<_>>().join(", "))
        };
        assert_eq!(words(0, 0, 0), (String::new(), String::new()));
        assert_eq!(words(1, 0, 0), ("1 frame lost".to_owned(), String::new()));
        let one = "1 byte lost, 1 gap of unknown length";
        assert_eq!(words(2, 1, 1), (format!("2 frames lost, {one}"), one.to_owned()));
        let many = "70000 bytes lost, 3 gaps of unknown length";
        assert_eq!(words(0, 70_000, 3), (many.to_owned(), many.to_owned()));
    }

    #[test]
    fn damaged_and_missing_frames_are_both_lost_and_a_later_recording_begins_at_none() {
        let before = Lost::of(&Summary { bad_frames: 1, missing_frames: 2, unknown_gaps: 1, ..Summary::default() });
        assert_eq!(before, Lost { frames_lost: 3, bytes_lost: 0, unknown_gaps: 1 });
        let now = Lost { frames_lost: 5, bytes_lost: 70, unknown_gaps: 1 };
        assert_eq!(now.since(before), Lost { frames_lost: 2, bytes_lost: 70, unknown_gaps: 0 });
    }
}
