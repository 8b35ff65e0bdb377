//! Messages and commands for tests: one plain example of each, the worst of each, and any at all.

#![allow(dead_code, reason = "every test binary uses a part")]

use crossfall_protocol::config::{Attitude, Ins, Limits, Measuring, Method, Scanner, Seed, Survey};
use crossfall_protocol::frame::{MAX_NAME, MAX_TEXT};
use crossfall_protocol::message::*;
use crossfall_protocol::ranges::MAX_CODE;
use crossfall_protocol::{Angle, Config, DeviceTime};
use proptest::collection::vec;
use proptest::prelude::*;

const fn degrees(microdegrees: i32) -> Angle {
    Angle::from_microdegrees(microdegrees)
}

/// One plain example of each message, as on a drive. `code` is that of the scan.
pub fn message_examples(code: &[u8]) -> Vec<(&'static str, Message<'_>)> {
    let hinge = |y_um| Hinge { y_um, ci95_um: 18_000, departure_um: y_um + 40_000 };
    let slope = |angle, start, end| Slope {
        angle: degrees(angle),
        ci95: degrees(31_000),
        length_um: 4_200_000,
        points: 26,
        start: hinge(start),
        end: hinge(end),
    };
    vec![
        (
            "Hello",
            Message::Hello(Hello {
                schema: crossfall_protocol::schema::HASH,
                firmware: "crossfall 0.1.0",
                board: "olimex-stm32-h405",
                boot: 3,
                restart: "watchdog",
            }),
        ),
        ("Config", Message::Config(Config::default())),
        (
            "Scan",
            Message::Scan(Scan {
                index: 4_711,
                stx: DeviceTime(125_431_870),
                layout: 1 << 14 | 181,
                mode: ScanMode { span_deg: 180, step_cdeg: 100, measuring: 6 },
                status: 0x10,
                counters: Some([17, 18]),
                code,
            }),
        ),
        (
            "Pose",
            Message::Pose(Pose {
                time: DeviceTime(125_400_000),
                latency_us: 21_500,
                timed_by_pulse: true,
                gps_week: 2_380,
                gps_us: 302_400_010_000,
                roll: degrees(-1_250_000),
                pitch: degrees(310_000),
                azimuth: degrees(87_500_000),
                fix: Some(Fix {
                    latitude_ndeg: 51_079_123_456,
                    longitude_ndeg: -114_132_654_321,
                    height_mm: 1_064_950,
                    velocity_mm_s: [-120, 22_310, 45],
                }),
                status: 3,
            }),
        ),
        ("Pulse", Message::Pulse(Pulse { time: DeviceTime(125_000_023), verdict: PulseVerdict::Accepted })),
        (
            "Clock",
            Message::Clock(ClockState {
                anchor: DeviceTime(125_000_023),
                gps: Some((2_380, 302_400_000_000)),
                drift: 98_785,
                pulses: 32,
            }),
        ),
        (
            "Profile",
            Message::Profile(Profile {
                scan: 4_711,
                time: DeviceTime(125_405_230),
                method: Method::Measuring,
                flags: flags::TIME_BY_ARRIVAL,
                roll: degrees(-1_249_000),
                left: Side {
                    road: Some(degrees(-1_100_000)),
                    edge: Some(hinge(3_512_000)),
                    adjacent: Some(slope(-8_040_000, 3_512_000, 7_660_000)),
                    opposing: Some(slope(7_310_000, 8_400_000, 12_500_000)),
                    flags: flags::VEGETATION,
                },
                right: Side { flags: flags::NO_ROAD, ..Side::default() },
            }),
        ),
        (
            "Status",
            Message::Status(Status {
                time: DeviceTime(126_000_000),
                lidar: LineCounters { bytes: 3_458_700, frames: 4_725, bad_frames: 1, skipped: 740, overruns: 0 },
                ins: LineCounters { bytes: 1_512_000, frames: 12_600, bad_frames: 0, skipped: 0, overruns: 2 },
                scans: 4_725,
                scans_missing: 1,
                scans_unreadable: 0,
                scans_skipped: 0,
                poses: 12_600,
                poses_unreadable: 0,
                pulses: 125,
                pulses_spurious: 1,
                pulses_overrun: 0,
                frames_dropped: 4,
                commands_rejected: 0,
            }),
        ),
        ("Log", Message::Log(LogLine { time: DeviceTime(1_250), level: Level::Warn, text: b"no pulse for 3 seconds" })),
        ("Reply", Message::Reply(Reply { to: 5, outcome: Outcome::Pong(0xC0FFEE) })),
        ("Session", Message::Session(Session::Started(DeviceTime(2_000_000)))),
        ("Skip", Message::Skip(Skip::Scan(4_724))),
        (
            "Marker",
            Message::Marker(Marker { time: DeviceTime(125_900_000), number: 2, label: Label::new("bridge 14") }),
        ),
    ]
}

