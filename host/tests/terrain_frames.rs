//! Folders of frames: what is read, and what is said of folders that are wrong.

use std::fs;
use std::path::Path;

use crossfall::terrain::frames::{Choices, Error, FrameFolder};

const IDENTITY: &str = "1 0 0 0 0 1 0 0 0 0 1 0\n";

fn folder(frames: usize, poses: &str) -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    fs::create_dir(folder.path().join("velodyne")).unwrap();
    for index in 0..frames {
        let bytes: Vec<u8> =
            [5.0f32, 1.0, -1.9, 0.3, f32::NAN, 0.0, 0.0, 0.0].iter().flat_map(|v| v.to_le_bytes()).collect();
        fs::write(folder.path().join(format!("velodyne/{index:06}.bin")), bytes).unwrap();
    }
    fs::write(folder.path().join("poses.txt"), poses).unwrap();
    folder
}

fn complaint(folder: &Path) -> String {
    FrameFolder::open(folder, &Choices::default()).unwrap_err().to_string()
}

#[test]
fn a_sound_folder_gives_points_poses_times_and_boxes() {
    let folder = folder(2, &IDENTITY.repeat(2));
    fs::write(folder.path().join("times.txt"), "0.0\n0.25\n").unwrap();
    fs::write(folder.path().join("objects.csv"), "frame,x,y,z,length,width,height,yaw\n1,10,2,0.7,4.4,1.8,1.5,0.1\n")
        .unwrap();
    let frames = FrameFolder::open(folder.path(), &Choices::default()).unwrap();
    let mut points = Vec::new();
    frames.points(1, &mut points).unwrap();
    assert_eq!((frames.len(), points.len(), points[0]), (2, 2, [5.0, 1.0, -1.9, 0.3]));
    assert_eq!((frames.step_us(0), frames.step_us(1)), (0, 250_000));
    assert_eq!((frames.boxes(0).len(), frames.boxes(1).len()), (0, 1));
    assert_eq!(frames.boxes(1)[0].centre_um, [10_000_000, 2_000_000]);
}

#[test]
fn missing_and_malformed_files_are_named_with_line_and_expectation() {
    let empty = tempfile::tempdir().unwrap();
    assert!(complaint(empty.path()).contains("velodyne"));
    assert!(complaint(folder(0, "").path()).contains("no frames"));
    assert!(complaint(folder(3, &IDENTITY.repeat(2)).path()).contains("2 poses for 3 frames"));
    assert!(complaint(folder(1, "1 0 0 0 0 1 0 0 0 0 1\n").path()).contains("line 1: 11 numbers, expected 12"));
    assert!(
        complaint(folder(2, &format!("{IDENTITY}1 0 0 x 0 1 0 0 0 0 1 0\n")).path())
            .contains("line 2: 'x' is no number")
    );
    let gap = folder(3, &IDENTITY.repeat(3));
    fs::remove_file(gap.path().join("velodyne/000001.bin")).unwrap();
    assert!(complaint(gap.path()).contains("frame 1 is missing although 2 exists"));
    let times = folder(2, &IDENTITY.repeat(2));
    fs::write(times.path().join("times.txt"), "1.0\n0.5\n").unwrap();
    assert!(complaint(times.path()).contains("line 2: time 0.5"));
    let boxes = folder(1, IDENTITY);
    fs::write(boxes.path().join("objects.csv"), "frame,x\n0,1\n").unwrap();
    assert!(complaint(boxes.path()).contains("expected frame,x,y,z,length,width,height,yaw"));
    // Many boxes of one frame: the line is that of the row in the file.
    let mut rows = String::from("frame,x,y,z,length,width,height,yaw\n");
    rows.push_str(&"0,10,2,0.7,4.4,1.8,1.5,0.1\n".repeat(10));
    fs::write(boxes.path().join("objects.csv"), format!("{rows}0,10,2,0.7,-4.4,1.8,1.5,0.1\n")).unwrap();
    assert!(complaint(boxes.path()).contains("line 12: the box of frame 0 has no sensible size"));
    fs::write(boxes.path().join("objects.csv"), format!("{rows}0,10,x,0.7,4.4,1.8,1.5,0.1\n")).unwrap();
    assert!(complaint(boxes.path()).contains("line 12: expected frame"));
}

#[test]
fn a_frame_cut_in_the_middle_of_a_point_is_an_error_of_that_frame() {
    let cut = folder(2, &IDENTITY.repeat(2));
    fs::write(cut.path().join("velodyne/000001.bin"), [0u8; 40]).unwrap();
    let frames = FrameFolder::open(cut.path(), &Choices::default()).unwrap();
    let mut points = Vec::new();
    assert!(frames.points(0, &mut points).is_ok());
    assert!(matches!(frames.points(1, &mut points), Err(Error::Size { bytes: 40, .. })));
}

