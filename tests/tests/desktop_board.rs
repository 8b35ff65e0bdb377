//! The firmware's tasks on a desktop: embassy's executor for std and a clock that the test moves. The lines are queues, the scanner answers the
//! bring-up, and a drive's bytes arrive with the stamps that a board's interrupts would give them. What comes out of the
//! link must be what the core makes of the same bytes without any task: the same scans, poses, pulses and profiles, bit for bit.

use std::cell::RefCell;
use std::collections::VecDeque;
use std::convert::Infallible;
use std::future::poll_fn;
use std::rc::Rc;
use std::sync::mpsc;
use std::task::{Poll, Waker};
use std::thread;
use std::time::Duration as Patience;

use crossfall::capture::Channel;
use crossfall::emulated::scanner::Scanner;
use crossfall::log;
use crossfall::simulate::scene::Scene;
use crossfall_core::instrument::{Decode, Identity};
use crossfall_core::protocol::frame::{Event, HostDecoder};
use crossfall_core::protocol::message::{Message, Status};
use crossfall_core::protocol::{Config, DeviceTime};
use crossfall_firmware::acquisition::{Acquisition, Shared};
use crossfall_firmware::lights::Lights;
use crossfall_firmware::line::{PulseInput, SensorLine, StampedRead};
use crossfall_firmware::outbox::{Outbox, Queue};
use crossfall_firmware::survey::Profiles;
use crossfall_firmware::work::{Places, WorkQueue, WorkReceiver};
use crossfall_firmware::{lights, link, now, sensors, survey};
use crossfall_tests::arrivals::{self, Arrival};
use crossfall_tests::drives;
use embassy_executor::{Executor, Spawner};
use embassy_time::{Duration, MockDriver};
use embedded_hal::digital::{ErrorType as PinErrors, OutputPin};
use embedded_io_async::{ErrorType, Read, Write};

/// The whole drive takes a second or two; a task that hangs takes for ever.
const PATIENCE: Patience = Patience::from_secs(120);

/// Bytes under way on a line, with their arrivals.
#[derive(Default)]
struct Bytes {
    queue: VecDeque<(u8, DeviceTime)>,
    waiting: Option<Waker>,
}

type End = Rc<RefCell<Bytes>>;

fn arrive(end: &End, byte: u8, at: DeviceTime) {
    let mut end = end.borrow_mut();
    end.queue.push_back((byte, at));
    end.waiting.take().into_iter().for_each(Waker::wake);
}

/// A sensor's line; what the board says goes to the scanner at its other end, if there is one.
struct Line {
    end: End,
    scanner: Option<Rc<RefCell<Scanner>>>,
    baud: u32,
    stamps: Vec<DeviceTime>,
}

impl ErrorType for Line {
    type Error = Infallible;
}

impl Read for Line {
    async fn read(&mut self, into: &mut [u8]) -> Result<usize, Infallible> {
        poll_fn(|context| {
            let mut end = self.end.borrow_mut();
            if end.queue.is_empty() {
                end.waiting = Some(context.waker().clone());
                return Poll::Pending;
            }
            let count = into.len().min(end.queue.len());
            self.stamps.clear();
            for (slot, (byte, at)) in into.iter_mut().zip(end.queue.drain(..count)) {
                *slot = byte;
                self.stamps.push(at);
            }
            Poll::Ready(Ok(count))
        })
        .await
    }
}

impl Write for Line {
    async fn write(&mut self, bytes: &[u8]) -> Result<usize, Infallible> {
        let answers = self.scanner.as_ref().map(|scanner| scanner.borrow_mut().hear(bytes, self.baud));
        for answer in answers.into_iter().flatten().filter(|answer| answer.baud == self.baud) {
            answer.bytes.iter().for_each(|&byte| arrive(&self.end, byte, now()));
        }
        Ok(bytes.len())
    }

    async fn flush(&mut self) -> Result<(), Infallible> {
        Ok(())
    }
}

impl StampedRead for Line {
    fn arrival(&self, k: usize) -> DeviceTime {
        self.stamps[k]
    }

    fn lost(&self) -> u32 {
        0
    }
}

impl SensorLine for Line {
    async fn set_baud(&mut self, baud: u32) {
        self.baud = baud;
    }
}

/// The pulse: edges as a line's bytes.
struct Pulses(Line);

impl PulseInput for Pulses {
    async fn edge(&mut self) -> DeviceTime {
        let mut edge = [0];
        let Ok(_one) = self.0.read(&mut edge).await;
        self.0.stamps[0]
    }

    fn overruns(&self) -> u32 {
        0
    }
}

/// The link: what the board sends is kept, and nothing is sent to it.
#[derive(Clone, Default)]
struct Link(Rc<RefCell<Vec<u8>>>);

impl ErrorType for Link {
    type Error = Infallible;
}

