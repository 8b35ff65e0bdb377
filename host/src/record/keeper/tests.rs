//! What a board does, step by step, and what the keeper makes of it.

use std::time::Duration;

use super::*;
use crate::units::angle_of;
use crossfall_core::protocol::frame::{BoardDecoder, Event};
use crossfall_core::protocol::message::{Hello, Status};

fn tilted(degrees: f64) -> Config {
    let mut config = Config::default();
    config.scanner.mounting_offset = angle_of(degrees);
    config
}

/// A keeper, the board's end of its outbox, and what it tells.
struct Bench {
    keeper: Keeper,
    outbox: Outbox,
    now: Instant,
    told: Vec<Notice>,
}

impl Bench {
    fn new(wanted: Option<Config>) -> Self {
        let (outbox, now) = (Outbox::default(), Instant::now());
        Self { keeper: Keeper::new(outbox.clone(), wanted, now), outbox, now, told: Vec::new() }
    }

    fn hear(&mut self, message: &Message<'_>, gap: Gap) {
        self.keeper.hear(message, gap, self.now, &mut |notice| self.told.push(notice));
    }

    fn hello(&mut self, gap: Gap) {
        self.hello_in(schema::HASH, gap);
    }

    fn hello_in(&mut self, schema: u64, gap: Gap) {
        let hello = Hello { schema, firmware: "", board: "", boot: 0, restart: "" };
        self.hear(&Message::Hello(hello), gap);
    }

    fn config(&mut self, config: Config) {
        self.hear(&Message::Config(config), Gap::None);
    }

    fn reply(&mut self, to: u16, outcome: Outcome) {
        self.hear(&Message::Reply(Reply { to, outcome }), Gap::None);
    }

    fn wait(&mut self, time: Duration) {
        self.now += time;
        self.keeper.due(self.now, &mut |notice| self.told.push(notice));
    }

    fn said(&self) -> Vec<(u16, Command)> {
        let mut said = Vec::new();
        while let Some(frame) = self.outbox.take() {
            let (mut decoder, mut rest) = (BoardDecoder::new(), frame.as_slice());
            while let Some(event) = decoder.next(&mut rest) {
                let Event::Frame(frame) = event else { panic!("{event:?}") };
                said.push((frame.sequence, frame.body));
            }
        }
        said
    }

    fn told(&mut self) -> Vec<Notice> {
        mem::take(&mut self.told)
    }
}

fn in_force(config: Config, again: bool) -> Notice {
    Notice::InForce { config, again, profiles: 0 }
}

#[test]
fn a_board_that_has_it_is_not_asked() {
    let mut bench = Bench::new(Some(tilted(0.8)));
    assert!(bench.keeper.astray());
    bench.hello(Gap::None);
    bench.config(tilted(0.8));
    bench.wait(60 * ANSWER);
    assert_eq!((bench.said(), bench.told()), (vec![], vec![in_force(tilted(0.8), false)]));
    assert!(!bench.keeper.astray());
}

#[test]
fn a_board_that_boots_is_told_with_its_first_word_and_before_what_waits() {
    let mut bench = Bench::new(Some(tilted(0.8)));
    bench.hello(Gap::None);
    bench.config(tilted(0.8));
    bench.outbox.say(&Command::Start);
    bench.hello(Gap::Restarted);
    assert_eq!(bench.said(), [(2, Command::Configure(tilted(0.8))), (1, Command::Start)]);
    bench.config(Config::default());
    assert!(bench.keeper.astray() && bench.said().is_empty(), "the answer is awaited");
    bench.config(tilted(0.8));
    bench.reply(2, Outcome::Done);
    bench.wait(60 * ANSWER);
    assert_eq!(bench.told(), [in_force(tilted(0.8), false), in_force(tilted(0.8), true)]);
    assert!(!bench.keeper.astray() && bench.said().is_empty());
    // Its hello is lost, its numbers show it.
    bench.hear(&Message::Config(Config::default()), Gap::Restarted);
    assert_eq!(bench.said(), [(3, Command::Configure(tilted(0.8)))]);
}

#[test]
fn a_boot_that_noise_has_swallowed_shows_by_the_boards_time() {
    let mut bench = Bench::new(Some(tilted(0.8)));
    bench.hello(Gap::None);
    bench.config(tilted(0.8));
    bench.told();
    for seconds in [3_000, 3_001, 0, 1] {
        bench.hear(&Message::Status(Status { time: DeviceTime(seconds * 1_000_000), ..Status::default() }), Gap::None);
        assert_eq!(bench.said(), if seconds == 0 { vec![(1, Command::Identify)] } else { vec![] });
    }
    bench.hello(Gap::None);
    bench.config(Config::default());
    assert_eq!(bench.said(), [(2, Command::Configure(tilted(0.8)))]);
    bench.config(tilted(0.8));
    assert_eq!(bench.told(), [in_force(tilted(0.8), true)]);
}

#[test]
fn one_that_was_without_power_unseen_is_found_by_its_introduction() {
    let mut bench = Bench::new(Some(tilted(0.8)));
    bench.hello(Gap::None);
    bench.config(tilted(0.8));
    bench.keeper.disconnected();
    bench.wait(60 * ANSWER);
    bench.keeper.connected(bench.now);
    bench.hello(Gap::Missing(7));
    bench.config(Config::default());
    assert_eq!(bench.said(), [(1, Command::Configure(tilted(0.8)))]);
}

