//! A simulated drive with a coarse sensor, through the map and out into files.

use std::collections::BTreeSet;
use std::fs;
use std::path::Path;

use crossfall::terrain::drive::{Body, Shape, TerrainScene};
use crossfall::terrain::frames::{Choices, FrameFolder};
use crossfall::terrain::ghosts::ghosts;
use crossfall::terrain::lidar::Lidar;
use crossfall::terrain::map_files;
use crossfall::terrain::mapper::Workshop;
use crossfall::terrain::picture::View;
use crossfall::terrain::raster::Grid;
use crossfall_core::terrain::{Class, SLOW, TerrainConfig};

fn scene() -> TerrainScene {
    let lidar = Lidar { columns: 600, ..Lidar::default() };
    let mut scene = TerrainScene { frames: 16, lidar, ..TerrainScene::default() };
    scene.road.heading_deg = 25.0;
    scene
}

fn map(scene: &TerrainScene, judge: impl FnOnce(&crossfall::terrain::mapper::Mapper<'_>, f64)) {
    let mut workshop = Workshop::for_range(TerrainConfig::default(), 40.0, 100_000);
    let mut mapper = workshop.open().unwrap();
    let mut time_s = 0.0;
    for index in 0..scene.frames {
        let frame = scene.frame(index).unwrap();
        let report = mapper.integrate(&frame.points, &frame.reported, 100_000, &[]).unwrap();
        assert_eq!(report.refused, None, "frame {index}");
        time_s = frame.time_s;
    }
    mapper.refresh();
    judge(&mapper, scene.station(time_s));
}

#[test]
fn both_curbs_are_risky_and_the_road_between_them_is_not() {
    let scene = scene();
    map(&scene, |mapper, station| {
        let (mut plain, mut wrong) = (0, 0);
        let mut seen = [0; 2];
        for along in 0..200 {
            let at = station + 6.0 + 0.1 * f64::from(along);
            for across in -27..=27 {
                let (x, y, _) = scene.road.place(at, 0.1 * f64::from(across));
                if let Some(cell) = mapper.cell_at(x, y) {
                    plain += 1;
                    wrong += i32::from(cell.risk >= SLOW);
                }
            }
            for (seen, curb) in seen.iter_mut().zip([scene.road.left_curb_m, scene.road.right_curb_m]) {
                let hit = (-2..=2).any(|k| {
                    let (x, y, _) = scene.road.place(at, curb + 0.1 * f64::from(k));
                    mapper.cell_at(x, y).is_some_and(|cell| cell.risk >= SLOW)
                });
                *seen += i32::from(hit);
            }
        }
        assert!(plain > 9_000 && wrong * 200 < plain, "{wrong} of {plain}");
        assert!(seen.iter().all(|count| *count >= 180), "{seen:?}");
    });
}

#[test]
fn the_same_scene_gives_the_same_points_and_the_same_map() {
    let run = || {
        let scene = TerrainScene { frames: 4, ..scene() };
        let mut cells = Vec::new();
        map(&scene, |mapper, _| {
            for block in Grid::of(mapper).unwrap().blocks(mapper) {
                cells.extend(block.unwrap().iter().map(|(at, c)| (at, c.cell.height, c.cell.risk, c.cell.class)));
            }
        });
        cells
    };
    let first = run();
    assert!(first.len() > 10_000);
    assert!(first == run());
}

#[test]
fn a_parked_car_stands_and_a_post_does_too() {
    let mut scene = scene();
    let body = |shape, at_m, lateral_m| Body { shape, at_m, lateral_m, speed_mps: 0.0, across_mps: 0.0 };
    scene.bodies = vec![body(Shape::Car, 25.0, -2.0), body(Shape::Post, 22.0, 4.5)];
    map(&scene, |mapper, _| {
        for (at, lateral) in [(22.8, -2.0), (22.0, 4.5)] {
            let standing = (-3..=3).flat_map(|i| (-3..=3).map(move |k| (i, k))).any(|(i, k)| {
                let (x, y, _) = scene.road.place(at + 0.1 * f64::from(i), lateral + 0.1 * f64::from(k));
                mapper.cell_at(x, y).is_some_and(|cell| cell.tall && cell.risk == 255)
            });
            assert!(standing, "nothing stands at {at} {lateral}");
        }
    });
}

#[test]
fn the_table_of_cells_and_the_rasters_say_the_same() {
    let scene = TerrainScene { frames: 4, ..scene() };
    map(&scene, |mapper, _| {
        let grid = Grid::of(mapper).unwrap();
        let folder = tempfile::tempdir().unwrap();
        let vehicle = scene.frame(3).unwrap().reported;
        let choices = map_files::Choices { georeference: None, table: true, view: View::whole(&grid), vehicle };
        let written = map_files::write(mapper, &grid, folder.path(), &choices, |_| Ok(())).unwrap();
        let mut reader = csv::Reader::from_path(folder.path().join("cells.csv")).unwrap();
        assert_eq!(reader.headers().unwrap(), &["x_m", "y_m", "elevation_m", "sigma_m", "risk", "class"][..]);
        let rows: Vec<csv::StringRecord> = reader.records().map(Result::unwrap).collect();
        assert_eq!(rows.len() as u64, written.known);
        let classes: BTreeSet<&str> = rows.iter().map(|row| row.get(5).unwrap()).collect();
        assert!(classes.contains("free") && classes.contains("curb"), "{classes:?}");
        assert!(rows.iter().all(|row| row.iter().take(5).all(|value| value.parse::<f64>().unwrap().is_finite())));

        let rasters: Vec<Vec<f64>> = ["elevation.tif", "sigma.tif", "risk.tif", "class.tif"]
            .iter()
            .map(|name| {
                let file = fs::File::open(folder.path().join(name)).unwrap();
                let mut decoder = tiff::decoder::Decoder::new(file).unwrap();
                assert_eq!(decoder.dimensions().unwrap(), (grid.width() as u32, grid.height() as u32));
                let tie = decoder.get_tag_f64_vec(tiff::tags::Tag::ModelTiepointTag).unwrap();
                assert_eq!(&tie[..3], &[0.0, 0.0, 0.0]);
                assert!((tie[3] - grid.north_west()[0]).abs() < 1e-9 && (tie[4] - grid.north_west()[1]).abs() < 1e-9);
                match decoder.read_image().unwrap() {
                    tiff::decoder::DecodingResult::F32(values) => values.into_iter().map(f64::from).collect(),
                    tiff::decoder::DecodingResult::U8(values) => values.into_iter().map(f64::from).collect(),
                    _ => panic!("neither floats nor bytes"),
                }
            })
            .collect();
        let known = rasters[0].iter().filter(|value| **value > -9000.0).count();
        assert_eq!(known, rows.len());
        for row in &rows {
            let number = |field: usize| row[field].parse::<f64>().unwrap();
            let column = ((number(0) - grid.north_west()[0]) / grid.cell_m) as usize;
            let line = ((grid.north_west()[1] - number(1)) / grid.cell_m) as usize;
            let [elevation, sigma, risk, class] =
                [0, 1, 2, 3].map(|raster| rasters[raster][line * grid.width() + column]);
            let off = [elevation - number(2), sigma - number(3), 0.1 * (risk - number(4))];
            assert!(off.iter().all(|off| off.abs() < 1e-4), "{row:?}: {elevation} {sigma} {risk}");
            assert_eq!(Class::from_bits(class as u8).name(), &row[5]);
        }
    });
}

#[test]
fn a_drive_takes_the_place_of_an_earlier_one_and_of_nothing_else() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let drive = |frames: u32| {
        let lidar = Lidar { columns: 64, ..Lidar::default() };
        TerrainScene { frames, lidar, ..TerrainScene::default() }.write(folder.path(), |_| {})
    };
    let names = |folder: &Path| {
        let mut names: Vec<String> =
            fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect();
        names.sort();
        names
    };
    drive(5).unwrap();
    fs::write(at("velodyne/notes.txt"), b"mine").unwrap();
    drive(2).unwrap();
    let all = ["poses.txt", "scene.toml", "times.txt", "truth.csv", "truth_poses.txt", "velodyne"];
    assert_eq!(names(folder.path()), all, "nothing of a temporary name is left");
    assert_eq!(names(&at("velodyne")), ["000000.bin", "000001.bin", "notes.txt"]);
    assert_eq!(FrameFolder::open(folder.path(), &Choices::default()).unwrap().len(), 2);
    let table = fs::read_to_string(at("truth.csv")).unwrap();
    assert!(table.starts_with("x_m,y_m,elevation_m,surface\n") && !table.contains("-0.0000"));
    // A recording in the same layout says nothing of a scene.
    fs::remove_file(at("scene.toml")).unwrap();
    let recorded = fs::read(at("velodyne/000001.bin")).unwrap();
    let refused = drive(3).unwrap_err().to_string();
    assert!(refused.ends_with("velodyne: holds frames that were not simulated; name another folder"), "{refused}");
    assert_eq!(fs::read(at("velodyne/000001.bin")).unwrap(), recorded);
    assert_eq!(names(&at("velodyne")).len(), 3);
}

#[test]
fn an_oncoming_car_leaves_nothing_also_where_columns_are_two_cells_apart() {
    let left: Vec<_> = ghosts(2, "oncoming, 800 columns").unwrap();
    let [ghost] = &left[..] else { panic!("{left:?}") };
    assert!(ghost.near.visible > 10_000 && ghost.far.visible > 1_000, "{ghost:?}");
    assert_eq!((ghost.near.risky, ghost.far.risky), (0, 0), "{ghost:?}");
}
