//! Bring-up against simulated sensors: answers, silence, NAKs, a wrong speed, a restart in the middle of a drive.

use std::collections::VecDeque;

use crossfall_core::protocol::DeviceTime;
use crossfall_core::sensors::{lms2xx, novatel};

/// Milliseconds of a simulation's step; a test's times are whole steps.
const STEP_US: u64 = 1_000;

/// A scanner as far as its line shows it: it understands whole telegrams at its own speed and answers nothing else.
struct Scanner {
    baud: u32,
    power: bool,
    streaming: bool,
    installing: bool,
    step_cdeg: u8,
    configuration: [u8; 34],
    /// Refuses configurations with indices, as an old scanner might.
    knows_indices: bool,
    /// Answers so many commands with a NAK first.
    naks: u32,
    /// Answers commands of this number with 92h.
    rejects: Option<u8>,
    /// Bytes on their way, with the time at which each leaves and the speed it leaves at.
    line: VecDeque<(u64, u8, u32)>,
    next_scan: u64,
    telegrams: u8,
    /// Configurations written.
    writes: u32,
}

impl Scanner {
    fn new(baud: u32) -> Self {
        let mut configuration = [0; 34];
        // As recorded: threshold 70h, measuring mode 04h, centimetres.
        (configuration[2], configuration[5]) = (0x70, 4);
        Self {
            baud,
            power: true,
            streaming: false,
            installing: false,
            step_cdeg: 100,
            configuration,
            knows_indices: true,
            naks: 0,
            rejects: None,
            line: VecDeque::new(),
            next_scan: 0,
            telegrams: 0,
            writes: 0,
        }
    }

    fn say(&mut self, from_us: u64, bytes: &[u8]) {
        let byte_us = 10_000_000 / u64::from(self.baud);
        let start = self.line.back().map_or(from_us, |&(at, ..)| from_us.max(at + byte_us));
        for (i, &byte) in bytes.iter().enumerate() {
            self.line.push_back((start + i as u64 * byte_us, byte, self.baud));
        }
    }

    fn reply(&mut self, from_us: u64, counted: &[u8]) {
        let mut telegram = vec![0x02, 0x80];
        telegram.extend((counted.len() as u16 + 1).to_le_bytes());
        telegram.extend(counted);
        telegram.push(0x10);
        telegram.extend(lms2xx::crc(&telegram).to_le_bytes());
        self.say(from_us, &telegram);
    }

    fn switch_on(&mut self, now: u64) {
        (self.power, self.streaming, self.installing, self.baud, self.step_cdeg) = (true, false, false, 9_600, 100);
        self.line.clear();
        self.reply(now, b"\x90LMS291;S05;V02.30");
    }

    /// What the host sends, at the host's speed.
    fn hear(&mut self, now: u64, telegram: &[u8], host_baud: u32) {
        if !self.power || host_baud != self.baud {
            return;
        }
        let (covered, crc) = telegram.split_at(telegram.len() - 2);
        assert_eq!(crc, lms2xx::crc(covered).to_le_bytes(), "the host's telegram is well formed");
        if self.naks > 0 {
            self.naks -= 1;
            return self.say(now + 5_000, &[0x15]);
        }
        self.say(now + 5_000, &[0x06]);
        let counted = &telegram[4..telegram.len() - 2];
        if self.rejects == Some(counted[0]) {
            return self.reply(now + 10_000, &[0x92]);
        }
        // A mode change takes its time.
        let later = now + 800_000;
        match *counted {
            [0x31] => {
                let mut report = [0; 153];
                report[0] = 0xb1;
                report[1 + 7] = if self.streaming { 0x24 } else { 0x25 };
                report[1 + 66] = 148;
                report[1 + 101] = self.configuration[5];
                (report[1 + 106], report[1 + 108]) = (180, self.step_cdeg);
                report[1 + 121] = self.configuration[6];
                self.reply(now + 10_000, &report);
            }
            [0x20, 0x25] => {
                (self.streaming, self.installing) = (false, false);
                self.reply(later, &[0xa0, 0]);
            }
            [0x20, 0x24] => {
                self.streaming = true;
                self.next_scan = later + 30_000;
                self.reply(later, &[0xa0, 0]);
            }
            [0x20, 0x00, ref password @ ..] => {
                self.installing = password == b"SICK_LMS";
                let code = u8::from(!self.installing);
                self.reply(later, &[0xa0, code]);
            }
            [0x20, speed] => {
                let baud = match speed {
                    0x48 => 500_000,
                    0x40 => 38_400,
                    0x41 => 19_200,
                    0x42 => 9_600,
                    other => panic!("mode {other:02x}"),
                };
                self.reply(later, &[0xa0, 0]);
                self.baud = baud;
            }
            [0x74] => self.reply(now + 10_000, &[&[0xf4][..], &self.configuration].concat()),
            [0x77, ref stored @ ..] => {
                let stored: [u8; 34] = stored.try_into().expect("34 bytes");
                let accepted = self.installing && (self.knows_indices || stored[4] & 2 == 0);
                if accepted {
                    self.configuration = stored;
                    self.writes += 1;
                }
                self.reply(later, &[&[0xf7, u8::from(accepted)][..], &self.configuration].concat());
            }
            [0x3b, 180, 0, step_cdeg, 0] => {
                self.step_cdeg = step_cdeg;
                self.reply(later, &[0xbb, 1, 180, 0, step_cdeg, 0]);
            }
            ref other => panic!("the host said {other:02x?}"),
        }
    }

