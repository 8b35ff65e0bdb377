//! The board's own drives to elevation and risk: a simulated drive between a curb and a drop of known heights, through the firmware's core into a
//! log, and from the log into the map.

use std::path::{Path, PathBuf};

use crossfall::capture;
use crossfall::log;
use crossfall::run;
use crossfall::simulate::{self, scene::Scene};
use crossfall::terrain::frames::Choices;
use crossfall::terrain::lidar::SensorPose;
use crossfall::terrain::map_files;
use crossfall::terrain::mapper::Mapper;
use crossfall::terrain::picture::View;
use crossfall::terrain::raster::Grid;
use crossfall::terrain::source::Source;
use crossfall_core::protocol::Config;
use crossfall_core::terrain::{Cell, Class, SLOW, TerrainConfig};

/// A straight road 6.5 m wide that falls by 1 degree to the right, and what is beside it.
fn road(seconds: f64, speed_m_s: f64, [left, right]: [&str; 2]) -> String {
    format!(
        r#"
[drive]
seconds = {seconds:?}
speed_m_s = {speed_m_s:?}
azimuth_deg = 30.0
track = []

[sections]
mode = "stations"
interpolation = "linear"

[[sections.station]]
at_m = 0.0
height_m = {SENSOR_M:?}
cross_slope_deg = 1.0
left = {{ edge_m = 3.0, {left} }}
right = {{ edge_m = 3.5, {right} }}
"#
    )
}

/// On the left a curb of 12 cm (69.3 mm at 60 degrees) and a pavement, on the right a drop of 10 cm and a verge.
const STEPS: [&str; 2] = [
    "adjacent_slope_deg = 60.0, adjacent_length_m = 0.0693, ditch_m = 3.0, opposing_slope_deg = 5.0, opposing_length_m = 4.0",
    "adjacent_slope_deg = -60.0, adjacent_length_m = 0.0577, ditch_m = 3.0, opposing_slope_deg = 5.0, opposing_length_m = 4.0",
];
const SENSOR_M: f64 = 2.5;
const CURB_M: f64 = 3.0;
const DROP_M: f64 = -3.5;

/// Height of the ground above the road under the sensor, by the distance to the left.
fn truth(left_m: f64) -> f64 {
    let road = |left: f64| left * 1.0f64.to_radians().tan();
    if left_m > CURB_M {
        road(CURB_M) + 0.12
    } else if left_m < DROP_M {
        road(DROP_M) - 0.10
    } else {
        road(left_m)
    }
}

/// The cells along a line beside the vehicle's path, `left_m` to its left, and the height of the road under the sensor at each.
fn beside<'m>(mapper: &'m Mapper<'_>, path: &'m [SensorPose], left_m: f64) -> impl Iterator<Item = (Cell, f64)> + 'm {
    path.iter().filter_map(move |pose| {
        let forward = [pose.rotation[0][0], pose.rotation[1][0]];
        let length = forward[0].hypot(forward[1]);
        let [x, y] = [pose.position[0] - left_m * forward[1] / length, pose.position[1] + left_m * forward[0] / length];
        Some((mapper.kept_cell_at(x, y).unwrap()?, pose.position[2] - SENSOR_M))
    })
}

/// Simulates a scene and runs the firmware's core over it; where the log lies.
fn drive(scene: &str, folder: &Path) -> PathBuf {
    let (capture_path, log_path) = (folder.join("c.mcap"), folder.join("l.mcap"));
    let scene: Scene = toml::from_str(scene).unwrap();
    let mut writer = capture::Writer::create(&capture_path).unwrap();
    simulate::simulate(&scene, &mut writer, |_| ()).unwrap();
    writer.finish().unwrap();
    let mut log = log::Writer::create(&log_path).unwrap();
    run::run(&mut capture::Reader::open(&capture_path).unwrap(), &Config::default(), &mut log, |_| ()).unwrap();
    log.finish().unwrap();
    log_path
}

/// Takes every frame into the map; the poses of the frames.
fn map(source: &mut Source, mapper: &mut Mapper<'_>) -> Vec<SensorPose> {
    let (mut points, mut path) = (Vec::new(), Vec::new());
    while let Some((index, frame)) = source.next(&mut points) {
        let frame = frame.unwrap();
        let report = mapper.integrate(&points, &frame.pose, frame.step_us, &frame.boxes).unwrap();
        assert_eq!(report.refused, None, "frame {index}");
        path.push(frame.pose);
    }
    mapper.refresh();
    path
}

