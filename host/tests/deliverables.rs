//! What is handed in, held against the truth of a simulated drive: stations, positions, slopes by the stretch, clouds; data sets that were stopped.

use std::f64::consts::PI;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Mutex;
use std::sync::OnceLock;
use std::time::{Duration, Instant};

use crossfall::capture::{Reader, Writer};
use crossfall::cloud::{self, Class, Stretch};
use crossfall::dataset::{self, Partition};
use crossfall::drive::Drive;
use crossfall::geodesy::{Utm, between};
use crossfall::intervals::{Every, Gather, Interval};
use crossfall::profiles::{Row, Rows, host_flags};
use crossfall::side::Side;
use crossfall::simulate::scene::Scene;
use crossfall::simulate::{self, truth};
use crossfall::stream::{Item, Stream};
use crossfall::table::Format;
use crossfall::{export, log, plot, report};
use crossfall_core::protocol::frame::{MAX_MESSAGE_FRAME, Sequencer};
use crossfall_core::protocol::message::{Fix, Message, Pose};
use crossfall_core::protocol::{Angle, Config};
use tempfile::TempDir;

/// A drive, made once for all tests.
struct Made {
    folder: TempDir,
    scene: Scene,
    truth: Vec<truth::Row>,
    rows: Vec<Row>,
}

impl Made {
    fn log(&self) -> PathBuf {
        self.folder.path().join("drive.log.mcap")
    }
}

fn make(scene: Scene) -> Made {
    make_with(scene, &Config::default())
}

fn make_with(scene: Scene, config: &Config) -> Made {
    let folder = tempfile::tempdir().unwrap();
    let capture_path = folder.path().join("drive.mcap");
    let mut capture = Writer::create(&capture_path).unwrap();
    let truth = simulate::simulate(&scene, &mut capture, |_| ()).unwrap().truth;
    capture.finish().unwrap();
    let mut writer = log::Writer::create(&folder.path().join("drive.log.mcap")).unwrap();
    crossfall::run::run(&mut Reader::open(&capture_path).unwrap(), config, &mut writer, |_| ()).unwrap();
    writer.finish().unwrap();
    let rows = Rows::open(&folder.path().join("drive.log.mcap")).unwrap().collect();
    Made { folder, scene, truth, rows }
}

fn drive() -> &'static Made {
    static DRIVE: OnceLock<Made> = OnceLock::new();
    DRIVE.get_or_init(|| {
        let mut scene = Scene::default();
        scene.drive.seconds = 20.0;
        make(scene)
    })
}

/// Where the simulated vehicle was at each of some times of the drive, in order: on the chain of poses, and between two of them on the arc that the
/// road has there.
fn simulated_places(scene: &Scene, times: impl Iterator<Item = f64>) -> Vec<[f64; 3]> {
    let rate = f64::from(scene.ins.rate_hz);
    let mut track = simulate::motion::Track::new(&scene.drive);
    let mut poses = 0.0;
    times
        .map(|time| {
            while (poses + 1.0) / rate <= time {
                track.step(1.0 / rate);
                poses += 1.0;
            }
            let mut between = track.clone();
            between.step(time - poses / rate);
            let place = between.place();
            [place.latitude_deg, place.longitude_deg, place.height_m]
        })
        .collect()
}

#[test]
fn every_section_is_where_the_vehicle_was() {
    held_against_the_poses(drive());
}

/// Every section within a decimetre of the simulated pose at its instant.
fn held_against_the_poses(made: &Made) {
    let clock = &made.scene.clock;
    let left = || made.rows.iter().filter(|row| row.side == Side::Left);
    let time = |row: &Row| (row.time.0 as f64 * 1e-6 - clock.start_s) / (1.0 + clock.drift_ppm * 1e-6);
    let places = simulated_places(&made.scene, left().map(time));
    assert_eq!(places.len(), made.truth.len());
    for (row, place) in left().zip(places) {
        let [east, north] = between(place, row.position.geodetic.unwrap());
        assert!(east.hypot(north) < 0.1, "scan {}: {east} {north}", row.scan);
        assert!((place[2] - row.position.geodetic.unwrap()[2]).abs() < 0.1, "scan {}", row.scan);
    }
}

#[test]
fn stations_are_the_way_travelled() {
    let made = drive();
    let stations: Vec<f64> =
        made.rows.iter().filter(|row| row.side == Side::Left).map(|row| row.position.station_m.unwrap()).collect();
    let way = stations.last().unwrap() - stations[0];
    let truth = made.truth.last().unwrap().station_m - made.truth[0].station_m;
    // The road climbs: a station is level, the truth's is along the slope.
    assert!((way / truth - 1.0).abs() < 1e-3, "{way} {truth}");
}

fn stretches(rows: &[Row], metres: f64) -> Vec<Interval> {
    let mut gather = Gather::new(Every { metres });
    let mut list: Vec<Interval> = rows.iter().filter_map(|row| gather.row(row)).collect();
    list.extend(gather.finish());
    list
}