    /// The bytes that the host hears until `now`, garbled when it listens at another speed.
    fn speak(&mut self, now: u64, host_baud: u32) -> Vec<(u64, u8)> {
        if !self.power {
            self.line.clear();
            return Vec::new();
        }
        if self.streaming && now >= self.next_scan {
            let beams = if self.step_cdeg == 50 { 361u16 } else { 181 };
            let mut scan = vec![0xb0];
            scan.extend((beams | u16::from(self.configuration[6]) << 14).to_le_bytes());
            (0..beams).for_each(|beam| scan.extend((2_000 + beam).to_le_bytes()));
            if self.configuration[4] & 2 != 0 {
                scan.extend([self.telegrams.wrapping_mul(2), self.telegrams]);
            }
            self.telegrams = self.telegrams.wrapping_add(1);
            self.reply(now, &scan);
            self.next_scan += 26_640;
            // A slow line skips scans rather than queue them.
            self.next_scan = self.next_scan.max(self.line.back().map_or(0, |&(at, ..)| at));
        }
        let mut heard = Vec::new();
        while let Some(&(at, byte, baud)) = self.line.front().filter(|&&(at, ..)| at <= now) {
            self.line.pop_front();
            heard.push((at, if baud == host_baud { byte } else { byte.rotate_left(3) ^ 0x5a }));
        }
        heard
    }
}

/// Scanner, decoder and bring-up on one line.
struct Bench {
    now: u64,
    host_baud: u32,
    scanner: Scanner,
    decoder: lms2xx::Decoder,
    bring_up: lms2xx::bring_up::BringUp,
    progress: Vec<lms2xx::bring_up::Progress>,
    scans: Vec<(u64, crossfall_core::scan::RawScan)>,
}

impl Bench {
    fn new(scanner: Scanner) -> Self {
        Self {
            now: 0,
            host_baud: 0,
            scanner,
            decoder: lms2xx::Decoder::new(6),
            bring_up: lms2xx::bring_up::BringUp::new(lms2xx::bring_up::Settings::default()),
            progress: Vec::new(),
            scans: Vec::new(),
        }
    }

    fn act(&mut self, action: lms2xx::bring_up::Action) {
        use lms2xx::bring_up::Action;
        match action {
            Action::Report(progress) => self.progress.push(progress),
            Action::SetBaud(baud) => {
                self.decoder.finish(&mut |_| {});
                self.host_baud = baud;
            }
            Action::Send(telegram) => {
                self.decoder.finish(&mut |_| {});
                let (now, baud) = (self.now, self.host_baud);
                self.scanner.hear(now, &telegram, baud);
            }
        }
    }

    fn run(&mut self, ms: u64) {
        for _ in 0..ms {
            self.now += STEP_US;
            let mut actions = Vec::new();
            for (at, byte) in self.scanner.speak(self.now, self.host_baud) {
                let (bring_up, scans, now) = (&mut self.bring_up, &mut self.scans, DeviceTime(self.now));
                self.decoder.push(byte, DeviceTime(at), &mut |event| {
                    if let lms2xx::Event::Scan { scan, .. } = &event {
                        scans.push((now.0, (*scan).clone()));
                    }
                    bring_up.event(&event, now, &mut |action| actions.push(action));
                });
                for action in actions.drain(..) {
                    self.act(action);
                }
            }
            self.bring_up.tick(DeviceTime(self.now), &mut |action| actions.push(action));
            for action in actions {
                self.act(action);
            }
        }
    }

