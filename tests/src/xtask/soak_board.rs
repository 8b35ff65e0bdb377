//! `cargo xtask soak`: ten minutes of drive through the emulated board, at half the scanner's rate, by the board's own clock. Nothing may be lost and
//! nothing may grow: the board's counters and its stack are looked at every half minute, and it says how long it took.

use std::cell::RefCell;
use std::process::ExitCode;
use std::time::{Duration, Instant};

use crossfall::emulated::scanner::{Mode, Scanner};
use crossfall::simulate::scene::Scene;
use crossfall::{capture, counters, log, simulate, verify};
use crossfall_core::protocol::message::{Message, Status};
use crossfall_tests::emulator::{Emulator, Image, Options, Step, at_line_rates, half_the_scans, image, told};

/// Seconds of drive unless told otherwise.
const SECONDS: u64 = 600;

/// How often the board is looked at, in seconds of the drive.
const LOOK_S: u64 = 30;

/// One instruction is 32 ns of the board's time, 31 million a second: a quarter of what the silicon does. A board that holds the drive so
/// holds it on the chip, and ten minutes take less than ten: while QEMU hands the board its bytes, only instructions move the board's clock.
const TIME: [&str; 2] = ["-icount", "shift=5"];

/// The stack has seen every path by now, in looks. What may still come is that two of the deepest meet, or interrupts on top of them: less than
/// this, in bytes, whatever the time.
const SETTLED: usize = 4;
const COINCIDENCE: u32 = 512;

/// How long the bring-up and the end may take.
const PATIENCE: Duration = Duration::from_secs(120);

type Failure = Box<dyn std::error::Error>;

/// Runs the soak over so many seconds of drive, or [`SECONDS`].
pub fn run(seconds: Option<&str>) -> ExitCode {
    let seconds = match seconds.map(str::parse) {
        None => SECONDS,
        Some(Ok(seconds)) if seconds > 0 => seconds,
        Some(_) => {
            eprintln!("xtask: soak: expected a number of seconds");
            return ExitCode::from(2);
        }
    };
    match soak(seconds) {
        Ok(problems) if problems.is_empty() => {
            println!("soak: {seconds} s of drive, nothing lost, nothing grown");
            ExitCode::SUCCESS
        }
        Ok(problems) => {
            problems.iter().for_each(|problem| println!("soak: {problem}"));
            ExitCode::FAILURE
        }
        Err(error) => {
            eprintln!("xtask: soak: {error}");
            ExitCode::FAILURE
        }
    }
}

