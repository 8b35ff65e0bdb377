use std::f64::consts::PI;

use crossfall_core::protocol::DeviceTime;
use crossfall_core::protocol::message::flags;

use super::manual::{Measurement, Place};
use super::*;
use crate::profiles::{SlopeRow, left_out};
use crate::side::Side;
use crate::track::Position;

/// A drive over a road whose slopes are a wave along it; `late_m` is how far its positions are behind.
fn drive(name: &str, start_m: f64, late_m: f64, noise: f64) -> Drive {
    let mut rows = Vec::new();
    for scan in 0..1_500_u32 {
        let along = start_m + f64::from(scan) * 0.8;
        let wave = (along * 2.0 * PI / 40.0).sin();
        let jitter = noise * f64::from(scan % 7).sin();
        // A bend of a kilometre's radius.
        let (east, north) =
            (1_000.0 - 1_000.0 * ((along - late_m) / 1_000.0).cos(), 1_000.0 * ((along - late_m) / 1_000.0).sin());
        for side in Side::BOTH {
            let slope = |slope_deg: f64| {
                Some(SlopeRow { slope_deg, ci95_deg: Some(0.1), length_m: 4.0, points: 30, end_y_m: 8.0 })
            };
            rows.push(Row {
                scan,
                time: DeviceTime(u64::from(scan) * 26_640),
                position: Position {
                    gps: None,
                    geodetic: Some([40.0 + north / 111_035.0, -77.0 + east / 85_394.0, 300.0]),
                    station_m: Some(f64::from(scan) * 0.8),
                    ..Position::default()
                },
                roll_deg: 0.0,
                side,
                road_slope_deg: None,
                edge_y_m: None,
                adjacent: slope(-8.0 + wave + jitter),
                opposing: slope(7.0 + 0.5 * wave + jitter),
                flags: 0,
            });
        }
    }
    Drive { name: name.to_owned(), rows, damage: 0 }
}

#[test]
fn a_drive_agrees_with_itself() {
    let first = drive("first", 0.0, 0.0, 0.0);
    let found = repeat(&[first.clone(), first], &Options::default()).unwrap();
    assert_eq!(found.all.matched, 6_000);
    assert!(found.all.mean_absolute_deg < 1e-9);
    // Two intervals of 0.1 degrees: deviations of 0.051, of their difference 0.072, whose mean magnitude is 0.0576.
    assert!((found.all.expected_deg.unwrap() - 0.0576).abs() < 1e-4);
}

#[test]
fn drives_that_begin_elsewhere_are_matched_by_place() {
    let drives = [drive("first", 0.0, 0.0, 0.0), drive("second", 100.4, 0.0, 0.0)];
    let found = repeat(&drives, &Options::default()).unwrap();
    // Half a scan apart the wave differs by up to 0.06 degrees; without matching by place it would be most of a degree.
    assert!(found.all.matched > 5_400, "{}", found.all.matched);
    assert!(found.adjacent.mean_absolute_deg < 0.05, "{:?}", found.adjacent);
    assert!(found.pairs[0].off_track > 200, "what lies before and behind is told");
}

#[test]
fn an_error_of_position_is_found_from_the_slopes() {
    let drives = [drive("first", 0.0, 0.0, 0.1), drive("second", 0.0, 4.0, 0.1)];
    let found = repeat(&drives, &Options::default()).unwrap();
    let aligned = found.aligned.unwrap();
    assert!((aligned.shift_m - 4.0).abs() < 0.3, "{}", aligned.shift_m);
    assert!(aligned.all.mean_absolute_deg < found.all.mean_absolute_deg / 2.0, "{aligned:?}");
    assert_eq!(aligned.stretches, 2);
}

#[test]
fn slopes_that_are_the_same_everywhere_tell_no_shift() {
    let mut drives = [drive("first", 0.0, 0.0, 0.0), drive("second", 0.0, 0.0, 0.0)];
    for row in drives.iter_mut().flat_map(|drive| &mut drive.rows) {
        for slope in [&mut row.adjacent, &mut row.opposing] {
            *slope = slope.map(|slope| SlopeRow { slope_deg: -8.0, ..slope });
        }
    }
    assert_eq!(repeat(&drives, &Options::default()).unwrap().aligned.unwrap().shift_m, 0.0);
}

#[test]
fn what_says_itself_unreliable_is_left_out_and_counted() {
    let mut drives = [drive("first", 0.0, 0.0, 0.0), drive("second", 0.0, 0.0, 0.0)];
    for row in drives[1].rows.iter_mut().filter(|row| row.scan < 100) {
        row.flags = flags::DOUBTFUL;
        row.adjacent = row.adjacent.map(|slope| SlopeRow { slope_deg: 40.0, ..slope });
    }
    let found = repeat(&drives, &Options::default()).unwrap();
    assert_eq!(found.pairs[0].unreliable, 200);
    assert!(left_out(1, "row").starts_with("1 row is left out"));
    assert!(found.adjacent.mean_absolute_deg < 0.01);
    assert!(
        found.remarks.iter().any(|remark| remark.contains("200 sections are left out as unreliable")),
        "{:?}",
        found.remarks
    );
}