    /// Runs until scans come, and says after how many milliseconds; fails when they do not.
    fn run_until_scans(&mut self, limit_ms: u64) -> u64 {
        let (begun, before) = (self.now, self.scans.len());
        while self.scans.len() == before || !self.bring_up.is_running() {
            assert!(self.now < begun + limit_ms * 1_000, "no scans after {limit_ms} ms: {:?}", self.progress);
            self.run(1);
        }
        (self.now - begun) / 1_000
    }

    fn saw(&self, wanted: lms2xx::bring_up::Progress) -> bool {
        self.progress.contains(&wanted)
    }

    fn assert_as_wanted(&self) {
        let (_, scan) = self.scans.last().unwrap();
        assert_eq!((scan.mode.span_deg, scan.mode.step_cdeg, scan.mode.measuring), (180, 50, 6));
        assert_eq!((scan.unit_um(), scan.beams(), self.host_baud), (1_000, 361, 500_000));
    }
}

mod scanner {
    use super::*;
    use lms2xx::bring_up::{Progress, Step};
    use lms2xx::command::Baud;

    #[test]
    fn is_found_at_any_speed_and_brought_to_the_survey() {
        for baud in Baud::ALL {
            let mut bench = Bench::new(Scanner::new(baud.rate()));
            bench.run_until_scans(12_000);
            bench.run(300);
            bench.assert_as_wanted();
            assert!(bench.saw(Progress::Found(baud)), "{:?}", bench.progress);
            assert!(bench.scans.last().unwrap().1.counters.is_some());
            assert_eq!((bench.decoder.scans_missing(), bench.scanner.writes), (0, 1));
            let stored = bench.scanner.configuration;
            assert_eq!((stored[2], stored[4], stored[5], stored[6]), (0x70, 2, 6, 1), "only what must change does");
        }
    }

    #[test]
    fn is_written_only_when_it_differs() {
        let mut scanner = Scanner::new(500_000);
        (scanner.configuration[4], scanner.configuration[5], scanner.configuration[6]) = (2, 6, 1);
        let mut bench = Bench::new(scanner);
        bench.run_until_scans(8_000);
        bench.assert_as_wanted();
        assert_eq!(bench.scanner.writes, 0);
        assert!(!bench.saw(Progress::Doing(Step::Install)));
    }

    #[test]
    fn that_is_to_be_restarted_is_set_up_anew_although_it_runs() {
        let mut bench = Bench::new(Scanner::new(500_000));
        bench.run_until_scans(12_000);
        bench.progress.clear();
        let mut actions = Vec::new();
        bench.bring_up.restart(DeviceTime(bench.now), &mut |action| actions.push(action));
        for action in actions {
            bench.act(action);
        }
        bench.run_until_scans(12_000);
        bench.run(300);
        bench.assert_as_wanted();
        assert!(bench.saw(Progress::Doing(Step::Stop)) && bench.saw(Progress::Doing(Step::Start)));
    }

    #[test]
    fn is_waited_for_as_long_as_it_is_silent_and_the_pauses_grow() {
        let mut scanner = Scanner::new(9_600);
        scanner.power = false;
        let mut bench = Bench::new(scanner);
        bench.run(60_000);
        let pauses: Vec<u16> = bench
            .progress
            .iter()
            .filter_map(|p| if let Progress::Pausing(ms) = p { Some(*ms) } else { None })
            .collect();
        assert!(pauses.len() > 10, "it tries for ever");
        assert_eq!(pauses[..4], [250, 500, 1_000, 1_000]);
        let now = bench.now;
        bench.scanner.switch_on(now);
        bench.run_until_scans(15_000);
        bench.assert_as_wanted();
    }

    #[test]
    fn that_refuses_indices_runs_without_them() {
        let mut scanner = Scanner::new(9_600);
        scanner.knows_indices = false;
        let mut bench = Bench::new(scanner);
        bench.run_until_scans(15_000);
        bench.assert_as_wanted();
        assert!(bench.saw(Progress::Refused(Step::WriteConfiguration)));
        assert_eq!(bench.scans.last().unwrap().1.counters, None);
    }

    #[test]
    fn that_knows_a_command_not_runs_as_it_is() {
        for (command, step) in
            [(0x74, Step::ReadConfiguration), (0x3b, Step::Variant), (0x77, Step::WriteConfiguration)]
        {
            let mut scanner = Scanner::new(9_600);
            scanner.rejects = Some(command);
            let mut bench = Bench::new(scanner);
            bench.run_until_scans(15_000);
            assert!(bench.saw(Progress::Refused(step)), "{:?}", bench.progress);
            assert!(bench.saw(Progress::Running));
        }
    }