impl Write for Link {
    async fn write(&mut self, bytes: &[u8]) -> Result<usize, Infallible> {
        self.0.borrow_mut().extend_from_slice(bytes);
        Ok(bytes.len())
    }

    async fn flush(&mut self) -> Result<(), Infallible> {
        Ok(())
    }
}

/// A light, and how often it has changed.
#[derive(Clone, Default)]
struct Light(Rc<RefCell<(bool, u32)>>);

impl PinErrors for Light {
    type Error = Infallible;
}

impl OutputPin for Light {
    fn set_low(&mut self) -> Result<(), Infallible> {
        self.set(false)
    }

    fn set_high(&mut self) -> Result<(), Infallible> {
        self.set(true)
    }
}

impl Light {
    fn set(&self, on: bool) -> Result<(), Infallible> {
        let (was, changes) = *self.0.borrow();
        *self.0.borrow_mut() = (on, changes + u32::from(was != on));
        Ok(())
    }
}

type Board = &'static Shared<'static>;

#[embassy_executor::task]
async fn scanner_task(shared: Board, line: Line) {
    sensors::scanner(shared, line).await
}

#[embassy_executor::task]
async fn unit_task(shared: Board, line: Line) {
    sensors::inertial(shared, line).await
}

#[embassy_executor::task]
async fn pulse_task(shared: Board, pulses: Pulses) {
    sensors::pulse(shared, pulses).await
}

#[embassy_executor::task]
async fn send_task(queue: &'static Queue, out: Link) {
    link::send(queue, out).await
}

#[embassy_executor::task]
async fn profiles_task(shared: Board, profiles: &'static Profiles) {
    link::profiles(shared, profiles.receiver()).await
}

#[embassy_executor::task]
async fn time_task(shared: Board) {
    link::time(shared).await
}

#[embassy_executor::task]
async fn lights_task(shared: Board, running: Light, lock: Light, fault: Light) {
    lights::lights(shared, Lights { running, lock, fault }).await
}

#[embassy_executor::task]
async fn survey_task(work: WorkReceiver<'static>, profiles: &'static Profiles) {
    survey::survey(Box::leak(Box::default()), work, profiles.sender()).await
}

/// What the test gets to see.
struct Seen {
    wire: Vec<u8>,
    status: Status,
    lights: [(bool, u32); 3],
    set_up_us: u64,
}

/// Moves the clock and the sensors' ends of the lines; the last to be spawned.
#[embassy_executor::task]
async fn bench(
    shared: Board,
    ends: [End; 3],
    scanner: Rc<RefCell<Scanner>>,
    drive: Vec<Arrival>,
    out: Link,
    lights: [Light; 3],
    seen: mpsc::Sender<Seen>,
) {
    let clock = MockDriver::get();
    while !scanner.borrow().is_sending() {
        clock.advance(Duration::from_millis(1));
        settle().await;
    }
    let set_up_us = now().0;
    for Arrival { at_ns, channel, byte } in drive {
        let at = DeviceTime(at_ns / 1_000);
        // A millisecond at a time, as timers of a board would see it go by.
        while let Some(left) = at.0.checked_sub(now().0).filter(|&left| left > 0) {
            clock.advance(Duration::from_micros(left.min(1_000)));
            settle().await;
        }
        if channel == Channel::Lidar {
            let begin = scanner.borrow_mut().begin();
            for byte in begin.into_iter().flat_map(|answer| answer.bytes) {
                arrive(&ends[0], byte, at);
            }
        }
        let end = match channel {
            Channel::Lidar => &ends[0],
            Channel::Ins => &ends[1],
            _ => &ends[2],
        };
        arrive(end, byte, at);
        settle().await;
    }
    for _ in 0..1_500 {
        clock.advance(Duration::from_millis(1));
        settle().await;
    }
    let status = shared.borrow_mut().status(now());
    let lights = lights.map(|light| *light.0.borrow());
    let wire = out.0.borrow().clone();
    seen.send(Seen { wire, status, lights, set_up_us }).expect("the test waits");
    std::future::pending::<()>().await;
}

/// Lets every task do what it has to: none of them needs more turns for one byte.
async fn settle() {
    for _ in 0..6 {
        embassy_futures::yield_now().await;
    }
}

