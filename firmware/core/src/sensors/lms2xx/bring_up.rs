//! Brings a scanner from any state to continuous output at 500 kbaud, half degrees, 15-bit millimetres, with indices:
//! a user connects power and it works.
//!
//! A pure state machine: time and the decoder's events go in, [`Action`]s come out. It looks for the line's speed with a
//! status request (which disturbs nothing), stops the output, changes the speed, writes the configuration only where it
//! differs (each write wears the scanner's memory), chooses the variant and starts. What the scanner refuses is reported
//! and left as it is; a scanner that falls silent or restarts is looked for again, for ever, with a pause after
//! each round of speeds that grows to one second. A scanner that was only unplugged and still sends the scans that
//! were asked for is taken up with its first scan.
//!
//! Times are the telegram listing's: an answer begins within 60 ms, at least 30 ms pass after a NAK, a mode
//! change takes up to 3 s once it has been acknowledged. The owner calls [`super::Decoder::finish`] before it carries
//! out [`Action::SetBaud`] or [`Action::Send`]: garbage from the old speed must not hide the answer.

use crossfall_protocol::DeviceTime;

use super::command::{self, Baud, Telegram, Variant};
use super::decoder::Event;
use super::reply::{Configuration, ModeChange, Reply, Report};

/// What the scanner is to be brought to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Settings {
    /// Speed of the line.
    pub baud: Baud,
    /// Angle and step.
    pub variant: Variant,
    /// Measuring mode, 00h to 06h.
    pub measuring_mode: u8,
    /// Whether scans are to carry their indices.
    pub indices: bool,
    /// Password of the installation mode.
    pub password: [u8; 8],
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            baud: Baud::B500000,
            variant: Variant::Span180Step50,
            measuring_mode: 6,
            indices: true,
            password: command::PASSWORD,
        }
    }
}

/// What the owner is to do.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Action {
    /// Set the line to so many baud.
    SetBaud(u32),
    /// Send these bytes.
    Send(Telegram),
    /// Tell the user.
    Report(Progress),
}

/// How the bring-up goes on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Progress {
    /// Listening and asking at this speed.
    Searching(Baud),
    /// Nothing answered at any speed; the next round begins after so many milliseconds.
    Pausing(u16),
    /// Something valid was received at this speed.
    Found(Baud),
    /// A step begins.
    Doing(Step),
    /// The scanner refused a step, or does not know it: its setting stays as it is.
    Refused(Step),
    /// The scanner gave no answer to a step: it is looked for again.
    NoAnswer(Step),
    /// The scanner sends scans as asked, as far as nothing was refused.
    Running,
    /// No scan has come for too long.
    Silent,
    /// The scanner says that it has just been switched on.
    Restarted,
}

/// One step of the set-up: a command and its answer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Step {
    /// Stop the continuous output.
    Stop,
    /// Change the line's speed.
    Baud,
    /// Ask for the state: confirms the speed.
    Status,
    /// Read the configuration.
    ReadConfiguration,
    /// Enter the installation mode.
    Install,
    /// Write the configuration.
    WriteConfiguration,
    /// Leave the installation mode.
    Leave,
    /// Choose angle and step.
    Variant,
    /// Start the continuous output.
    Start,
}

impl Step {
    /// Whether the survey can do without it.
    fn is_optional(self) -> bool {
        matches!(self, Self::ReadConfiguration | Self::Install | Self::WriteConfiguration | Self::Variant)
    }
}

/// Operating mode of a scanner that sends all scans.
const CONTINUOUS: u8 = 0x24;
/// Before a command: after a NAK, and after a change of speed.
const REST_US: i64 = 30_000;
/// Until an acknowledgement or an answer must have come: the 60 ms of the listing, and the bytes of a scan that is
/// just going out and of the longest answer, 892 in all.
const fn answer_us(baud: Baud) -> i64 {
    match baud {
        Baud::B500000 => 120_000,
        Baud::B38400 => 340_000,
        Baud::B19200 => 570_000,
        Baud::B9600 => 1_030_000,
    }
}
/// Until the answer must have come once the command has been acknowledged: 3 s and some.
const CHANGE_US: i64 = 3_200_000;
/// Times a command is sent.
const TRIES: u8 = 3;
/// The first pause between rounds of the search; doubles up to the last.
const FIRST_PAUSE_MS: u16 = 250;
const LAST_PAUSE_MS: u16 = 1_000;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Phase {
    /// Nothing done yet.
    Idle,
    /// The speed of this place in the order has been set; the status request follows.
    Tuned(u8),
    /// Waiting for anything valid at this speed.
    Probing(u8),
    /// All speeds tried.
    Pausing,
    /// The step's command goes out when the deadline has come.
    Resting(Step),
    /// The step's command has gone out.
    Waiting(Step),
    /// Scans come.
    Running,
}