    #[test]
    fn that_says_nak_is_asked_again_after_a_rest() {
        let mut scanner = Scanner::new(38_400);
        scanner.naks = 2;
        let mut bench = Bench::new(scanner);
        bench.run_until_scans(15_000);
        bench.assert_as_wanted();
    }

    #[test]
    fn that_was_unplugged_is_taken_up_with_its_first_scan() {
        for away_ms in [600, 1_500, 5_000, 20_000] {
            let mut bench = Bench::new(Scanner::new(9_600));
            bench.run_until_scans(12_000);
            bench.run(500);
            // The plug is pulled: the scanner goes on measuring, nothing reaches the host.
            let stop = bench.now + away_ms * 1_000;
            while bench.now < stop {
                let now = bench.now;
                bench.scanner.speak(now, 0);
                bench.scanner.power = false;
                bench.run(1);
                bench.scanner.power = true;
            }
            assert!(bench.saw(Progress::Silent));
            let next = bench.now;
            bench.scanner.next_scan = next;
            let starts = bench.progress.iter().filter(|&&p| p == Progress::Doing(Step::Start)).count();
            let after_ms = bench.run_until_scans(2_000);
            bench.assert_as_wanted();
            assert!(after_ms <= 2_000, "{after_ms} ms");
            let again = bench.progress.iter().filter(|&&p| p == Progress::Doing(Step::Start)).count();
            assert_eq!(again, starts, "nothing had to be set up again");
        }
    }

    #[test]
    fn that_restarts_in_the_middle_of_a_drive_is_set_up_again() {
        let mut bench = Bench::new(Scanner::new(9_600));
        bench.run_until_scans(12_000);
        bench.run(1_000);
        let now = bench.now;
        bench.scanner.switch_on(now);
        let before = bench.scans.len();
        bench.run(700);
        assert!(bench.saw(Progress::Silent));
        bench.run_until_scans(15_000);
        bench.run(100);
        assert!(bench.scans.len() > before);
        bench.assert_as_wanted();
        assert_eq!(bench.scanner.writes, 1, "its memory still has the configuration");
    }

    #[test]
    fn that_streams_at_a_slow_speed_already_is_stopped_and_sped_up() {
        for baud in [9_600, 19_200, 38_400] {
            let mut scanner = Scanner::new(baud);
            scanner.streaming = true;
            scanner.step_cdeg = 50;
            let mut bench = Bench::new(scanner);
            while bench.host_baud != 500_000 || !bench.saw(Progress::Running) {
                bench.run(10);
                assert!(bench.now < 30_000_000, "{:?}", bench.progress);
            }
            bench.run(200);
            bench.assert_as_wanted();
        }
    }
}

/// A receiver: it obeys `unlogall` and `log`, and sends what was asked for.
struct Receiver {
    power: bool,
    /// Message number, period and next time of each log.
    logs: Vec<(u16, u64, u64)>,
    deaf_to: Option<&'static [u8]>,
    received: Vec<Vec<u8>>,
}

impl Receiver {
    fn hear(&mut self, now: u64, line: &[u8]) {
        self.received.push(line.to_vec());
        if !self.power || self.deaf_to.is_some_and(|deaf| line.starts_with(deaf)) {
            return;
        }
        match line {
            b"unlogall\r\n" => self.logs.clear(),
            b"log com1 inspvasb ontime 0.01\r\n" => self.logs.push((508, 10_000, now)),
            b"log com1 timeb ontime 1\r\n" => self.logs.push((101, 1_000_000, now)),
            other => panic!("{}", String::from_utf8_lossy(other)),
        }
    }

    fn speak(&mut self, now: u64) -> Vec<u8> {
        let mut heard = Vec::new();
        for (id, period, next) in &mut self.logs {
            if now < *next {
                continue;
            }
            *next += *period;
            let (mut frame, body) = match *id {
                508 => (vec![0xaa, 0x44, 0x13, 88, 0xfc, 0x01, 0xa1, 0x08, 0, 0, 0, 0], 88),
                _ => {
                    let mut header = vec![0; 28];
                    header[..10].copy_from_slice(&[0xaa, 0x44, 0x12, 28, 101, 0, 0, 0x20, 44, 0]);
                    (header, 44)
                }
            };
            frame.resize(frame.len() + body, 0);
            frame.extend(novatel::crc32(&frame).to_le_bytes());
            heard.extend(frame);
        }
        if self.power { heard } else { Vec::new() }
    }
}

