//! The files of a map that lies along a line through a large, mostly unknown rectangle: what a drive of an hour is, in small.

use std::fs::{self, File};
use std::path::Path;

use crossfall::terrain::geotiff::{GeoTiff, Layout, Pixel};
use crossfall::terrain::lidar::SensorPose;
use crossfall::terrain::map_files::{self, Choices};
use crossfall::terrain::mapper::{Mapper, Workshop};
use crossfall::terrain::picture::View;
use crossfall::terrain::raster::{Grid, SIDE};
use crossfall_core::terrain::TerrainConfig;
use tiff::decoder::{Decoder, DecodingResult};
use tiff::tags::Tag;

const LEVEL: [[f64; 3]; 3] = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];

fn pose(frame: u32) -> SensorPose {
    let along = 4.0 * f64::from(frame);
    SensorPose { rotation: LEVEL, position: [along, along, 2.0] }
}

/// Drives to the north-east at 57 m/s over a plane with a step of 20 cm, and keeps what is left behind in a folder.
fn drive<'a>(workshop: &'a mut Workshop, folder: &Path, frames: u32) -> Mapper<'a> {
    let mut mapper = workshop.open().unwrap();
    mapper.keep_in(folder).unwrap();
    let points: Vec<[f32; 4]> = (-30..30)
        .flat_map(|iy| (-30..30).map(move |ix| [0.1 * ix as f32 + 0.05, 0.1 * iy as f32 + 0.05]))
        .map(|[x, y]| [x, y, if y > 1.0 { -1.8 } else { -2.0 }, 0.0])
        .collect();
    for frame in 0..frames {
        let report = mapper.integrate(&points, &pose(frame), 100_000, &[]).unwrap();
        assert_eq!((report.refused, report.restarted), (None, false), "frame {frame}");
    }
    mapper.refresh();
    mapper
}

fn workshop() -> Workshop {
    let config = TerrainConfig {
        push_broom: true,
        nearest_m: 0.5,
        farthest_m: 10.0,
        ahead_m: 0.0,
        half_turn: 0.5,
        ..TerrainConfig::default()
    };
    Workshop::new(config, 16, 4000)
}

#[test]
fn a_long_diagonal_drive_is_written_in_little_memory_and_room_and_seen_from_end_to_end() {
    let folder = tempfile::tempdir().unwrap();
    let mut workshop = workshop();
    let frames = 250;
    let mapper = drive(&mut workshop, folder.path(), frames);
    let kept = mapper.kept();
    assert!(kept.tiles > 2_000 && kept.memory < 1 << 20 && kept.disk > 1 << 20, "{kept:?}");

    // 1 km each way: as one piece of memory 4 GB.
    let grid = Grid::of(&mapper).unwrap();
    assert!(Grid::check(&mapper).is_ok() && grid.width() > 10_000 && grid.height() > 10_000);
    assert!(grid.known_blocks() < 80, "{}", grid.known_blocks());
    let vehicle = pose(frames - 1);
    let choices = Choices { georeference: None, table: true, view: View::whole(&grid), vehicle };
    let mut blocks = 0;
    let cells = map_files::write(&mapper, &grid, folder.path(), &choices, |written| {
        assert_eq!(written, blocks);
        blocks += 1;
        Ok(())
    })
    .unwrap();
    assert_eq!(blocks as usize, grid.known_blocks());
    assert!(cells.known > 300_000 && cells.stop > 5_000, "{cells:?}");

    // What a reader finds: every cell of the table, in its place, and nothing in the corners where nothing was seen.
    let path = |name: &str| folder.path().join(name);
    let mut decoder = Decoder::new(File::open(path("elevation.tif")).unwrap()).unwrap();
    assert_eq!(decoder.dimensions().unwrap(), (grid.width() as u32, grid.height() as u32));
    assert_eq!(decoder.chunk_dimensions(), (SIDE as u32, SIDE as u32));
    let tie = decoder.get_tag_f64_vec(Tag::ModelTiepointTag).unwrap();
    // To the last digit, as a reader prints them.
    assert_eq!(decoder.get_tag_f64_vec(Tag::ModelPixelScaleTag).unwrap()[..2], [0.1, 0.1]);
    let [column, row] = grid.corner();
    assert_eq!([tie[3], tie[4]], [column as f64 / 10.0, (row + grid.height() as i64) as f64 / 10.0]);
    let across = grid.width().div_ceil(SIDE);
    let mut read = |chunk: usize| match decoder.read_chunk(chunk as u32).unwrap() {
        DecodingResult::F32(values) => values,
        _ => panic!("not floats"),
    };
    assert!(read(0).iter().all(|value| *value == map_files::NO_DATA));
    let mut held: Option<(usize, Vec<f32>)> = None;
    let mut rows = 0;
    for record in csv::Reader::from_path(path("cells.csv")).unwrap().records() {
        let record = record.unwrap();
        let number = |field: usize| record[field].parse::<f64>().unwrap();
        let column = ((number(0) - tie[3]) / grid.cell_m) as usize;
        let row = ((tie[4] - number(1)) / grid.cell_m) as usize;
        let chunk = row / SIDE * across + column / SIDE;
        if held.as_ref().is_none_or(|(at, _)| *at != chunk) {
            held = Some((chunk, read(chunk)));
        }
        // Tiles at the eastern and southern rim come without what lies beyond it.
        let width = SIDE.min(grid.width() - column / SIDE * SIDE);
        let value = held.as_ref().unwrap().1[row % SIDE * width + column % SIDE];
        assert!((f64::from(value) - number(2)).abs() < 1e-4, "{record:?}: {value}");
        rows += 1;
    }
    assert_eq!(rows, cells.known);
    for name in ["elevation.tif", "sigma.tif", "risk.tif", "class.tif"] {
        assert!(fs::metadata(path(name)).unwrap().len() < 4 << 20, "{name}");
    }

    // The picture shows all of it: both ends are there, each pixel the worst of its cells.
    let reader = png::Decoder::new(std::io::BufReader::new(File::open(path("risk.png")).unwrap()));
    let mut reader = reader.read_info().unwrap();
    let mut pixels = vec![0; reader.output_buffer_size().unwrap()];
    let info = reader.next_frame(&mut pixels).unwrap();
    let (width, height) = (info.width as usize, info.height as usize);
    assert!(width <= 4000 && height <= 4000 && width > 3000, "{width} x {height}");
    let drawn = |from: [usize; 2]| {
        (from[1]..from[1] + 20).any(|y| (from[0]..from[0] + 20).any(|x| pixels[3 * (y * width + x)..][..3] != [255; 3]))
    };
    assert!(drawn([0, height - 20]), "the drive's beginning");
    assert!(drawn([width - 20, 0]), "the drive's end");
    assert!(!drawn([0, 0]) && !drawn([width - 20, height - 20]), "where nobody was");
}

