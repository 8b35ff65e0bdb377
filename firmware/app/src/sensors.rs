//! The sensors' tasks: bytes and pulses into the decode layer, the bring-up's words out to the sensors.
//!
//! The bring-up itself is a pair of pure state machines of the core; here are their line, their clock and their voice. They
//! run for ever: a sensor that falls silent or restarts is brought up again.

use core::fmt::Write as _;

use crossfall_core::sensors::lms2xx::bring_up as scanner_up;
use crossfall_core::sensors::lms2xx::command::Baud;
use crossfall_core::sensors::novatel::bring_up as unit_up;
use crossfall_protocol::message::{Level, Sensor};
use embassy_futures::select::{Either, select};
use embassy_time::{Duration, Timer};

use crate::acquisition::Shared;
use crate::line::{PulseInput, SensorLine};
use crate::now;

/// Bytes taken from a line at a time.
const CHUNK: usize = 64;

/// How often a silent line's bring-up is asked what to do.
const TICK: Duration = Duration::from_millis(5);

/// Actions that one byte or one tick can bring about: three, by the state machines; room for twice as many.
const ACTIONS: usize = 6;

/// Longest line that is told.
type Line = heapless::String<96>;

/// Brings the scanner up and takes its bytes, for ever.
pub async fn scanner<L: SensorLine>(shared: &Shared<'_>, mut line: L) -> ! {
    let mut bring_up = scanner_up::BringUp::new(settings(shared));
    let mut told_silent = false;
    let mut actions: heapless::Vec<scanner_up::Action, ACTIONS> = heapless::Vec::new();
    let mut chunk = [0; CHUNK];
    loop {
        let count = read(&mut line, &mut chunk).await;
        for (k, &byte) in chunk.iter().take(count).enumerate() {
            shared.borrow_mut().lidar_byte(byte, line.arrival(k), line.lost(), &mut |event| {
                bring_up.event(event, now(), &mut |action| note(&mut actions, action));
            });
            perform(shared, &mut line, &mut actions, &mut told_silent).await;
        }
        if shared.borrow_mut().take_restart(Sensor::Lidar) {
            bring_up = scanner_up::BringUp::new(settings(shared));
            bring_up.restart(now(), &mut |action| note(&mut actions, action));
            perform(shared, &mut line, &mut actions, &mut told_silent).await;
        }
        bring_up.tick(now(), &mut |action| note(&mut actions, action));
        perform(shared, &mut line, &mut actions, &mut told_silent).await;
    }
}

/// What the scanner is to be brought to, by the configuration in force.
fn settings(shared: &Shared<'_>) -> scanner_up::Settings {
    let config = shared.borrow().config().scanner;
    scanner_up::Settings {
        baud: Baud::of(config.baud).unwrap_or(Baud::B500000),
        measuring_mode: config.measuring_mode,
        ..scanner_up::Settings::default()
    }
}

/// Carries out what the scanner's bring-up has decided.
async fn perform<L: SensorLine>(
    shared: &Shared<'_>,
    line: &mut L,
    actions: &mut heapless::Vec<scanner_up::Action, ACTIONS>,
    told_silent: &mut bool,
) {
    for action in &*actions {
        match action {
            scanner_up::Action::SetBaud(baud) => {
                shared.borrow_mut().cut_lidar();
                line.set_baud(*baud).await;
            }
            scanner_up::Action::Send(telegram) => {
                shared.borrow_mut().cut_lidar();
                // A line that fails is a scanner that does not answer: the bring-up's own case.
                let _unheard = line.write_all(telegram).await;
            }
            scanner_up::Action::Report(progress) => tell_scanner(shared, *progress, told_silent),
        }
    }
    actions.clear();
}

/// Brings the inertial unit up and takes its bytes, for ever.
pub async fn inertial<L: SensorLine>(shared: &Shared<'_>, mut line: L) -> ! {
    let mut bring_up = unit_up::BringUp::default();
    let mut actions: heapless::Vec<unit_up::Action, ACTIONS> = heapless::Vec::new();
    let mut chunk = [0; CHUNK];
    let mut told_silent = false;
    loop {
        let count = read(&mut line, &mut chunk).await;
        {
            let mut acquisition = shared.borrow_mut();
            for (k, &byte) in chunk.iter().take(count).enumerate() {
                acquisition.ins_byte(byte, line.arrival(k), line.lost(), &mut |event| {
                    bring_up.event(event, now(), &mut |action| note(&mut actions, action));
                });
            }
        }
        if shared.borrow_mut().take_restart(Sensor::Ins) {
            // The unit keeps its own rate: the line follows what the configuration says of it.
            let baud = shared.borrow().config().ins.baud;
            line.set_baud(baud).await;
            bring_up.restart(now(), &mut |action| note(&mut actions, action));
        } else {
            bring_up.tick(now(), &mut |action| note(&mut actions, action));
        }
        for action in &actions {
            match action {
                unit_up::Action::Send(command) => {
                    let _unheard = line.write_all(command).await;
                }
                unit_up::Action::Report(progress) => tell_unit(shared, *progress, &mut told_silent),
            }
        }
        actions.clear();
    }
}