/// A stretch's slope in degrees.
struct Compared {
    value: f64,
    half: f64,
    /// The truth's mean over the scans.
    truth: f64,
    /// What the inertial unit's mean roll over them makes of it, positive = too steep outward.
    by_roll: f64,
}

impl Compared {
    fn error(&self) -> f64 {
        self.value - self.truth
    }
}

/// Every stretch's slopes against the truth.
fn against_truth(made: &Made, metres: f64) -> Vec<Compared> {
    let mut all = Vec::new();
    for stretch in stretches(&made.rows, metres) {
        let stations = stretch.from_m..stretch.to_m;
        let inside = || {
            let rows = made.rows.iter().filter(|row| row.side == stretch.side);
            rows.filter(|row| row.position.station_m.is_some_and(|at| stations.contains(&at)))
        };
        let sections: Vec<_> = inside().map(|row| made.truth[row.scan as usize].section).collect();
        // A vehicle taken to hang further to the right than it does makes its left side steeper outward.
        let roll: f64 = inside().map(|row| row.roll_deg - made.truth[row.scan as usize].roll_deg).sum();
        let by_roll = roll / sections.len() as f64 * stretch.side.outward();
        let side = |section: &simulate::section::Section| {
            if stretch.side == Side::Left { section.left } else { section.right }
        };
        let mean = |slope: &dyn Fn(&simulate::section::Side) -> f64| {
            sections.iter().map(|section| slope(&side(section))).sum::<f64>() / sections.len() as f64
        };
        for (found, truth) in [
            (stretch.adjacent, mean(&|side| side.adjacent_slope_deg)),
            (stretch.opposing, mean(&|side| side.opposing_slope_deg)),
        ] {
            let found = found.expect("found in every stretch").slope_deg;
            all.push(Compared { value: found.value, half: found.ci95, truth, by_roll });
        }
    }
    all
}

#[test]
fn slopes_by_the_stretch_are_the_truth_within_their_intervals() {
    let all = against_truth(drive(), 10.0);
    assert!(all.len() > 150);
    let worst = all.iter().map(|slope| slope.error().abs()).fold(0.0, f64::max);
    assert!(worst < 0.05, "worst {worst}");
    let held = all.iter().filter(|slope| slope.error().abs() <= slope.half).count();
    assert!(held * 100 >= all.len() * 95, "{held} of {} intervals hold the truth", all.len());
}

/// Ten miles with the default scene's errors: positions, stations, slopes by the tenth of a mile. A tenth lasts seven seconds, the unit's roll error
/// thirty: it does not average out, and is 0.016 degrees RMS whatever is done with the scans. One tenth in five hundred is off by more than 0.05
/// degrees for it alone, one drive of ten miles in eight has such a tenth (docs/deliverables.md). So what is left without it is held closely too.
#[test]
fn ten_miles_are_right_by_the_tenth() {
    if std::env::var_os("CROSSFALL_LONG").is_none() {
        eprintln!("skipped: the ten-mile drive takes minutes; `cargo xtask test --long` runs it");
        return;
    }
    let mut scene = Scene::default();
    scene.drive.seconds = 16_093.44 / scene.drive.speed_m_s;
    if let Ok(seed) = std::env::var("CROSSFALL_SEED") {
        scene.drive.seed = seed.parse().unwrap();
    }
    let made = make(scene);
    held_against_the_poses(&made);
    let stations = made.rows.iter().filter_map(|row| row.position.station_m);
    let way = stations.fold(0.0, f64::max);
    let truth = made.truth.last().unwrap().station_m;
    println!("{way:.3} m of {truth:.3} m");
    assert!((way / truth - 1.0).abs() < 1e-3, "{way} {truth}");
    let all = against_truth(&made, 160.9344);
    let worst = |error: &dyn Fn(&Compared) -> f64| all.iter().map(|slope| error(slope).abs()).fold(0.0, f64::max);
    let rms = |error: &dyn Fn(&Compared) -> f64| {
        (all.iter().map(|slope| error(slope).powi(2)).sum::<f64>() / all.len() as f64).sqrt()
    };
    let (total, rest) = (|slope: &Compared| slope.error(), |slope: &Compared| slope.error() - slope.by_roll);
    let held = all.iter().filter(|slope| slope.error().abs() <= slope.half).count();
    println!("{} slopes of tenths: worst {:.4}, RMS {:.4} degrees", all.len(), worst(&total), rms(&total));
    println!(
        "without the unit's roll: worst {:.4}, RMS {:.4}; {held} intervals hold the truth",
        worst(&rest),
        rms(&rest)
    );
    assert!(all.len() >= 400 && worst(&total) < 0.05, "worst {} of {}", worst(&total), all.len());
    assert!(worst(&rest) < 0.02 && rms(&rest) < 0.005, "{} {}", worst(&rest), rms(&rest));
    // Neighbouring tenths share their error, so that this is worth a tenth of as many.
    assert!(held * 100 >= all.len() * 88, "{held} of {} intervals hold the truth", all.len());
}