#[test]
fn a_drive_the_other_way_is_not_mixed_in() {
    let mut back = drive("back", 0.0, 0.0, 0.0);
    back.rows.reverse();
    let found = repeat(&[drive("first", 0.0, 0.0, 0.0), back], &Options::default()).unwrap();
    assert_eq!(found.all.matched, 0);
    // The mean of nothing is no -0.
    assert!(found.all.mean_absolute_deg.is_sign_positive() && found.all.mean_deg.is_sign_positive());
    assert!(found.remarks.iter().any(|remark| remark.contains("the other way")), "{:?}", found.remarks);
}

#[test]
fn without_positions_the_way_travelled_counts() {
    let mut drives = [drive("first", 0.0, 0.0, 0.0), drive("second", 0.0, 0.0, 0.0)];
    for drive in &mut drives {
        drive.rows.iter_mut().for_each(|row| row.position.geodetic = None);
    }
    let found = repeat(&drives, &Options::default()).unwrap();
    assert_eq!(found.all.matched, 6_000);
    assert!(found.remarks.iter().any(|remark| remark.contains("way travelled")), "{:?}", found.remarks);
}

#[test]
fn medians_over_stretches_take_the_noise_out() {
    let drives = [drive("first", 0.0, 0.0, 0.3), drive("second", 0.0, 0.0, 0.0)];
    let single = repeat(&drives, &Options::default()).unwrap();
    let pooled = repeat(&drives, &Options { over_m: Some(10.0), ..Options::default() }).unwrap();
    assert_eq!(pooled.all.matched, 480);
    assert!(pooled.aligned.is_none() && pooled.pairs[0].aligned.is_none(), "medians on one grid tell no shift");
    assert!(pooled.all.mean_absolute_deg < single.all.mean_absolute_deg);
}

#[test]
fn measurements_by_hand_find_their_place() {
    let drive = drive("drive", 0.0, 0.0, 0.0);
    let at = |place, kind, slope_deg| Measurement { place, side: Side::Left, kind, slope_deg };
    let [latitude, longitude, _] = drive.rows[600].position.geodetic.unwrap();
    let list = [
        at(Place::Station(240.0), Kind::Adjacent, -8.3),
        at(Place::Geodetic(latitude, longitude), Kind::Opposing, 7.2),
        at(Place::Station(5_000.0), Kind::Adjacent, -8.0),
    ];
    let held = manual::hold(&drive, drive.way().as_ref(), &list, &Options::default(), false);
    assert_eq!((held.all.matched, held.unmatched), (2, 1));
    assert!((held.adjacent.mean_deg - 0.3).abs() < 0.05, "{:?}", held.adjacent);
    assert!((held.held[1].station_m - 240.0).abs() < 0.01);
    let unsigned = [at(Place::Station(240.0), Kind::Adjacent, 8.3)];
    let held = manual::hold(&drive, None, &unsigned, &Options::default(), true);
    assert!((held.adjacent.mean_absolute_deg - 0.3).abs() < 0.05);
}

#[test]
fn stations_of_a_table_are_the_first_drives_whichever_drive_is_held() {
    let (first, later) = (drive("first", 0.0, 0.0, 0.0), drive("later", 150.0, 0.0, 0.0));
    // The slope at 310 m of the first drive, which is 160 m of the later one, where the wave has its other sign.
    let slope_deg = -8.0 + (310.0 * 2.0 * PI / 40.0).sin();
    let list = [Measurement { place: Place::Station(310.0), side: Side::Left, kind: Kind::Adjacent, slope_deg }];
    let way = first.way();
    for drive in [&first, &later] {
        let held = manual::hold(drive, way.as_ref(), &list, &Options::default(), false);
        assert!(held.adjacent.mean_absolute_deg < 0.05, "{}: {:?}", drive.name, held.adjacent);
    }
    // Driven the other way, left is right.
    let mut back = later.clone();
    back.rows.reverse();
    let held = manual::hold(&back, way.as_ref(), &list, &Options::default(), false);
    assert!(held.other_way && held.held.is_empty() && held.unmatched == 1, "{held:?}");
}

#[test]
fn a_table_that_cannot_be_used_is_refused_with_its_line() {
    let refuse = |text: &str| {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.csv");
        std::fs::write(&path, text).unwrap();
        manual::read(&path).unwrap_err().to_string().split_once("a.csv").unwrap().1.to_owned()
    };
    assert!(refuse("side,slope_deg,station_m\n").starts_with(":1: no column `slope`"));
    assert!(refuse("side,slope,slope_deg\nleft,adjacent,1\n").starts_with(":1: no column `station_m`"));
    let head = "note,side,slope,slope_deg,station_m\n";
    assert_eq!(
        refuse(&format!("{head}x,left,adjacent,-8,10\nx,middle,adjacent,-8,10\n")),
        ":3: side = `middle`, expected left or right"
    );
    assert_eq!(refuse(&format!("{head}x,left,adjacent,steep,10\n")), ":2: slope_deg = `steep`, expected a number");
}
