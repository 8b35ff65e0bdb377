//! Commands in the middle of a drive, pulses that are missing or come twice, and a host that does not read for three seconds: the log still verifies.

mod board;

use std::cell::RefCell;
use std::time::Duration;

use crossfall::capture::{Channel, Chunk};
use crossfall::verify;
use crossfall_core::protocol::config::Method;
use crossfall_core::protocol::message::{Command, Message, Outcome, PulseVerdict, Session};
use crossfall_core::protocol::{Angle, Config};
use crossfall_tests::emulator::Step;

const SECOND_NS: u64 = 1_000_000_000;

#[test]
fn commands_faulty_pulses_and_a_deaf_host_leave_a_log_that_verifies() {
    let scratch = tempfile::tempdir().expect("a scratch folder");
    let (drive, _truth) = board::simulated_drive(scratch.path(), 11.0);
    let begin = drive[0].device_time_ns;
    let numbers = RefCell::new(Vec::new());
    let mut steps = vec![board::rest(&drive)];
    let mut pulses = 0;
    for chunk in drive {
        if chunk.channel == Channel::Pps {
            pulses += 1;
            let later = |us: u64| Chunk { device_time_ns: chunk.device_time_ns + us * 1_000, ..chunk.clone() };
            match pulses {
                // Missing, bouncing, and one from nowhere.
                5 => continue,
                7 => steps.push(Step::Bytes(later(300))),
                9 => steps.push(Step::Bytes(later(437_000))),
                _ => {}
            }
        }
        steps.push(Step::Bytes(chunk));
    }

    let seed = Config {
        survey: crossfall_core::protocol::config::Survey { method: Method::Seed, ..Config::default().survey },
        ..Config::default()
    };
    let mut tilted = Config::default();
    tilted.scanner.mounting_offset = Angle(tilted.scanner.mounting_offset.0.wrapping_add(1 << 22));
    let mut refused = Config::default();
    refused.survey.limits.min_length_um = refused.survey.limits.max_length_um + 1;
    let commands = [
        (2, Command::Configure(tilted), Outcome::Done),
        (3, Command::Configure(refused), Outcome::BadConfig),
        (4, Command::Configure(seed), Outcome::Done),
        (6, Command::Stop, Outcome::Done),
        (7, Command::Configure(Config::default()), Outcome::Done),
        (8, Command::Start, Outcome::Done),
    ];
    for (second, command, outcome) in commands {
        let numbers = &numbers;
        let act = move |board: &mut crossfall_tests::emulator::Emulator,
                        _: &mut crossfall_tests::lms_emulator::Scanner| {
            numbers.borrow_mut().push((board.command(&command)?, outcome));
            // Noise on the command line: rejected at its delimiter.
            board.link_bytes(&[0x11, 0x22, 0x33, 0x00])
        };
        steps.push(Step::Do(begin + second * SECOND_NS, Box::new(act)));
    }
    let deaf = |board: &mut crossfall_tests::emulator::Emulator, _: &mut crossfall_tests::lms_emulator::Scanner| {
        board.link.pause(Duration::from_secs(3));
        Ok(())
    };
    steps.push(Step::Do(begin + 9 * SECOND_NS, Box::new(deaf)));
    steps.sort_by_key(Step::device_time_ns);

    let (mut board, mut scanner) = board::running_board();
    let played = board.play(&mut scanner, steps, |_| ()).expect("a running board");
    let status = board::stop(&mut board);
    println!("{played:?}\n{status:?}");

    let replies = board
        .link
        .collect(|message| if let Message::Reply(reply) = message { Some((reply.to, reply.outcome)) } else { None });
    for expected in numbers.borrow().iter() {
        assert_eq!(replies.iter().filter(|reply| *reply == expected).count(), 1, "{expected:?} in {replies:?}");
    }
    assert_eq!(status.commands_rejected as usize, commands.len());
    assert_eq!((status.frames_dropped, status.lidar.overruns, status.ins.overruns), (0, 0, 0));
    assert_eq!((status.pulses_spurious, status.pulses_overrun), (2, 0));
    let verdicts =
        board.link.collect(|message| if let Message::Pulse(pulse) = message { Some(pulse.verdict) } else { None });
    assert_eq!(verdicts.iter().filter(|&&verdict| verdict == PulseVerdict::Restarted).count(), 1, "{verdicts:?}");
    assert_eq!(verdicts.len(), pulses + 1, "one missing, two more");

    // Nothing is missing on the link, although nobody read it for three seconds, and all of it verifies.
    assert_eq!((board.link.losses(), board.link.counters().rejected()), ((0, 0), 0));
    let path = scratch.path().join("board.mcap");
    board::write_log(&board, &path);
    let report = verify::verify(&path, |_| ()).expect("a readable log");
    assert_eq!(report.problems, []);
    assert_eq!(report.profiles, report.profiles_reproduced);
    let methods =
        board.link.collect(|message| if let Message::Profile(profile) = message { Some(profile.method) } else { None });
    let count = |method| methods.iter().filter(|&&m| m == method).count();
    println!("{} profiles measured, {} by the paper's search", count(Method::Measuring), count(Method::Seed));
    // Two seconds of the seed's search, two of nothing, the rest measured; each with room for a late host.
    assert!(count(Method::Measuring) > 60 && count(Method::Seed) > 15);
    let borders = board.link.collect(|message| {
        if let Message::Session(session) = message { Some(matches!(session, Session::Started(_))) } else { None }
    });
    assert_eq!(
        borders,
        [true, false, true, false],
        "started at boot and by command, stopped by command and at the end"
    );
}