#[test]
fn a_cloud_lies_on_the_simulated_ground() {
    let made = drive();
    let file = made.folder.path().join("cloud.laz");
    let told = cloud::write(&[made.log()], cloud::Format::Laz, &file, |_, _| ()).unwrap();
    assert_eq!(told.unplaced, 0);
    let mut reader = las::Reader::from_path(&file).unwrap();
    assert_eq!(reader.header().number_of_points(), told.points);
    assert!(reader.header().has_wkt_crs());
    let all = reader.read_all().unwrap();
    let points: Vec<las::Point> = all.points().collect::<Result<_, _>>().unwrap();
    // Every scan has some 360 returns, most of them of the five surfaces' own.
    assert!(points.len() > 300 * made.truth.len());
    let start = made.rows[0].position.geodetic.unwrap();
    let utm = Utm::around(start).unwrap();
    let drive = Drive::read(&made.log(), |_| ()).unwrap();
    let way = drive.way().unwrap();
    let first_m = drive.span_m().unwrap().0;
    let mut checked = 0;
    for point in points.iter().step_by(997).filter(|point| u8::from(point.classification) == Class::Road as u8) {
        let place = utm.geodetic([point.x, point.y, point.z]).unwrap();
        let Some(station_m) = way.station_m(place) else { continue };
        // The section that was under the vehicle there, and the vehicle's height.
        let at = station_m - first_m + made.truth[0].station_m;
        let Some(truth) = made.truth.iter().find(|row| row.station_m >= at) else { continue };
        let Some([scan, next]) = drive.scans.get(truth.scan..truth.scan + 2) else { continue };
        let (ahead, there) = (between(scan.place, next.place), between(scan.place, place));
        let left_m = (ahead[0] * there[1] - ahead[1] * there[0]) / ahead[0].hypot(ahead[1]);
        let ground = scan.place[2] - truth.section.height_m + left_m * truth.section.cross_slope_deg.to_radians().tan();
        assert!((point.z - ground).abs() < 0.12, "station {at}: {} {ground}", point.z);
        checked += 1;
    }
    assert!(checked > 50, "{checked}");
}

/// The log of a drive with other poses, by their seconds after the first scan; without those for which there are none.
fn rewritten(made: &Made, name: &str, poses: impl Fn(f64, Pose) -> Option<Pose>) -> PathBuf {
    let path = made.folder.path().join(name);
    let mut writer = log::Writer::create(&path).unwrap();
    let mut stream = Stream::open(&made.log()).unwrap();
    let (mut sequencer, mut room) = (Sequencer::new(), [0; MAX_MESSAGE_FRAME]);
    let (mut now_ns, first) = (0, made.rows[0].time);
    while let Some((_, item)) = stream.next() {
        let Item::Message { message, .. } = item else { panic!("a log without damage") };
        let message = match message {
            Message::Pose(pose) => match poses(pose.time.since(first) as f64 * 1e-6, pose) {
                Some(pose) => Message::Pose(pose),
                None => continue,
            },
            other => other,
        };
        let length = sequencer.message(&message, &mut room).unwrap();
        now_ns += 1_000_000;
        writer.frame(now_ns, &room[..length]).unwrap();
    }
    writer.finish().unwrap();
    path
}

/// The points of a cloud of one log, and how many scans are not in it.
fn cloud_of(log: &Path) -> (Vec<las::Point>, u64) {
    let file = log.with_extension("las");
    let told = cloud::write(&[log.to_path_buf()], cloud::Format::Las, &file, |_, _| ()).unwrap();
    assert_eq!(told.epsg, 32_618, "the zone of the drive");
    let all = las::Reader::from_path(&file).unwrap().read_all().unwrap();
    (all.points().collect::<Result<_, _>>().unwrap(), told.unplaced)
}

