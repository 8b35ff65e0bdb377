//! PCD, LAS and Velodyne sources, by bytes written here as their formats' documents say; trajectories; and what is said of bad ones.

use std::fs;
use std::path::{Path, PathBuf};

use crossfall::terrain::frames::{Choices, Error, FrameFolder};
use crossfall::terrain::source::Source;
use crossfall::terrain::turns::Turns;
use crossfall::terrain::velodyne::{Model, PACKET, Refusal, decode};

const IDENTITY: &str = "1 0 0 0 0 1 0 0 0 0 1 0\n";

fn points(folder: &Path, choices: &Choices, index: usize) -> Result<Vec<[f32; 4]>, Error> {
    let mut points = Vec::new();
    FrameFolder::open(folder, choices)?.points(index, &mut points)?;
    Ok(points)
}

fn folder(files: &[(&str, Vec<u8>)], poses: &str) -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    for (name, bytes) in files {
        fs::write(folder.path().join(name), bytes).unwrap();
    }
    fs::write(folder.path().join("poses.txt"), poses).unwrap();
    folder
}

fn pcd_header(points: usize, data: &str) -> Vec<u8> {
    format!(
        "# .PCD v0.7 - Point Cloud Data file format\nVERSION 0.7\nFIELDS ring x y z intensity\nSIZE 2 4 4 8 1\nTYPE U F F F U\n\
         COUNT 1 1 1 1 1\nWIDTH {points}\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS {points}\nDATA {data}\n"
    )
    .into_bytes()
}

const CLOUD: [(u16, f32, f32, f64, u8); 3] =
    [(7, 5.5, -1.25, -1.9, 200), (8, f32::NAN, 0.0, 0.0, 0), (9, 6.0, 2.0, 0.5, 1)];

fn pcd_binary() -> Vec<u8> {
    let mut file = pcd_header(3, "binary");
    for (ring, x, y, z, intensity) in CLOUD {
        file.extend(ring.to_le_bytes());
        file.extend(x.to_le_bytes());
        file.extend(y.to_le_bytes());
        file.extend(z.to_le_bytes());
        file.push(intensity);
    }
    file
}

fn pcd_compressed() -> Vec<u8> {
    let mut planes = Vec::new();
    planes.extend(CLOUD.iter().flat_map(|p| p.0.to_le_bytes()));
    planes.extend(CLOUD.iter().flat_map(|p| p.1.to_le_bytes()));
    planes.extend(CLOUD.iter().flat_map(|p| p.2.to_le_bytes()));
    planes.extend(CLOUD.iter().flat_map(|p| p.3.to_le_bytes()));
    planes.extend(CLOUD.iter().map(|p| p.4));
    // LZF of literals alone, 32 at a time: a control byte of their number less one before each run.
    let packed: Vec<u8> =
        planes.chunks(32).flat_map(|run| std::iter::once(run.len() as u8 - 1).chain(run.iter().copied())).collect();
    let mut file = pcd_header(3, "binary_compressed");
    file.extend((packed.len() as u32).to_le_bytes());
    file.extend((planes.len() as u32).to_le_bytes());
    file.extend(packed);
    file
}

fn pcd_ascii() -> Vec<u8> {
    let mut file = pcd_header(3, "ascii");
    for (ring, x, y, z, intensity) in CLOUD {
        file.extend(format!("{ring} {x} {y} {z} {intensity}\n").replace("NaN", "nan").into_bytes());
    }
    file
}

#[test]
fn a_pcd_sequence_gives_the_same_points_in_all_three_forms() {
    let folder = folder(
        // In the order of their numbers, which is not that of their names.
        &[("2.pcd", pcd_binary()), ("10.pcd", pcd_compressed()), ("9.pcd", pcd_ascii())],
        &IDENTITY.repeat(3),
    );
    let frames = FrameFolder::open(folder.path(), &Choices::default()).unwrap();
    assert_eq!((frames.len(), frames.largest().unwrap()), (3, 3));
    assert!(frames.file(2).unwrap().ends_with("10.pcd"));
    for index in 0..3 {
        let points = points(folder.path(), &Choices::default(), index).unwrap();
        assert_eq!((points[0], points[2]), ([5.5, -1.25, -1.9, 200.0], [6.0, 2.0, 0.5, 1.0]), "frame {index}");
        assert!(points[1][0].is_nan() && points.len() == 3);
    }
}

