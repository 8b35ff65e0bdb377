use std::fs;

use super::*;

/// A small capture: `count` chunks a millisecond apart, the channels in turn.
fn sample(path: &Path, count: u64) -> Vec<Chunk> {
    let mut writer = Writer::create(path).unwrap();
    let chunks: Vec<_> = (0..count)
        .map(|i| {
            let channel = [Channel::Lidar, Channel::Ins, Channel::Pps][i as usize % 3];
            let data = if channel == Channel::Pps { Vec::new() } else { vec![i as u8; 20] };
            Chunk { channel, device_time_ns: 1_000_000 * (i + 1), data }
        })
        .collect();
    for chunk in &chunks {
        writer.write(chunk.channel, chunk.device_time_ns, &chunk.data).unwrap();
    }
    writer.finish().unwrap();
    chunks
}

#[test]
fn what_is_written_is_read() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.mcap");
    let written = sample(&path, 100);
    let reader = Reader::open(&path).unwrap();
    assert_eq!(reader.span_ns(), Some((1_000_000, 100_000_000)));
    assert_eq!(reader.map(Result::unwrap).collect::<Vec<_>>(), written);
}

#[test]
fn a_capture_cut_at_any_byte_yields_what_is_whole_and_then_one_error() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.mcap");
    let written = sample(&path, 12);
    let whole = fs::read(&path).unwrap();
    let cut = folder.path().join("cut.mcap");
    let mut most = 0;
    for length in mcap::MAGIC.len()..whole.len() {
        fs::write(&cut, &whole[..length]).unwrap();
        let Ok(reader) = Reader::open(&cut) else { continue };
        let (chunks, errors): (Vec<_>, Vec<_>) = reader.partition(Result::is_ok);
        let chunks: Vec<_> = chunks.into_iter().map(Result::unwrap).collect();
        assert_eq!(chunks, written[..chunks.len()], "cut at {length}");
        assert!(chunks.len() >= most, "cut at {length}: never fewer than with a shorter file");
        most = chunks.len();
        // The end of the file is the footer and the magic: without the last of these nothing is missing.
        if length + mcap::MAGIC.len() + 29 < whole.len() {
            assert_eq!(errors.len(), 1, "cut at {length}: {errors:?}");
        }
    }
    assert_eq!(most, written.len());
}

#[test]
fn chunks_come_in_the_order_of_time_whatever_the_file_has() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.mcap");
    // Uneven MCAP chunks whose times overlap: lines of a capture that was merged from two.
    let mut mcap = mcap::WriteOptions::new().chunk_size(Some(200)).create(fs::File::create(&path).unwrap()).unwrap();
    let id = mcap.add_channel(0, "ins", ENCODING, &BTreeMap::new()).unwrap();
    for time in (0..100_u64).map(|i| i * 37 % 101) {
        let header = MessageHeader { channel_id: id, sequence: 0, log_time: time, publish_time: time };
        mcap.write_to_known_channel(&header, &[time as u8; 10]).unwrap();
    }
    mcap.finish().unwrap();
    let times: Vec<_> = Reader::open(&path).unwrap().map(|chunk| chunk.unwrap().device_time_ns).collect();
    assert_eq!(times.len(), 100);
    assert!(times.is_sorted());
}

#[test]
fn a_flipped_bit_in_a_chunk_is_told_and_costs_nothing_else() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.mcap");
    let written = sample(&path, 12);
    let mut bytes = fs::read(&path).unwrap();
    // The tenth message's payload of 20 equal bytes.
    let at = bytes.windows(20).position(|window| window == [9; 20]).unwrap();
    bytes[at] ^= 0x10;
    fs::write(&path, &bytes).unwrap();
    let (chunks, errors): (Vec<_>, Vec<_>) = Reader::open(&path).unwrap().partition(Result::is_ok);
    assert_eq!(chunks.len(), written.len());
    assert!(errors[0].as_ref().unwrap_err().to_string().contains("the chunk's CRC is"), "{errors:?}");
}

#[test]
fn a_foreign_file_and_a_foreign_mcap_are_refused_by_name() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.mcap");
    fs::write(&path, b"PK\x03\x04 not what you think").unwrap();
    let error = Reader::open(&path).unwrap_err().to_string();
    assert!(error.contains("not an MCAP file: it begins with 50 4B 03 04"), "{error}");

    let mut mcap = mcap::Writer::new(fs::File::create(&path).unwrap()).unwrap();
    mcap.add_channel(0, "/camera", "ros1", &BTreeMap::new()).unwrap();
    mcap.finish().unwrap();
    let error = Reader::open(&path).unwrap_err().to_string();
    assert!(error.contains("not a capture: it has `/camera`, expected lidar, ins and pps"), "{error}");
}

#[test]
fn the_example_capture_reads_whole_and_cut() {
    let Some(folder) = std::env::var_os("CROSSFALL_RECORDINGS") else {
        eprintln!("skipped: CROSSFALL_RECORDINGS does not name the folder of recordings");
        return;
    };
    let path = Path::new(&folder).join("capture/example.mcap");
    let all: Vec<_> = Reader::open(&path).unwrap().map(Result::unwrap).collect();
    let count = |channel| all.iter().filter(|chunk| chunk.channel == channel).count();
    assert_eq!((count(Channel::Lidar), count(Channel::Ins), count(Channel::Pps)), (750, 2068, 21));
    assert!(all.is_sorted_by_key(|chunk| chunk.device_time_ns));

    // The whole of it is one compressed chunk, and half of that is still worth reading.
    let bytes = fs::read(&path).unwrap();
    let scratch = tempfile::tempdir().unwrap();
    let cut = scratch.path().join("cut.mcap");
    fs::write(&cut, &bytes[..bytes.len() / 2]).unwrap();
    let (chunks, errors): (Vec<_>, Vec<_>) = Reader::open(&cut).unwrap().partition(Result::is_ok);
    assert!(chunks.len() > all.len() / 3, "{} of {}", chunks.len(), all.len());
    assert!(chunks.into_iter().map(Result::unwrap).zip(&all).all(|(cut, whole)| cut == *whole));
    let error = errors[0].as_ref().unwrap_err().to_string();
    assert!(error.contains("cut short: the file ends at byte 299022, inside of the chunk"), "{error}");
}