#[test]
fn what_the_unit_says_itself_not_to_know_places_nothing() {
    let made = drive();
    let (whole, _) = cloud_of(&made.log());
    let start_s = whole[0].gps_time.unwrap();
    let nowhere = Fix { latitude_ndeg: 0, longitude_ndeg: 0, height_mm: 0, velocity_mm_s: [0; 3] };
    for (name, status) in [("aligning.mcap", 1), ("inactive.mcap", 0)] {
        let log = rewritten(made, name, |seconds, pose| {
            let zeros = Pose { roll: Angle::ZERO, pitch: Angle::ZERO, azimuth: Angle::ZERO, status, ..pose };
            match status {
                _ if seconds >= 10.0 => Some(pose),
                0 => Some(Pose { fix: Some(nowhere), ..zeros }),
                _ => Some(zeros),
            }
        });
        let rows: Vec<Row> = Rows::open(&log).unwrap().collect();
        assert_eq!(rows.len(), made.rows.len());
        for (row, whole) in rows.iter().zip(&made.rows) {
            let known = status == 1 || row.position.turn.is_some();
            assert_eq!(row.flags & host_flags::NO_POSITION == 0, known, "scan {}", row.scan);
            if known {
                // Where it was, whatever the state: a satellites' position is one.
                assert_eq!(row.position.geodetic, whole.position.geodetic, "scan {}", row.scan);
            }
        }
        let turned = rows.iter().filter(|row| row.position.turn.is_some()).count();
        assert!((turned as f64 / rows.len() as f64 - 0.5).abs() < 0.02, "{turned}");
        let (points, unplaced) = cloud_of(&log);
        assert!((370..=380).contains(&unplaced), "{unplaced} of 750 scans");
        let first = points.iter().map(|point| point.gps_time.unwrap()).fold(f64::INFINITY, f64::min);
        assert!((9.9..10.1).contains(&(first - start_s)), "{}", first - start_s);
        // What is there is where it was.
        let last = whole.last().unwrap();
        let found = points.last().unwrap();
        assert!((found.x - last.x).hypot(found.y - last.y) < 1e-9, "{found:?} {last:?}");
    }
}

#[test]
fn scans_without_attitude_are_not_in_a_cloud() {
    let made = drive();
    let log = rewritten(made, "gap.mcap", |seconds, pose| (!(5.0..6.5).contains(&seconds)).then_some(pose));
    let (points, unplaced) = cloud_of(&log);
    assert!((50..60).contains(&unplaced), "{unplaced}");
    // Held for 50 ms at either end; a scan lasts 26 ms.
    let start_s = cloud_of(&made.log()).0[0].gps_time.unwrap();
    let within = points.iter().filter(|point| (5.1..6.4).contains(&(point.gps_time.unwrap() - start_s))).count();
    assert_eq!(within, 0);
}

#[test]
fn scan_angles_are_to_the_plumb_line_however_the_scanner_is_mounted() {
    for mirrored in [false, true] {
        let mut scene = Scene::default();
        scene.drive.seconds = 3.0;
        scene.scanner.mirrored = mirrored;
        scene.scanner.mounting_offset_deg = 10.0;
        let mut config = Config::default();
        config.scanner.mirrored = mirrored;
        config.scanner.mounting_offset = Angle::from_microdegrees(10_000_000);
        let made = make_with(scene, &config);
        let (points, _) = cloud_of(&made.log());
        let utm = Utm::around(made.rows[0].position.geodetic.unwrap()).unwrap();
        // The scanner's places by GPS time.
        let places: Vec<_> =
            made.rows.iter().filter(|row| row.side == Side::Left && row.position.turn.is_some()).collect();
        let seconds = |row: &Row| {
            let (week, seconds) = row.position.gps.unwrap();
            f64::from(week) * 604_800.0 + seconds - 1e9
        };
        let mut checked = 0;
        for point in points.iter().step_by(101) {
            let at = point.gps_time.unwrap();
            let Some(row) = places.iter().rfind(|row| seconds(row) <= at) else { continue };
            let (there, azimuth) = (row.position.geodetic.unwrap(), row.position.turn.unwrap().azimuth);
            let [east, north] = between(there, utm.geodetic([point.x, point.y, point.z]).unwrap());
            let (right, down) = (east * azimuth.cos() - north * azimuth.sin(), there[2] - point.z);
            let expected = right.atan2(down).to_degrees();
            // The vehicle climbs a centimetre within a scan.
            assert!((f64::from(point.scan_angle) - expected).abs() < 1.0, "{} {expected}", point.scan_angle);
            checked += 1;
        }
        assert!(checked > 300, "{checked}");
    }
}

#[test]
fn a_ply_cloud_has_as_many_points_as_it_says() {
    let made = drive();
    let file = made.folder.path().join("cloud.ply");
    let told = cloud::write(&[made.log()], cloud::Format::Ply, &file, |_, _| ()).unwrap();
    let bytes = fs::read(&file).unwrap();
    let end = bytes.windows(11).position(|w| w == b"end_header\n").unwrap() + 11;
    let header = String::from_utf8(bytes[..end].to_vec()).unwrap();
    assert!(header.contains(&format!("element vertex {:010}\n", told.points)), "{header}");
    assert_eq!((bytes.len() - end) as u64, told.points * 34);
}