#[test]
fn camera_poses_are_carried_over_to_the_lidar_by_the_calibration() {
    // KITTI's axes: the camera looks along z, x right, y down. One metre ahead for the camera is one along the LiDAR's x.
    let kitti = folder(2, &format!("{IDENTITY}1 0 0 0 0 1 0 0 0 0 1 1\n"));
    fs::write(kitti.path().join("calib.txt"), "P0: 1\nTr: 0 -1 0 0.1 0 0 -1 -0.2 1 0 0 -0.3\n").unwrap();
    let frames = FrameFolder::open(kitti.path(), &Choices::default()).unwrap();
    let pose = frames.pose(1).unwrap();
    for (got, wanted) in pose.position.iter().zip([1.0, 0.0, 0.0]) {
        assert!((got - wanted).abs() < 1e-12, "{:?}", pose.position);
    }
    assert!(frames.remarks()[0].contains("taken to the LiDAR through"), "{:?}", frames.remarks());
    assert!(pose.rotation[0][0] > 0.999_999 && pose.rotation[2][2] > 0.999_999);
}

/// Frames 10 to 19 of 30, each with a pose of its own number.
#[test]
fn a_part_of_a_drive_has_the_poses_times_and_objects_of_its_numbers() {
    let pose = |number: usize| format!("1 0 0 {number} 0 1 0 0 0 0 1 0\n");
    let poses = |numbers: std::ops::Range<usize>| numbers.map(pose).collect::<String>();
    let part = folder(20, &poses(0..30));
    let at = part.path();
    for number in 0..10 {
        fs::remove_file(at.join(format!("velodyne/{number:06}.bin"))).unwrap();
    }
    let times: String = (0..30).map(|number: i32| format!("{}\n", number.pow(2))).collect();
    fs::write(at.join("times.txt"), times).unwrap();
    let boxes = "frame,x,y,z,length,width,height,yaw\n3,1,2,0.7,4.4,1.8,1.5,0\n13,10,2,0.7,4.4,1.8,1.5,0\n";
    fs::write(at.join("objects.csv"), boxes).unwrap();
    let open = || FrameFolder::open(at, &Choices::default()).unwrap();
    let frames = open();
    assert!(frames.file(3).unwrap().ends_with("000013.bin"));
    assert_eq!(frames.pose(3).unwrap().position, [13.0, 0.0, 0.0]);
    assert_eq!((frames.step_us(0), frames.step_us(3)), (0, 25_000_000));
    assert_eq!((frames.boxes(3).len(), frames.boxes(3)[0].centre_um[0]), (1, 10_000_000));
    let said = frames.remarks().join("\n");
    assert!(
        said.contains("30 poses for 10 frames: taken by the files' numbers; 10 before 000010.bin and 10 behind"),
        "{said}"
    );
    assert!(said.contains("30 times for 10 frames"), "{said}");
    // As many as frames: theirs.
    fs::write(at.join("poses.txt"), poses(100..110)).unwrap();
    assert_eq!(open().pose(3).unwrap().position, [103.0, 0.0, 0.0]);
    // Neither as many nor enough for the numbers.
    fs::write(at.join("poses.txt"), poses(0..15)).unwrap();
    assert!(complaint(at).contains("15 poses for 10 frames"));
    let whole = folder(2, &IDENTITY.repeat(2));
    assert!(FrameFolder::open(whole.path(), &Choices::default()).unwrap().remarks().is_empty());
    // No numbers.
    let named = folder(2, &IDENTITY.repeat(3));
    fs::rename(named.path().join("velodyne/000000.bin"), named.path().join("velodyne/a.bin")).unwrap();
    assert!(complaint(named.path()).contains("3 poses for 2 frames"));
}

#[test]
fn a_trajectory_is_the_lidars_whatever_calibration_lies_beside_it() {
    let slam = folder(2, "0 1 2 3 0 0 0 1\n0.1 2 2 3 0 0 0 1\n");
    fs::write(slam.path().join("times.txt"), "0\n0.1\n").unwrap();
    fs::write(slam.path().join("calib.txt"), "Tr: 0 -1 0 0.1 0 0 -1 -0.2 1 0 0 -0.3\n").unwrap();
    let frames = FrameFolder::open(slam.path(), &Choices::default()).unwrap();
    assert_eq!(frames.pose(1).unwrap().position, [2.0, 2.0, 3.0]);
    assert!(frames.remarks().is_empty());
}
