//! Scan telegrams of the LMS 1xx and 5xx: what each field means (telegram listing, `LMDscandata`).

use crossfall_core::protocol::config::Scanner as Mounting;
use crossfall_core::protocol::{Angle, DeviceTime};
use crossfall_core::scan::{ONE_TURN, Points, RawScan, RollTrack, level};
use crossfall_core::sensors::Scanner;
use crossfall_core::sensors::cola::{Decoder, Event, checksum};

/// What a telegram says, to be varied.
#[derive(Clone)]
struct Telegram {
    name: &'static [u8],
    status: u8,
    counter: u16,
    index_us: u32,
    sent_us: u32,
    frequency: u32,
    encoders: u16,
    content: &'static [u8; 5],
    scale: f32,
    start: i32,
    step: u16,
    values: Vec<u16>,
    strengths: bool,
}

impl Default for Telegram {
    fn default() -> Self {
        Self {
            name: b"sSN LMDscandata ",
            status: 0,
            counter: 7,
            index_us: 1_000_000,
            sent_us: 1_025_000,
            frequency: 5_000,
            encoders: 0,
            content: b"DIST1",
            scale: 1.0,
            start: 0,
            step: 5_000,
            values: (0..361).map(|i| 1_000 + i).collect(),
            strengths: false,
        }
    }
}

impl Telegram {
    fn bytes(&self) -> Vec<u8> {
        let mut payload = self.name.to_vec();
        let mut put = |bytes: &[u8]| payload.extend_from_slice(bytes);
        put(&[0, 1, 0, 1, 0x00, 0x98, 0x96, 0x81, 0, self.status]);
        put(&self.counter.to_be_bytes());
        put(&self.counter.wrapping_add(300).to_be_bytes());
        put(&self.index_us.to_be_bytes());
        put(&self.sent_us.to_be_bytes());
        put(&[0, 0, 7, 0, 0, 0]);
        put(&self.frequency.to_be_bytes());
        put(&270_u32.to_be_bytes());
        put(&self.encoders.to_be_bytes());
        (0..self.encoders).for_each(|_| put(&[0, 0, 0, 1, 0, 2]));
        put(&1_u16.to_be_bytes());
        put(self.content);
        put(&self.scale.to_be_bytes());
        put(&[0; 4]);
        put(&self.start.to_be_bytes());
        put(&self.step.to_be_bytes());
        put(&(self.values.len() as u16).to_be_bytes());
        self.values.iter().for_each(|value| put(&value.to_be_bytes()));
        if self.strengths {
            put(&1_u16.to_be_bytes());
            put(b"RSSI1\x3f\x80\x00\x00\x00\x00\x00\x00");
            put(&self.start.to_be_bytes());
            put(&self.step.to_be_bytes());
            put(&(self.values.len() as u16).to_be_bytes());
            self.values.iter().for_each(|_| put(&[99]));
        } else {
            put(&[0, 0]);
        }
        put(&[0; 10]);
        frame(&payload)
    }
}

fn frame(payload: &[u8]) -> Vec<u8> {
    let mut frame = vec![2, 2, 2, 2];
    frame.extend((payload.len() as u32).to_be_bytes());
    frame.extend(payload);
    frame.push(checksum(payload));
    frame
}

/// Feeds bytes that all arrive at one instant; the scans that come out and how many each proves missing.
fn feed(decoder: &mut Decoder, bytes: &[u8], at: u64) -> Vec<(RawScan, u16)> {
    let mut scans = Vec::new();
    for &byte in bytes {
        decoder.push(byte, DeviceTime(at), &mut |event| {
            if let Event::Scan { scan, missing, .. } = event {
                scans.push((scan.clone(), missing));
            }
        });
    }
    scans
}

/// The one scan in a telegram.
fn scan(telegram: &Telegram) -> Option<RawScan> {
    let mut decoder = Decoder::default();
    let scans = feed(&mut decoder, &telegram.bytes(), 9_000_000);
    assert_eq!(scans.len() as u32 + decoder.scans_unreadable(), 1);
    assert_eq!((decoder.scans(), decoder.counters().frames), (scans.len() as u32, 1));
    scans.into_iter().next().map(|(scan, _)| scan)
}

