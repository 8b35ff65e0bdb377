//! What a scan costs on the board's core, and that board and host give the same bits.

use std::collections::BTreeMap;
use std::io;
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use crossfall::simulate::scene::Scene;
use crossfall::{capture, log, run, simulate};
use crossfall_core::protocol::Config;
use crossfall_tests::emulator::{Image, image};

/// Scans of each kind; ten thousand with `cargo xtask test --long`. `CROSSFALL_BENCH_SCANS` asks for another number.
const SCANS: (u32, u32) = (2_000, 10_000);

/// A kind of scans, of random sections.
struct Kind {
    name: &'static str,
    range_noise_mm: f64,
    vegetation: f64,
    strays: f64,
    /// Instructions that a scan may cost from ranges to intervals, both sides, in the mean and at worst: what is reached over 10,000 scans with a little
    /// room, so that a change for the worse shows. 26.64 ms at 168 MHz are 4.5 million. docs/performance.md has where they go.
    mean: u64,
    worst: u64,
}

const KINDS: [Kind; 2] = [
    Kind { name: "hard", range_noise_mm: 10.0, vegetation: 0.3, strays: 0.01, mean: 335_000, worst: 445_000 },
    Kind { name: "plain", range_noise_mm: 3.5, vegetation: 0.0, strays: 0.0, mean: 280_000, worst: 325_000 },
];

/// The bench may take this long for a scan, on a host that is busy with other things.
const PATIENCE_A_SCAN: Duration = Duration::from_millis(100);

/// A run of the simulated scans on this host, as the frames of its link.
fn host_run(folder: &Path, kind: &Kind, scans: u32) -> io::Result<()> {
    let mut scene = Scene::default();
    scene.drive.seconds = f64::from(scans) * 0.02664 + 0.01;
    scene.scanner.range_noise_mm = kind.range_noise_mm;
    scene.vegetation.share = kind.vegetation;
    scene.vegetation.stray_share = kind.strays;
    scene.sections.mode = simulate::scene::Mode::RandomPerScan;
    let (drive, result) = (folder.join("drive.mcap"), folder.join("drive.log.mcap"));
    let mut writer = capture::Writer::create(&drive).map_err(io::Error::other)?;
    simulate::simulate(&scene, &mut writer, |_| ()).map_err(io::Error::other)?;
    writer.finish().map_err(io::Error::other)?;
    let mut reader = capture::Reader::open(&drive).map_err(io::Error::other)?;
    let mut writer = log::Writer::create(&result).map_err(io::Error::other)?;
    run::run(&mut reader, &Config::default(), &mut writer, |_| ()).map_err(io::Error::other)?;
    writer.finish().map_err(io::Error::other)?;
    let mut wire = Vec::new();
    for frame in log::Reader::open(&result).map_err(io::Error::other)? {
        wire.extend(frame.map_err(io::Error::other)?.bytes);
    }
    std::fs::write(folder.join("bench.wire"), wire)
}

/// One run of the bench over `bench.wire`: what it prints.
fn bench(image: &Path, folder: &Path, scans: u32) -> String {
    let mut qemu = Command::new("qemu-system-arm")
        .args([
            "-M",
            "olimex-stm32-h405",
            "-display",
            "none",
            "-monitor",
            "none",
            "-serial",
            "null",
            "-icount",
            "shift=0",
        ])
        .args(["-semihosting-config", "enable=on,target=native", "-kernel"])
        .arg(image)
        .current_dir(folder)
        .stdin(Stdio::null())
        .stdout(Stdio::piped())
        .spawn()
        .expect("qemu-system-arm (tests/scripts/install-emulator.sh installs it)");
    let deadline = Instant::now() + PATIENCE_A_SCAN * scans;
    let status = loop {
        if let Some(status) = qemu.try_wait().expect("a child process") {
            break status;
        }
        if Instant::now() > deadline {
            let _ = qemu.kill();
            panic!("the bench is still running after {:?}", PATIENCE_A_SCAN * scans);
        }
        std::thread::sleep(Duration::from_millis(50));
    };
    let mut text = String::new();
    io::Read::read_to_string(&mut qemu.stdout.take().expect("piped"), &mut text).expect("text");
    assert!(status.success(), "{status}: {text}");
    text
}

#[test]
fn instructions_are_within_bounds_and_results_equal_to_the_hosts() {
    let usual = if std::env::var_os("CROSSFALL_LONG").is_some() { SCANS.1 } else { SCANS.0 };
    let scans =
        std::env::var("CROSSFALL_BENCH_SCANS").ok().map_or(usual, |text| text.parse().expect("a number of scans"));
    let image = image(Image::Bench);
    for kind in &KINDS {
        let scratch = tempfile::tempdir().expect("a scratch folder");
        host_run(scratch.path(), kind, scans).expect("a run on the host");
        let first = bench(&image, scratch.path(), scans);
        print!("{} scans\n{first}", kind.name);
        assert_eq!(first, bench(&image, scratch.path(), scans), "two runs differ");

        let lines: BTreeMap<&str, Vec<u64>> = first
            .lines()
            .filter_map(|line| line.split_once(' '))
            .map(|(name, numbers)| (name, numbers.split(' ').filter_map(|number| number.parse().ok()).collect()))
            .collect();
        assert_eq!(lines["wrong"], [0]);
        assert_eq!(lines["compared"], [u64::from(scans)]);
        let [count, mean, worst] = lines["survey"][..] else { panic!("no figures of the survey: {first}") };
        assert_eq!(count, u64::from(scans));
        assert!(mean <= kind.mean && worst <= kind.worst, "{mean} instructions a scan, {worst} at worst");
    }
}

#[test]
fn nothing_in_the_core_can_panic() {
    for proof in [Image::Proof, Image::ProofOfMap] {
        assert!(image(proof).is_file());
    }
}
