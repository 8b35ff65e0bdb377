//! Frames of the risk map in every form that they are read in, and the files beside them.
//!
//! The first byte of an input says which file it is; the others of its folder are sound.

use std::fs;
use std::path::Path;

use crossfall::terrain::frames::Choices;
use crossfall::terrain::source::Source;
use tempfile::TempDir;

/// The file that an input is, in the order of its first byte.
const FILES: [&str; 8] =
    ["0.pcd", "0.las", "0.laz", "a.pcap", "velodyne/0.bin", "poses.txt", "times.txt", "objects.csv"];
const LAST: usize = FILES.len() - 1;

const POSES: &str = "1 0 0 0 0 1 0 0 0 0 1 1.9\n1 0 0 1 0 1 0 0 0 0 1 1.9\n";
const TRAJECTORY: &str = "# seconds x y z qx qy qz qw\n0.0 0 0 0 0 0 0 1\n0.2 2 0 0 0 0 0.0871557 0.9961947\n";
const TIMES: &str = "0.0\n0.1\n";
const OBJECTS: &str = "frame,x,y,z,length,width,height,yaw\n0,10,2,0.7,4.4,1.8,1.5,0.1\n";

thread_local! {
    /// Folders for all inputs, in memory where the system has such a place.
    static FOLDER: TempDir = {
        let memory = Path::new("/dev/shm");
        let made = if memory.is_dir() { TempDir::new_in(memory) } else { TempDir::new() };
        let made = made.expect("a folder");
        for kind in 0..FILES.len() {
            prepare(&made.path().join(kind.to_string()), kind);
        }
        made
    };
}

/// What lies beside the file of a kind.
fn prepare(folder: &Path, kind: usize) {
    let write = |name: &str, bytes: &[u8]| fs::write(folder.join(name), bytes).expect("room in memory");
    fs::create_dir_all(folder.join("velodyne")).expect("a folder");
    // A capture and a folder of files are found by what they are, frames of the KITTI layout by their folder.
    if kind < 4 {
        fs::remove_dir(folder.join("velodyne")).expect("an empty folder");
    } else {
        let point = [5.0f32, 1.0, -1.9, 0.3].map(f32::to_le_bytes);
        write("velodyne/0.bin", point.as_flattened());
    }
    write("poses.txt", POSES.as_bytes());
    if kind >= 4 {
        write("times.txt", TIMES.as_bytes());
    }
}

/// The LAZ library panics on damage, which the reader contains, but libFuzzer ends at any panic: only the suite's mutations try it.
fn is_laz(kind: usize, bytes: &[u8]) -> bool {
    FILES[kind].ends_with("laz")
        || FILES[kind].ends_with("las") && bytes.get(104).is_some_and(|format| format & 0xC0 != 0)
}

/// Whatever the file holds: opening and reading it ends, with no more points than a frame may have.
pub fn frames(input: &[u8]) {
    let Some((kind, bytes)) = input.split_first() else { return };
    let kind = usize::from(*kind).min(LAST);
    if cfg!(fuzzing) && is_laz(kind, bytes) {
        return;
    }
    FOLDER.with(|folder| {
        let folder = folder.path().join(kind.to_string());
        let file = folder.join(FILES[kind]);
        fs::write(&file, bytes).expect("room in memory");
        let path = if FILES[kind].ends_with(".pcap") { &file } else { &folder };
        let Ok(mut source) = Source::open(path, &Choices::default()) else { return };
        let most = source.largest().unwrap_or(0);
        let mut points = Vec::new();
        while let Some((_, frame)) = source.next(&mut points) {
            assert!(frame.is_err() || points.len() <= most.max(4 << 20), "{} points", points.len());
        }
        let _ = source.losses();
    });
}

/// One sound file of each kind, or more.
pub(super) fn corpus(scratch: &Path) -> Vec<Vec<u8>> {
    let [las, laz] = ["f.las", "f.laz"].map(|name| las_file(&scratch.join(name)));
    let bin = [[5.0f32, 1.0, -1.9, 0.3], [f32::NAN; 4]].concat().into_iter().flat_map(f32::to_le_bytes).collect();
    let all = [
        (0, pcd("ascii", b"1 2 3 4\n5 6 nan 7\n")),
        (0, pcd("binary", &[7; 32])),
        // 32 bytes: eight literals, and 24 that lie eight back.
        (0, pcd("binary_compressed", &[12, 0, 0, 0, 32, 0, 0, 0, 7, 1, 2, 3, 4, 5, 6, 7, 8, 0xE0, 15, 7])),
        (1, las),
        (2, laz),
        (3, pcap(160)),
        (4, bin),
        (5, POSES.into()),
        (5, TRAJECTORY.into()),
        (6, TIMES.into()),
        (7, OBJECTS.into()),
    ];
    all.into_iter().map(|(kind, bytes): (u8, Vec<u8>)| [vec![kind], bytes].concat()).collect()
}

fn pcd(form: &str, data: &[u8]) -> Vec<u8> {
    let header = "VERSION 0.7\nFIELDS x y z intensity\nSIZE 4 4 4 4\nTYPE F F F F\nCOUNT 1 1 1 1\nWIDTH 2\nHEIGHT 1\n\
                  VIEWPOINT 0 0 0 1 0 0 0\nPOINTS 2\nDATA ";
    [header.as_bytes(), form.as_bytes(), b"\n", data].concat()
}

fn las_file(path: &Path) -> Vec<u8> {
    let header = las::Builder::from((1, 4)).into_header().expect("a header");
    let mut writer = las::Writer::from_path(path, header).expect("a file");
    for place in 0..40 {
        let x = f64::from(place) * 0.1;
        writer.write_point(las::Point { x, y: -x, z: 1.0, intensity: 7, ..Default::default() }).expect("a point");
    }
    writer.close().expect("the file's end");
    fs::read(path).expect("the file")
}

/// A VLP-16's packets of 4.8 degrees each in UDP over IPv4 over Ethernet.
fn pcap(packets: u32) -> Vec<u8> {
    let mut file: Vec<u8> =
        [0xA1B2_C3D4u32, 0x0004_0002, 0, 0, 65_535, 1].into_iter().flat_map(u32::to_le_bytes).collect();
    for packet in 0..packets {
        let mut data = Vec::new();
        for block in 0..12 {
            let azimuth = ((19_000 + packet * 480 + block * 40) % 36_000) as u16;
            data.extend([0xFF, 0xEE]);
            data.extend(azimuth.to_le_bytes());
            data.extend([0x88, 0x13, 51].repeat(32));
        }
        data.extend([0, 0, 0, 0, 0x37, 0x22]);
        let udp = 8 + data.len() as u16;
        let mut frame = vec![0xFF; 12];
        frame.extend([0x08, 0x00, 0x45, 0]);
        frame.extend((20 + udp).to_be_bytes());
        frame.extend([0, 0, 0x40, 0, 64, 17, 0, 0, 192, 168, 1, 201, 255, 255, 255, 255]);
        frame.extend([2368u16, 2368, udp, 0].into_iter().flat_map(u16::to_be_bytes));
        frame.extend(data);
        let size = frame.len() as u32;
        file.extend([1_700_000_000, packet * 1327, size, size].into_iter().flat_map(u32::to_le_bytes));
        file.extend(frame);
    }
    file
}
