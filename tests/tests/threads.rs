//! One capture, one log: on every run, and however many threads are at work in the same process.

use std::path::Path;

use crossfall::simulate::scene::Scene;
use crossfall::{capture, log, run, verify};
use crossfall_core::protocol::Config;
use crossfall_tests::drives;

fn logged(capture_path: &Path, log_path: &Path) -> Vec<u8> {
    let mut log = log::Writer::create(log_path).expect("a log");
    let mut reader = capture::Reader::open(capture_path).expect("the capture");
    run::run(&mut reader, &Config::default(), &mut log, |_| ()).expect("a run");
    log.finish().expect("a whole log");
    std::fs::read(log_path).expect("the log")
}

#[test]
fn threads_do_not_show_in_the_log() {
    let folder = tempfile::tempdir().expect("a scratch folder");
    let capture_path = folder.path().join("drive.mcap");
    let mut scene = Scene::default();
    scene.drive.seconds = 4.0;
    drives::capture(&scene, &capture_path);
    let alone = logged(&capture_path, &folder.path().join("alone.mcap"));
    let together: Vec<Vec<u8>> = std::thread::scope(|scope| {
        let (capture_path, folder) = (&capture_path, folder.path());
        let runs: Vec<_> =
            (0..6).map(|i| scope.spawn(move || logged(capture_path, &folder.join(format!("{i}.mcap"))))).collect();
        runs.into_iter().map(|run| run.join().expect("a run")).collect()
    });
    assert!(together.iter().all(|log| *log == alone));
    let reports: Vec<_> = std::thread::scope(|scope| {
        let folder = folder.path();
        let verifies: Vec<_> =
            (0..4).map(|i| scope.spawn(move || verify::verify(&folder.join(format!("{i}.mcap")), |_| ()))).collect();
        verifies.into_iter().map(|verify| verify.join().expect("a thread").expect("a log")).collect()
    });
    assert!(reports.iter().all(|report| report.ok && report.frames == reports[0].frames));
}