/// The state machine.
pub struct BringUp {
    settings: Settings,
    phase: Phase,
    /// When the phase ends by itself.
    deadline: DeviceTime,
    tries: u8,
    pause_ms: u16,
    /// Speed of the line.
    baud: Baud,
    report: Option<Report>,
    configuration: Option<Configuration>,
    /// Indices are wanted and have not been refused.
    indices: bool,
    /// The scanner has been set up and has not restarted since, as far as anyone knows.
    is_set_up: bool,
}

impl BringUp {
    /// A scanner of which nothing is known.
    #[must_use]
    pub fn new(settings: Settings) -> Self {
        Self {
            settings,
            phase: Phase::Idle,
            deadline: DeviceTime(0),
            tries: 0,
            pause_ms: FIRST_PAUSE_MS,
            baud: settings.baud,
            report: None,
            configuration: None,
            indices: settings.indices,
            is_set_up: false,
        }
    }

    /// Whether scans come.
    #[must_use]
    pub fn is_running(&self) -> bool {
        self.phase == Phase::Running
    }

    /// The speed that the line is to have.
    #[must_use]
    pub fn baud(&self) -> u32 {
        self.baud.rate()
    }

    /// When [`BringUp::tick`] has something to do at the latest.
    #[must_use]
    pub fn deadline(&self) -> DeviceTime {
        self.deadline
    }

    /// Begins from the start, as with a scanner of which nothing is known.
    pub fn restart(&mut self, now: DeviceTime, out: &mut impl FnMut(Action)) {
        self.is_set_up = false;
        self.search(now, out);
    }

    /// Lets time pass: to be called at least every few milliseconds.
    pub fn tick(&mut self, now: DeviceTime, out: &mut impl FnMut(Action)) {
        if now < self.deadline {
            return;
        }
        match self.phase {
            Phase::Idle | Phase::Pausing => self.tune(0, now, out),
            Phase::Tuned(place) => {
                out(Action::Send(command::status()));
                self.wait(Phase::Probing(place), now, answer_us(self.baud));
            }
            Phase::Probing(place) => self.tune(place + 1, now, out),
            Phase::Resting(step) => self.send(step, now, out),
            Phase::Waiting(step) if self.tries < TRIES => self.send(step, now, out),
            Phase::Waiting(step) if step.is_optional() => self.refused(step, now, out),
            Phase::Waiting(step) => {
                out(Action::Report(Progress::NoAnswer(step)));
                self.search(now, out);
            }
            Phase::Running => {
                out(Action::Report(Progress::Silent));
                self.search(now, out);
            }
        }
    }

    /// Takes an event of the decoder.
    pub fn event(&mut self, event: &Event<'_>, now: DeviceTime, out: &mut impl FnMut(Action)) {
        match (event, self.phase) {
            (Event::Reply { reply: Reply::PowerOn(_), .. }, _) => {
                out(Action::Report(Progress::Restarted));
                self.is_set_up = false;
                self.found(now, out);
            }
            (Event::Scan { .. }, Phase::Running) => self.wait(Phase::Running, now, self.silence_us()),
            // A scan that was asked for. One asked for may also overtake the answer to the start command.
            (Event::Scan { scan, .. }, Phase::Tuned(_) | Phase::Probing(_) | Phase::Pausing)
                if self.is_set_up && self.is_wanted(scan) =>
            {
                self.run(now, out);
            }
            // The answer to the search may come before the next scan is whole.
            (Event::Reply { reply: Reply::Report(report), .. }, Phase::Probing(_))
                if self.is_set_up && self.is_at_work(report) =>
            {
                self.run(now, out);
            }
            (Event::Scan { .. }, Phase::Waiting(Step::Start)) => self.run(now, out),
            (Event::Scan { .. } | Event::Reply { .. }, Phase::Tuned(_) | Phase::Probing(_) | Phase::Pausing) => {
                self.found(now, out);
            }
            (Event::Ack(_), Phase::Waiting(step)) => self.wait(Phase::Waiting(step), now, CHANGE_US),
            (Event::Nak(_), Phase::Waiting(step)) if self.tries < TRIES => {
                self.wait(Phase::Resting(step), now, REST_US);
            }
            (Event::Nak(_), Phase::Waiting(step)) => self.refused(step, now, out),
            (Event::Reply { reply, .. }, Phase::Waiting(step)) => match self.outcome(step, reply) {
                Some(true) => self.done(step, now, out),
                Some(false) => self.refused(step, now, out),
                None => {}
            },
            _ => {}
        }
    }