/// Takes the pulse per second, for ever.
pub async fn pulse<P: PulseInput>(shared: &Shared<'_>, mut pulses: P) -> ! {
    loop {
        let edge = pulses.edge().await;
        shared.borrow_mut().pulse(edge, pulses.overruns());
    }
}

/// Keeps an action until it is carried out. There is always room: see [`ACTIONS`].
fn note<A>(actions: &mut heapless::Vec<A, ACTIONS>, action: A) {
    let _fits = actions.push(action);
}

/// What the line has, waiting for it no longer than a tick.
async fn read<L: SensorLine>(line: &mut L, chunk: &mut [u8]) -> usize {
    match select(line.read(chunk), Timer::after(TICK)).await {
        Either::First(Ok(count)) => count,
        // A failing line is a silent one; it is left alone for as long.
        Either::First(Err(_)) => {
            Timer::after(TICK).await;
            0
        }
        Either::Second(()) => 0,
    }
}

/// How the scanner's bring-up goes on, in words. Of a search, which may last for ever, only the first round in vain is told.
fn tell_scanner(shared: &Shared<'_>, progress: scanner_up::Progress, told_silent: &mut bool) {
    use scanner_up::Progress;
    let mut line = Line::new();
    let (level, written) = match progress {
        Progress::Searching(_) | Progress::Doing(_) => return,
        Progress::Pausing(_) if core::mem::replace(told_silent, true) => return,
        Progress::Pausing(_) => (Level::Warn, write!(line, "scanner: answers at no rate, still looking for it")),
        Progress::Found(baud) => {
            *told_silent = false;
            (Level::Info, write!(line, "scanner: found at {} baud", baud.rate()))
        }
        Progress::Refused(step) => (Level::Warn, write!(line, "scanner: refuses to {}", name(step))),
        Progress::NoAnswer(step) => (Level::Warn, write!(line, "scanner: does not answer when told to {}", name(step))),
        Progress::Running => (Level::Info, write!(line, "scanner: sends scans")),
        Progress::Silent => (Level::Warn, write!(line, "scanner: silent, looking for it")),
        Progress::Restarted => (Level::Warn, write!(line, "scanner: has restarted")),
    };
    if written.is_ok() {
        shared.borrow_mut().log(now(), level, line.as_bytes());
    }
}

/// What a step asks of the scanner.
fn name(step: scanner_up::Step) -> &'static str {
    use scanner_up::Step;
    match step {
        Step::Stop => "stop its output",
        Step::Baud => "change its line's rate",
        Step::Status => "report its state",
        Step::ReadConfiguration => "report its configuration",
        Step::Install => "enter installation mode",
        Step::WriteConfiguration => "store a configuration",
        Step::Leave => "leave installation mode",
        Step::Variant => "change angle and step",
        Step::Start => "start its output",
    }
}

/// How the unit's bring-up goes on, likewise.
fn tell_unit(shared: &Shared<'_>, progress: unit_up::Progress, told_silent: &mut bool) {
    use unit_up::Progress;
    let mut line = Line::new();
    let (level, written) = match progress {
        // A unit takes longer to start than a board: the first two rounds say nothing yet.
        Progress::Requesting | Progress::Checking | Progress::Pausing(..unit_up::LAST_PAUSE_MS) => return,
        Progress::Pausing(_) if core::mem::replace(told_silent, true) => return,
        Progress::Pausing(_) => (Level::Warn, write!(line, "inertial unit: sends none of its logs, still asking")),
        Progress::Running => {
            *told_silent = false;
            (Level::Info, write!(line, "inertial unit: sends its logs"))
        }
        Progress::Missing(id) => (Level::Warn, write!(line, "inertial unit: log {id} stays away, requested again")),
        Progress::Silent => (Level::Warn, write!(line, "inertial unit: silent, requesting its logs again")),
    };
    if written.is_ok() {
        shared.borrow_mut().log(now(), level, line.as_bytes());
    }
}