#[test]
fn a_stopped_data_set_goes_on_where_it_was() {
    let made = drive();
    let folder = tempfile::tempdir().unwrap();
    let logs: Vec<PathBuf> = (0..3)
        .map(|i| {
            let log = folder.path().join(format!("run{i}.log.mcap"));
            fs::copy(made.log(), &log).unwrap();
            log
        })
        .collect();
    let set = folder.path().join("set");
    let take_in_every = |logs: &[PathBuf], every: Option<Every>| {
        let outcomes = Mutex::new(Vec::new());
        dataset::take_in(
            logs,
            Some("I-80"),
            every,
            &set,
            |_, _| (),
            |_, outcome| outcomes.lock().unwrap().push(outcome),
        )
        .unwrap();
        outcomes.into_inner().unwrap()
    };
    let take_in = |logs: &[PathBuf]| take_in_every(logs, None);
    let first = take_in(&logs[..2]);
    assert!(first.iter().all(|outcome| outcome.as_ref().unwrap().rows == Some(made.rows.len() as u64)));
    assert!(set.join("road=I-80/date=2026-01-06/run0.parquet").exists(), "{:?}", first[0]);
    let second = take_in(&logs);
    let written = second.iter().filter(|outcome| outcome.as_ref().unwrap().rows.is_some()).count();
    assert_eq!((second.len(), written), (3, 1), "what was finished is left as it is");

    // Made in another way it is another table; of the same way, the same.
    let rows = |every| take_in_every(&logs[..1], every)[0].as_ref().unwrap().rows;
    let tens = Some(Every { metres: 10.0 });
    assert!(rows(tens).is_some_and(|rows| rows < made.rows.len() as u64 / 2));
    assert_eq!((rows(tens), rows(None), rows(None)), (None, Some(made.rows.len() as u64), None));
    // A log in the place of another, older than it as a copy that keeps its time is.
    let earlier = fs::metadata(&logs[0]).unwrap().modified().unwrap() - Duration::from_secs(86_400);
    fs::File::options().write(true).open(&logs[0]).unwrap().set_modified(earlier).unwrap();
    assert_eq!((rows(None), rows(None)), (Some(made.rows.len() as u64), None));

    // A log that is none fails alone.
    let broken = folder.path().join("broken.log.mcap");
    fs::write(&broken, b"no log at all").unwrap();
    let third = take_in(&[logs[0].clone(), broken.clone()]);
    assert_eq!(third.iter().filter(|outcome| outcome.is_err()).count(), 1);
    assert_eq!(Partition::of(&logs[0], None).unwrap().drive, "run0");
}

/// One file of a drive is gone: the partition has what the table has, and the loss is told.
#[test]
fn a_drive_with_a_missing_file_is_taken_into_a_data_set() {
    let folder = tempfile::tempdir().unwrap();
    let first = folder.path().join("rot.log.mcap");
    let options = log::Options { max_bytes: 100_000, ..log::Options::default() };
    let mut writer = log::Writer::create_with(&first, options).unwrap();
    for frame in log::Reader::open(&drive().log()).unwrap().map(Result::unwrap) {
        writer.frame(frame.receive_ns, &frame.bytes).unwrap();
    }
    assert!(writer.parts() >= 3);
    writer.finish().unwrap();
    let (second, aside) = (folder.path().join("rot.log.part0002.mcap"), folder.path().join("aside"));
    fs::rename(&second, &aside).unwrap();
    let command = |output: &str, code: i32| {
        let mut command = std::process::Command::new(env!("CARGO_BIN_EXE_crossfall"));
        let ended = command.current_dir(&folder).args(["profiles", "rot.log.mcap", "-o", output]).output().unwrap();
        let said = String::from_utf8_lossy(&ended.stderr).into_owned();
        assert_eq!(ended.status.code(), Some(code), "{said}");
        let rows = said.lines().find_map(|line| line.strip_suffix(" rows")?.rsplit(' ').next()?.parse::<usize>().ok());
        (rows, said)
    };
    let (table, said) = command("rot.csv", 3);
    assert!(table.is_some_and(|rows| rows < drive().rows.len()), "{said}");
    let (partition, said) = command("set/", 3);
    assert!(partition == table && said.contains(" damaged, broken or missing parts passed over"), "{said}");
    // A second time nothing is made, and the loss is told all the same.
    let (again, said) = command("set/", 3);
    assert!(again.is_none() && said.contains("is there, of this log"), "{said}");
    assert!(said.contains(" damaged, broken or missing parts passed over"), "{said}");
    // The file has been found again.
    fs::rename(&aside, &second).unwrap();
    assert_eq!(command("set/", 0).0, Some(drive().rows.len()));
}

#[test]
fn the_report_is_one_page_that_needs_nothing_else() {
    let made = drive();
    let drive = Drive::read(&made.log(), |_| ()).unwrap();
    assert!(drive.is_whole());
    let page = report::page(&drive, "Drive <1> & more");
    assert!(page.contains("<title>Drive &lt;1&gt; &amp; more"));
    assert!(!page.contains("{{") && !page.contains("src=") && !page.contains("href="), "no outside, nothing unfilled");
    assert!(page.len() < 2_500_000, "{}", page.len());
    let data = page.split_once("id=\"data\">").unwrap().1.split_once("</script>").unwrap().0;
    let data: serde_json::Value = serde_json::from_str(data).unwrap();
    assert_eq!(data["x"].as_array().unwrap().len(), data["slopes"][0].as_array().unwrap().len());
    assert!(data["sections"].as_array().unwrap().len() > 100);
}