fn boot(spawner: Spawner, drive: Vec<Arrival>, seen: mpsc::Sender<Seen>) {
    let (sender, receiver) = Box::leak(Box::new(WorkQueue::new(Box::leak(Box::new(Places::new()))))).split();
    let profiles: &'static Profiles = Box::leak(Box::new(Profiles::new()));
    let queue: &'static Queue = Box::leak(Box::new(Queue::new()));
    let decode = Box::leak(Box::new(Decode::new(Config::default(), Identity::default())));
    let outbox = Box::leak(Box::new(Outbox::new(queue)));
    let shared: Board = Box::leak(Box::new(RefCell::new(Acquisition::new(decode, outbox, sender))));
    let ends: [End; 3] = Default::default();
    let mut scanner = Scanner::waiting_at(9_600);
    scanner.holds_start = true;
    let scanner = Rc::new(RefCell::new(scanner));
    let line = |k: usize, scanner| Line { end: ends[k].clone(), scanner, baud: 500_000, stamps: Vec::new() };
    let (out, lights): (Link, [Light; 3]) = Default::default();
    shared.borrow_mut().start(now());
    let [running, lock, fault] = lights.clone();
    spawner.spawn(scanner_task(shared, line(0, Some(scanner.clone()))).expect("spawned once"));
    spawner.spawn(unit_task(shared, line(1, None)).expect("spawned once"));
    spawner.spawn(pulse_task(shared, Pulses(line(2, None))).expect("spawned once"));
    spawner.spawn(send_task(queue, out.clone()).expect("spawned once"));
    spawner.spawn(profiles_task(shared, profiles).expect("spawned once"));
    spawner.spawn(time_task(shared).expect("spawned once"));
    spawner.spawn(lights_task(shared, running, lock, fault).expect("spawned once"));
    spawner.spawn(survey_task(receiver, profiles).expect("spawned once"));
    spawner.spawn(bench(shared, ends, scanner, drive, out, lights, seen).expect("spawned once"));
}

/// The messages that sensors bring about, as text, and what the board says in words; a frame's number is left out.
#[derive(Debug, Default, PartialEq)]
struct Stream {
    inputs: Vec<String>,
    profiles: Vec<String>,
    words: Vec<String>,
}

fn stream(wire: &[u8]) -> Stream {
    let (mut decoder, mut rest, mut stream) = (HostDecoder::new(), wire, Stream::default());
    while let Some(event) = decoder.next(&mut rest) {
        let Event::Frame(frame) = event else { panic!("a damaged frame: {event:?}") };
        match frame.body {
            Message::Scan(_) | Message::Pose(_) | Message::Pulse(_) => {
                stream.inputs.push(format!("{:?}", frame.body));
            }
            Message::Log(log) => stream.words.push(String::from_utf8_lossy(log.text).into_owned()),
            Message::Profile(profile) => stream.profiles.push(format!("{profile:?}")),
            _ => {}
        }
    }
    stream
}

#[test]
fn the_tasks_stream_what_the_core_alone_makes_of_the_same_bytes() {
    let scratch = tempfile::tempdir().expect("a scratch folder");
    let (capture_path, log_path) = (scratch.path().join("drive.mcap"), scratch.path().join("drive.log.mcap"));
    let mut scene = Scene::default();
    scene.drive.seconds = 8.0;
    // The board boots at 0, has its scanner up before the drive begins, and misses the unit.
    scene.clock.start_s = 6.0;
    drives::capture(&scene, &capture_path);

    drives::log(&capture_path, &log_path);
    let frames = log::Reader::open(&log_path).expect("a log").flat_map(|frame| frame.expect("whole").bytes);
    let expected = stream(&frames.collect::<Vec<u8>>());

    let drive = arrivals::of(&capture_path, &Config::default());
    let (seen, outcome) = mpsc::channel();
    // An executor runs for ever: its thread ends with the test's process.
    thread::spawn(move || {
        let executor: &'static mut Executor = Box::leak(Box::new(Executor::new()));
        executor.run(|spawner| boot(spawner, drive, seen));
    });
    let Seen { wire, status, lights, set_up_us } = outcome.recv_timeout(PATIENCE).expect("the drive ends");
    println!("{status:?}; the scanner was set up after {} ms", set_up_us / 1_000);
    let streamed = stream(&wire);
    assert_eq!(streamed.inputs.len(), expected.inputs.len());
    assert!(streamed.inputs == expected.inputs, "scans, poses or pulses differ");
    // `run` ends the survey and so measures the last scans too.
    let measured = streamed.profiles.len();
    assert!(measured + crossfall_core::instrument::WAITING >= expected.profiles.len(), "{measured} profiles");
    assert!(streamed.profiles == expected.profiles[..measured], "profiles differ");

    // It sends nothing before the drive begins.
    let unit: Vec<_> = streamed.words.iter().filter(|words| words.starts_with("inertial unit")).take(2).collect();
    assert_eq!(unit, ["inertial unit: sends none of its logs, still asking", "inertial unit: sends its logs"]);
    assert_eq!((status.scans_missing, status.scans_skipped, status.frames_dropped), (0, 0, 0));
    assert_eq!((status.lidar.bad_frames, status.ins.bad_frames, status.pulses_spurious), (0, 0, 0));
    let [(_, blinks), (locked, _), (fault, _)] = lights;
    assert!(blinks > 10 && locked && !fault, "{lights:?}");
    assert!(set_up_us < 3_000_000, "the bring-up takes {set_up_us} us");
}
