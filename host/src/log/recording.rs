//! Whether a file is a recording: what a board has sent, which nobody can make again.

use std::path::Path;

use crossfall_core::protocol::message::Message;

use super::metadata;
use crate::run;
use crate::stream::{Item, Stream};

/// Frames that are looked at for a hello: without one after so many, whose they are is not known, and a board's is supposed.
const LOOKED_AT: u64 = 1_000;

/// Whether a file holds frames of a board. What `run` has made of a capture can be made again, and so can a simulated drive that says that it is one.
#[must_use]
pub fn is_recording(path: &Path) -> bool {
    let Ok(mut log) = Stream::open(path) else { return false };
    loop {
        if log.metadata().contains_key(metadata::SIMULATED) {
            return false;
        }
        let board = log.metadata().get(metadata::IDENTITY).and_then(|identity| identity.get("board"));
        if let Some(board) = board {
            return board != run::identity().board;
        }
        match log.next() {
            Some((_, Item::Message { message: Message::Hello(hello), .. })) => {
                return hello.board != run::identity().board;
            }
            Some((place, _)) if place.frame < LOOKED_AT => {}
            _ => return log.frames() > 0,
        }
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use crossfall_core::protocol::frame::{MAX_MESSAGE_FRAME, Sequencer};
    use crossfall_core::protocol::message::{Hello, Message};
    use crossfall_core::protocol::schema;

    use super::super::{Writer, metadata};
    use super::is_recording;
    use crate::output::{self, Output};

    fn hello(board: &str) -> Vec<u8> {
        let message =
            Message::Hello(Hello { schema: schema::HASH, firmware: "crossfall", board, boot: 0, restart: "" });
        let mut frame = [0; MAX_MESSAGE_FRAME];
        let length = Sequencer::new().message(&message, &mut frame).unwrap();
        frame[..length].to_vec()
    }

    #[test]
    fn only_what_can_be_made_again_is_written_over() {
        let folder = tempfile::tempdir().unwrap();
        let log = |name: &str, frames: &[&[u8]], simulated: bool| {
            let path = folder.path().join(name);
            let mut log = Writer::create_live(&path).unwrap();
            if simulated {
                log.metadata(metadata::SIMULATED, BTreeMap::new()).unwrap();
            }
            for (number, frame) in frames.iter().enumerate() {
                log.frame(number as u64, frame).unwrap();
            }
            log.finish().unwrap();
            path
        };
        let (board, own) = (hello("a board"), hello(crate::run::identity().board));
        let recorded = log("recorded.mcap", &[&[1, 2, 0], &board], false);
        let unnamed = log("unnamed.mcap", &[&[1, 2, 0]], false);
        for path in [&recorded, &unnamed] {
            assert!(is_recording(path));
            let before = std::fs::read(path).unwrap();
            let error = output::write(path, b"a table").unwrap_err().to_string();
            assert!(error.contains("is a recording of a board, which is never written over"), "{error}");
            assert_eq!(std::fs::read(path).unwrap(), before);
        }
        let text = folder.path().join("text.mcap");
        std::fs::write(&text, "no log").unwrap();
        for path in
            [log("run.mcap", &[&own], false), log("demo.mcap", &[&board], true), log("empty.mcap", &[], false), text]
        {
            assert!(!is_recording(&path), "{}", path.display());
            output::write(&path, b"a table").unwrap();
        }
        // Damage at the beginning makes a recording no less of one, and what can be made again no more of one.
        for hit in [1, 8, 512] {
            for (name, frames) in [("hit.mcap", &board), ("made.mcap", &own)] {
                let path = log(name, &[frames, &[1, 2, 0]], false);
                let mut bytes = std::fs::read(&path).unwrap();
                let at = bytes.windows(frames.len()).position(|window| window == frames).unwrap();
                bytes[..hit.min(at - 31)].fill(0x5a);
                std::fs::write(&path, &bytes).unwrap();
                assert_eq!(is_recording(&path), name == "hit.mcap", "{name}: {hit}");
                std::fs::remove_file(&path).unwrap();
            }
        }
        // One that has come while the output was made.
        let late = folder.path().join("late.mcap");
        let output = Output::create(&late).unwrap();
        log("late.mcap", &[&board], false);
        assert!(output.commit().is_err() && is_recording(&late));
    }
}
