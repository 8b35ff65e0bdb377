//! Sequence numbers: what is missing is counted, through wraps and reboots.

use crossfall_protocol::DeviceTime;
use crossfall_protocol::frame::{Gap, MAX_MESSAGE_FRAME, MAX_TEXT, Sequence, Sequencer};
use crossfall_protocol::message::{ClockState, Hello, Level, LogLine, Message, Pulse, PulseVerdict, Session};
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

/// A frame of a board `ms` milliseconds after its boot.
fn pulse(ms: u64) -> Message<'static> {
    Message::Pulse(Pulse { time: DeviceTime(1_000 * ms), verdict: PulseVerdict::Accepted })
}

/// One that says nothing of the time.
const TIMELESS: Message<'_> = Message::Clock(ClockState { anchor: DeviceTime(0), gps: None, drift: 0, pulses: 0 });

/// Ten seconds of a board that sends 200 frames a second, numbers 0 to 1999.
fn ten_seconds() -> Sequence {
    let mut sequence = Sequence::new();
    for i in 0..2_000 {
        assert_eq!(sequence.observe_message(i, &pulse(5 * u64::from(i))), Gap::None);
    }
    sequence
}

/// What is told of a loss of so many frames, and of the frame behind.
fn behind(lost: u64, timeless: bool) -> (Gap, Gap, Sequence) {
    let mut sequence = ten_seconds();
    let number = |ahead: u64| ((2_000 + ahead) % 65_536) as u16;
    let first = if timeless { TIMELESS } else { pulse(5 * (2_000 + lost)) };
    let told = sequence.observe_message(number(lost), &first);
    let next = sequence.observe_message(number(lost + 1), &pulse(5 * (2_001 + lost)));
    (told, next, sequence)
}

#[test]
fn a_loss_of_more_than_half_a_turn_is_not_counted_and_no_restart() {
    for lost in [40_000, 65_000, 70_000, 120_000, 200_000] {
        let (told, next, sequence) = behind(lost, false);
        assert_eq!((told, next), (Gap::Unknown, Gap::None), "{lost}");
        assert_eq!((sequence.missing(), sequence.unknown(), sequence.restarts()), (0, 1, 0), "{lost}");
    }
    assert_eq!(behind(32_000, false).0, Gap::Missing(32_000));
}

#[test]
fn a_frame_without_a_time_behind_a_long_loss_does_not_hide_it() {
    let (told, next, sequence) = behind(40_000, true);
    assert_eq!((told, next, sequence.restarts()), (Gap::Unknown, Gap::None, 0));
    // The 4,464 are missing for sure.
    let (told, next, sequence) = behind(70_000, true);
    assert_eq!((told, next, sequence.restarts()), (Gap::Missing(4_464), Gap::Unknown, 0));
    let (told, next, _) = behind(4_464, true);
    assert_eq!((told, next), (Gap::Missing(4_464), Gap::None));
}

#[test]
fn time_that_goes_back_is_a_restart_whatever_the_numbers_say() {
    for number in [3_000, 1_000] {
        assert_eq!(ten_seconds().observe_message(number, &pulse(500)), Gap::Restarted, "{number}");
        // Or as soon as there is a time.
        let mut sequence = ten_seconds();
        assert_ne!(sequence.observe_message(number, &TIMELESS), Gap::None);
        assert_eq!(sequence.observe_message(number + 1, &pulse(500)), Gap::Restarted, "{number}");
        assert_eq!(sequence.observe_message(number + 2, &pulse(505)), Gap::None);
        assert_eq!(sequence.restarts(), 1);
    }
}

#[test]
fn a_hello_of_another_boot_is_a_restart_whatever_its_number() {
    let hello = |boot| Message::Hello(Hello { schema: 0, firmware: "", board: "", boot, restart: "" });
    let mut sequence = ten_seconds();
    assert_eq!(sequence.observe_message(2_000, &hello(7)), Gap::None);
    assert_eq!(sequence.observe_message(2_001, &hello(7)), Gap::None);
    assert_eq!(sequence.observe_message(2_500, &hello(8)), Gap::Restarted);
    assert_eq!(sequence.observe_message(2_501, &hello(8)), Gap::None);
    // One that time has told already is not told twice.
    assert_eq!(sequence.observe_message(2_502, &pulse(100_000)), Gap::None);
    assert_eq!(sequence.observe_message(40, &pulse(500)), Gap::Restarted);
    assert_eq!(sequence.observe_message(41, &hello(9)), Gap::None);
}

