//! Counts the instructions that a scan costs on this core, and holds every result against the host's.
//!
//! Runs in QEMU with `-icount shift=0`, where an instruction takes a nanosecond and TIM5, not prescaled, counts nanoseconds: its
//! differences are instruction counts, the same in every run. They are instructions and not cycles: no wait states.
//!
//! The input is the stream of a run on the host, read by semihosting from `bench.wire` in the emulator's folder: the
//! board surveys its scans and poses again and must get every profile, and the code of every scan, bit for bit. One line a
//! stage comes out: name, number, mean, worst. The exit code is 1 when anything differs.
#![no_std]
#![no_main]

use core::panic::PanicInfo;

use cortex_m_rt::entry;
use cortex_m_semihosting::{debug, hprintln, syscall};
use crossfall_core::instrument::{Event, Survey};
use crossfall_core::scan::{Points, RawScan, RollTrack, level};
use crossfall_protocol::frame::{self, HostDecoder, MAX_MESSAGE_FRAME};
use crossfall_protocol::message::{Message, Profile, Scan};
use crossfall_protocol::ranges::{self, MAX_CODE};
use crossfall_protocol::{Angle, Config};
use embassy_stm32::pac;

const INPUT: &[u8] = b"bench.wire\0";

/// Profiles that may be ahead of the stream's: what the survey can hold back, and more.
const AHEAD: usize = 32;

/// What one stage has cost.
#[derive(Default)]
struct Stage {
    count: u32,
    sum: u64,
    worst: u32,
}

impl Stage {
    /// Adds what `work` costs, less what counting costs.
    fn measure<T>(&mut self, overhead: u32, work: impl FnOnce() -> T) -> T {
        let (cost, result) = count(work);
        self.add(cost.saturating_sub(overhead));
        result
    }

    fn add(&mut self, cost: u32) {
        self.count += 1;
        self.sum += u64::from(cost);
        self.worst = self.worst.max(cost);
    }

    fn print(&self, name: &str) {
        hprintln!("{} {} {} {}", name, self.count, self.sum / u64::from(self.count.max(1)), self.worst);
    }
}

#[inline(never)]
fn count<T>(work: impl FnOnce() -> T) -> (u32, T) {
    let before = pac::TIM5.cnt().read();
    let result = work();
    (pac::TIM5.cnt().read().wrapping_sub(before), result)
}

#[entry]
fn main() -> ! {
    pac::RCC.apb1enr().modify(|w| w.set_tim5en(true));
    pac::TIM5.psc().write_value(0);
    pac::TIM5.arr().write_value(u32::MAX);
    pac::TIM5.cr1().write(|w| w.set_cen(true));
    let wrong = run();
    debug::exit(if wrong == 0 { debug::EXIT_SUCCESS } else { debug::EXIT_FAILURE });
    loop {
        cortex_m::asm::wfi();
    }
}

/// Works through the input; how many results differ from the host's.
fn run() -> u32 {
    // SAFETY: the name ends with a zero that the length leaves out, as the call wants it; 1 is "rb".
    let file = unsafe { syscall!(OPEN, INPUT.as_ptr(), 1, INPUT.len() - 1) } as isize;
    if file < 0 {
        hprintln!("cannot open bench.wire");
        return 1;
    }
    let overhead = (0..8).map(|_| count(|| ()).0).min().unwrap_or(0);
    let mut bench = Bench::new(overhead);
    let mut decoder = HostDecoder::new();
    let mut chunk = [0u8; 1024];
    loop {
        // SAFETY: the buffer is as long as the call is told.
        let unread = unsafe { syscall!(READ, file, chunk.as_mut_ptr(), chunk.len()) };
        let Some(mut rest) = chunk.len().checked_sub(unread).and_then(|count| chunk.get(..count)) else { break };
        if rest.is_empty() {
            break;
        }
        while let Some(event) = decoder.next(&mut rest) {
            match event {
                frame::Event::Frame(frame) => bench.take(&frame.body),
                frame::Event::Rejected(_) => bench.wrong += 1,
            }
        }
    }
    bench.report()
}

