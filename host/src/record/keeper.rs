//! Keeps a configuration in force on a board that may restart at any time.
//!
//! A board has no memory for its configuration: after a watchdog, a brown-out or a power cycle it measures with the defaults, and every
//! slope is off by the whole of the calibrated mounting offset. So what was put in force in this run - by the caller, or by a command
//! from elsewhere in this program whose echo comes back - is sent again with the first word of a board that has booted, before anything that
//! waits. On a board that is at work already the introduction is read first, and nothing is sent where the configuration is there.
//!
//! In force is what the board echoes, and nothing else: the echo stands in the stream where it holds from, and is what replays of the log go
//! by. A reply alone proves nothing (the stream may be a recording); it only ends the wait where it is a refusal. A question without an
//! answer is repeated [`TRIES`] times, [`ANSWER`] apart, and then given up until the next hello; nobody is kept waiting meanwhile.
//! A configuration that somebody else puts in force is told and not fought.
//!
//! A boot shows by the hello and by the frames' numbers (`Sequence`). Where noise has swallowed the one and the others happen to look like a
//! loss, it shows within a second by the board's time, which goes back; then the board is asked who it is.

#[cfg(test)]
mod tests;

use std::mem;
use std::time::Instant;

use crossfall_core::protocol::frame::Gap;
use crossfall_core::protocol::message::{Command, Message, Outcome, Reply};
use crossfall_core::protocol::{Config, DeviceTime, schema};

use super::outbox::ANSWER;
use super::{Notice, Outbox, Unconfigured};

/// How often a board is asked.
const TRIES: u8 = 3;

/// See the module.
pub struct Keeper {
    outbox: Outbox,
    /// What is to be in force.
    wanted: Option<Config>,
    /// Whether it is.
    in_force: bool,
    /// Whether anything has been.
    ever_in_force: bool,
    /// What the board has said last, on this boot or before.
    echoed: Option<Config>,
    /// Whether the board speaks the messages that this program knows; not known before its first hello.
    understood: Option<bool>,
    /// Profiles since the board booted, or came back, or was heard first.
    profiles: u64,
    /// The board's time in its last status, on this boot and this connection.
    time: Option<DeviceTime>,
    /// Whether nothing can be said on this connection.
    mute: bool,
    step: Step,
}

#[derive(Clone, Copy)]
enum Step {
    /// Nothing is awaited.
    Settled,
    /// The board's introduction is awaited.
    Greeting { tries: u8, until: Instant },
    /// The echo of the configuration is awaited.
    Asking { tries: u8, until: Instant },
}

impl Keeper {
    /// One for a connection that begins with the question who the board is.
    pub fn new(outbox: Outbox, wanted: Option<Config>, now: Instant) -> Self {
        let mut keeper = Self {
            outbox,
            wanted,
            in_force: false,
            ever_in_force: false,
            echoed: None,
            understood: None,
            profiles: 0,
            time: None,
            mute: false,
            step: Step::Settled,
        };
        keeper.connected(now);
        keeper
    }

    /// Whether a configuration is to be in force that is not.
    pub fn astray(&self) -> bool {
        self.wanted.is_some() && !self.in_force
    }

    /// There is a connection, and the board was asked who it is.
    pub fn connected(&mut self, now: Instant) {
        self.mute = false;
        self.greet(now);
    }

    /// There is none any more: nothing can be asked, and what was in force may have gone with the board's power.
    pub fn disconnected(&mut self) {
        self.step = Step::Settled;
    }

    /// Nothing can be said on this connection.
    pub fn mute(&mut self, notice: &mut impl FnMut(Notice)) {
        self.mute = true;
        self.step = Step::Settled;
        if self.astray() {
            self.give_up(Unconfigured::Mute, notice);
        }
    }