#[test]
fn a_drive_between_a_curb_and_a_drop_gives_their_heights_risk_and_class() {
    let folder = tempfile::tempdir().unwrap();
    // A scan every 8 cm.
    let mut source = Source::open(&drive(&road(9.0, 3.0, STEPS), folder.path()), &Choices::default()).unwrap();
    let mut workshop = source.workshop(TerrainConfig::default(), 20.0, source.largest().unwrap());
    let mut mapper = workshop.open().unwrap();
    let path = map(&mut source, &mut mapper);
    assert!(path.len() > 50, "{} frames of 9 s", path.len());
    assert!(source.georeference().is_some_and(|(_, epsg)| epsg == 32618), "{:?}", source.georeference());
    // Off the ends, where a line has no neighbours yet.
    let path = &path[5..path.len() - 5];

    // Elevation, up to 1.5 m beyond either step, where beams still lie closer than cells: within 15 mm of the truth in the mean and 40 mm in nearly every cell.
    for left_m in [-5.0, -4.2, -3.0, -1.5, 0.0, 1.5, 2.5, 3.5, 4.5] {
        let off: Vec<f64> = beside(&mapper, path, left_m)
            .filter_map(|(cell, road)| Some(mapper.elevation_m(cell.height?) - road - truth(left_m)))
            .collect();
        assert!(off.len() * 10 >= path.len() * 8, "{left_m} m left: {} of {} cells known", off.len(), path.len());
        let mean = off.iter().sum::<f64>() / off.len() as f64;
        let close = off.iter().filter(|off| off.abs() < 0.04).count();
        assert!(mean.abs() < 0.015, "{left_m} m left: off by {mean:.4} m");
        assert!(close * 20 >= off.len() * 19, "{left_m} m left: {close} of {} within 4 cm", off.len());
    }

    // Each step is risky and told for what it is; plain road is not risky.
    // Of the drop's foot the scanner sees less, as the edge hides it.
    for (step_m, class, told_percent) in [(CURB_M, Class::Curb, 80), (DROP_M, Class::Drop, 60)] {
        let cells: Vec<Vec<Cell>> = [-0.1, 0.0, 0.1]
            .iter()
            .map(|by| beside(&mapper, path, step_m + by).map(|(cell, _)| cell).collect())
            .collect();
        let count = cells.iter().map(Vec::len).min().unwrap();
        let risky = (0..count).filter(|at| cells.iter().any(|line| line[*at].risk >= SLOW)).count();
        let told = (0..count).filter(|at| cells.iter().any(|line| line[*at].class == class)).count();
        assert!(count >= 40 && risky * 100 >= count * 95, "{step_m} m left: {risky} of {count} risky");
        assert!(told * 100 >= count * told_percent, "{step_m} m left: {told} of {count} told a {}", class.name());
    }
    let plain: Vec<Cell> = (-25..=20)
        .flat_map(|tenth| beside(&mapper, path, 0.1 * f64::from(tenth)).map(|(cell, _)| cell).collect::<Vec<_>>())
        .collect();
    let wrong = plain.iter().filter(|cell| cell.risk >= SLOW).count();
    assert!(plain.len() > 1500 && wrong * 1000 < plain.len(), "{wrong} of {} cells of plain road", plain.len());

    // The written map names its coordinates.
    let grid = Grid::of(&mapper).unwrap();
    let (georeference, view) = (source.georeference(), View::whole(&grid));
    let choices = map_files::Choices { georeference, table: false, view, vehicle: path[0] };
    map_files::write(&mapper, &grid, folder.path(), &choices, |_| Ok(())).unwrap();
    let file = folder.path().join("elevation.tif");
    let mut decoder = tiff::decoder::Decoder::new(std::fs::File::open(&file).unwrap()).unwrap();
    let keys = decoder.get_tag_u32_vec(tiff::tags::Tag::GeoKeyDirectoryTag).unwrap();
    assert!(keys.chunks(4).any(|key| key[0] == 3072 && key[3] == 32618), "{keys:?}");
}

/// At 22 m/s: the lines lie 0.6 m apart, 30 degrees askew to the cells.
fn highway(sides: [&str; 2]) -> String {
    road(6.0, 22.0, sides)
}