#[test]
fn a_report_and_a_table_come_from_one_reading() {
    let made = drive();
    let folder = tempfile::tempdir().unwrap();
    let (alone, beside) = (folder.path().join("alone.csv"), folder.path().join("beside.csv"));
    dataset::write(&made.log(), None, Format::Csv, &alone, |_| ()).unwrap();
    let (written, drive) = dataset::write_from(None, Format::Csv, &beside, |sink| {
        Drive::read_with(
            &made.log(),
            |_| (),
            |rows| {
                for row in rows {
                    sink.push(row);
                }
            },
        )
    })
    .unwrap();
    assert_eq!((written.rows, drive.scans.len()), (Some(made.rows.len() as u64), made.truth.len()));
    assert!(fs::read(&alone).unwrap() == fs::read(&beside).unwrap(), "the same table, byte for byte");
    // A log that is none leaves no half of a table.
    let none = folder.path().join("none.csv");
    let failed =
        dataset::write_from(None, Format::Csv, &none, |_| Drive::read(&folder.path().join("no.log.mcap"), |_| ()));
    assert!(failed.is_err() && !none.exists());
}

#[test]
fn a_stretch_of_the_cloud_lies_ahead_of_where_it_begins() {
    let made = drive();
    let from_m = made.rows[0].position.station_m.unwrap() + 50.0;
    let stretch = Stretch::read(&made.log(), from_m, from_m + 60.0).unwrap();
    assert!((55.0..60.0).contains(&stretch.length_m) && stretch.sections.len() > 90, "{}", stretch.length_m);
    let road = stretch.returns.iter().filter(|(_, class)| *class == Class::Road);
    for ([ahead, left, up], _) in road {
        // The bend of 600 m leads 3 m aside in 60 m, the climb of 1.5 % a metre up.
        assert!((-1.0..61.5).contains(ahead) && left.abs() < 9.0 && (-4.5..-0.5).contains(up), "{ahead} {left} {up}");
    }
    let svg = plot::view(&stretch, "A <stretch>", plot::Theme::Dark);
    assert!(svg.contains("A &lt;stretch>") && svg.len() < 600_000, "{}", svg.len());
    assert!(svg.contains(">50 m</text>"), "its sections are told by their distance");
    let nothing = Stretch::read(&made.log(), 1e6, 2e6).unwrap();
    assert!(nothing.returns.is_empty());
}

#[test]
fn an_export_has_every_profile_under_schemas_that_viewers_know() {
    let made = drive();
    let file = made.folder.path().join("drive.foxglove.mcap");
    let told = export::foxglove(&made.log(), &file, |_| ()).unwrap();
    assert_eq!(told.profiles, made.truth.len() as u64);
    let bytes = fs::read(&file).unwrap();
    assert_eq!(angles_of_the_scan(&bytes), (0.0, PI));
    let mut counts = std::collections::BTreeMap::new();
    for message in mcap::MessageStream::new(&bytes).unwrap() {
        let message = message.unwrap();
        let schema = message.channel.schema.as_ref().unwrap().name.clone();
        let json: serde_json::Value = serde_json::from_slice(&message.data).unwrap();
        if schema == "foxglove.LaserScan" {
            assert_eq!(json["ranges"].as_array().unwrap().len(), 361);
        }
        // Week 2400 and 259,200 s begin 2026-01-06 23:59:42 UTC.
        let since = json["timestamp"]["sec"].as_u64().unwrap() - 1_767_743_982;
        assert!(since <= 21, "{}", json["timestamp"]);
        *counts.entry(schema).or_insert(0_u64) += 1;
    }
    let names: Vec<_> = counts.keys().map(String::as_str).collect();
    assert_eq!(
        names,
        [
            "crossfall.Profile",
            "foxglove.FrameTransform",
            "foxglove.LaserScan",
            "foxglove.LocationFix",
            "foxglove.PointCloud"
        ]
    );
    assert!(counts.values().all(|count| *count == told.profiles), "{counts:?}");
}

