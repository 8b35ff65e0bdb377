//! The receiver's logs: exact conversion against f64, fields that cannot be true, headers of other lengths.

use crossfall_core::clock::WEEK_US;
use crossfall_core::protocol::{Angle, DeviceTime};
use crossfall_core::sensors::novatel::{Decoder, Event, Log, Number, Quality, crc32, id};
use proptest::prelude::*;

/// A frame with a short header.
fn short(id: u16, body: &[u8]) -> Vec<u8> {
    let mut frame = vec![0xaa, 0x44, 0x13, body.len() as u8];
    frame.extend(id.to_le_bytes());
    frame.extend(2_209u16.to_le_bytes());
    frame.extend(490_712_000u32.to_le_bytes());
    frame.extend(body);
    frame.extend(crc32(&frame).to_le_bytes());
    frame
}

/// A frame with a long header of `header` bytes and this message type.
fn long(id: u16, header: u8, message_type: u8, body: &[u8]) -> Vec<u8> {
    let mut frame = vec![0; usize::from(header)];
    frame[..4].copy_from_slice(&[0xaa, 0x44, 0x12, header]);
    frame[4..6].copy_from_slice(&id.to_le_bytes());
    frame[6] = message_type;
    frame[8..10].copy_from_slice(&(body.len() as u16).to_le_bytes());
    frame[13] = 180;
    frame[14..16].copy_from_slice(&2_209u16.to_le_bytes());
    frame[16..20].copy_from_slice(&490_712_000u32.to_le_bytes());
    frame.extend(body);
    frame.extend(crc32(&frame).to_le_bytes());
    frame
}

/// An INSPVA body: week, seconds, then latitude, longitude, height, three velocities and three angles, status.
fn inspva(seconds: f64, numbers: [f64; 9], status: u32) -> Vec<u8> {
    let mut body = 2_209u32.to_le_bytes().to_vec();
    body.extend(seconds.to_le_bytes());
    numbers.iter().for_each(|number| body.extend(number.to_le_bytes()));
    body.extend(status.to_le_bytes());
    body
}

const DRIVE: [f64; 9] = [51.116, -114.038, 1_048.5, 12.5, -0.25, 0.0005, -2.5, 0.75, 359.9];