    /// The next message, and what its number says of those before it.
    pub fn hear(&mut self, message: &Message<'_>, gap: Gap, now: Instant, notice: &mut impl FnMut(Notice)) {
        let restarted = gap == Gap::Restarted;
        if let Message::Hello(hello) = message {
            self.understood = Some(hello.schema == schema::HASH);
        }
        if restarted {
            self.outbox.board_booted();
            self.in_force = false;
            self.greet(now);
        }
        match message {
            _ if self.wanted.is_none() => {}
            _ if restarted && self.understood == Some(true) => self.ask(1, now, notice),
            Message::Hello(_) => self.introduced(now, notice),
            _ => {}
        }
        match message {
            Message::Config(config) => self.echoed(*config, now, notice),
            Message::Reply(reply) => self.answered(*reply, notice),
            Message::Profile(_) => self.profiles += 1,
            Message::Status(status) => {
                let before = self.time.replace(status.time);
                if before.is_some_and(|before| status.time < before) && !self.mute {
                    self.outbox.say(&Command::Identify);
                }
            }
            _ => {}
        }
    }

    /// What is due by time.
    pub fn due(&mut self, now: Instant, notice: &mut impl FnMut(Notice)) {
        match self.step {
            Step::Greeting { until, .. } if now >= until && self.understood == Some(true) => self.ask(1, now, notice),
            Step::Greeting { tries, until } if now >= until && tries < TRIES => {
                self.outbox.say(&Command::Identify);
                self.step = Step::Greeting { tries: tries + 1, until: now + ANSWER };
            }
            Step::Asking { tries, until } if now >= until && tries < TRIES => self.ask(tries + 1, now, notice),
            Step::Greeting { tries, until } | Step::Asking { tries, until } if now >= until => {
                self.give_up(Unconfigured::NoAnswer { tries }, notice);
            }
            _ => {}
        }
    }

    /// The board's introduction is to come.
    fn greet(&mut self, now: Instant) {
        (self.profiles, self.time) = (0, None);
        if self.wanted.is_some() {
            self.step = Step::Greeting { tries: 1, until: now + ANSWER };
        }
    }

    /// A board that is at work says who it is; its configuration follows.
    fn introduced(&mut self, now: Instant, notice: &mut impl FnMut(Notice)) {
        if self.understood == Some(false) {
            self.give_up(Unconfigured::OtherSchema, notice);
        } else if !matches!(self.step, Step::Asking { .. }) {
            self.step = Step::Greeting { tries: 1, until: now + ANSWER };
        }
    }

    fn ask(&mut self, tries: u8, now: Instant, notice: &mut impl FnMut(Notice)) {
        if self.mute {
            self.give_up(Unconfigured::Mute, notice);
        } else if let Some(config) = self.wanted {
            // Before what viewers have asked for: a configuration among that is the newer one.
            self.outbox.say_first(&Command::Configure(config));
            self.step = Step::Asking { tries, until: now + ANSWER };
        }
    }

    fn echoed(&mut self, config: Config, now: Instant, notice: &mut impl FnMut(Notice)) {
        let before = self.echoed.replace(config);
        if self.outbox.has_said(&config) {
            self.wanted = Some(config);
        }
        if self.wanted == Some(config) {
            self.step = Step::Settled;
            if !mem::replace(&mut self.in_force, true) {
                let again = mem::replace(&mut self.ever_in_force, true);
                notice(Notice::InForce { config, again, profiles: self.profiles });
            }
            return;
        }
        self.in_force = false;
        match (self.step, before) {
            (Step::Greeting { .. }, _) if self.understood == Some(true) => self.ask(1, now, notice),
            (Step::Settled, Some(before)) if before != config => notice(Notice::Changed { before, now: config }),
            _ => {}
        }
    }

    fn answered(&mut self, reply: Reply, notice: &mut impl FnMut(Notice)) {
        let asked = self.outbox.answered(reply.to);
        if asked.is_none() || asked != self.wanted || !matches!(self.step, Step::Asking { .. }) {
            return;
        }
        match reply.outcome {
            Outcome::BadConfig => self.give_up(Unconfigured::Refused, notice),
            Outcome::Unknown => self.give_up(Unconfigured::NotUnderstood, notice),
            // The echo has gone before; where it has not arrived, it is asked for again when its time is over.
            Outcome::Done | Outcome::Pong(_) => {}
        }
    }

    fn give_up(&mut self, why: Unconfigured, notice: &mut impl FnMut(Notice)) {
        (self.step, self.in_force) = (Step::Settled, false);
        notice(Notice::Unconfigured { why, echoed: self.echoed });
    }
}
