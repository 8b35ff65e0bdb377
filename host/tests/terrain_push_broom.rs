//! The board's own drives to elevation and risk: a simulated drive between a curb and a drop of known heights, through the firmware's core into a
//! log, and from the log into the map.

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

/// A road 6.5 m wide that falls by 1 degree to the right. On the left a curb of 12 cm (69.3 mm at 60 degrees) and a pavement, on the right a
/// drop of 10 cm and a verge. 3 m/s: a scan every 8 cm.
const SCENE: &str = r#"
[drive]
seconds = 9.0
speed_m_s = 3.0
azimuth_deg = 30.0
track = []

[sections]
mode = "stations"
interpolation = "linear"

[[sections.station]]
at_m = 0.0
height_m = 2.5
cross_slope_deg = 1.0
left = { edge_m = 3.0, adjacent_slope_deg = 60.0, adjacent_length_m = 0.0693, ditch_m = 3.0, opposing_slope_deg = 5.0, opposing_length_m = 4.0 }
right = { edge_m = 3.5, adjacent_slope_deg = -60.0, adjacent_length_m = 0.0577, ditch_m = 3.0, opposing_slope_deg = 5.0, opposing_length_m = 4.0 }
"#;
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

#[test]
fn a_drive_between_a_curb_and_a_drop_gives_their_heights_risk_and_class() {
    let folder = tempfile::tempdir().unwrap();
    let (capture_path, log_path) = (folder.path().join("c.mcap"), folder.path().join("l.mcap"));
    let scene: Scene = toml::from_str(SCENE).unwrap();
    let mut writer = capture::Writer::create(&capture_path).unwrap();
    simulate::simulate(&scene, &mut writer, |_| ()).unwrap();
    writer.finish().unwrap();
    let mut log = log::Writer::create(&log_path).unwrap();
    run::run(&mut capture::Reader::open(&capture_path).unwrap(), &Config::default(), &mut log, |_| ()).unwrap();
    log.finish().unwrap();

    let mut source = Source::open(&log_path, &Choices::default()).unwrap();
    let mut workshop = source.workshop(TerrainConfig::default(), 20.0, source.largest().unwrap());
    let mut mapper = workshop.open().unwrap();
    let (mut points, mut path) = (Vec::new(), Vec::new());
    while let Some((index, frame)) = source.next(&mut points) {
        let frame = frame.unwrap();
        let report = mapper.integrate(&points, &frame.pose, frame.step_us, &frame.boxes).unwrap();
        assert_eq!(report.refused, None, "frame {index}");
        path.push(frame.pose);
    }
    mapper.refresh();
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