struct SpanBench {
    now: u64,
    receiver: Receiver,
    decoder: novatel::Decoder,
    bring_up: novatel::bring_up::BringUp<2>,
    progress: Vec<novatel::bring_up::Progress>,
    poses: u32,
}

impl SpanBench {
    fn new() -> Self {
        Self {
            now: 0,
            receiver: Receiver { power: true, logs: Vec::new(), deaf_to: None, received: Vec::new() },
            decoder: novatel::Decoder::new(),
            bring_up: novatel::bring_up::BringUp::default(),
            progress: Vec::new(),
            poses: 0,
        }
    }

    fn run(&mut self, ms: u64) {
        use novatel::bring_up::Action;
        for _ in 0..ms {
            self.now += STEP_US;
            let now = DeviceTime(self.now);
            let mut actions = Vec::new();
            for byte in self.receiver.speak(self.now) {
                let (bring_up, poses) = (&mut self.bring_up, &mut self.poses);
                self.decoder.push(byte, now, &mut |event| {
                    *poses += u32::from(matches!(event.log, novatel::Log::Solution(..)));
                    bring_up.event(&event, now, &mut |action| actions.push(action));
                });
            }
            self.bring_up.tick(now, &mut |action| actions.push(action));
            for action in actions {
                match action {
                    Action::Send(line) => self.receiver.hear(self.now, line),
                    Action::Report(progress) => self.progress.push(progress),
                }
            }
        }
    }
}

mod receiver {
    use super::*;
    use novatel::bring_up::Progress;

    #[test]
    fn is_asked_for_its_logs_once_and_sends_them() {
        let mut bench = SpanBench::new();
        bench.run(10_000);
        assert_eq!(bench.progress, [Progress::Requesting, Progress::Checking, Progress::Running]);
        assert_eq!(bench.receiver.received.len(), 3);
        assert!(bench.poses > 950);
    }

    #[test]
    fn that_is_silent_is_asked_for_ever_with_growing_pauses() {
        let mut bench = SpanBench::new();
        bench.receiver.power = false;
        bench.run(30_000);
        let pauses: Vec<u16> = bench
            .progress
            .iter()
            .filter_map(|p| if let Progress::Pausing(ms) = p { Some(*ms) } else { None })
            .collect();
        assert!(pauses.len() > 10);
        assert_eq!(pauses[..4], [250, 500, 1_000, 1_000]);
        bench.receiver.power = true;
        bench.run(2_000);
        assert!(bench.bring_up.is_running() && bench.poses > 0);
    }

    #[test]
    fn that_is_to_be_restarted_is_asked_anew_although_it_sends() {
        let mut bench = SpanBench::new();
        bench.run(5_000);
        bench.progress.clear();
        let (now, receiver) = (bench.now, &mut bench.receiver);
        bench.bring_up.restart(DeviceTime(now), &mut |action| {
            if let novatel::bring_up::Action::Send(line) = action {
                receiver.hear(now, line);
            }
        });
        bench.run(3_000);
        assert_eq!(bench.progress, [Progress::Checking, Progress::Running]);
        assert_eq!((bench.receiver.received.len(), bench.receiver.logs.len()), (6, 2));
    }

    #[test]
    fn that_restarts_and_forgets_is_asked_again() {
        let mut bench = SpanBench::new();
        bench.run(5_000);
        bench.receiver.logs.clear();
        let before = bench.poses;
        bench.run(4_000);
        assert!(bench.progress.contains(&Progress::Missing(508)), "{:?}", bench.progress);
        assert!(bench.bring_up.is_running() && bench.poses > before + 200);
        assert_eq!(bench.receiver.logs.len(), 2);
    }

    #[test]
    fn that_was_unplugged_is_taken_up_with_its_first_frame() {
        let mut bench = SpanBench::new();
        bench.run(5_000);
        bench.receiver.power = false;
        bench.run(10_000);
        assert!(bench.progress.contains(&Progress::Silent));
        bench.receiver.power = true;
        let before = bench.poses;
        bench.run(1_000);
        assert!(bench.bring_up.is_running() && bench.poses > before);
    }

    #[test]
    fn that_missed_one_request_is_asked_for_that_log_again() {
        let mut bench = SpanBench::new();
        bench.receiver.deaf_to = Some(b"log com1 timeb");
        bench.run(10_000);
        assert!(bench.progress.contains(&Progress::Missing(101)));
        assert!(!bench.progress.contains(&Progress::Silent));
        bench.receiver.deaf_to = None;
        bench.run(5_000);
        assert_eq!(bench.receiver.logs.iter().filter(|(id, ..)| *id == 101).count(), 1);
    }
}