#[test]
fn a_bad_pcd_file_is_an_error_of_its_frame_that_says_where() {
    let complaint = |bytes: Vec<u8>| {
        let folder = folder(&[("a.pcd", bytes)], IDENTITY);
        points(folder.path(), &Choices::default(), 0).unwrap_err().to_string()
    };
    let cut = |mut bytes: Vec<u8>, less: usize| {
        bytes.truncate(bytes.len() - less);
        bytes
    };
    assert!(complaint(b"ply\nformat ascii 1.0\n".to_vec()).contains("no key of a PCD header"));
    assert!(complaint(Vec::new()).contains("no line DATA"));
    assert!(complaint(cut(pcd_binary(), 1)).contains("ends after 56 of 57 bytes"));
    assert!(complaint(cut(pcd_compressed(), 1)).contains("compressed bytes"));
    assert!(complaint(cut(pcd_ascii(), 3)).contains("expected 5"));
    assert!(complaint(pcd_header(2, "ascii")).contains("after 0 of 2 points"));
    assert!(complaint(pcd_header(2, "binary_lz4")).contains("'binary_lz4'"));
    assert!(complaint(pcd_header(1 << 40, "binary")).contains("POINTS"));
    let mut damaged = pcd_compressed();
    // The first control byte, behind the header and the two sizes: now a copy of what is not there yet.
    let first = pcd_header(3, "binary_compressed").len() + 8;
    damaged[first] = 0xFF;
    assert!(complaint(damaged).contains(&format!("byte {first}: the compressed data is damaged")));
    let no_z = String::from_utf8(pcd_header(0, "ascii")).unwrap().replace("y z", "y w");
    assert!(complaint(no_z.into_bytes()).contains("x, y and z"));
}

#[test]
fn what_a_small_file_tells_is_not_believed_before_it_is_held_against_its_size() {
    // A field of no values; 143 bytes that tell of four gigabytes; a compression that LZF cannot reach.
    let lines = String::from_utf8(pcd_header(2, "ascii")).unwrap().replace("COUNT 1 1 1 1 1", "COUNT 1 1 1 0 1");
    let complaint = |name: &str, bytes: &[u8]| {
        let folder = folder(&[(name, bytes.to_vec())], IDENTITY);
        points(folder.path(), &Choices::default(), 0).unwrap_err().to_string()
    };
    assert!(complaint("0.pcd", format!("{lines}1 2 3 4\n5 6 7 8\n").as_bytes()).contains("field z: 0 values"));
    let header = String::from_utf8(pcd_header(4_194_304, "binary_compressed")).unwrap();
    let wide = header.replace("COUNT 1 1 1 1 1", "COUNT 501 1 1 1 1");
    for (header, unpacked) in [(&header, 4_194_304u32 * 19), (&wide, 4_194_304 * 1019)] {
        let sizes = [4u32.to_le_bytes(), unpacked.to_le_bytes(), [0, 7, 0, 7]].concat();
        let told = complaint("0.pcd", &[header.as_bytes(), &sizes].concat());
        assert!(told.contains("4 compressed bytes cannot be"), "{told}");
    }

    let place = tempfile::tempdir().unwrap();
    let [las, laz] = ["a.las", "a.laz"].map(|name| {
        las_file(&place.path().join(name), &[[500_000.0, 4_500_000.0, 1.0]]);
        fs::read(place.path().join(name)).unwrap()
    });
    let with = |bytes: &[u8], at: usize, value: &[u8]| {
        let mut bytes = bytes.to_vec();
        bytes[at..at + value.len()].copy_from_slice(value);
        bytes
    };
    // Records of 65,535 bytes; 65,536 points; an extended record that reaches to the end of all files.
    assert!(complaint("0.las", &with(&las, 105, &[0xFF; 2])).contains("ends before 1 points of 65535 bytes"));
    assert!(complaint("0.las", &with(&las, 247, &[0, 0, 1])).contains("ends before 65536 points"));
    // More than fit into 64 bits once they are multiplied by their length.
    for (name, bytes) in [("0.las", &las), ("0.laz", &laz)] {
        let told = complaint(name, &with(bytes, 247, &[0xFF; 8]));
        assert!(told.contains("18446744073709551615 points are more than any frame has"), "{told}");
    }
    let record = [[0; 20].as_slice(), &[0xFF; 8], &[0; 32]].concat();
    let mut extended = with(&with(&las, 235, &(las.len() as u64).to_le_bytes()), 243, &[1]);
    extended.extend(record);
    assert!(complaint("0.las", &extended).contains("extended record"), "{}", complaint("0.las", &extended));
    let first = u32::from_le_bytes(laz[96..100].try_into().unwrap()) as usize;
    let table = u64::from_le_bytes(laz[first..first + 8].try_into().unwrap()) as usize;
    let told = complaint("0.laz", &with(&laz, table + 4, &[0xFF; 4]));
    assert!(told.contains("4294967295 chunks do not fit"), "{told}");
}