/// The single event of a frame, and the count of bad fields.
fn only(frame: &[u8], look: impl Fn(&Event<'_>)) -> u32 {
    let mut decoder = Decoder::new();
    let mut events = 0;
    for (i, &byte) in frame.iter().enumerate() {
        decoder.push(byte, DeviceTime(500 + i as u64), &mut |event| {
            assert_eq!(event.header.arrival, DeviceTime(500));
            look(&event);
            events += 1;
        });
    }
    assert_eq!((events, decoder.counters().frames), (1, 1));
    decoder.bad_fields()
}

#[test]
fn a_pose_in_the_projects_units() {
    let bad = only(&short(id::INSPVAS, &inspva(490_712.005, DRIVE, 3)), |event| {
        let Log::Solution(solution, None) = &event.log else { panic!("{event:?}") };
        assert_eq!((solution.week, solution.gps_us, solution.quality()), (2_209, 490_712_005_000, Quality::Good));
        assert_eq!(solution.roll, Angle::from_microdegrees(-2_500_000));
        assert_eq!(solution.pitch, Angle::from_microdegrees(750_000));
        assert_eq!(solution.azimuth, Angle::from_microdegrees(-100_000), "359.9 degrees as a signed angle");
        let fix = solution.fix.unwrap();
        assert_eq!((fix.latitude_ndeg, fix.longitude_ndeg), (51_116_000_000, -114_038_000_000));
        assert_eq!((fix.height_mm, fix.velocity_mm_s), (1_048_500, [12_500, -250, 1]));
    });
    assert_eq!(bad, 0);
}

#[test]
fn what_a_status_allows() {
    for status in 0..=12 {
        only(&short(id::INSPVAS, &inspva(1.0, DRIVE, status)), |event| {
            let Log::Solution(solution, _) = &event.log else { panic!("{event:?}") };
            let quality = match status {
                3 | 7 => Quality::Good,
                2 | 6 => Quality::Degraded,
                1 => Quality::Aligning,
                _ => Quality::Unusable,
            };
            assert_eq!((solution.quality(), u32::from(solution.status)), (quality, status));
            let usable = [2, 3, 6, 7].contains(&status);
            assert_eq!((quality.has_attitude(), quality.has_position()), (usable, usable || status == 1), "{status}");
        });
    }
}

#[test]
fn what_cannot_be_true_is_counted_and_never_believed() {
    let with = |place: usize, value: f64| {
        let mut numbers = DRIVE;
        numbers[place] = value;
        short(id::INSPVAS, &inspva(490_712.0, numbers, 3))
    };
    // Position and velocity: the attitude stands without them.
    for (place, value) in [(0, f64::NAN), (0, 90.000_000_001), (1, -180.5), (2, 1e300), (3, f64::INFINITY), (5, -2.2e6)]
    {
        let bad = only(&with(place, value), |event| {
            let Log::Solution(solution, _) = &event.log else { panic!("{event:?}") };
            assert_eq!((solution.fix, solution.roll), (None, Angle::from_microdegrees(-2_500_000)), "{place} {value}");
        });
        assert_eq!(bad, 1);
    }
    // Attitude: no pose.
    for (place, value, field) in [
        (6, f64::NAN, "roll"),
        (6, 180.000_000_1, "roll"),
        (7, -90.1, "pitch"),
        (8, 360.000_1, "azimuth"),
        (8, f64::NEG_INFINITY, "azimuth"),
    ] {
        let bad = only(&with(place, value), |event| assert_eq!(event.log, Log::BadField(field)));
        assert_eq!(bad, 1);
    }
    for (body, field) in [
        (inspva(604_800.5, DRIVE, 3), "time"),
        (inspva(-0.1, DRIVE, 3), "time"),
        (inspva(f64::NAN, DRIVE, 3), "seconds"),
        (inspva(1.0, DRIVE, 1 << 20), "status"),
        (inspva(1.0, DRIVE, 3)[..80].to_vec(), "length"),
    ] {
        let bad = only(&short(id::INSPVAS, &body), |event| assert_eq!(event.log, Log::BadField(field)));
        assert_eq!(bad, 1);
    }
    for id in [id::INSATTS, id::INSPVAX, id::RAWIMUS, id::BESTPOS, id::TIME] {
        assert_eq!(only(&short(id, &[0; 3]), |event| assert_eq!(event.log, Log::BadField("length"))), 1);
    }
}

#[test]
fn inspvax_takes_its_time_from_the_header_and_tells_its_deviations() {
    let mut body = vec![6, 0, 0, 0, 56, 0, 0, 0];
    DRIVE[..3].iter().for_each(|number| body.extend(number.to_le_bytes()));
    body.extend((-16.25f32).to_le_bytes());
    DRIVE[3..].iter().for_each(|number| body.extend(number.to_le_bytes()));
    [0.5f32, 0.25, 1.0, 0.02, 0.03, 0.04, 0.015, 0.016, 0.1].iter().for_each(|sigma| body.extend(sigma.to_le_bytes()));
    body.extend(0x40u32.to_le_bytes());
    body.extend(7u16.to_le_bytes());
    assert_eq!(body.len(), 126);
    let bad = only(&long(id::INSPVAX, 28, 0, &body), |event| {
        let Log::Solution(solution, Some(detail)) = &event.log else { panic!("{event:?}") };
        assert_eq!((solution.week, solution.gps_us, solution.status), (2_209, 490_712_000_000, 6));
        assert_eq!(event.header.time_status, Some(180));
        assert_eq!((detail.position_type, detail.undulation_mm, detail.update_age_s), (56, -16_250, 7));
        assert_eq!((detail.position_sigma_mm, detail.velocity_sigma_mm_s), ([500, 250, 1_000], [20, 30, 40]));
        assert_eq!(detail.attitude_sigma.map(Angle::to_microdegrees), [15_000, 16_000, 100_000]);
        assert_eq!(detail.extended_status, 0x40);
    });
    assert_eq!(bad, 0);
    // A deviation that is no number costs the deviations, not the pose.
    body[84..88].copy_from_slice(&f32::NAN.to_le_bytes());
    let bad = only(&long(id::INSPVAX, 28, 0, &body), |event| {
        assert!(matches!(&event.log, Log::Solution(solution, None) if solution.fix.is_some()), "{event:?}");
    });
    assert_eq!(bad, 1);
}

#[test]
fn headers_and_bodies_may_be_longer_than_documented() {
    let body = [&inspva(490_712.0, DRIVE, 3)[..], &[1, 2, 3, 4]].concat();
    for header in 28..=32 {
        only(&long(id::INSPVA, header, 0, &body), |event| {
            assert!(matches!(&event.log, Log::Solution(solution, None) if solution.fix.is_some()));
        });
    }
}

#[test]
fn other_numbers_and_responses_are_given_as_they_are() {
    only(&short(812, &[1, 2, 3]), |event| assert_eq!((event.header.id, &event.log), (812, &Log::Other(&[1, 2, 3]))));
    // The answer to a LOG command in binary carries the number of the log, and is none.
    only(&long(id::INSPVA, 28, 0x80, b"\x01\0\0\0OK"), |event| {
        assert!(event.header.response);
        assert_eq!(event.log, Log::Other(b"\x01\0\0\0OK"));
    });
}

fn number(value: f64) -> Option<Number> {
    Number::from_f64_bits(value.to_bits())
}

/// The value times `factor` to nearest, ties away from zero, in twice the precision of f64: product and its error.
fn nearest(value: f64, factor: u32) -> f64 {
    let factor = f64::from(factor);
    let product = value * factor;
    let error = libm::fma(value, factor, -product);
    let whole = libm::trunc(product);
    // The fraction is exact (Sterbenz), the error far below it.
    let fraction = (product - whole) + error;
    let magnitude = fraction * libm::copysign(1.0, value);
    if magnitude >= 0.5 {
        whole + libm::copysign(1.0, value)
    } else if magnitude < -0.5 {
        whole - libm::copysign(1.0, value)
    } else {
        whole
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 20_000, ..ProptestConfig::default() })]

    #[test]
    fn scaling_is_the_nearest_integer(
        value in prop_oneof![-1e5..1e5, -1.0..1.0, (-4_000_000i32..4_000_000).prop_map(|n| f64::from(n) / 2_000.0)],
        factor in prop::sample::select(vec![1u32, 1_000, 1_000_000, 1_000_000_000]),
    ) {
        prop_assert_eq!(number(value).unwrap().scaled(factor), Some(nearest(value, factor) as i64));
    }

    #[test]
    fn degrees_are_the_nearest_binary_angle(degrees in -360.0..360.0f64) {
        let angle = number(degrees).unwrap().degrees().unwrap();
        // 2^32 / 360 is no dyadic number: f64 is within 2^-20 units, so that only a near tie may differ.
        let units = degrees * (4_294_967_296.0 / 360.0);
        let wrapped = (units - f64::from(angle.0)).rem_euclid(4_294_967_296.0);
        let error = wrapped.min(4_294_967_296.0 - wrapped);
        prop_assert!(error <= 0.5 + 1e-6, "{degrees} is {} units, got {}", units, angle.0);
    }

    #[test]
    fn limits_are_exact(bits in any::<u64>(), limit in prop::sample::select(vec![0u32, 1, 90, 180, 360, u32::MAX])) {
        let value = f64::from_bits(bits);
        match Number::from_f64_bits(bits) {
            None => prop_assert!(!value.is_finite()),
            Some(number) => prop_assert_eq!(number.is_within(limit), value.abs() <= f64::from(limit)),
        }
    }

    #[test]
    fn no_bits_panic_and_none_that_do_not_fit_are_taken(bits in any::<u64>(), factor in any::<u32>()) {
        let value = f64::from_bits(bits);
        if let Some(number) = Number::from_f64_bits(bits) {
            let product = value * f64::from(factor);
            match number.scaled(factor) {
                Some(scaled) => prop_assert!((product - scaled as f64).abs() <= 0.5 + product.abs() * 1e-15),
                None => prop_assert!(product.abs() > 9.2e18),
            }
            prop_assert_eq!(number.degrees().is_some(), value.abs() <= 360.0);
            prop_assert_eq!(number.scaled_i32(factor).is_some(), number.scaled(factor).is_some_and(|n| n as i32 as i64 == n));
        }
    }

    #[test]
    fn floats_are_as_exact_as_doubles(bits in any::<u32>()) {
        let value = f32::from_bits(bits);
        let (single, double) = (Number::from_f32_bits(bits), Number::from_f64_bits(f64::from(value).to_bits()));
        prop_assert_eq!(single.is_some(), value.is_finite());
        if let (Some(single), Some(double)) = (single, double) {
            prop_assert_eq!(single.scaled(1_000), double.scaled(1_000));
            prop_assert_eq!(single.degrees(), double.degrees());
            prop_assert_eq!(single.is_within(180), double.is_within(180));
        }
    }
}