/// One of each command.
pub fn command_examples() -> Vec<(&'static str, Command)> {
    vec![
        ("Identify", Command::Identify),
        ("Ping", Command::Ping(0xC0FFEE)),
        ("Configure", Command::Configure(Config::default())),
        ("Start", Command::Start),
        ("Stop", Command::Stop),
        ("Mark", Command::Mark(Label::new("bridge 14"))),
        ("Restart", Command::Restart(Sensor::Ins)),
    ]
}

/// Every field of a configuration in its longest form.
pub fn worst_config() -> Config {
    let long = i32::MIN;
    Config {
        scanner: Scanner {
            mounting_offset: Angle(long),
            mirrored: true,
            delay_us: long,
            measuring_mode: 255,
            baud: u32::MAX,
        },
        ins: Ins { baud: u32::MAX, latency_us: u32::MAX, lever_arm_mm: [long; 3] },
        attitude: Attitude { max_gap_us: u32::MAX, hold_us: u32::MAX },
        survey: Survey {
            method: Method::Seed,
            limits: Limits {
                min_length_um: long,
                max_length_um: long,
                min_slope: Angle(long),
                max_slope: Angle(long),
                obstruction_um: long,
            },
            seed: Seed { spacing_um: long, inlier_um: long, departure_um: long, departure_points: 255, onset_um: long },
            measuring: Measuring { range_sigma_um: long, roughness_um: long },
        },
    }
}