#[test]
fn a_damaged_laz_frame_is_told_whatever_its_library_does() {
    let place = tempfile::tempdir().unwrap();
    let places: Vec<_> =
        (0..400u32).map(|index| [500_000.0 + f64::from(index.pow(2) % 977), 4_500_000.0, 1.0]).collect();
    let mut random = 1u64;
    let mut below = |bound: usize| {
        random = random.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
        (random >> 33) as usize % bound
    };
    // Packed point by point, and in layers.
    for format in [0, 6] {
        las_file_as(&place.path().join("a.laz"), &places, format, 0);
        let sound = fs::read(place.path().join("a.laz")).unwrap();
        let first = first_chunk(&sound) - 8;
        for _ in 0..300 {
            let mut bytes = sound.clone();
            bytes[first + below(sound.len() - first)] ^= 1 << below(8);
            let folder = folder(&[("0.laz", bytes)], IDENTITY);
            if let Ok(frame) = points(folder.path(), &Choices::default(), 0) {
                assert_eq!(frame.len(), 400);
            }
        }
    }
}

fn las_file(path: &Path, places: &[[f64; 3]]) {
    las_file_as(path, places, 0, 0);
}

fn las_file_as(path: &Path, places: &[[f64; 3]], format: u8, extra_bytes: u16) {
    let mut builder = las::Builder::from((1, 4));
    builder.point_format = las::point::Format { extra_bytes, ..las::point::Format::new(format).unwrap() };
    let axis = |offset: f64| las::Transform { scale: 0.001, offset };
    builder.transforms = las::Vector { x: axis(500_000.0), y: axis(4_500_000.0), z: axis(0.0) };
    let mut writer = las::Writer::from_path(path, builder.into_header().unwrap()).unwrap();
    let has = las::point::Format::new(format).unwrap();
    for [x, y, z] in places {
        let point = las::Point {
            x: *x,
            y: *y,
            z: *z,
            gps_time: has.has_gps_time.then_some(1.0),
            color: has.has_color.then(las::Color::default),
            nir: has.has_nir.then_some(0),
            waveform: has.has_waveform.then(las::raw::point::Waveform::default),
            extra_bytes: vec![0; extra_bytes.into()],
            ..Default::default()
        };
        writer.write_point(point).unwrap();
    }
    writer.close().unwrap();
}

/// Where the first chunk of LAZ begins.
fn first_chunk(laz: &[u8]) -> usize {
    u32::from_le_bytes(laz[96..100].try_into().unwrap()) as usize + 8
}