    /// Whether the reply answers the step, and with success. Keeps what it tells.
    fn outcome(&mut self, step: Step, reply: &Reply<'_>) -> Option<bool> {
        match (step, reply) {
            (_, Reply::Rejected) => Some(false),
            (Step::Status, Reply::Report(report)) => {
                self.report = Some(*report);
                Some(true)
            }
            (Step::ReadConfiguration, Reply::Configuration(configuration)) => {
                self.configuration = Some(*configuration);
                Some(true)
            }
            (Step::ReadConfiguration, Reply::Other { command: 0xf4, .. })
            | (Step::WriteConfiguration, Reply::Other { command: 0xf7, .. })
            | (Step::Variant, Reply::Other { command: 0xbb, .. }) => Some(false),
            (Step::WriteConfiguration, Reply::Configured { accepted, .. }) => Some(*accepted),
            (Step::Variant, Reply::Variant { changed, .. }) => Some(*changed),
            (Step::Stop | Step::Baud | Step::Install | Step::Leave | Step::Start, Reply::Mode(change)) => {
                Some(*change == ModeChange::Done)
            }
            _ => None,
        }
    }

    /// Goes on after a step that succeeded.
    fn done(&mut self, step: Step, now: DeviceTime, out: &mut impl FnMut(Action)) {
        match step {
            Step::Stop if self.baud != self.settings.baud => self.begin(Step::Baud, now, out),
            Step::Stop => self.begin(Step::Status, now, out),
            Step::Baud => {
                self.baud = self.settings.baud;
                out(Action::SetBaud(self.baud.rate()));
                self.rest(Step::Status, now, out);
            }
            Step::Status => self.begin(Step::ReadConfiguration, now, out),
            Step::ReadConfiguration if self.to_write().is_some() => self.begin(Step::Install, now, out),
            Step::Install => self.begin(Step::WriteConfiguration, now, out),
            Step::WriteConfiguration => self.begin(Step::Leave, now, out),
            Step::ReadConfiguration | Step::Leave if self.has_variant() => self.begin(Step::Start, now, out),
            Step::ReadConfiguration | Step::Leave => self.begin(Step::Variant, now, out),
            Step::Variant => self.begin(Step::Start, now, out),
            Step::Start => {
                self.is_set_up = true;
                self.run(now, out);
            }
        }
    }

    /// Goes on after a step that the scanner refused.
    fn refused(&mut self, step: Step, now: DeviceTime, out: &mut impl FnMut(Action)) {
        out(Action::Report(Progress::Refused(step)));
        match step {
            Step::Stop if self.baud != self.settings.baud => self.rest(Step::Baud, now, out),
            // The speed that was found must do.
            Step::Stop | Step::Baud => self.rest(Step::Status, now, out),
            Step::Status => self.rest(Step::ReadConfiguration, now, out),
            // Without its configuration nothing can be written.
            Step::ReadConfiguration => self.rest(Step::Variant, now, out),
            Step::Install => self.rest(Step::Leave, now, out),
            // An older scanner may know no indices: once more without them.
            Step::WriteConfiguration if self.indices => {
                self.indices = false;
                let next = if self.to_write().is_some() { Step::WriteConfiguration } else { Step::Leave };
                self.rest(next, now, out);
            }
            Step::WriteConfiguration => self.rest(Step::Leave, now, out),
            Step::Leave => self.rest(Step::Variant, now, out),
            Step::Variant => self.rest(Step::Start, now, out),
            Step::Start => self.search(now, out),
        }
    }

    /// The configuration to write; none when it is unknown or already as wanted.
    fn to_write(&self) -> Option<Configuration> {
        let stored = self.configuration?;
        let wanted = stored.for_survey(self.settings.measuring_mode, self.indices);
        (wanted != stored).then_some(wanted)
    }