/// Places 0.3 m apart on the way, off the ends.
fn every_third_of_a_metre(path: &[SensorPose]) -> Vec<SensorPose> {
    let between = |pair: &[SensorPose]| {
        let [from, to] = [pair[0].position, pair[1].position];
        let parts = (0..8).map(|part| f64::from(part) / 8.0);
        let place = |part| [0, 1, 2].map(|axis| from[axis] + part * (to[axis] - from[axis]));
        parts.map(|part| SensorPose { position: place(part), ..pair[0] }).collect::<Vec<_>>()
    };
    path[3..path.len() - 3].windows(2).flat_map(between).collect()
}

/// Cells between two distances to the left, and the risky ones among them.
fn risky(mapper: &Mapper<'_>, path: &[SensorPose], [from_m, to_m]: [f64; 2]) -> [usize; 2] {
    let lines = ((to_m - from_m) * 10.0).round() as i32;
    (0..=lines).fold([0; 2], |[cells, risky], line| {
        let line: Vec<Cell> = beside(mapper, path, from_m + 0.1 * f64::from(line)).map(|(cell, _)| cell).collect();
        [cells + line.len(), risky + line.iter().filter(|cell| cell.risk >= SLOW).count()]
    })
}

#[test]
fn side_slopes_of_8_degrees_passed_at_22_m_s_are_as_free_as_the_road_and_their_hinges_no_steps() {
    let folder = tempfile::tempdir().unwrap();
    let beyond = "adjacent_length_m = 5.0, ditch_m = 2.0, opposing_slope_deg = 5.0, opposing_length_m = 3.0";
    // The left falls away from the road, the right rises.
    let [falls, rises] = ["-8.0", "8.0"].map(|slope| format!("adjacent_slope_deg = {slope}, {beyond}"));
    let mut source = Source::open(&drive(&highway([&falls, &rises]), folder.path()), &Choices::default()).unwrap();
    let mut workshop = source.workshop(TerrainConfig::default(), 20.0, source.largest().unwrap());
    let mut mapper = workshop.open().unwrap();
    let path = every_third_of_a_metre(&map(&mut source, &mut mapper));
    for (what, across, least, per_thousand) in [
        ("road", [-3.0, 2.5], 15_000, 1),
        ("slope that falls", [3.5, 7.5], 9_000, 1),
        ("slope that rises", [-8.0, -4.0], 12_000, 1),
        ("hinge on the left", [2.6, 3.4], 2_500, 10),
        ("hinge on the right", [-3.9, -3.1], 2_500, 10),
        ("foot of what falls", [7.6, 8.4], 1_500, 10),
        ("top of what rises", [-8.9, -8.1], 2_000, 10),
    ] {
        let [cells, risky] = risky(&mapper, &path, across);
        assert!(cells >= least && risky * 1000 <= cells * per_thousand, "{what}: {risky} of {cells} risky");
    }
}

#[test]
fn a_curb_and_a_drop_passed_at_22_m_s_are_risky_all_along() {
    let folder = tempfile::tempdir().unwrap();
    let mut source = Source::open(&drive(&highway(STEPS), folder.path()), &Choices::default()).unwrap();
    let mut workshop = source.workshop(TerrainConfig::default(), 20.0, source.largest().unwrap());
    let mut mapper = workshop.open().unwrap();
    let path = every_third_of_a_metre(&map(&mut source, &mut mapper));
    // Of the drop's foot the scanner sees less, as the edge hides it.
    for (step_m, class, told_percent) in [(CURB_M, Class::Curb, 90), (DROP_M, Class::Drop, 60)] {
        let lines: Vec<Vec<Cell>> = (-2..=2)
            .map(|by| beside(&mapper, &path, step_m + 0.1 * f64::from(by)).map(|(cell, _)| cell).collect())
            .collect();
        let count = lines.iter().map(Vec::len).min().unwrap();
        let places =
            |is: &dyn Fn(&Cell) -> bool| (0..count).filter(|at| lines.iter().any(|line| is(&line[*at]))).count();
        let (risky, told) = (places(&|cell| cell.risk >= SLOW), places(&|cell| cell.class == class));
        assert!(count >= 250 && risky * 100 >= count * 95, "{step_m} m left: {risky} of {count} risky");
        assert!(told * 100 >= count * told_percent, "{step_m} m left: {told} of {count} told a {}", class.name());
    }
    for across in [[-3.0, 2.5], [3.5, 5.5], [-6.0, -4.0]] {
        let [cells, risky] = risky(&mapper, &path, across);
        assert!(cells >= 2_000 && risky * 1000 <= cells, "{across:?} m left: {risky} of {cells} risky");
    }
}