/// Every message with every field in its longest form, and how long its payload is by `limits`' sums.
pub fn worst_messages() -> Vec<(Message<'static>, usize)> {
    let far = DeviceTime(u64::MAX);
    let long = Angle(i32::MIN);
    let name: &'static str = "n".repeat(MAX_NAME).leak();
    let text: &'static str = "t".repeat(MAX_TEXT).leak();
    let hinge = Hinge { y_um: i32::MIN, ci95_um: u32::MAX, departure_um: i32::MIN };
    let slope = Slope { angle: long, ci95: long, length_um: i32::MIN, points: u16::MAX, start: hinge, end: hinge };
    let side =
        Side { road: Some(long), edge: Some(hinge), adjacent: Some(slope), opposing: Some(slope), flags: u16::MAX };
    let line =
        LineCounters { bytes: u64::MAX, frames: u32::MAX, bad_frames: u32::MAX, skipped: u64::MAX, overruns: u32::MAX };
    let most = u32::MAX;
    vec![
        (
            Message::Hello(Hello { schema: u64::MAX, firmware: name, board: name, boot: most, restart: text }),
            4 + 10 + 65 + 65 + 5 + 514,
        ),
        (Message::Config(worst_config()), 4 + 17 + 25 + 10 + 1 + 25 + 21 + 10),
        (
            Message::Scan(Scan {
                index: most,
                stx: far,
                layout: u16::MAX,
                mode: ScanMode { span_deg: 255, step_cdeg: 255, measuring: 255 },
                status: 255,
                counters: Some([255; 2]),
                code: vec![0xA5; MAX_CODE].leak(),
            }),
            4 + 5 + 10 + 6 + 1 + 3 + 2 + MAX_CODE,
        ),
        (
            Message::Pose(Pose {
                time: far,
                latency_us: i32::MIN,
                timed_by_pulse: true,
                gps_week: u16::MAX,
                gps_us: u64::MAX,
                roll: long,
                pitch: long,
                azimuth: long,
                fix: Some(Fix {
                    latitude_ndeg: i64::MIN,
                    longitude_ndeg: i64::MIN,
                    height_mm: i32::MIN,
                    velocity_mm_s: [i32::MIN; 3],
                }),
                status: 255,
            }),
            4 + 10 + 5 + 1 + 3 + 10 + 15 + 41 + 1,
        ),
        (Message::Pulse(Pulse { time: far, verdict: PulseVerdict::Restarted }), 4 + 10 + 1),
        (
            Message::Clock(ClockState { anchor: far, gps: Some((u16::MAX, u64::MAX)), drift: i32::MIN, pulses: 255 }),
            4 + 10 + 14 + 5 + 1,
        ),
        (
            Message::Profile(Profile {
                scan: most,
                time: far,
                method: Method::Seed,
                flags: u16::MAX,
                roll: long,
                left: side,
                right: side,
            }),
            4 + 5 + 10 + 1 + 3 + 5 + 2 * (6 + 16 + 2 * 49 + 3),
        ),
        (
            Message::Status(Status {
                time: far,
                lidar: line,
                ins: line,
                scans: most,
                scans_missing: most,
                scans_unreadable: most,
                scans_skipped: most,
                poses: most,
                poses_unreadable: most,
                pulses: most,
                pulses_spurious: most,
                pulses_overrun: most,
                frames_dropped: most,
                commands_rejected: most,
            }),
            4 + 10 + 2 * 35 + 11 * 5,
        ),
        (Message::Log(LogLine { time: far, level: Level::Defmt, text: text.as_bytes() }), 4 + 10 + 1 + 514),
        (Message::Reply(Reply { to: u16::MAX, outcome: Outcome::Pong(most) }), 4 + 3 + 1 + 5),
        (Message::Session(Session::Stopped(far)), 4 + 1 + 10),
        (Message::Skip(Skip::Pose(far)), 4 + 1 + 10),
        (Message::Marker(Marker { time: far, number: most, label: Label([255; Label::MAX]) }), 4 + 10 + 5 + 24),
    ]
}

fn any_angle() -> impl Strategy<Value = Angle> {
    any::<i32>().prop_map(Angle)
}

fn any_time() -> impl Strategy<Value = DeviceTime> {
    prop_oneof![any::<u64>(), 0..10_000_000_000_u64].prop_map(DeviceTime)
}

fn any_method() -> impl Strategy<Value = Method> {
    prop_oneof![Just(Method::Measuring), Just(Method::Seed)]
}

fn any_text(longest: usize) -> impl Strategy<Value = &'static str> {
    vec(any::<char>(), 0..=longest / 4).prop_map(|text| &*text.into_iter().collect::<String>().leak())
}

prop_compose! {
    /// Any configuration, sensible or not.
    pub fn any_config()(
        angles in [any_angle(), any_angle(), any_angle()],
        lengths in any::<[i32; 13]>(),
        times in any::<[u32; 5]>(),
        small in any::<[u8; 2]>(),
        mirrored: bool,
        method in any_method(),
    ) -> Config {
        Config {
            scanner: Scanner {
                mounting_offset: angles[0],
                mirrored,
                delay_us: lengths[0],
                measuring_mode: small[0],
                baud: times[0],
            },
            ins: Ins { baud: times[1], latency_us: times[2], lever_arm_mm: [lengths[1], lengths[2], lengths[3]] },
            attitude: Attitude { max_gap_us: times[3], hold_us: times[4] },
            survey: Survey {
                method,
                limits: Limits {
                    min_length_um: lengths[4],
                    max_length_um: lengths[5],
                    min_slope: angles[1],
                    max_slope: angles[2],
                    obstruction_um: lengths[6],
                },
                seed: Seed {
                    spacing_um: lengths[7],
                    inlier_um: lengths[8],
                    departure_um: lengths[9],
                    departure_points: small[1],
                    onset_um: lengths[10],
                },
                measuring: Measuring { range_sigma_um: lengths[11], roughness_um: lengths[12] },
            },
        }
    }
}