#[test]
fn no_answer_is_asked_for_three_times_and_then_at_the_next_hello() {
    let mut bench = Bench::new(Some(tilted(0.8)));
    bench.hello(Gap::None);
    bench.config(Config::default());
    for number in 1..=3 {
        assert_eq!(bench.said(), [(number, Command::Configure(tilted(0.8)))]);
        bench.wait(ANSWER / 2);
        assert!(bench.said().is_empty() && bench.told().is_empty());
        // A reply without the echo: a recording's, or the echo was lost.
        bench.reply(number, Outcome::Done);
        bench.wait(ANSWER / 2);
    }
    let why = Unconfigured::NoAnswer { tries: 3 };
    assert_eq!(bench.told(), [Notice::Unconfigured { why, echoed: Some(Config::default()) }]);
    bench.wait(60 * ANSWER);
    assert!(bench.said().is_empty() && bench.told().is_empty() && bench.keeper.astray());
    bench.hello(Gap::None);
    bench.config(Config::default());
    assert_eq!(bench.said(), [(4, Command::Configure(tilted(0.8)))]);
    // The answer to the first question, late.
    bench.config(tilted(0.8));
    assert!(!bench.keeper.astray());
}

#[test]
fn a_lost_introduction_is_asked_for() {
    let mut bench = Bench::new(Some(tilted(0.8)));
    for number in 1..=2 {
        bench.wait(ANSWER);
        assert_eq!(bench.said(), [(number, Command::Identify)]);
    }
    // Without a hello nobody knows what the board would make of it.
    bench.config(Config::default());
    assert!(bench.said().is_empty());
    bench.hello(Gap::None);
    bench.wait(ANSWER);
    assert_eq!(bench.said(), [(3, Command::Configure(tilted(0.8)))]);
}

#[test]
fn a_stream_that_nobody_listens_behind_is_given_up() {
    let mut bench = Bench::new(Some(tilted(0.8)));
    for _ in 0..60 {
        bench.wait(ANSWER);
    }
    let why = Unconfigured::NoAnswer { tries: 3 };
    assert_eq!(bench.told(), [Notice::Unconfigured { why, echoed: None }]);
    assert_eq!(bench.said().len(), 2, "the first question is the connection's own");
}

#[test]
fn refusals_and_other_schemas_are_told_at_once() {
    let mut bench = Bench::new(Some(tilted(0.8)));
    for (number, outcome, why) in
        [(1, Outcome::BadConfig, Unconfigured::Refused), (2, Outcome::Unknown, Unconfigured::NotUnderstood)]
    {
        bench.hello(Gap::None);
        bench.config(Config::default());
        assert_eq!(bench.said().len(), 1);
        bench.reply(number, outcome);
        assert_eq!(bench.told(), [Notice::Unconfigured { why, echoed: Some(Config::default()) }]);
    }
    for gap in [Gap::None, Gap::Restarted] {
        bench.hello_in(schema::HASH ^ 1, gap);
        bench.config(Config::default());
        bench.wait(60 * ANSWER);
        let why = Unconfigured::OtherSchema;
        assert_eq!(bench.told(), [Notice::Unconfigured { why, echoed: Some(Config::default()) }]);
        assert!(bench.said().is_empty());
    }
}

#[test]
fn what_is_put_in_force_from_elsewhere_is_kept_from_then_on() {
    for wanted in [None, Some(tilted(0.8))] {
        let mut bench = Bench::new(wanted);
        bench.hello(Gap::None);
        bench.config(wanted.unwrap_or_default());
        // Refused, it changes nothing.
        let refused = bench.outbox.say(&Command::Configure(tilted(-3.0))).unwrap();
        bench.reply(refused, Outcome::BadConfig);
        let number = bench.outbox.say(&Command::Configure(tilted(1.5))).unwrap();
        bench.config(tilted(1.5));
        bench.reply(number, Outcome::Done);
        bench.said();
        bench.hello(Gap::Restarted);
        assert_eq!(bench.said(), [(number + 1, Command::Configure(tilted(1.5)))]);
    }
}

#[test]
fn what_nobody_asked_for_is_told_and_not_fought() {
    let mut bench = Bench::new(None);
    bench.hello(Gap::None);
    bench.config(tilted(0.8));
    bench.hello(Gap::Restarted);
    bench.config(Config::default());
    bench.config(Config::default());
    assert_eq!(bench.told(), [Notice::Changed { before: tilted(0.8), now: Config::default() }]);
    assert!(!bench.keeper.astray() && bench.said().is_empty(), "nothing was wanted");

    let mut bench = Bench::new(Some(tilted(0.8)));
    bench.hello(Gap::None);
    bench.config(tilted(0.8));
    bench.told();
    bench.config(tilted(2.0));
    assert_eq!(bench.told(), [Notice::Changed { before: tilted(0.8), now: tilted(2.0) }]);
    assert!(bench.keeper.astray() && bench.said().is_empty());
}

#[test]
fn where_nothing_can_be_said_that_is_told_and_nothing_said() {
    let mut bench = Bench::new(Some(tilted(0.8)));
    bench.keeper.mute(&mut |notice| bench.told.push(notice));
    let mute = |echoed| Notice::Unconfigured { why: Unconfigured::Mute, echoed };
    assert_eq!(bench.told(), [mute(None)]);
    bench.hello(Gap::None);
    bench.config(Config::default());
    assert_eq!((bench.told(), bench.said()), (vec![mute(Some(Config::default()))], vec![]));
    bench.keeper.connected(bench.now);
    bench.hello(Gap::None);
    bench.config(Config::default());
    assert_eq!(bench.said(), [(1, Command::Configure(tilted(0.8)))]);
}