#[test]
fn what_is_read_back_from_the_disk_is_what_the_window_left() {
    let folder = tempfile::tempdir().unwrap();
    let mut workshop = workshop();
    let on_disk = drive(&mut workshop, folder.path(), 40);
    // A cell of the first frames is still known, and is the step that was mapped there.
    let place = pose(3).position;
    assert!(on_disk.cell_at(place[0], place[1]).is_none(), "the window has gone on");
    let cell = on_disk.kept_cell_at(place[0], place[1]).unwrap().unwrap();
    assert!((on_disk.elevation_m(cell.height.unwrap())).abs() < 0.01 && cell.risk == 0, "{cell:?}");
    let edge = on_disk.kept_cell_at(place[0], place[1] + 1.05).unwrap().unwrap();
    assert!((on_disk.elevation_m(edge.height.unwrap()) - 0.2).abs() < 0.01 && edge.risk > 250, "{edge:?}");
    assert_eq!(on_disk.kept_cell_at(place[0] - 500.0, place[1]).unwrap(), None);
}

#[test]
fn a_geotiff_of_either_size_of_offsets_gives_its_tiles_back_and_nothing_elsewhere() {
    let folder = tempfile::tempdir().unwrap();
    for (name, most) in [("small.tif", 2), ("big.tif", u64::MAX)] {
        for tiles in [1u32, 3] {
            let layout = Layout {
                width: 16 * tiles,
                height: 16,
                tile: 16,
                pixel: Pixel::Byte,
                no_data: (vec![255], "255"),
                north_west: [500_000.25, 4_600_000.5],
                pixel_m: 0.25,
                epsg: 32_618,
            };
            let path = folder.path().join(name);
            let mut file = GeoTiff::create(&path, layout, most).unwrap();
            let last = tiles - 1;
            file.put([last, 0], &(0..=255).collect::<Vec<u8>>()).unwrap();
            file.finish().unwrap();
            assert_eq!(fs::read(&path).unwrap()[2], if most == 2 { 42 } else { 43 });
            let mut decoder = Decoder::new(File::open(&path).unwrap()).unwrap();
            let DecodingResult::U8(values) = decoder.read_chunk(last).unwrap() else { panic!("not bytes") };
            assert_eq!(values, (0..=255).collect::<Vec<u8>>());
            if tiles > 1 {
                let DecodingResult::U8(values) = decoder.read_chunk(0).unwrap() else { panic!("not bytes") };
                assert_eq!(values, [255; 256]);
            }
            assert_eq!(
                decoder.get_tag_f64_vec(Tag::ModelTiepointTag).unwrap(),
                [0.0, 0.0, 0.0, 500_000.25, 4_600_000.5, 0.0]
            );
            let keys = decoder.get_tag_u32_vec(Tag::GeoKeyDirectoryTag).unwrap();
            assert!(keys.chunks(4).any(|key| key[0] == 3072 && key[3] == 32_618), "{keys:?}");
            assert_eq!(decoder.get_tag_ascii_string(Tag::GdalNodata).unwrap(), "255");
        }
    }
}
