//! Sequence numbers: what is missing is counted, through wraps and reboots.

use crossfall_protocol::DeviceTime;
use crossfall_protocol::frame::{Gap, MAX_MESSAGE_FRAME, MAX_TEXT, Sequence, Sequencer};
use crossfall_protocol::message::{Hello, Level, LogLine, Message, Session};
use proptest::collection::vec;
use proptest::prelude::*;

const HELLO: Message<'_> = Message::Hello(Hello { schema: 0, firmware: "", board: "", boot: 0, restart: "" });
const OTHER: Message<'_> = Message::Session(Session::Started(DeviceTime(0)));

#[test]
fn the_first_frame_is_where_counting_starts() {
    let mut sequence = Sequence::new();
    assert_eq!(sequence.observe_message(4_711, &OTHER), Gap::None);
    assert_eq!(sequence.observe_message(4_712, &OTHER), Gap::None);
    assert_eq!(sequence.observe_message(4_715, &OTHER), Gap::Missing(2));
    assert_eq!(sequence.missing(), 2);
}

#[test]
fn a_hello_numbered_0_restarts_the_count_without_loss() {
    let mut sequence = Sequence::new();
    sequence.observe_message(60_000, &OTHER);
    assert_eq!(sequence.observe_message(0, &HELLO), Gap::Restarted);
    assert_eq!(sequence.observe_message(1, &OTHER), Gap::None);
    assert_eq!((sequence.missing(), sequence.restarts()), (0, 1));
}

#[test]
fn a_hello_that_answers_a_command_goes_on_counting() {
    let mut sequence = Sequence::new();
    sequence.observe_message(65_535, &OTHER);
    assert_eq!(sequence.observe_message(0, &HELLO), Gap::None);
    assert_eq!(sequence.observe_message(5, &HELLO), Gap::Missing(4));
    assert_eq!(sequence.restarts(), 0);
}

#[test]
fn a_step_back_is_a_restart_whose_hello_was_lost() {
    let mut sequence = Sequence::new();
    sequence.observe_message(20_000, &OTHER);
    assert_eq!(sequence.observe_message(1, &OTHER), Gap::Restarted);
    assert_eq!(sequence.missing(), 0);
}

#[test]
fn a_frame_that_does_not_fit_uses_up_its_number() {
    let mut sequencer = Sequencer::new();
    let text = [b'x'; MAX_TEXT + MAX_MESSAGE_FRAME];
    let long = Message::Log(LogLine { time: DeviceTime(0), level: Level::Info, text: &text });
    assert!(sequencer.message(&long, &mut [0; MAX_MESSAGE_FRAME]).is_err());
    assert_eq!(sequencer.take(), 1);
}

proptest! {
    /// However frames are dropped, what the receiver counts is what the sender dropped.
    #[test]
    fn every_dropped_frame_is_counted(start: u16, losses in vec(0..32_767_u16, 1..50)) {
        let mut sequencer = Sequencer::new();
        for _ in 0..start {
            sequencer.take();
        }
        let mut sequence = Sequence::new();
        sequence.observe(sequencer.take());
        let mut missing = 0;
        for loss in losses {
            for _ in 0..loss {
                sequencer.take();
            }
            missing += u64::from(loss);
            let gap = sequence.observe(sequencer.take());
            prop_assert_eq!(gap, if loss == 0 { Gap::None } else { Gap::Missing(loss) });
        }
        prop_assert_eq!((sequence.missing(), sequence.restarts()), (missing, 0));
    }
}