    fn has_variant(&self) -> bool {
        self.report.is_some_and(|report| (report.span_deg, report.step_cdeg) == self.settings.variant.span_and_step())
    }

    fn is_wanted(&self, scan: &crate::scan::RawScan) -> bool {
        (scan.mode.span_deg, scan.mode.step_cdeg) == self.settings.variant.span_and_step()
            && self.baud == self.settings.baud
    }

    fn is_at_work(&self, report: &Report) -> bool {
        report.operating_mode == CONTINUOUS
            && (report.span_deg, report.step_cdeg) == self.settings.variant.span_and_step()
            && self.baud == self.settings.baud
    }

    /// Without a scan for so long, the scanner counts as silent: about 18 scans, or two at 9600 baud.
    fn silence_us(&self) -> i64 {
        if self.baud == Baud::B500000 { 500_000 } else { 2_000_000 }
    }

    /// The line's speeds in the order of the search: the others in turn, the wanted one before each of them, so that a
    /// scanner that returns is heard within a second or so.
    fn speed(&self, place: u8) -> Option<Baud> {
        let other = Baud::ALL.into_iter().filter(|&baud| baud != self.settings.baud).nth(usize::from(place / 2))?;
        Some(if place.is_multiple_of(2) { self.settings.baud } else { other })
    }

    fn search(&mut self, now: DeviceTime, out: &mut impl FnMut(Action)) {
        self.pause_ms = FIRST_PAUSE_MS;
        self.tune(0, now, out);
    }

    /// Tries the speed at this place of the order; after the last one, pauses where scans are expected.
    fn tune(&mut self, place: u8, now: DeviceTime, out: &mut impl FnMut(Action)) {
        let speed = self.speed(place);
        self.baud = speed.unwrap_or(self.settings.baud);
        out(Action::SetBaud(self.baud.rate()));
        if speed.is_some() {
            out(Action::Report(Progress::Searching(self.baud)));
            self.wait(Phase::Tuned(place), now, REST_US);
        } else {
            out(Action::Report(Progress::Pausing(self.pause_ms)));
            self.wait(Phase::Pausing, now, i64::from(self.pause_ms) * 1_000);
            self.pause_ms = (self.pause_ms * 2).min(LAST_PAUSE_MS);
        }
    }

    fn found(&mut self, now: DeviceTime, out: &mut impl FnMut(Action)) {
        out(Action::Report(Progress::Found(self.baud)));
        self.indices = self.settings.indices;
        (self.report, self.configuration) = (None, None);
        self.rest(Step::Stop, now, out);
    }

    fn run(&mut self, now: DeviceTime, out: &mut impl FnMut(Action)) {
        self.is_set_up = true;
        out(Action::Report(Progress::Running));
        self.wait(Phase::Running, now, self.silence_us());
    }

    /// Begins a step at once.
    fn begin(&mut self, step: Step, now: DeviceTime, out: &mut impl FnMut(Action)) {
        self.tries = 0;
        out(Action::Report(Progress::Doing(step)));
        self.send(step, now, out);
    }

    /// Begins a step after a rest.
    fn rest(&mut self, step: Step, now: DeviceTime, out: &mut impl FnMut(Action)) {
        self.tries = 0;
        out(Action::Report(Progress::Doing(step)));
        self.wait(Phase::Resting(step), now, REST_US);
    }

    fn send(&mut self, step: Step, now: DeviceTime, out: &mut impl FnMut(Action)) {
        let telegram = match step {
            Step::Stop | Step::Leave => command::stop_continuous(),
            Step::Baud => command::set_baud(self.settings.baud),
            Step::Status => command::status(),
            Step::ReadConfiguration => command::configuration(),
            Step::Install => command::installation_mode(self.settings.password),
            Step::WriteConfiguration => match self.to_write() {
                Some(configuration) => command::write_configuration(&configuration),
                None => return self.done(step, now, out),
            },
            Step::Variant => command::set_variant(self.settings.variant),
            Step::Start => command::start_continuous(),
        };
        self.tries += 1;
        out(Action::Send(telegram));
        self.wait(Phase::Waiting(step), now, answer_us(self.baud));
    }

    fn wait(&mut self, phase: Phase, now: DeviceTime, us: i64) {
        self.phase = phase;
        self.deadline = now.offset(us);
    }
}