#[test]
fn no_time_makes_it_panic_or_forget() {
    let mut sequence = Sequence::new();
    for (number, time) in [(0, u64::MAX), (5, 0), (40_000, u64::MAX), (40_001, 3), (9, u64::MAX / 2), (10, 0)] {
        sequence.observe_message(
            number,
            &Message::Pulse(Pulse { time: DeviceTime(time), verdict: PulseVerdict::Spurious }),
        );
    }
    assert_eq!((sequence.missing(), sequence.unknown(), sequence.restarts()), (0, 1, 2));
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

    /// A board at any pace, with losses of up to five turns and boots with and without their first word. What is counted was lost, no loss passes for a boot
    /// and no boot for a loss, and what is too long to count is said to be so.
    #[test]
    fn nothing_is_counted_that_was_not_lost(
        pace_us in 1_000..50_000_u64,
        jitter: u64,
        events in vec((0..4_u8, 0..5 * 65_536_u64, 20_000_000..400_000_000_u64, 0..5_u16), 1..12),
    ) {
        let mut board = Board { number: 0, time_us: 0, pace_us, random: jitter };
        let mut sequence = Sequence::new();
        let (mut certain, mut all, mut whole_turns) = (0, 0, false);
        for (kind, lost, down_us, timeless) in events {
            // Long enough for its time to be more than that of any boot's first words.
            for _ in 0..30_000_000 / pace_us {
                let told = board.hear(&mut sequence, None);
                prop_assert_eq!(told, Gap::None);
            }
            let before = sequence;
            let boot = kind == 0;
            let mut told = Vec::new();
            if boot {
                board = Board { number: 0, time_us: 0, ..board };
                if down_us % 2 == 0 {
                    told.push(sequence.observe_message(0, &HELLO));
                    prop_assert!(told[0] == Gap::Restarted || told[0] == Gap::None);
                    board.number = 1;
                }
                board.skip(lost % (20_000_000 / pace_us));
            } else {
                let lost = if kind == 1 { lost % 200 } else { lost };
                board.skip(lost);
                all += lost;
                certain += if lost < 14_000 { lost } else { 0 };
            }
            for _ in 0..timeless {
                told.push(board.hear(&mut sequence, Some(false)));
            }
            told.push(board.hear(&mut sequence, Some(true)));
            let grown = (sequence.missing() - before.missing(), sequence.restarts() - before.restarts());
            if boot {
                prop_assert_eq!(grown.1, 1, "{:?}", told);
                all += grown.0;
                continue;
            }
            let lost = if kind == 1 { lost % 200 } else { lost };
            prop_assert_eq!(grown.1, 0, "{} lost: {:?}", lost, told);
            match lost {
                0..14_000 => prop_assert_eq!(grown.0, lost, "{:?}", told),
                _ if lost % 65_536 == 0 => whole_turns = true,
                _ => prop_assert!(grown.0 == lost || told.contains(&Gap::Unknown), "{} lost: {:?}", lost, told),
            }
        }
        prop_assert!(sequence.missing() >= certain && sequence.missing() <= all);
        prop_assert!(sequence.missing() == all || sequence.unknown() > 0 || whole_turns);
    }
}

/// A board that works at its pace, more or less.
#[derive(Clone, Copy)]
struct Board {
    number: u64,
    time_us: u64,
    pace_us: u64,
    random: u64,
}

impl Board {
    fn skip(&mut self, frames: u64) {
        self.number += frames;
        self.time_us += frames * self.pace_us;
    }

    /// Its next frame is received, with a time or without.
    fn hear(&mut self, sequence: &mut Sequence, timed: Option<bool>) -> Gap {
        self.random = self.random.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        let random = self.random >> 33;
        let message = match random % 8 {
            _ if timed == Some(true) => pulse(self.time_us / 1_000),
            _ if timed == Some(false) => TIMELESS,
            // Late by what a scan waits.
            0 => pulse((self.time_us / 1_000).saturating_sub(random % 300)),
            1 => HELLO,
            2 => TIMELESS,
            _ => pulse(self.time_us / 1_000),
        };
        let out_of_turn_word = matches!(message, Message::Hello(_)) && self.number.is_multiple_of(65_536);
        let message = if out_of_turn_word { TIMELESS } else { message };
        let gap = sequence.observe_message((self.number % 65_536) as u16, &message);
        self.skip(1);
        gap
    }
}