/// A telegram byte for byte, as the listing lays it out.
#[test]
fn a_telegram_by_hand() {
    let mut bytes = vec![2, 2, 2, 2, 0, 0, 0x01, 0xc3];
    bytes.extend(b"sSN LMDscandata ");
    bytes.extend([0x00, 0x01, 0x00, 0x01, 0x00, 0x98, 0x96, 0x81, 0x00, 0x00]); // version, device, serial, status
    bytes.extend([0x01, 0x02, 0x03, 0x04]); // telegram counter, scan counter
    bytes.extend([0x00, 0x0f, 0x42, 0x40, 0x00, 0x0f, 0xa4, 0x08]); // 1.000000 s, 1.025032 s
    bytes.extend([0x00, 0x00, 0x07, 0x00, 0x00, 0x00]); // inputs, outputs, layer
    bytes.extend([0x00, 0x00, 0x09, 0xc4, 0x00, 0x00, 0x01, 0x0e, 0x00, 0x00]); // 25 Hz, 27 kHz, no encoder
    bytes.extend([0x00, 0x01, b'D', b'I', b'S', b'T', b'1', 0x3f, 0x80, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00]);
    bytes.extend([0x00, 0x00, 0x00, 0x00, 0x27, 0x10, 0x00, 0xb5]); // from 0 in steps of 1 degree, 181 values
    (0..181).for_each(|_| bytes.extend([0x09, 0xc4]));
    bytes.extend([0; 12]);
    assert_eq!(bytes.len() - 8, 0x1c3);
    bytes.push(checksum(&bytes[8..]));

    let mut decoder = Decoder::default();
    let scans = feed(&mut decoder, &bytes, 5_000_000);
    let (scan, missing) = &scans[0];
    assert_eq!((scan.beams(), scan.step_cdeg(), scan.unit_um(), scan.turns()), (181, 100, 1_000, 1));
    assert_eq!((scan.mode.span_deg, scan.mode.measuring, scan.status, *missing), (180, ONE_TURN, 0, 0));
    assert_eq!(scan.counters, Some([0x04, 0x02]));
    assert!(scan.ranges().iter().all(|&range| range == 2_500));
    // Sent 25.032 ms after the index, which the mirror passed a quarter of 40 ms before the first beam.
    assert_eq!(scan.start(0), DeviceTime(5_000_000 - 25_032 + 10_000));
    assert_eq!((decoder.scans(), decoder.scans_unreadable(), decoder.pending()), (1, 0, 0));
}

#[test]
fn the_half_circle_is_taken_out_of_whatever_window_holds_it() {
    let narrow = scan(&Telegram::default()).unwrap();
    assert_eq!(narrow.ranges(), (0..361).map(|i| 1_000 + i).collect::<Vec<_>>());
    // An LMS 111 sees from -45 to 225 degrees, an LMS 511 from -5 to 185.
    for (start, step, count, stride) in [(-450_000, 5_000, 541, 1), (-50_000, 2_500, 761, 2), (-50_000, 5_000, 381, 1)]
    {
        let skipped = -start as usize / usize::from(step);
        let values: Vec<u16> = (0..count).map(|i| 2_000 + i).collect();
        let wide = scan(&Telegram { start, step, values: values.clone(), ..Telegram::default() }).unwrap();
        assert_eq!((wide.beams(), wide.step_cdeg()), (361, 50));
        let expected: Vec<u16> = values.into_iter().skip(skipped).step_by(stride).take(361).collect();
        assert_eq!(wide.ranges(), expected);
        assert_eq!((wide.beam_cdeg(0), wide.beam_cdeg(360)), (0, 18_000));
    }
}

#[test]
fn what_is_not_known_is_counted_and_not_guessed() {
    let usual = Telegram::default();
    for strange in [
        Telegram { step: 1_667, ..usual.clone() },
        Telegram { step: 0, ..usual.clone() },
        Telegram { start: 10_000, ..usual.clone() },
        Telegram { start: -2_500, ..usual.clone() },
        Telegram { start: i32::MIN, ..usual.clone() },
        Telegram { values: vec![1_000; 360], ..usual.clone() },
        Telegram { values: vec![], ..usual.clone() },
        Telegram { frequency: 5_001, ..usual.clone() },
        Telegram { scale: 1.5, ..usual.clone() },
        Telegram { content: b"DIST2", ..usual.clone() },
        Telegram { encoders: 9, ..usual.clone() },
    ] {
        assert_eq!(scan(&strange), None);
    }
    // Every telegram that ends too early, with a right check.
    let whole = usual.bytes();
    let payload = &whole[8..whole.len() - 1];
    for end in 16..payload.len() - 10 {
        let mut decoder = Decoder::default();
        assert!(feed(&mut decoder, &frame(&payload[..end]), 0).is_empty(), "cut at {end}");
        assert_eq!(decoder.scans_unreadable(), 1);
    }
}