struct Bench {
    overhead: u32,
    survey: Survey,
    points: Points,
    room: RawScan,
    /// Profiles made here that the stream has yet to confirm.
    made: heapless::Deque<Profile, AHEAD>,
    level: Stage,
    surveyed: Stage,
    ranges: Stage,
    scan_frame: Stage,
    profile_frame: Stage,
    /// Instructions of the survey since the last profile.
    pending: u32,
    compared: u32,
    wrong: u32,
}

impl Bench {
    fn new(overhead: u32) -> Self {
        Self {
            overhead,
            survey: Survey::new(),
            points: Points::new(),
            room: RawScan::EMPTY,
            made: heapless::Deque::new(),
            level: Stage::default(),
            surveyed: Stage::default(),
            ranges: Stage::default(),
            scan_frame: Stage::default(),
            profile_frame: Stage::default(),
            pending: 0,
            compared: 0,
            wrong: 0,
        }
    }

    fn take(&mut self, message: &Message<'_>) {
        if let Message::Profile(theirs) = message {
            self.compare(theirs);
            return;
        }
        let Ok(event) = Event::of(message, &mut self.room) else {
            self.wrong += 1;
            return;
        };
        let mut frame = [0; MAX_MESSAGE_FRAME];
        if let (Event::Scan(scan), Message::Scan(theirs)) = (&event, message) {
            let RawScan { index, stx, layout, mode, status, counters, ref values } = **scan;
            let points = &mut self.points;
            let config = Config::default();
            self.level
                .measure(self.overhead, || level(scan, &RollTrack::constant(Angle::ZERO), &config.scanner, points));
            let mut out = [0; MAX_CODE];
            let code = self.ranges.measure(self.overhead, || ranges::encode(layout, mode, values, &mut out));
            self.wrong += u32::from(code != theirs.code);
            let message = Message::Scan(Scan { index, stx, layout, mode, status, counters, code });
            let encoded = self.scan_frame.measure(self.overhead, || message.encode(0, &mut frame));
            self.wrong += u32::from(encoded.is_err());
        }
        let Self { survey, made, .. } = self;
        let (mut emitted, mut overflow) = (0, 0);
        let (cost, ()) = count(|| {
            survey.take(&event, &mut |profile| {
                emitted += 1;
                overflow += u32::from(made.push_back(profile).is_err());
            });
        });
        self.wrong += overflow;
        // Poses, and scans that only wait, are part of what the next profile costs.
        self.pending += cost.saturating_sub(self.overhead);
        for _ in 0..emitted {
            self.surveyed.add(self.pending / emitted);
        }
        if emitted > 0 {
            self.pending = 0;
        }
    }

    fn compare(&mut self, theirs: &Profile) {
        let ours = self.made.pop_front();
        self.wrong += u32::from(ours.as_ref() != Some(theirs));
        self.compared += 1;
        let mut frame = [0; MAX_MESSAGE_FRAME];
        let message = Message::Profile(*theirs);
        let encoded = self.profile_frame.measure(self.overhead, || message.encode(0, &mut frame));
        self.wrong += u32::from(encoded.is_err());
    }

    fn report(&self) -> u32 {
        self.level.print("level");
        self.surveyed.print("survey");
        self.ranges.print("ranges");
        self.scan_frame.print("scan-frame");
        self.profile_frame.print("profile-frame");
        let wrong = self.wrong + self.made.len() as u32 + u32::from(self.compared == 0);
        hprintln!("compared {}", self.compared);
        hprintln!("wrong {}", wrong);
        wrong
    }
}

#[panic_handler]
fn panic(info: &PanicInfo) -> ! {
    hprintln!("{}", info);
    debug::exit(debug::EXIT_FAILURE);
    loop {
        cortex_m::asm::wfi();
    }
}