#[test]
fn layers_of_laz_that_their_file_does_not_hold_are_refused_before_room_is_made_for_them() {
    let place = tempfile::tempdir().unwrap();
    let path = place.path().join("a.laz");
    let places = |count: u32| -> Vec<_> {
        (0..count).map(|i| [500_000.0 + f64::from(i.wrapping_mul(i) % 977), 4_500_000.0, 1.0]).collect()
    };
    let frame = |bytes: &[u8]| {
        let folder = folder(&[("0.laz", bytes.to_vec())], IDENTITY);
        points(folder.path(), &Choices::default(), 0)
    };
    let refused = |mut bytes: Vec<u8>, at: usize, value: u32, why: &str| {
        bytes[at..at + 4].copy_from_slice(&value.to_le_bytes());
        let told = frame(&bytes).unwrap_err().to_string();
        assert!(told.contains(why), "{at}: {told}");
    };
    // Bytes of a point and layers of each format that has any; the second with extra bytes as well.
    for (format, extra, point, layers) in
        [(6, 0, 30, 9), (6, 3, 33, 12), (7, 0, 36, 10), (8, 0, 38, 11), (9, 0, 59, 10)]
    {
        las_file_as(&path, &places(400), format, extra);
        let sound = fs::read(&path).unwrap();
        assert_eq!(frame(&sound).unwrap().len(), 400, "format {format}");
        let count = first_chunk(&sound) + point;
        for layer in 1..=layers {
            refused(sound.clone(), count + 4 * layer, u32::MAX, "a chunk with layers of 4294");
        }
        refused(sound.clone(), count, 0, "a chunk without points");
        refused(sound.clone(), count, 399, "");
    }
    // The second of two chunks: behind the layers of the first.
    las_file_as(&path, &places(50_001), 6, 0);
    let sound = fs::read(&path).unwrap();
    assert_eq!(frame(&sound).unwrap().len(), 50_001);
    let lengths = first_chunk(&sound) + 34;
    let layers = sound[lengths..lengths + 36].chunks(4).map(|n| u32::from_le_bytes(n.try_into().unwrap()) as usize);
    let second = lengths + 36 + layers.sum::<usize>();
    assert_eq!(sound[second + 30..second + 34], [1, 0, 0, 0], "one point");
    refused(sound.clone(), second + 34, 0x1000_0000, "a chunk with layers of 268435");
    // Without the first chunk's number of points, nothing behind it is known to be one, and nothing behind it is read.
    refused(sound.clone(), lengths - 4, 50_001, "");
}

#[test]
fn las_and_laz_frames_of_the_world_come_back_into_the_sensors_axes() {
    let turned = "0 -1 0 500100 1 0 0 4500200 0 0 1 102\n";
    let folder = folder(&[], &turned.repeat(2));
    // Five metres ahead of a sensor that looks north, one to its left, at ground two metres below.
    let place = [[500_099.0, 4_500_205.0, 100.0]];
    las_file(&folder.path().join("scan_a.las"), &place);
    las_file(&folder.path().join("scan_b.laz"), &place);
    let choices = Choices { world_points: true, ..Choices::default() };
    for index in 0..2 {
        let points = points(folder.path(), &choices, index).unwrap();
        assert_eq!(points.len(), 1);
        for (got, wanted) in points[0].iter().zip([5.0, 1.0, -2.0]) {
            assert!((got - wanted).abs() < 1e-3, "{points:?}");
        }
    }
    fs::write(folder.path().join("scan_b.laz"), b"LASF but no more").unwrap();
    let broken = points(folder.path(), &choices, 1).unwrap_err().to_string();
    assert!(broken.contains("scan_b.laz"), "{broken}");
}

#[test]
fn kitti_sequences_find_their_poses_two_folders_up() {
    let dataset = tempfile::tempdir().unwrap();
    let sequence = dataset.path().join("sequences/07");
    fs::create_dir_all(sequence.join("velodyne")).unwrap();
    fs::create_dir(dataset.path().join("poses")).unwrap();
    fs::write(sequence.join("velodyne/000000.bin"), [0u8; 16]).unwrap();
    fs::write(dataset.path().join("poses/07.txt"), "1 0 0 4 0 1 0 5 0 0 1 6\n").unwrap();
    let frames = FrameFolder::open(&sequence, &Choices::default()).unwrap();
    assert_eq!(frames.pose(0).unwrap().position, [4.0, 5.0, 6.0]);
}

