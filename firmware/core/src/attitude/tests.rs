use super::*;
use crossfall_protocol::message::ScanMode;
use proptest::prelude::*;

const UNIT_DEG: f64 = 360.0 / 4_294_967_296.0;

fn limits() -> Limits {
    Limits::default()
}

fn pose(time: DeviceTime, roll_deg: f64) -> Pose {
    Pose {
        time,
        latency_us: 20_000,
        timed_by_pulse: true,
        gps_week: 2_400,
        gps_us: time.0,
        roll: Angle((roll_deg / UNIT_DEG).round() as i64 as i32),
        pitch: Angle::ZERO,
        azimuth: Angle::ZERO,
        fix: None,
        status: 3,
    }
}

fn half_degree_scan(stx: DeviceTime) -> RawScan {
    RawScan {
        index: 0,
        stx,
        layout: 0x4169,
        mode: ScanMode { span_deg: 180, step_cdeg: 50, measuring: 6 },
        status: 0x10,
        counters: None,
        values: [5_000; crate::scan::MAX_BEAMS],
    }
}

/// Roll in degrees of a vehicle that rocks sinusoidally.
fn rocking(amplitude_deg: f64, hertz: f64, time_us: f64) -> f64 {
    amplitude_deg * libm::sin(core::f64::consts::TAU * hertz * time_us * 1e-6)
}

fn worst_over_drive(amplitude_deg: f64, hertz: f64, period_us: u64) -> f64 {
    let mut history = History::default();
    let mut worst = 0f64;
    for i in 0..400u64 {
        let time = DeviceTime(1_000_000 + i * period_us);
        history.push(&pose(time, rocking(amplitude_deg, hertz, time.0 as f64)));
        let scan = half_degree_scan(time.offset(-3 * period_us as i64));
        let start = scan.start(0);
        assert!(history.samples.len() < 4 || history.covers(scan.stx));
        if i < 20 {
            continue;
        }
        let found = history.over_scan(&scan, start, &limits());
        assert_eq!(found.flags, 0);
        for beam in 0..scan.beams() {
            let instant = start.0 as f64 + f64::from(scan.beam_ns(beam)) * 1e-3;
            let true_roll = rocking(amplitude_deg, hertz, instant);
            let error = f64::from(found.track.roll(&scan, beam).0) * UNIT_DEG - true_roll;
            worst = worst.max(error.abs());
        }
    }
    worst
}

#[test]
fn every_beam_gets_the_roll_of_its_own_instant() {
    // Road motion and its worst case, from 100 Hz poses; and slower poses, which serve slower motion.
    let slow = worst_over_drive(2.0, 1.0, 10_000);
    let fast = worst_over_drive(0.5, 5.0, 10_000);
    let sparse = worst_over_drive(1.5, 0.8, 50_000);
    assert!(slow < 2e-5, "{slow}");
    assert!(fast < 2.5e-4, "{fast}");
    assert!(sparse < 2e-4, "{sparse}");
}

#[test]
fn a_scan_that_has_come_over_a_slow_line_still_finds_its_poses() {
    for (baud, period_us) in [(9_600, 10_000), (19_200, 10_000), (19_200, 5_000), (38_400, 5_000), (500_000, 5_000)] {
        // 732 bytes of ten bits; the longest delay that a configuration may have.
        let telegram_us = 7_320_000_000 / baud;
        let delay_us = 200_000;
        let scan = half_degree_scan(DeviceTime(3_000_000));
        let mut history = History::default();
        for i in 0.. {
            let time = DeviceTime(i * period_us);
            if time.0 > scan.stx.0 + telegram_us + 20_000 {
                break;
            }
            history.push(&pose(time, 1.0));
        }
        let found = history.over_scan(&scan, scan.start(delay_us), &limits());
        assert_eq!(found.flags, 0, "{baud} baud, a pose every {period_us} us");
    }
}

#[test]
fn a_constant_roll_is_reproduced_to_the_last_bit() {
    let mut history = History::default();
    for i in 0..20 {
        history.push(&pose(DeviceTime(i * 10_000), 1.25));
    }
    let scan = half_degree_scan(DeviceTime(150_000));
    let found = history.over_scan(&scan, scan.start(0), &limits());
    for beam in 0..scan.beams() {
        assert_eq!(found.track.roll(&scan, beam), pose(DeviceTime(0), 1.25).roll);
    }
    assert_eq!(found.nadir, pose(DeviceTime(0), 1.25).roll);
}