prop_compose! {
    fn any_hinge()(y_um: i32, ci95_um: u32, departure_um: i32) -> Hinge {
        Hinge { y_um, ci95_um, departure_um }
    }
}

prop_compose! {
    fn any_slope()(
        angle in any_angle(),
        ci95 in any_angle(),
        length_um: i32,
        points: u16,
        start in any_hinge(),
        end in any_hinge(),
    ) -> Slope {
        Slope { angle, ci95, length_um, points, start, end }
    }
}

prop_compose! {
    fn any_side()(
        road in proptest::option::of(any_angle()),
        edge in proptest::option::of(any_hinge()),
        adjacent in proptest::option::of(any_slope()),
        opposing in proptest::option::of(any_slope()),
        flags: u16,
    ) -> Side {
        Side { road, edge, adjacent, opposing, flags }
    }
}

fn any_hello() -> impl Strategy<Value = Message<'static>> {
    (any::<u64>(), any_text(MAX_NAME), any_text(MAX_NAME), any::<u32>(), any_text(MAX_TEXT)).prop_map(
        |(schema, firmware, board, boot, restart)| Message::Hello(Hello { schema, firmware, board, boot, restart }),
    )
}

/// The scanner's own modes as often as nonsense.
pub fn any_scan_mode() -> impl Strategy<Value = (u16, ScanMode)> {
    let whole = (0..5_usize, 0..4_u16, 0..8_u8).prop_map(|(which, unit, measuring)| {
        let (span_deg, step_cdeg, count) =
            [(180, 100, 181), (180, 50, 361), (100, 100, 101), (100, 50, 201), (100, 25, 401)][which];
        (count | unit << 14, ScanMode { span_deg, step_cdeg, measuring })
    });
    let other = (any::<u16>(), any::<[u8; 3]>())
        .prop_map(|(layout, [span_deg, step_cdeg, measuring])| (layout, ScanMode { span_deg, step_cdeg, measuring }));
    prop_oneof![whole, other]
}

fn any_scan() -> impl Strategy<Value = Message<'static>> {
    let code = vec(any::<u8>(), 0..=MAX_CODE).prop_map(|code| &*code.leak());
    (any::<u32>(), any_time(), any_scan_mode(), any::<u8>(), any::<Option<[u8; 2]>>(), code).prop_map(
        |(index, stx, (layout, mode), status, counters, code)| {
            Message::Scan(Scan { index, stx, layout, mode, status, counters, code })
        },
    )
}

fn any_pose() -> impl Strategy<Value = Message<'static>> {
    let fix = (any::<i64>(), any::<i64>(), any::<i32>(), any::<[i32; 3]>()).prop_map(
        |(latitude_ndeg, longitude_ndeg, height_mm, velocity_mm_s)| Fix {
            latitude_ndeg,
            longitude_ndeg,
            height_mm,
            velocity_mm_s,
        },
    );
    (any_time(), any::<(i32, bool, u16, u64, u8)>(), [any_angle(), any_angle(), any_angle()], proptest::option::of(fix))
        .prop_map(|(time, (latency_us, timed_by_pulse, gps_week, gps_us, status), [roll, pitch, azimuth], fix)| {
            Message::Pose(Pose {
                time,
                latency_us,
                timed_by_pulse,
                gps_week,
                gps_us,
                roll,
                pitch,
                azimuth,
                fix,
                status,
            })
        })
}