#[test]
fn a_trajectory_is_interpolated_and_has_no_pose_outside_itself_or_in_a_hole() {
    let slam = "# seconds x y z qx qy qz qw\n\
                10.0 0 0 0 0 0 0 1\n10.2 2 0 0 0 0 0.0871557 0.9961947\n20.0 9 0 0 0 0 0 1\n";
    let folder = folder(&[], "");
    for index in 0..5 {
        fs::write(folder.path().join(format!("{index}.pcd")), pcd_binary()).unwrap();
    }
    fs::write(folder.path().join("times.txt"), "9.9\n10.0\n10.1\n15.0\n20.1\n").unwrap();
    fs::write(folder.path().join("poses.txt"), slam).unwrap();
    let frames = FrameFolder::open(folder.path(), &Choices::default()).unwrap();
    assert!([0, 3, 4].iter().all(|index| frames.pose(*index).is_none()));
    let pose = frames.pose(2).unwrap();
    assert!((pose.position[0] - 1.0).abs() < 1e-9);
    // Half of ten degrees.
    assert!((pose.rotation[1][0] - 5f64.to_radians().sin()).abs() < 1e-6, "{:?}", pose.rotation);
    fs::remove_file(folder.path().join("times.txt")).unwrap();
    let complaint = FrameFolder::open(folder.path(), &Choices::default()).unwrap_err().to_string();
    assert!(complaint.contains("needs times.txt"), "{complaint}");
    let reversed = "1 0 0 0 0 0 0 1\n0.5 0 0 0 0 0 0 1\n";
    fs::write(folder.path().join("poses.txt"), reversed).unwrap();
    let complaint = FrameFolder::open(folder.path(), &Choices::default()).unwrap_err().to_string();
    assert!(complaint.contains("line 2") && complaint.contains("does not follow"), "{complaint}");
}

/// A data packet: azimuth of its first block, hundredths of a degree from block to block, one distance for all returns.
fn packet(first: u32, step: u32, distance: u16, mode: u8, id: u8) -> Vec<u8> {
    let mut bytes = Vec::with_capacity(PACKET);
    for block in 0..12 {
        bytes.extend([0xFF, 0xEE]);
        bytes.extend((((first + block * step) % 36_000) as u16).to_le_bytes());
        for _ in 0..32 {
            bytes.extend(distance.to_le_bytes());
            bytes.push(51);
        }
    }
    bytes.extend([0, 0, 0, 0, mode, id]);
    bytes
}

#[test]
fn packets_become_points_at_the_azimuth_of_their_own_instant() {
    let mut all = Vec::new();
    let model = decode(&packet(0, 40, 5000, 0x37, 0x22), |seen| all.push(seen)).unwrap();
    assert_eq!((model, all.len()), (Model::Vlp16, 384));
    // Laser 0 of the first firing: 10 m, 15 degrees down, straight ahead, its exit 11.2 mm up.
    let [x, y, z, reflectivity] = all[0].point;
    assert!((x - 9.6593).abs() < 1e-3 && y.abs() < 1e-3 && (z + 2.5882 - 0.0112).abs() < 1e-3 && reflectivity == 0.2);
    // The second firing of a block is half a block's step on: 0.2 degrees to the right.
    assert!((all[16].azimuth_deg - 0.2).abs() < 1e-9 && all[16].point[1] < -0.03);
    assert!((all[383].after_us - (23.0 * 55.296 + 15.0 * 2.304)).abs() < 1e-6);

    let mut all = Vec::new();
    let model = decode(&packet(9_000, 17, 1000, 0x38, 0x21), |seen| all.push(seen)).unwrap();
    assert_eq!((model, all.len()), (Model::Hdl32, 384));
    let [x, y, z, _] = all[1].point;
    assert!(x.abs() < 0.01 && (y + 2.0 * 9.33f32.to_radians().cos()).abs() < 1e-3, "to the right: {x} {y}");
    assert!((z + 2.0 * 9.33f32.to_radians().sin()).abs() < 1e-3);

    // Dual returns: one of each pair. No echo: no point.
    let mut dual = 0;
    decode(&packet(0, 20, 1000, 0x39, 0x22), |_| dual += 1).unwrap();
    decode(&packet(0, 20, 0, 0x37, 0x22), |_| dual += 1000).unwrap();
    assert_eq!(dual, 192);
}