#[test]
fn when_poses_stop_roll_is_held_then_given_up() {
    let mut history = History::default();
    for i in 0..20 {
        history.push(&pose(DeviceTime(i * 10_000), 1.0));
    }
    let newest = DeviceTime(190_000);
    let during = half_degree_scan(newest.offset(20_000));
    let found = history.over_scan(&during, during.start(0), &limits());
    assert_eq!(found.flags, flags::ATTITUDE_HELD);
    assert_eq!(found.nadir, pose(newest, 1.0).roll);
    let after = half_degree_scan(newest.offset(60_000));
    let found = history.over_scan(&after, after.start(0), &limits());
    assert_eq!((found.flags, found.nadir), (flags::NO_ATTITUDE, Angle::ZERO));
    assert_eq!(History::default().over_scan(&after, after.start(0), &limits()).flags, flags::NO_ATTITUDE);
}

#[test]
fn a_gap_between_poses_is_bridged_only_up_to_its_limit() {
    let scan = half_degree_scan(DeviceTime(240_000));
    let cases = [(100_000, 110_000, 0), (90_000, 80_000, flags::ATTITUDE_HELD), (300_000, 110_000, flags::NO_ATTITUDE)];
    for (gap_us, max_gap_us, expected) in cases {
        let mut history = History::default();
        // The gap is centred on the scan.
        let (before, after) = (scan.start(0).offset(13_000 - gap_us / 2), scan.start(0).offset(13_000 + gap_us / 2));
        for i in (0..5).rev() {
            history.push(&pose(before.offset(-10_000 * i), 1.0));
        }
        for i in 0..5 {
            history.push(&pose(after.offset(10_000 * i), 1.0));
        }
        assert_eq!(
            history.over_scan(&scan, scan.start(0), &Limits { max_gap_us, ..limits() }).flags,
            expected,
            "{gap_us}"
        );
    }
}

#[test]
fn unusable_and_degraded_poses_are_told_apart() {
    for (status, expected) in [
        (0, flags::NO_ATTITUDE),
        (1, flags::NO_ATTITUDE),
        (2, flags::ATTITUDE_DEGRADED),
        (3, 0),
        (6, flags::ATTITUDE_DEGRADED),
        (7, 0),
        (11, flags::NO_ATTITUDE),
    ] {
        let mut history = History::default();
        for i in 0..20 {
            history.push(&Pose { status, ..pose(DeviceTime(i * 10_000), 1.0) });
        }
        let scan = half_degree_scan(DeviceTime(150_000));
        assert_eq!(history.over_scan(&scan, scan.start(0), &limits()).flags, expected, "status {status}");
    }
}

#[test]
fn repeated_and_late_poses_change_nothing_and_a_clock_set_back_starts_anew() {
    let mut history = History::default();
    for i in 0..10 {
        history.push(&pose(DeviceTime(1_000_000 + i * 10_000), 1.0));
    }
    let before = history.clone();
    history.push(&pose(DeviceTime(1_090_000), 5.0));
    history.push(&pose(DeviceTime(1_040_000), 5.0));
    assert_eq!(history.samples, before.samples);
    history.push(&pose(DeviceTime(10_000), 2.0));
    assert_eq!(history.samples.len(), 1);
}

proptest! {
    /// Any rolls at any times: no overflow, and between two poses the answer stays near them.
    #[test]
    fn arbitrary_poses_are_survived(
        poses in prop::collection::vec((0u64..2_000_000, any::<i32>(), 0u8..13), 0..60),
        stx in 0u64..1_500_000,
    ) {
        let mut history = History::default();
        for (time, roll, status) in poses {
            history.push(&Pose { roll: Angle(roll), status, ..pose(DeviceTime(time), 0.0) });
            let scan = half_degree_scan(DeviceTime(stx));
            let found = history.over_scan(&scan, scan.start(0), &limits());
            for beam in 0..scan.beams() {
                let _ = found.track.roll(&scan, beam);
            }
        }
    }
}
