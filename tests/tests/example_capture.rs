//! The example capture, end to end: 750 scans of random sections at 10 mm noise, roll 1.5 degrees at 0.8 Hz, device clock 23 ppm fast.

use std::collections::HashMap;
use std::path::Path;

use crossfall::side::Side;
use crossfall::{capture, log, profiles, run, verify};
use crossfall_core::protocol::Config;
use crossfall_tests::recordings;

/// Root of the mean square of what is there, and how many.
fn rms(errors: &[f64]) -> f64 {
    (errors.iter().map(|e| e * e).sum::<f64>() / errors.len() as f64).sqrt()
}

fn truth(path: &Path) -> HashMap<u32, HashMap<String, f64>> {
    let mut table = csv::Reader::from_path(path).expect("the truth beside the capture");
    let headers = table.headers().expect("a header").clone();
    let row = |record: csv::StringRecord| -> (u32, HashMap<String, f64>) {
        let cells = headers.iter().zip(&record).filter_map(|(name, cell)| Some((name.to_owned(), cell.parse().ok()?)));
        (record[0].parse().expect("a scan number"), cells.collect())
    };
    table.records().map(|record| row(record.expect("a row"))).collect()
}

#[test]
fn every_scan_is_measured_and_every_profile_proved() {
    let Some(folder) = recordings("capture") else { return };
    let scratch = tempfile::tempdir().expect("a scratch folder");
    let log_path = scratch.path().join("example.log.mcap");

    let mut reader = capture::Reader::open(&folder.join("example.mcap")).expect("the capture");
    let mut writer = log::Writer::create(&log_path).expect("a log");
    let summary = run::run(&mut reader, &Config::default(), &mut writer, |_| ()).expect("a run");
    writer.finish().expect("a whole log");
    assert_eq!((summary.status.scans, summary.profiles), (750, 750));
    assert_eq!((summary.status.lidar.bad_frames, summary.status.lidar.skipped), (0, 0));
    assert_eq!(summary.status.poses, 2_068);
    assert_eq!(summary.status.pulses, 21);

    let report = verify::verify(&log_path, |_| ()).expect("a readable log");
    assert_eq!(report.problems, []);
    assert_eq!((report.ok, report.profiles, report.profiles_reproduced), (true, 750, 750));

    let truth = truth(&folder.join("example.truth.csv"));
    let rows: Vec<_> =
        profiles::Rows::open(&log_path).expect("a readable log").filter(|row| row.side == Side::Left).collect();
    assert_eq!(rows.len(), 750);
    let mut errors: HashMap<&str, Vec<f64>> = HashMap::new();
    let mut covered = [0, 0];
    for row in &rows {
        let truth = &truth[&row.scan];
        let mut note = |name, value: Option<f64>, column: &str| {
            if let Some(value) = value {
                errors.entry(name).or_default().push(value - truth[column]);
            }
        };
        note("start", Some(row.time.0 as f64 * 1e-6), "start_device_s");
        note("roll", Some(row.roll_deg), "roll_deg");
        note("road", row.road_slope_deg, "road_deg");
        note("edge", row.edge_y_m, "edge_y_m");
        note("adjacent", row.adjacent.map(|s| s.slope_deg), "adjacent_deg");
        note("foot", row.adjacent.map(|s| s.end_y_m), "adjacent_end_y_m");
        note("opposing", row.opposing.map(|s| s.slope_deg), "opposing_deg");
        note("top", row.opposing.map(|s| s.end_y_m), "opposing_end_y_m");
        for (hits, slope, column) in [(0, row.adjacent, "adjacent_deg"), (1, row.opposing, "opposing_deg")] {
            if let Some(slope) = slope {
                covered[hits] += usize::from((slope.slope_deg - truth[column]).abs() <= slope.ci95_deg.unwrap_or(0.0));
            }
        }
    }
    for (name, errors) in &errors {
        println!("{name:9} {:4} found, RMS {:.5}", errors.len(), rms(errors));
    }
    println!("intervals cover {:?} of 750", covered);
    assert!(rms(&errors["start"]) < 2e-6);
    // The truth's roll is the vehicle's at straight down; the unit's own noise is in the measured one.
    assert!(rms(&errors["roll"]) < 0.005);
    for slope in ["adjacent", "opposing"] {
        assert!(errors[slope].len() >= 743, "{slope}: {} found", errors[slope].len());
        assert!(rms(&errors[slope]) < 0.07, "{slope}: {}", rms(&errors[slope]));
    }
    assert!(rms(&errors["edge"]) < 0.10);
}