#[test]
fn what_is_no_packet_is_refused_by_its_reason() {
    let mut broken = packet(0, 40, 5000, 0x37, 0x22);
    assert_eq!(decode(&broken[1..], |_| ()), Err(Refusal::Size));
    assert_eq!(decode(&packet(0, 40, 1, 0x37, 0x28), |_| ()), Err(Refusal::Model(0x28)));
    broken[103] = 0xFF;
    assert_eq!(decode(&broken, |_| ()), Err(Refusal::Azimuth));
    broken[100] = 0;
    assert_eq!(decode(&broken, |_| ()), Err(Refusal::Flag));
}

/// UDP over IPv4 over Ethernet.
fn ethernet(payload: &[u8]) -> Vec<u8> {
    let mut frame = vec![0xFF; 6];
    frame.extend([0x60, 0x76, 0x88, 0, 0, 1, 0x08, 0x00]);
    let length = (20 + 8 + payload.len()) as u16;
    frame.extend([0x45, 0]);
    frame.extend(length.to_be_bytes());
    frame.extend([0, 0, 0x40, 0, 64, 17, 0, 0, 192, 168, 1, 201, 255, 255, 255, 255]);
    frame.extend(2368u16.to_be_bytes());
    frame.extend(2368u16.to_be_bytes());
    frame.extend((8 + payload.len() as u16).to_be_bytes());
    frame.extend([0, 0]);
    frame.extend(payload);
    frame
}

/// Packets of 12 blocks, 0.4 degrees apart, from azimuth 190 on; one every 1.327 ms.
fn packets(count: u32) -> Vec<(u64, Vec<u8>)> {
    (0..count)
        .map(|index| {
            let azimuth = (19_000 + index * 480) % 36_000;
            let time_us = 1_700_000_000_000_000 + u64::from(index) * 1327;
            (time_us, ethernet(&packet(azimuth, 40, 5000, 0x37, 0x22)))
        })
        .collect()
}

fn pcap(packets: &[(u64, Vec<u8>)]) -> Vec<u8> {
    let mut file = Vec::new();
    for word in [0xA1B2_C3D4u32, 0x0004_0002, 0, 0, 65_535, 1] {
        file.extend(word.to_le_bytes());
    }
    for (time_us, frame) in packets {
        for word in [(time_us / 1_000_000) as u32, (time_us % 1_000_000) as u32, frame.len() as u32, frame.len() as u32]
        {
            file.extend(word.to_le_bytes());
        }
        file.extend(frame);
    }
    file
}

fn pcapng(packets: &[(u64, Vec<u8>)]) -> Vec<u8> {
    let mut file = Vec::new();
    let mut block = |kind: u32, body: &[u8]| {
        let length = 12 + body.len() as u32;
        file.extend(kind.to_le_bytes());
        file.extend(length.to_le_bytes());
        file.extend(body);
        file.extend(length.to_le_bytes());
    };
    let words = |words: &[u32]| words.iter().flat_map(|word| word.to_le_bytes()).collect::<Vec<u8>>();
    block(0x0A0D_0D0A, &words(&[0x1A2B_3C4D, 1, u32::MAX, u32::MAX]));
    block(1, &words(&[1, 65_535]));
    for (time_us, frame) in packets {
        let size = frame.len() as u32;
        let mut body = words(&[0, (time_us >> 32) as u32, *time_us as u32, size, size]);
        body.extend(frame);
        body.resize(body.len().next_multiple_of(4), 0);
        block(6, &body);
    }
    file
}

