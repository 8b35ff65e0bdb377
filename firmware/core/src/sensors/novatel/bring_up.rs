//! Brings a receiver to sending the logs of the survey, and keeps it there.
//!
//! A pure state machine: time and the decoder's events go in, [`Action`]s come out. It clears the receiver's logs,
//! requests its own one after the other and watches that each arrives. One that stays away is requested again; when
//! nothing arrives at all the whole is repeated, for ever, with a pause that grows to one second. A receiver that was
//! only unplugged is taken up with its first frame.

use crossfall_protocol::DeviceTime;

use super::logs::{Event, Log, id};

/// A log to be requested.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Request {
    /// The command, with its line end.
    pub line: &'static [u8],
    /// Message number that is then expected.
    pub id: u16,
    /// Its period.
    pub period_us: u32,
}

/// Clears all logs.
pub const CLEAR: &[u8] = b"unlogall\r\n";

/// Poses at 100 Hz and the time once a second, on the receiver's first port.
pub const REQUESTS: [Request; 2] = [
    Request { line: b"log com1 inspvasb ontime 0.01\r\n", id: id::INSPVAS, period_us: 10_000 },
    Request { line: b"log com1 timeb ontime 1\r\n", id: id::TIME, period_us: 1_000_000 },
];

/// What the owner is to do.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Action {
    /// Send these bytes.
    Send(&'static [u8]),
    /// Tell the user.
    Report(Progress),
}

/// How the bring-up goes on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Progress {
    /// The logs are being requested.
    Requesting,
    /// Waiting for the first frame.
    Checking,
    /// Nothing came; the requests are repeated after so many milliseconds.
    Pausing(u16),
    /// Frames come.
    Running,
    /// The log with this number has stayed away; it is requested again.
    Missing(u16),
    /// Nothing has come for too long.
    Silent,
}

/// Between commands: the receiver works through one at a time.
const GAP_US: i64 = 50_000;
/// Until the first log must have come.
const CHECK_US: i64 = 500_000;
/// Without any of the logs for this and the shortest of their periods, the receiver counts as silent.
const SILENCE_US: i64 = 1_500_000;
/// A log is missing when it has not come for this and two of its periods.
const MARGIN_US: i64 = 1_000_000;
const FIRST_PAUSE_MS: u16 = 250;
/// The longest pause between two rounds of requests, and the third.
pub const LAST_PAUSE_MS: u16 = 1_000;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Phase {
    Idle,
    /// The request of this number goes out when the deadline has come.
    Requesting(usize),
    Checking,
    Pausing,
    Running,
}

/// The state machine for `N` logs.
pub struct BringUp<const N: usize> {
    requests: [Request; N],
    /// When each log counts as missing.
    overdue: [DeviceTime; N],
    phase: Phase,
    deadline: DeviceTime,
    pause_ms: u16,
}

impl Default for BringUp<{ REQUESTS.len() }> {
    fn default() -> Self {
        Self::new(REQUESTS)
    }
}

impl<const N: usize> BringUp<N> {
    /// A receiver of which nothing is known, and the logs wanted from it.
    #[must_use]
    pub fn new(requests: [Request; N]) -> Self {
        Self {
            requests,
            overdue: [DeviceTime(0); N],
            phase: Phase::Idle,
            deadline: DeviceTime(0),
            pause_ms: FIRST_PAUSE_MS,
        }
    }

    /// Whether logs come.
    #[must_use]
    pub fn is_running(&self) -> bool {
        self.phase == Phase::Running
    }

    /// Begins from the start: clears the receiver's logs and requests its own.
    pub fn restart(&mut self, now: DeviceTime, out: &mut impl FnMut(Action)) {
        self.pause_ms = FIRST_PAUSE_MS;
        self.clear(now, out);
    }

    /// Lets time pass: to be called at least every few milliseconds.
    pub fn tick(&mut self, now: DeviceTime, out: &mut impl FnMut(Action)) {
        if self.phase == Phase::Running {
            self.ask_again(now, out);
        }
        if now < self.deadline {
            return;
        }
        match self.phase {
            Phase::Idle | Phase::Pausing => self.clear(now, out),
            Phase::Requesting(next) => {
                if let Some(request) = self.requests.get(next) {
                    out(Action::Send(request.line));
                    self.wait(Phase::Requesting(next + 1), now, GAP_US);
                } else {
                    out(Action::Report(Progress::Checking));
                    self.wait(Phase::Checking, now, CHECK_US);
                }
            }
            Phase::Checking => {
                out(Action::Report(Progress::Pausing(self.pause_ms)));
                self.wait(Phase::Pausing, now, i64::from(self.pause_ms) * 1_000);
                self.pause_ms = (self.pause_ms * 2).min(LAST_PAUSE_MS);
            }
            Phase::Running => {
                out(Action::Report(Progress::Silent));
                self.pause_ms = FIRST_PAUSE_MS;
                self.clear(now, out);
            }
        }
    }

    /// Takes an event of the decoder.
    pub fn event(&mut self, event: &Event<'_>, now: DeviceTime, out: &mut impl FnMut(Action)) {
        if matches!(event.log, Log::Other(_)) {
            return;
        }
        let mut wanted = false;
        for (request, overdue) in self.requests.iter().zip(&mut self.overdue) {
            if request.id == event.header.id {
                *overdue = overdue_at(request, now);
                wanted = true;
            }
        }
        // While requests go out, what comes may be on its way from before they were cleared.
        if !wanted || matches!(self.phase, Phase::Idle | Phase::Requesting(_)) {
            return;
        }
        if self.phase != Phase::Running {
            out(Action::Report(Progress::Running));
            for (request, overdue) in self.requests.iter().zip(&mut self.overdue) {
                *overdue = overdue_at(request, now);
            }
        }
        self.wait(Phase::Running, now, SILENCE_US + self.shortest_us());
    }

    /// Requests again what has stayed away.
    fn ask_again(&mut self, now: DeviceTime, out: &mut impl FnMut(Action)) {
        for (request, overdue) in self.requests.iter().zip(&mut self.overdue) {
            if now >= *overdue {
                out(Action::Report(Progress::Missing(request.id)));
                out(Action::Send(request.line));
                *overdue = overdue_at(request, now);
            }
        }
    }

    /// The period of the most frequent log.
    fn shortest_us(&self) -> i64 {
        self.requests.iter().map(|request| i64::from(request.period_us)).min().unwrap_or(0)
    }

    fn clear(&mut self, now: DeviceTime, out: &mut impl FnMut(Action)) {
        out(Action::Report(Progress::Requesting));
        out(Action::Send(CLEAR));
        self.wait(Phase::Requesting(0), now, GAP_US);
    }

    fn wait(&mut self, phase: Phase, now: DeviceTime, us: i64) {
        self.phase = phase;
        self.deadline = now.offset(us);
    }
}

fn overdue_at(request: &Request, now: DeviceTime) -> DeviceTime {
    now.offset(MARGIN_US + 2 * i64::from(request.period_us))
}
