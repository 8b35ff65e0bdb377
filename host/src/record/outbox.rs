//! What is said to the board: numbered, framed, and on its way to the thread that owns the port.
//!
//! The port is written to between two of its reads, so a command goes out at most a read's time late and never keeps the reader waiting
//! for anything but its own bytes. Each command has a number of its own, to which the board answers; number 0 is that of the question
//! which every connection begins with. Configurations are remembered until they are answered: who hears the board's echo can tell one that
//! was asked for here from one that is simply there.

use std::collections::{BTreeMap, VecDeque};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use crossfall_core::protocol::Config;
use crossfall_core::protocol::frame::MAX_COMMAND_FRAME;
use crossfall_core::protocol::message::Command;

/// How long a board may take to answer: the round trip and a survey that is behind.
pub(crate) const ANSWER: Duration = Duration::from_secs(2);

/// Commands that may wait; the oldest are given up. None outlives the connection that it was meant for.
const WAITING: usize = 64;

/// Configurations that may be without an answer; the oldest are forgotten.
const UNANSWERED: usize = 16;

/// A frame and its number.
type Numbered = (u16, Vec<u8>);

/// Commands on their way to the board. Clones share one queue and one count.
#[derive(Clone, Debug, Default)]
pub struct Outbox(Arc<Mutex<Waiting>>);

#[derive(Debug, Default)]
struct Waiting {
    /// The last command's.
    number: u16,
    frames: VecDeque<Numbered>,
    /// Without an answer so far, by the number of their frames.
    configurations: BTreeMap<u16, Config>,
}

impl Outbox {
    /// Queues a command. Returns its number, to which the board will answer; None when it fits no frame, which none does.
    pub fn say(&self, command: &Command) -> Option<u16> {
        self.put(command, VecDeque::push_back)
    }

    /// The same before everything that waits.
    pub(super) fn say_first(&self, command: &Command) -> Option<u16> {
        self.put(command, VecDeque::push_front)
    }

    fn put(&self, command: &Command, place: fn(&mut VecDeque<Numbered>, Numbered)) -> Option<u16> {
        let mut waiting = self.lock();
        // Number 0 is that of the reader's own question.
        let number = waiting.number.checked_add(1).unwrap_or(1);
        let frame = framed(command, number)?;
        waiting.number = number;
        if waiting.frames.len() == WAITING {
            waiting.frames.pop_front();
        }
        place(&mut waiting.frames, (number, frame));
        if let Command::Configure(config) = command {
            if waiting.configurations.len() == UNANSWERED {
                waiting.configurations.pop_first();
            }
            waiting.configurations.insert(number, *config);
        }
        Some(number)
    }

    /// The next frame to be written.
    pub(crate) fn take(&self) -> Option<Vec<u8>> {
        self.lock().frames.pop_front().map(|(_, frame)| frame)
    }

    /// Whether this configuration was said and is not answered yet.
    pub(super) fn has_said(&self, config: &Config) -> bool {
        self.lock().configurations.values().any(|said| said == config)
    }

    /// A command of this number is answered: the configuration, if it was one.
    pub(super) fn answered(&self, number: u16) -> Option<Config> {
        self.lock().configurations.remove(&number)
    }

    /// The board has booted: what had gone out to it will not be answered.
    pub(super) fn board_booted(&self) {
        let Waiting { frames, configurations, .. } = &mut *self.lock();
        configurations.retain(|number, _| frames.iter().any(|(waiting, _)| waiting == number));
    }

    /// Another connection: what was said on the one before would now come too late.
    pub(super) fn clear(&self) {
        let mut waiting = self.lock();
        waiting.frames.clear();
        waiting.configurations.clear();
    }

    fn lock(&self) -> MutexGuard<'_, Waiting> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// A command as it is written: a leading delimiter ends whatever the board has of a frame that was broken off.
pub(super) fn framed(command: &Command, number: u16) -> Option<Vec<u8>> {
    let mut frame = vec![0; MAX_COMMAND_FRAME + 1];
    let length = command.encode(number, frame.get_mut(1..)?).ok()?;
    frame.truncate(length + 1);
    Some(frame)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crossfall_core::protocol::frame::{BoardDecoder, Event};

    fn drain(outbox: &Outbox) -> Vec<(u16, Command)> {
        let mut said = Vec::new();
        while let Some(frame) = outbox.take() {
            let (mut decoder, mut rest) = (BoardDecoder::new(), frame.as_slice());
            while let Some(event) = decoder.next(&mut rest) {
                match event {
                    Event::Frame(frame) => said.push((frame.sequence, frame.body)),
                    Event::Rejected(rejected) => panic!("{rejected:?}"),
                }
            }
        }
        said
    }

    #[test]
    fn commands_are_numbered_from_one_and_a_configuration_may_go_first() {
        let outbox = Outbox::default();
        let config = Config::default();
        assert_eq!(outbox.say(&Command::Stop), Some(1));
        assert_eq!(outbox.clone().say_first(&Command::Configure(config)), Some(2));
        assert_eq!(drain(&outbox), [(2, Command::Configure(config)), (1, Command::Stop)]);
        for _ in 2..u16::MAX {
            outbox.say(&Command::Start);
        }
        assert_eq!(drain(&outbox).len(), WAITING, "no more wait");
        assert_eq!(outbox.say(&Command::Start), Some(1), "0 is the reader's");
    }

    #[test]
    fn configurations_are_remembered_until_they_are_answered_or_cannot_be() {
        let outbox = Outbox::default();
        let config = Config::default();
        let number = outbox.say(&Command::Configure(config)).unwrap();
        assert!(outbox.has_said(&config));
        assert_eq!((outbox.answered(number), outbox.answered(number)), (Some(config), None));
        outbox.say(&Command::Configure(config));
        outbox.board_booted();
        assert!(outbox.has_said(&config), "it has not gone out yet");
        drain(&outbox);
        outbox.board_booted();
        assert!(!outbox.has_said(&config));
        outbox.say(&Command::Configure(config));
        outbox.clear();
        assert!(!outbox.has_said(&config) && outbox.take().is_none());
        for _ in 0..3 * UNANSWERED {
            outbox.say(&Command::Configure(config));
        }
        assert_eq!(outbox.lock().configurations.len(), UNANSWERED);
    }
}