fn any_profile() -> impl Strategy<Value = Message<'static>> {
    (any::<u32>(), any_time(), any_method(), any::<u16>(), any_angle(), any_side(), any_side()).prop_map(
        |(scan, time, method, flags, roll, left, right)| {
            Message::Profile(Profile { scan, time, method, flags, roll, left, right })
        },
    )
}

fn any_status() -> impl Strategy<Value = Message<'static>> {
    let line = || {
        any::<(u64, u32, u32, u64, u32)>().prop_map(|(bytes, frames, bad_frames, skipped, overruns)| LineCounters {
            bytes,
            frames,
            bad_frames,
            skipped,
            overruns,
        })
    };
    (any_time(), line(), line(), any::<[u32; 11]>()).prop_map(|(time, lidar, ins, n)| {
        Message::Status(Status {
            time,
            lidar,
            ins,
            scans: n[0],
            scans_missing: n[1],
            scans_unreadable: n[9],
            scans_skipped: n[2],
            poses: n[3],
            poses_unreadable: n[10],
            pulses: n[4],
            pulses_spurious: n[5],
            pulses_overrun: n[6],
            frames_dropped: n[7],
            commands_rejected: n[8],
        })
    })
}

fn any_short_message() -> impl Strategy<Value = Message<'static>> {
    let verdict =
        prop_oneof![Just(PulseVerdict::Accepted), Just(PulseVerdict::Spurious), Just(PulseVerdict::Restarted)];
    let level = prop_oneof![Just(Level::Error), Just(Level::Warn), Just(Level::Info), Just(Level::Defmt)];
    let outcome = prop_oneof![
        Just(Outcome::Done),
        Just(Outcome::BadConfig),
        Just(Outcome::Unknown),
        any::<u32>().prop_map(Outcome::Pong),
    ];
    prop_oneof![
        (any_time(), verdict).prop_map(|(time, verdict)| Message::Pulse(Pulse { time, verdict })),
        (any_time(), any::<(Option<(u16, u64)>, i32, u8)>())
            .prop_map(|(anchor, (gps, drift, pulses))| Message::Clock(ClockState { anchor, gps, drift, pulses })),
        (any_time(), level, vec(any::<u8>(), 0..=MAX_TEXT)).prop_map(|(time, level, text)| Message::Log(LogLine {
            time,
            level,
            text: text.leak()
        })),
        (any::<u16>(), outcome).prop_map(|(to, outcome)| Message::Reply(Reply { to, outcome })),
        (any_time(), any::<bool>()).prop_map(|(time, start)| Message::Session(if start {
            Session::Started(time)
        } else {
            Session::Stopped(time)
        })),
        any::<u32>().prop_map(|scan| Message::Skip(Skip::Scan(scan))),
        any_time().prop_map(|pose| Message::Skip(Skip::Pose(pose))),
        (any_time(), any::<u32>(), any::<[u8; Label::MAX]>())
            .prop_map(|(time, number, label)| Message::Marker(Marker { time, number, label: Label(label) })),
    ]
}

/// Any message at all.
pub fn any_message() -> impl Strategy<Value = Message<'static>> {
    prop_oneof![
        any_hello(),
        any_config().prop_map(Message::Config),
        any_scan(),
        any_pose(),
        any_profile(),
        any_status(),
        any_short_message(),
    ]
}

/// Any command at all.
pub fn any_command() -> impl Strategy<Value = Command> {
    prop_oneof![
        Just(Command::Identify),
        any::<u32>().prop_map(Command::Ping),
        any_config().prop_map(Command::Configure),
        Just(Command::Start),
        Just(Command::Stop),
        any::<[u8; Label::MAX]>().prop_map(|label| Command::Mark(Label(label))),
        prop_oneof![Just(Sensor::Lidar), Just(Sensor::Ins)].prop_map(Command::Restart),
    ]
}