/// The first and the last angle of the first scan of an export; every scan's returns lie where its points do, to within some degrees of roll.
fn angles_of_the_scan(export: &[u8]) -> (f64, f64) {
    let mut first = None;
    let mut angles = (0.0, 0.0);
    let mut ranges: Vec<f64> = Vec::new();
    for message in mcap::MessageStream::new(export).unwrap() {
        let message = message.unwrap();
        let json: serde_json::Value = serde_json::from_slice(&message.data).unwrap();
        match &*message.channel.topic {
            "/scan" => {
                angles = (json["start_angle"].as_f64().unwrap(), json["end_angle"].as_f64().unwrap());
                first.get_or_insert(angles);
                ranges = serde_json::from_value(json["ranges"].clone()).unwrap();
            }
            "/points" => {
                let step = (angles.1 - angles.0) / (ranges.len() - 1) as f64;
                let places = ranges.iter().enumerate().filter(|(_, range)| **range > 0.0);
                let mut right: Vec<f64> =
                    places.map(|(beam, range)| range * (angles.0 + beam as f64 * step).cos()).collect();
                let data = base64(json["data"].as_str().unwrap());
                let left = data.chunks(12).map(|point| f32::from_le_bytes(point[4..8].try_into().unwrap()));
                let mut left: Vec<f64> = left.map(f64::from).collect();
                assert_eq!(left.len(), right.len());
                // Whatever the order of either.
                left.sort_by(|a, b| b.total_cmp(a));
                right.sort_by(f64::total_cmp);
                for (left, right) in left.iter().zip(&right) {
                    assert!((right + left).abs() < 0.02 * left.abs() + 0.2, "{right} {left}");
                }
            }
            _ => {}
        }
    }
    first.unwrap()
}

fn base64(text: &str) -> Vec<u8> {
    let digit = |c: u8| match c {
        b'A'..=b'Z' => c - b'A',
        b'a'..=b'z' => c - b'a' + 26,
        b'0'..=b'9' => c - b'0' + 52,
        b'+' => 62,
        _ => 63,
    };
    let groups = text.trim_end_matches('=').as_bytes().chunks(4);
    let bytes = groups.flat_map(|group| {
        let bits = group.iter().fold(0_u32, |bits, c| bits << 6 | u32::from(digit(*c))) << (6 * (4 - group.len()));
        bits.to_be_bytes()[1..group.len()].to_vec()
    });
    bytes.collect()
}

#[test]
fn an_export_of_a_mirrored_scanner_has_its_returns_on_their_side() {
    let mut scene = Scene::default();
    scene.drive.seconds = 2.0;
    scene.scanner.mirrored = true;
    let mut config = Config::default();
    config.scanner.mirrored = true;
    let made = make_with(scene, &config);
    let file = made.folder.path().join("drive.foxglove.mcap");
    export::foxglove(&made.log(), &file, |_| ()).unwrap();
    assert_eq!(angles_of_the_scan(&fs::read(&file).unwrap()), (PI, 0.0));
}

/// The Python beside the build that `cargo xtask setup` furnishes, or the one that is named.
fn python() -> Option<PathBuf> {
    let beside = Path::new(env!("CARGO_BIN_EXE_crossfall")).parent()?.parent()?.join("python/bin/python");
    let python = std::env::var_os("CROSSFALL_PYTHON").map_or(beside, PathBuf::from);
    if !python.exists() {
        eprintln!(
            "skipped: no {} with laspy, pyarrow, duckdb and geojson; `cargo xtask setup` makes it",
            python.display()
        );
        return None;
    }
    Some(python)
}

fn run_python(python: &Path, folder: &Path, script: &str) -> String {
    let output = std::process::Command::new(python).arg("-c").arg(script).current_dir(folder).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8(output.stdout).unwrap().trim().to_owned()
}

#[test]
fn other_programs_open_every_file() {
    let Some(python) = python() else { return };
    let made = drive();
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    for (name, every) in [("a.csv", None), ("a.parquet", None), ("a.geojson", Some(Every { metres: 10.0 }))] {
        dataset::write(&made.log(), every, Format::of(Path::new(name)).unwrap(), &at(name), |_| ()).unwrap();
    }
    let told = cloud::write(&[made.log(), made.log()], cloud::Format::Laz, &at("a.laz"), |_, _| ()).unwrap();
    fs::create_dir(at("logs")).unwrap();
    fs::copy(made.log(), at("logs/one.log.mcap")).unwrap();
    dataset::take_in(
        &[at("logs/one.log.mcap")],
        Some("I-80"),
        None,
        &at("set"),
        |_, _| (),
        |_, done| {
            done.unwrap();
        },
    )
    .unwrap();

    let rows = run_python(
        &python,
        folder.path(),
        "import pyarrow.parquet as pq, pyarrow.csv as pc\n\
         a, b = pq.read_table('a.parquet'), pc.read_csv('a.csv')\n\
         assert a.column_names == b.column_names, a.column_names\n\
         x, y = a.column('adjacent_slope_deg').to_pylist(), b.column('adjacent_slope_deg').to_pylist()\n\
         assert x == y and len(x) == a.num_rows\n\
         print(a.num_rows)",
    );
    assert_eq!(rows, made.rows.len().to_string());
    let duck = run_python(
        &python,
        folder.path(),
        "import duckdb\n\
         print(*duckdb.sql(\"select road, date::varchar, side, count(*) from read_parquet('set/**/*.parquet', hive_partitioning = true) \
         group by all order by side\").fetchall())",
    );
    let each = made.rows.len() / 2;
    assert_eq!(duck, format!("('I-80', '2026-01-06', 'left', {each}) ('I-80', '2026-01-06', 'right', {each})"));
    let points = run_python(
        &python,
        folder.path(),
        "import laspy\n\
         c = laspy.read('a.laz')\n\
         assert str(c.header.version) == '1.4' and c.point_format.id == 6\n\
         assert set(c.point_source_id) == {1, 2} and 11 in c.classification and 64 in c.classification\n\
         assert any('UTM zone 18N' in v.string for v in c.header.vlrs if v.record_id == 2112)\n\
         assert (c.gps_time[1:] - c.gps_time[:-1]).max() < 0.1\n\
         print(len(c))",
    );
    assert_eq!(points, told.points.to_string());
    let valid = run_python(
        &python,
        folder.path(),
        "import geojson\n\
         c = geojson.load(open('a.geojson'))\n\
         assert c.is_valid, c.errors()\n\
         print(sorted({f.geometry.type for f in c.features}))",
    );
    assert_eq!(valid, "['LineString', 'Point', 'Polygon']");
}

