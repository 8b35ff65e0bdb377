//! Blocks that a disk has written twice, or in each other's place.

use super::*;

/// A log of frames as far apart as makes a chunk of some, or of all but some, of the blocks.
fn written(folder: &Folder, count: u64, every_ns: u64) -> (Vec<Vec<u8>>, Vec<u8>) {
    let sent = frames(count);
    let path = folder.path(&format!("{count} of {every_ns}.mcap"));
    let mut log = log::Writer::create_live(&path).unwrap();
    for (i, frame) in sent.iter().enumerate() {
        log.frame(T + i as u64 * every_ns, frame).unwrap();
    }
    log.finish().unwrap();
    let whole = fs::read(&path).unwrap();
    (sent, whole)
}

/// Which frames have their records whole in a file.
fn whole_records(file: &[u8], intact: &[u8], sent: &[Vec<u8>]) -> Vec<bool> {
    let mut at = 0;
    let mut records = sent.iter().map(|frame| {
        at += place(&intact[at..], frame);
        &intact[at - 31..at + frame.len()]
    });
    // Frames are all different, and so are the records.
    let mut found = std::collections::HashSet::new();
    for start in 0..file.len() {
        for length in 41..=48 {
            found.extend(file.get(start..start + length).filter(|record| record[0] == 5 && record[length - 1] == 0));
        }
    }
    records.by_ref().map(|record| found.contains(record)).collect()
}

/// What recovery makes of a file: every frame whose record is whole, in its order, once; what is missing by its number; no restart.
fn check(folder: &Folder, file: &[u8], intact: &[u8], sent: &[Vec<u8>], what: &str) -> Report {
    fs::write(folder.path("a.mcap"), file).unwrap();
    let report = folder.recover("a.mcap");
    let out: Vec<_> = read(&folder.path("out.mcap")).into_iter().filter(|frame| log_frame(frame)).collect();
    let numbers: Vec<_> = out.iter().map(|frame| sent.iter().position(|one| one == frame)).collect();
    let back = numbers.windows(2).find(|pair| pair[0] >= pair[1]);
    assert_eq!(back, None, "{what}: out of order, or twice: {report:?}");
    for (frame, _) in sent.iter().zip(whole_records(file, intact, sent)).filter(|(_, whole)| *whole) {
        assert!(out.contains(frame), "{what}: a whole frame is lost: {report:?}");
    }
    assert_eq!((report.restarts, report.unknown_gaps), (0, 0), "{what}: {report:?}");
    let behind = sent.iter().rev().position(|frame| Some(frame) == out.last()).unwrap();
    let before = sent.iter().position(|frame| Some(frame) == out.first()).unwrap();
    // Broken frames that none follows are lost by no number.
    let missing = (sent.len() - behind - before - out.len()) as u64;
    assert!((missing..=missing + report.bad_frames).contains(&report.frames_lost), "{what}: {missing}, {report:?}");
    let verified = verify(&folder.path("a.mcap"), |_| ()).unwrap();
    assert_eq!(verified.missing_frames, missing, "{what}: {verified:?}");
    let twice = verified.problems.iter().any(|problem| problem.what.contains(" here a second time"));
    // The first thousand problems are kept in words, of which these pulses without a clock are many.
    assert!(verified.problem_count > 1_000 || twice == (report.frames_twice > 0), "{what}");
    let restarted = verified.problems.iter().any(|problem| problem.what.contains("begins again"));
    assert!(!restarted && verified.boots == 0, "{what}: {verified:?}");
    report
}

/// Size of a log, of a block, and how far apart the frames are.
const CASES: [(u64, usize, u64); 4] =
    [(1_200, 4_096, 20_000_000), (1_200, 4_096, 400_000), (6_000, 65_536, 5_000_000), (6_000, 65_536, 100_000)];

#[test]
fn a_block_written_twice_is_read_once_and_is_no_restart() {
    let folder = Folder::new();
    for (count, size, every_ns) in CASES {
        let (sent, intact) = written(&folder, count, every_ns);
        let blocks = place(&intact, &sent[sent.len() - 1]) / size;
        for block in 0..blocks - 1 {
            let (from, to) = (block * size, (block + 1) * size);
            let what = format!("block {block} of {size}, {every_ns} ns");
            // Over the one behind it: what was there is lost.
            let mut over = intact.clone();
            over.copy_within(from..to, to);
            let report = check(&folder, &over, &intact, &sent, &what);
            // At the end of the file no number says how many frames were there.
            let told = report.frames_lost > 0 || report.losses.iter().any(|loss| loss.frames.is_none());
            assert!(report.frames_twice > 0 && told, "{what}: {report:?}");
            // Between it and the one behind it.
            let between = [&intact[..to], &intact[from..]].concat();
            let report = check(&folder, &between, &intact, &sent, &what);
            assert!(report.frames_twice > 0 && report.frames_lost <= 2, "{what}: {report:?}");
        }
    }
}

#[test]
fn blocks_in_each_others_place_are_read_in_order() {
    let folder = Folder::new();
    for (count, size, every_ns) in CASES {
        let (sent, intact) = written(&folder, count, every_ns);
        let blocks = intact.len() / size;
        for block in 1..blocks - 1 {
            for other in (block + 1..blocks - 1).filter(|other| other - block < 4) {
                let mut swapped = intact.clone();
                swapped[block * size..][..size].copy_from_slice(&intact[other * size..][..size]);
                swapped[other * size..][..size].copy_from_slice(&intact[block * size..][..size]);
                let what = format!("blocks {block} and {other} of {size}, {every_ns} ns");
                let report = check(&folder, &swapped, &intact, &sent, &what);
                assert!(report.frames_lost <= 8 && report.frames_twice == 0, "{what}: {report:?}");
            }
        }
    }
}