#[test]
fn boundaries_of_the_conversion() {
    let scaled = |value: f64, factor| number(value).and_then(|n| n.scaled(factor));
    assert_eq!(
        (scaled(0.0005, 1_000), scaled(-0.5, 1), scaled(0.5, 1), scaled(1.5, 1)),
        (Some(1), Some(-1), Some(1), Some(2))
    );
    assert_eq!(
        (scaled(-0.0, 1_000), scaled(f64::MIN_POSITIVE, u32::MAX), scaled(5e-324, 1)),
        (Some(0), Some(0), Some(0))
    );
    assert_eq!(
        (scaled(9_223_372_036_854_774_784.0, 1), scaled(9_223_372_036_854_775_808.0, 1)),
        (Some(i64::MAX - 1_023), None)
    );
    assert_eq!((scaled(f64::MAX, 1), scaled(f64::MAX, 0), scaled(f64::NAN, 1)), (None, Some(0), None));
    let degrees = |value: f64| number(value).and_then(Number::degrees).map(|angle| angle.0);
    assert_eq!((degrees(90.0), degrees(-90.0), degrees(180.0)), (Some(1 << 30), Some(-(1 << 30)), Some(i32::MIN)));
    assert_eq!((degrees(360.0), degrees(-360.0), degrees(270.0)), (Some(0), Some(0), Some(-(1 << 30))));
    // Half a unit rounds away from zero: 45 / 2^30 degrees are half a unit.
    let half = 45.0 / f64::from(1 << 30);
    assert_eq!((degrees(half), degrees(-half), degrees(half * (1.0 - 1e-15))), (Some(1), Some(-1), Some(0)));
    assert_eq!(degrees(5e-324), Some(0));
}

#[test]
fn a_gps_second_never_leaves_its_week() {
    for (seconds, week, us) in [
        (0.0, 2_209, 0),
        (604_799.999_999, 2_209, WEEK_US - 1),
        (604_799.999_999_9, 2_210, 0),
        (0.000_000_75, 2_209, 1),
    ] {
        only(&short(id::INSPVAS, &inspva(seconds, DRIVE, 3)), |event| {
            let Log::Solution(solution, _) = &event.log else { panic!("{event:?}") };
            assert_eq!((solution.week, solution.gps_us), (week, us));
        });
    }
}