/// A job of Spark takes half a minute, and several on a busy machine.
const SPARK_LIMIT: Duration = Duration::from_secs(600);

/// The job of the documentation on two workers of one machine, and its data set read by the same engine.
#[test]
fn spark_takes_logs_in() {
    let Some(python) = python() else { return };
    let runs = |program: &Path, argument: &[&str]| {
        std::process::Command::new(program).args(argument).output().is_ok_and(|output| output.status.success())
    };
    let java = std::env::var_os("JAVA_HOME").map_or(PathBuf::from("java"), |home| Path::new(&home).join("bin/java"));
    if !runs(&python, &["-c", "import pyspark"]) || !runs(&java, &["-version"]) {
        eprintln!(
            "skipped: {} has no pyspark, or there is no Java; `cargo xtask setup` fetches both",
            python.display()
        );
        return;
    }
    let made = drive();
    let folder = tempfile::tempdir().unwrap();
    let logs: Vec<PathBuf> = (0..3).map(|i| folder.path().join(format!("run{i}.log.mcap"))).collect();
    for log in &logs {
        fs::copy(made.log(), log).unwrap();
    }
    let spark = |arguments: &[&std::ffi::OsStr]| {
        let mut job = std::process::Command::new(&python);
        job.args(arguments)
            .current_dir(folder.path())
            .env("PYSPARK_PYTHON", &python)
            .env("SPARK_LOCAL_IP", "127.0.0.1");
        // Two workers; without Spark's own page, and without two hundred pieces of a table of two rows.
        let session =
            "--master local[2] --conf spark.ui.enabled=false --conf spark.sql.shuffle.partitions=2 pyspark-shell";
        let [said, told] = ["stdout", "stderr"].map(|name| folder.path().join(name));
        job.env("PYSPARK_SUBMIT_ARGS", session);
        job.stdout(fs::File::create(&said).unwrap()).stderr(fs::File::create(&told).unwrap());
        let mut running = job.spawn().unwrap();
        let deadline = Instant::now() + SPARK_LIMIT;
        let status = loop {
            if let Some(status) = running.try_wait().unwrap() {
                break status;
            }
            if Instant::now() > deadline {
                // Spark's Java ends with the Python that started it.
                running.kill().unwrap();
                running.wait().unwrap();
                panic!("Spark takes more than {SPARK_LIMIT:?}: {}", fs::read_to_string(&told).unwrap());
            }
            std::thread::sleep(Duration::from_millis(100));
        };
        assert!(status.success(), "{}", fs::read_to_string(&told).unwrap());
        fs::read_to_string(&said).unwrap()
    };
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("../docs/scripts/take_in.py");
    let program = Path::new(env!("CARGO_BIN_EXE_crossfall"));
    let mut arguments = vec![script.as_os_str(), "--road".as_ref(), "I-80".as_ref(), "--crossfall".as_ref()];
    arguments.extend([program.as_os_str(), "set".as_ref()]);
    arguments.extend(logs.iter().map(|log| log.as_os_str()));
    spark(&arguments);
    let read = "from pyspark.sql import SparkSession\n\
                spark = SparkSession.builder.getOrCreate()\n\
                drives = spark.read.parquet('set')\n\
                print([tuple(r) for r in drives.groupBy('road', 'side').count().orderBy('side').collect()])";
    let each = 3 * made.rows.len() / 2;
    let counted = spark(&["-c".as_ref(), read.as_ref()]);
    assert_eq!(counted.trim(), format!("[('I-80', 'left', {each}), ('I-80', 'right', {each})]"));
}