/// What was lost or has grown.
fn soak(seconds: u64) -> Result<Vec<String>, Failure> {
    let scratch = tempfile::tempdir()?;
    let drive_path = scratch.path().join("drive.mcap");
    let mut scene = Scene::default();
    scene.drive.seconds = seconds as f64;
    at_line_rates(&mut scene);
    let mut writer = capture::Writer::create(&drive_path)?;
    let made = simulate::simulate(&scene, &mut writer, |_| ())?;
    writer.finish()?;
    let scans = made.truth.len().div_ceil(2);

    let begun = Instant::now();
    let mut board = on_one_processor(|| {
        Emulator::start(&image(Image::Board), &Options { arguments: TIME.map(String::from).to_vec() })
    })?;
    let mut scanner = Scanner::waiting_at(9_600);
    scanner.holds_start = true;
    if !board.converse(&mut scanner, PATIENCE, |scanner| scanner.mode == Mode::Continuous)? {
        return Err(format!("the bring-up got as far as {:x?}", scanner.understood).into());
    }
    let reader = capture::Reader::open(&drive_path)?;
    let start_ns = reader.span_ns().map_or(0, |(first, _)| first);
    // A capture that was just written here is whole.
    let mut drive = half_the_scans(reader.map_while(Result::ok)).peekable();
    let (stacks, seen) = (RefCell::new(Vec::new()), RefCell::new(0));
    let mut next_look = LOOK_S;
    let mut rest = Some(start_ns + (seconds + 2) * 1_000_000_000);
    let steps = std::iter::from_fn(|| {
        let look_ns = start_ns + next_look * 1_000_000_000;
        match drive.peek() {
            Some(chunk) if chunk.device_time_ns < look_ns => drive.next().map(Step::Bytes),
            Some(_) => {
                let (second, stacks, seen) = (next_look, &stacks, &seen);
                next_look += LOOK_S;
                Some(Step::Do(
                    look_ns,
                    Box::new(move |board: &mut Emulator, _: &mut Scanner| {
                        let stack = board.stack()?.0;
                        let status = latest(board, &mut seen.borrow_mut());
                        println!(
                            "{second:5} s: {} scans, {} poses, {} pulses, {} losses, {stack} bytes of stack; {:.0} s of this machine",
                            status.scans,
                            status.poses,
                            status.pulses,
                            counters::losses(&status).len(),
                            begun.elapsed().as_secs_f64()
                        );
                        stacks.borrow_mut().push(stack);
                        Ok(())
                    }),
                ))
            }
            None => rest.take().map(|at_ns| Step::Do(at_ns, Box::new(|_, _| Ok(())))),
        }
    });
    let played = board.play(&mut scanner, steps, |_| ())?;
    let status = board.stop(PATIENCE)?;
    let took = begun.elapsed();

    let log_path = scratch.path().join("soak.log.mcap");
    let mut writer = log::Writer::create(&log_path)?;
    for (receive_ns, frame) in board.link.stamped_frames() {
        writer.frame(receive_ns, &frame)?;
    }
    writer.finish()?;
    let report = verify::verify(&log_path, |_| ())?;
    println!("{seconds} s of drive and the bring-up took {:.0} s of this machine", took.as_secs_f64());
    println!(
        "{} of {} profiles reproduced; this machine was {:.1} ms late at worst",
        report.profiles_reproduced,
        report.profiles,
        played.latest.as_secs_f64() * 1e3
    );

    let mut problems: Vec<String> =
        counters::losses(&status).into_iter().map(|(name, count)| format!("lost: {name} = {count}")).collect();
    let mut expect = |what: &str, found: u64, expected: u64| {
        if found != expected {
            problems.push(format!("{what}: {found}, expected {expected}"));
        }
    };
    expect("scans", status.scans.into(), scans as u64);
    expect("poses", status.poses.into(), made.poses);
    expect("pulses", status.pulses.into(), made.pulses);
    expect("profiles", report.profiles, scans as u64);
    expect("profiles reproduced", report.profiles_reproduced, scans as u64);
    expect("problems of the log", report.problems.len() as u64, 0);
    expect("frames missing", board.link.losses().0, 0);
    expect("restarts", board.link.losses().1, 0);
    expect("bytes that are no frame", board.link.counters().rejected(), 0);
    let stacks = stacks.into_inner();
    if let (Some(&settled), Some(&last)) = (stacks.get(SETTLED), stacks.last())
        && last > settled + COINCIDENCE
    {
        problems.push(format!("the stack grows: {settled} bytes after two minutes and a half, {last} at the end"));
    }
    if !problems.is_empty() {
        for (time, text) in told(&board) {
            println!("{:>12} {text}", time.0);
        }
    }
    Ok(problems)
}

/// Starts QEMU on one processor, where it then stays. Its two threads take turns with every byte: waking one on another processor that has gone
/// to sleep costs more than the byte does, half as much time again for the whole drive.
#[cfg(target_os = "linux")]
fn on_one_processor<T>(start: impl FnOnce() -> T) -> T {
    use rustix::thread::{CpuSet, sched_getaffinity, sched_setaffinity};
    let Ok(allowed) = sched_getaffinity(None) else { return start() };
    let mut one = CpuSet::new();
    // The last: interrupts of devices go to the first.
    (0..CpuSet::MAX_CPU).rev().find(|&processor| allowed.is_set(processor)).inspect(|&last| one.set(last));
    // A child begins where its parent is. Where that is refused, the soak only takes longer.
    let _refused = sched_setaffinity(None, &one);
    let started = start();
    let _refused = sched_setaffinity(None, &allowed);
    started
}

#[cfg(not(target_os = "linux"))]
fn on_one_processor<T>(start: impl FnOnce() -> T) -> T {
    start()
}

/// The board's latest status; `seen` is how many of its frames have been looked at.
fn latest(board: &Emulator, seen: &mut usize) -> Status {
    let mut found = Status::default();
    let status = |message: &Message<'_>| if let Message::Status(status) = message { Some(*status) } else { None };
    while let Some((at, status)) = board.link.wait_for(*seen, Duration::ZERO, status) {
        (*seen, found) = (at, status);
    }
    found
}
