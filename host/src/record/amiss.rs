//! What is amiss with a recording, in one set of words for `record`, `serve` and `monitor`.

use super::Summary;

/// How a recording has ended, apart from what was counted as lost.
pub(crate) struct Amiss {
    pub frames: u64,
    pub restarts: u64,
    pub disconnected: bool,
    pub unconfigured: bool,
}

impl Amiss {
    pub fn words(&self) -> impl Iterator<Item = String> + use<> {
        let Self { frames, restarts, disconnected, unconfigured } = *self;
        let said = [
            (frames == 0).then(|| "no frame came: is the board powered, and is the baud rate right?".to_owned()),
            (restarts > 0)
                .then(|| format!("restarts of the board: {restarts}; what it had not sent before is not known")),
            disconnected.then(|| "not connected at the end: what the board has sent since is not known".to_owned()),
            unconfigured.then(|| "the configuration is not in force at the end, or not known to be".to_owned()),
        ];
        said.into_iter().flatten()
    }
}

impl Summary {
    /// What is amiss with the recording, in words, apart from damaged and missing frames, which are told by their numbers.
    #[must_use]
    pub fn amiss(&self) -> Vec<String> {
        let Self { frames, bytes_lost, unknown_gaps, disconnected, unconfigured, ref totals, .. } = *self;
        let lost = [
            (bytes_lost > 0)
                .then(|| format!("lost: {bytes_lost} bytes, because the log could not be written fast enough")),
            (unknown_gaps > 0).then(|| {
                format!(
                    "gaps too long for the frames' numbers to count: {unknown_gaps}; how many are missing there is not known"
                )
            }),
        ];
        let end = Amiss { frames, restarts: totals.restarts(), disconnected, unconfigured };
        let on_board =
            totals.losses_since().into_iter().map(|(name, count)| format!("lost on the board: {name} = {count}"));
        lost.into_iter().flatten().chain(end.words()).chain(on_board).collect()
    }
}
