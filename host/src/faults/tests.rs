use super::*;

fn pieces(count: u64) -> Vec<Piece> {
    (0..count).map(|i| Piece { at_ns: i * 27_000_000, bytes: (0..200).map(|j| (i + j) as u8).collect() }).collect()
}

fn through(spec: &str, pieces: &[Piece]) -> (Vec<Piece>, Counts) {
    let spec: Spec = spec.parse().unwrap();
    let mut injector = Injector::new(spec.rates(Channel::Lidar).unwrap(), spec.seed, 0);
    let mut out = Vec::new();
    for piece in pieces {
        injector.pass(piece.clone(), &mut |piece| out.push(piece));
    }
    injector.finish(&mut |piece| out.push(piece));
    (out, injector.counts())
}

#[test]
fn specifications_are_read_as_they_are_printed() {
    for text in [
        "flip=0.00001,drop=0.000001,seed=7",
        "lidar:burst=0.000001:200,seed=0;pps:drop=0.1,flip=0",
        "truncate=0.5,duplicate=1,reorder=0.25,stall=0.001:1500,seed=18446744073709551615",
    ] {
        let spec: Spec = text.parse().unwrap();
        assert_eq!(spec.to_string().parse::<Spec>().unwrap(), spec, "{spec}");
    }
    let spec: Spec = "flip=1e-5;ins:drop=1e-6".parse().unwrap();
    assert_eq!(spec.rates(Channel::Lidar).unwrap().flip, 1e-5);
    assert_eq!(spec.rates(Channel::Ins).unwrap(), Rates { drop: 1e-6, ..Rates::default() });
    assert_eq!((spec.rates(Channel::Pps), spec.rates(Channel::Ins2)), (None, None));
    for wrong in [
        "",
        "flip",
        "flip=2",
        "flip=-1",
        "flip=nan",
        "flip=1:3",
        "burst=1:0",
        "fire=1",
        "usb:flip=1",
        "ins2:flip=1",
        "pps:flip=0.5",
        "pps:drop=0.1,truncate=0.1",
        "flip=1;drop=1",
        "seed=x",
    ] {
        assert!(wrong.parse::<Spec>().unwrap_err().contains("expected FAULT=RATE"), "{wrong}");
    }
}

#[test]
fn every_byte_is_accounted_for() {
    let sent = pieces(3_000);
    let spec =
        "flip=0.002,drop=0.003,burst=0.0005:40,duplicate=0.02,reorder=0.02,truncate=0.02,stall=0.005:90,seed=291";
    let (came, counts) = through(spec, &sent);
    assert_eq!((counts.pieces, counts.bytes), (3_000, 600_000));
    let bytes: u64 = came.iter().map(|piece| piece.bytes.len() as u64).sum();
    assert_eq!(bytes, counts.bytes - counts.dropped - counts.truncated_bytes + counts.duplicated_bytes);
    // Each fault at its rate, within five deviations of a binomial count.
    for (count, trials, rate) in [
        (counts.flipped, 600_000.0, 0.002),
        (counts.dropped, 600_000.0, 0.003),
        (counts.bursts, 600_000.0, 0.0005),
        (counts.duplicated, 3_000.0, 0.02),
        (counts.reordered, 3_000.0, 0.02),
        (counts.truncated, 3_000.0, 0.02),
        (counts.stalled, 3_000.0, 0.005),
    ] {
        let expected: f64 = trials * rate;
        // Bursts hide some flips; truncated ends take some of all.
        assert!(
            (count as f64 - expected).abs() < 5.0 * expected.sqrt() + 0.05 * expected,
            "{count}, expected {expected}"
        );
    }
    assert!(came.is_sorted_by_key(|piece| piece.at_ns), "time goes forward");
}

#[test]
fn the_same_seed_makes_the_same_faults_and_another_one_others() {
    let sent = pieces(200);
    let spec = |seed| format!("flip=0.01,drop=0.01,duplicate=0.1,reorder=0.1,truncate=0.1,stall=0.1,seed={seed}");
    assert_eq!(through(&spec(1), &sent), through(&spec(1), &sent));
    assert_ne!(through(&spec(1), &sent), through(&spec(2), &sent));
    assert_eq!(through("flip=0,seed=1", &sent).0, sent);
}

#[test]
fn each_fault_alone_does_what_it_says() {
    let sent = pieces(4);
    let bytes = |pieces: &[Piece]| pieces.iter().flat_map(|piece| piece.bytes.clone()).collect::<Vec<_>>();
    let (came, _) = through("flip=1", &sent);
    let flips = bytes(&came).iter().zip(bytes(&sent)).filter(|(a, b)| (*a ^ b).count_ones() == 1).count();
    assert_eq!(flips, 800);
    assert_eq!(through("drop=1", &sent).0, []);
    let (came, _) = through("duplicate=1", &sent);
    assert!(came.len() == 8 && came[0] == sent[0] && came[1] == sent[0]);
    let (came, _) = through("reorder=1", &sent);
    assert!(came[0].bytes == sent[1].bytes && came[1].bytes == sent[0].bytes && came[0].at_ns == 0);
    let (came, _) = through("stall=1:100", &sent[..1]);
    assert_eq!(came[0].at_ns, 100_000_000);
    let pulse = [Piece { at_ns: 5, bytes: Vec::new() }];
    assert_eq!(through("drop=1", &pulse).0, []);
    assert_eq!(
        through("duplicate=1", &pulse).0.iter().map(|piece| piece.at_ns).collect::<Vec<_>>(),
        [5, 5 + BOUNCE_NS]
    );
}

/// A line that stalls does not keep the others waiting, and a capture with faults is still in the order of time.
#[test]
fn a_stalled_line_keeps_no_other_waiting() {
    let chunks = (0..200_u64).map(|i| {
        let channel = if i % 2 == 0 { Channel::Lidar } else { Channel::Ins };
        Ok(Chunk { channel, device_time_ns: i * 10_000_000, data: vec![i as u8; 20] })
    });
    let spec: Spec = "lidar:stall=0.2:95,seed=3".parse().unwrap();
    let mut faulty = Faulty::new(chunks, &spec);
    let came: Vec<Chunk> = faulty.by_ref().map(Result::unwrap).collect();
    assert_eq!(came.len(), 200);
    assert!(came.is_sorted_by_key(|chunk| chunk.device_time_ns));
    let ins = came.iter().filter(|chunk| chunk.channel == Channel::Ins).map(|chunk| chunk.device_time_ns);
    assert!(ins.eq((0..100).map(|i| (2 * i + 1) * 10_000_000)));
    let counts: Vec<_> = faulty.counts().collect();
    assert!(counts.len() == 1 && counts[0].0 == Channel::Lidar && counts[0].1.stalled > 5);
}