fn capture(name: &str, bytes: &[u8], poses: &str) -> (tempfile::TempDir, PathBuf, PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let (file, poses_file) = (folder.path().join(name), folder.path().join("poses.txt"));
    fs::write(&file, bytes).unwrap();
    fs::write(&poses_file, poses).unwrap();
    (folder, file, poses_file)
}

#[test]
fn captures_of_either_form_give_the_same_turns() {
    // 4.8 degrees a packet: 75 a turn. From 190 degrees on: the first turn is nearly complete, the third is not.
    let packets = packets(160);
    let mut found = Vec::new();
    for (name, bytes) in [("a.pcap", pcap(&packets)), ("b.pcapng", pcapng(&packets))] {
        let (_folder, file, poses) = capture(name, &bytes, &IDENTITY.repeat(2));
        let turns = Turns::open(&file, &poses).unwrap();
        assert_eq!((turns.count(), turns.passed().packets, turns.passed().incomplete), (2, 160, 1), "{name}");
        // From 190 to 360 degrees are 35.4 packets.
        let ahead = turns.time_s(0).unwrap() - 1_700_000_000.0;
        assert!((ahead - 35.4 * 1.327e-3).abs() < 1.4e-3, "{ahead}");
        assert!(turns.step_us(1).abs_diff(75 * 1327) < 1500);
        let mut points = Vec::new();
        turns.points(1, &mut points).unwrap();
        assert!(points.len().abs_diff(75 * 384) < 32, "{}", points.len());
        let second = points.clone();
        turns.points(0, &mut points).unwrap();
        assert!(points.len() > 72 * 384);
        found.push((points, second));
    }
    assert!(found[0] == found[1]);
}

#[test]
fn damage_in_a_capture_is_counted_and_costs_only_itself() {
    let mut spoilt = packets(160);
    spoilt.insert(80, (spoilt[80].0, ethernet(b"position packets are 512 bytes")));
    let broken = spoilt[90].1.len();
    spoilt[90].1[broken - 1] = 0x99;
    let mut bytes = pcap(&spoilt);
    bytes.truncate(bytes.len() - 100);
    let (_folder, file, poses) = capture("a.pcap", &bytes, &IDENTITY.repeat(2));
    let passed = Turns::open(&file, &poses).unwrap().passed();
    assert_eq!((passed.packets, passed.refused, passed.other, passed.cut), (158, 1, 1, true));

    let complaint = |bytes: &[u8], poses: &str| {
        let (_folder, file, poses) = capture("a.pcap", bytes, poses);
        Turns::open(&file, &poses).err().unwrap().to_string()
    };
    assert!(complaint(&pcap(&packets(160)), IDENTITY).contains("1 poses for 2 frames"));
    assert!(
        complaint(&pcap(&packets(160)), &IDENTITY.repeat(3)).contains("3 poses for 2 frames"),
        "whose is the third?"
    );
    assert!(complaint(&pcap(&packets(20)), IDENTITY).contains("no complete turn"));
    assert!(complaint(b"not a capture at all, not even nearly", IDENTITY).contains("no capture"));
    assert!(complaint(b"", IDENTITY).contains("no capture"));
}

#[test]
fn a_source_of_turns_gives_frames_with_poses_in_the_captures_time() {
    let slam = "1699999999.5 0 0 1.9 0 0 0 1\n1700000000.4 9 0 1.9 0 0 0 1\n1700000001.3 9 0 1.9 0 0 0 1\n";
    let (_folder, file, poses) = capture("a.pcap", &pcap(&packets(160)), slam);
    let mut source = Source::open(&file, &Choices { poses: Some(poses), world_points: false }).unwrap();
    let mut points = Vec::new();
    let (index, frame) = source.next(&mut points).unwrap();
    let frame = frame.unwrap();
    // 0.5 s + 47 ms at 10 m/s.
    assert!(index == 0 && (frame.pose.position[0] - 5.47).abs() < 0.02, "{:?}", frame.pose.position);
    assert!(points.len() > 10_000 && source.next(&mut points).unwrap().1.is_ok() && source.next(&mut points).is_none());
    assert!(source.losses().iter().any(|loss| loss.contains("1 turns left out")));
}