#[test]
fn variants_are_read() {
    let usual = Telegram::default();
    assert!(scan(&Telegram { name: b"sRA LMDscandata ", ..usual.clone() }).is_some());
    assert!(scan(&Telegram { encoders: 3, ..usual.clone() }).is_some());
    assert!(scan(&Telegram { strengths: true, ..usual.clone() }).is_some());
    assert_eq!(scan(&Telegram { scale: 2.0, ..usual.clone() }).unwrap().unit_um(), 2_000);
    for (status, said) in [(0, 0), (1, 4), (2, 0x80), (5, 4)] {
        assert_eq!(scan(&Telegram { status, ..usual.clone() }).unwrap().status, said);
    }
    for (frequency, period_us) in [(2_500, 40_000), (3_500, 28_571), (5_000, 20_000), (7_500, 13_333), (10_000, 10_000)]
    {
        let scan = scan(&Telegram { frequency, ..usual.clone() }).unwrap();
        assert_eq!(scan.one_turn_us(), Some(period_us));
        // Half a turn from the first beam to the last.
        assert!((scan.beam_ns(360) - period_us * 500).abs() <= 500);
        assert_eq!(scan.start(0).since(DeviceTime(9_000_000 - 25_000)), i64::from(period_us) / 4);
    }
    // The scanner's clock wraps every 71 minutes.
    let wrapped = scan(&Telegram { index_us: u32::MAX - 4_999, sent_us: 20_000, ..usual }).unwrap();
    assert_eq!(wrapped.start(0), DeviceTime(9_000_000 - 25_000 + 5_000));
}

#[test]
fn the_counter_proves_what_is_missing() {
    let mut decoder = Decoder::default();
    let missing: Vec<u16> = [65_534_u16, 65_535, 0, 3]
        .into_iter()
        .flat_map(|counter| feed(&mut decoder, &Telegram { counter, ..Telegram::default() }.bytes(), 0))
        .map(|(_, missing)| missing)
        .collect();
    assert_eq!(missing, [0, 0, 0, 2]);
    assert_eq!((decoder.scans(), decoder.scans_missing()), (4, 2));
}

#[test]
fn special_values_are_no_points() {
    let values = (0..361).map(|i| if i < 16 { i } else { 2_000 }).collect();
    let telegram = Telegram { values, ..Telegram::default() };
    let scan = scan(&telegram).unwrap();
    let mut points = Points::new();
    level(&scan, &RollTrack::constant(Angle::ZERO), &Mounting::default(), &mut points);
    assert_eq!(points.first().map(|echo| echo.beam), Some(16));
    assert_eq!(points.len(), 345);
    let down = points.iter().find(|echo| echo.beam == 180).unwrap();
    assert_eq!((down.point.y_um, down.point.z_um), (0, -2_000_000));
}

/// One random bit flipped in every third telegram: that telegram is lost, and no other.
#[test]
fn a_flipped_bit_costs_the_telegram_it_hits_and_no_other() {
    let mut state = 0x9e37_79b9_7f4a_7c15_u64;
    let mut random = |below: usize| {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 33) as usize % below
    };
    let (mut bytes, mut whole) = (Vec::new(), Vec::new());
    for counter in 0..600_u16 {
        let mut telegram = Telegram { counter, ..Telegram::default() }.bytes();
        if counter % 3 == 1 {
            let place = random(telegram.len());
            telegram[place] ^= 1 << random(8);
        } else {
            whole.push(counter as u8);
        }
        bytes.extend(telegram);
    }
    let mut decoder = Decoder::default();
    let mut found: Vec<u8> =
        feed(&mut decoder, &bytes, 0).iter().filter_map(|(scan, _)| Some(scan.counters?[1])).collect();
    decoder.finish(&mut |event| {
        if let Event::Scan { scan, .. } = event {
            found.extend(scan.counters.map(|counters| counters[1]));
        }
    });
    assert_eq!(found, whole);
    assert_eq!(decoder.scans_missing(), 200);
    let counters = decoder.counters();
    assert_eq!(counters.bytes, bytes.len() as u64);
    assert!(counters.skipped > 0 && counters.bad_frames > 100);
}
