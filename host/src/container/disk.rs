//! A file of which some places cannot be read: a disk with bad sectors.
//!
//! Where a read fails, it is tried again in pieces of [`PIECE`] bytes, what a sector of today's disks has; those that fail are read as zeros and
//! remembered, and no byte around them is lost. A disk may take seconds to say that a piece is unreadable, and one that is dying says so
//! everywhere: behind [`MOST`] pieces, or [`LONGEST`] of waiting for them, it is given up.

use std::collections::BTreeSet;
use std::fmt::Debug;
use std::io::{self, Read, Seek, SeekFrom};
use std::ops::Range;
use std::time::{Duration, Instant};

use crate::interrupt;

/// What is given up at once, in bytes.
pub const PIECE: u64 = 4096;

/// Pieces of a file that may be unreadable: 64 MiB.
pub const MOST: usize = 1 << 14;

/// Time that may be spent on reads that fail.
const LONGEST: Duration = Duration::from_secs(300);

/// What is read: a file, and in tests one that fails.
pub trait Source: Read + Seek + Debug + Send + Sync {}

impl<T: Read + Seek + Debug + Send + Sync> Source for T {}

/// See the module.
#[derive(Debug)]
pub struct Disk {
    source: Box<dyn Source>,
    size: u64,
    at: u64,
    /// Whether places that cannot be read are passed over. Else they are errors.
    patient: bool,
    /// Up to here it is read piece by piece.
    careful_to: u64,
    /// Numbers of the pieces that cannot be read, and those of them that nobody has asked for yet.
    failed: BTreeSet<u64>,
    untold: BTreeSet<u64>,
    /// Why the first of them could not be.
    why: Option<(io::ErrorKind, String)>,
    waited: Duration,
    given_up: bool,
}

impl Disk {
    /// Over a source of `size` bytes that is at its beginning.
    pub fn new(source: Box<dyn Source>, size: u64, patient: bool) -> Self {
        Self {
            source,
            size,
            at: 0,
            patient,
            careful_to: 0,
            failed: BTreeSet::new(),
            untold: BTreeSet::new(),
            why: None,
            waited: Duration::ZERO,
            given_up: false,
        }
    }

    /// Why something could not be read, if anything.
    pub fn failure(&self) -> Option<io::Error> {
        self.why.as_ref().map(|(kind, why)| io::Error::new(*kind, why.clone()))
    }

    /// Places in front of `below` that cannot be read and were not returned here before, in their order.
    pub fn unreadable(&mut self, below: u64) -> Vec<Range<u64>> {
        let later = self.untold.split_off(&below.div_ceil(PIECE));
        let mut places: Vec<Range<u64>> = Vec::new();
        for piece in std::mem::replace(&mut self.untold, later) {
            let (from, to) = (piece * PIECE, ((piece + 1) * PIECE).min(self.size));
            match places.last_mut() {
                Some(last) if last.end == from => last.end = to,
                _ => places.push(from..to),
            }
        }
        places
    }

    /// One read, and the time of it if it fails.
    fn attempt(&mut self, into: &mut [u8]) -> io::Result<usize> {
        let began = Instant::now();
        let read = self.source.read(into);
        match &read {
            Ok(count) => self.at += *count as u64,
            Err(_) => self.waited += began.elapsed(),
        }
        read
    }

    /// At most up to the next piece.
    fn piece(&mut self, into: &mut [u8]) -> io::Result<usize> {
        let piece = self.at / PIECE;
        let end = ((piece + 1) * PIECE).min(self.size);
        let room = usize::try_from(end.saturating_sub(self.at)).unwrap_or(usize::MAX).min(into.len());
        let into = &mut into[..room];
        if !self.failed.contains(&piece) {
            // Where a read that fails leaves a file is not said.
            self.source.seek(SeekFrom::Start(self.at))?;
            match self.attempt(into) {
                Err(error) if error.kind() != io::ErrorKind::Interrupted => self.fail(piece, &error)?,
                read => return read,
            }
        }
        into.fill(0);
        self.at += room as u64;
        self.source.seek(SeekFrom::Start(self.at))?;
        Ok(room)
    }

    fn fail(&mut self, piece: u64, error: &io::Error) -> io::Result<()> {
        self.failed.insert(piece);
        self.untold.insert(piece);
        self.why.get_or_insert_with(|| (error.kind(), error.to_string()));
        self.given_up |= self.failed.len() > MOST || self.waited > LONGEST || interrupt::requested();
        self.hopeful()
    }

    fn hopeful(&self) -> io::Result<()> {
        let Some((kind, why)) = self.why.as_ref().filter(|_| self.given_up) else { return Ok(()) };
        let what = format!("{why}; {} places of {PIECE} bytes cannot be read, it is given up", self.failed.len());
        Err(io::Error::new(*kind, what))
    }
}

impl Read for Disk {
    fn read(&mut self, into: &mut [u8]) -> io::Result<usize> {
        self.hopeful()?;
        // What is known to fail is not tried again.
        let known = self.failed.range(self.at / PIECE..).next().map_or(u64::MAX, |piece| piece * PIECE);
        if self.at < self.careful_to || known <= self.at {
            return self.piece(into);
        }
        let room = usize::try_from(known - self.at).unwrap_or(usize::MAX).min(into.len());
        match self.attempt(&mut into[..room]) {
            Err(error) if self.patient && error.kind() != io::ErrorKind::Interrupted => {
                self.careful_to = self.at.saturating_add(room as u64);
                self.piece(into)
            }
            read => read,
        }
    }
}

impl Seek for Disk {
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        let to = match to {
            SeekFrom::Current(distance) => {
                let at = self.at.checked_add_signed(distance);
                SeekFrom::Start(at.ok_or_else(|| io::Error::from(io::ErrorKind::InvalidInput))?)
            }
            other => other,
        };
        self.at = self.source.seek(to)?;
        Ok(self.at)
    }

    fn stream_position(&mut self) -> io::Result<u64> {
        Ok(self.at)
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use std::ops::Range;
    use std::sync::Arc;
    use std::sync::atomic::{AtomicUsize, Ordering};

    use super::*;

    /// A disk that cannot read some places, and counts how often it was asked for one of them.
    #[derive(Debug)]
    pub(crate) struct Failing {
        pub bytes: Vec<u8>,
        pub places: Vec<Range<u64>>,
        pub at: u64,
        pub failures: Arc<AtomicUsize>,
    }

    impl Failing {
        pub(crate) fn new(bytes: &[u8], places: &[Range<u64>]) -> Self {
            Self { bytes: bytes.to_vec(), places: places.to_vec(), at: 0, failures: Arc::default() }
        }

        pub(crate) fn at(bytes: &[u8], place: Range<u64>) -> Self {
            Self::new(bytes, std::slice::from_ref(&place))
        }
    }

    impl Read for Failing {
        fn read(&mut self, into: &mut [u8]) -> io::Result<usize> {
            let rest = self.bytes.get(self.at as usize..).unwrap_or_default();
            let wanted = self.at..self.at + into.len().min(rest.len()) as u64;
            if self.places.iter().any(|place| place.start < wanted.end && wanted.start < place.end) {
                self.failures.fetch_add(1, Ordering::Relaxed);
                // As bad as is allowed: the place is lost, too.
                self.at = 0;
                return Err(io::Error::other("Input/output error"));
            }
            let count = (&rest[..]).read(into)?;
            self.at += count as u64;
            Ok(count)
        }
    }

    impl Seek for Failing {
        fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
            let SeekFrom::Start(at) = to else { return Err(io::Error::from(io::ErrorKind::Unsupported)) };
            self.at = at;
            Ok(at)
        }
    }

    #[test]
    fn what_cannot_be_read_is_zeros_and_all_around_it_is_there() {
        let bytes: Vec<u8> = (0..100_000_u32).map(|i| (i % 250) as u8 + 1).collect();
        // Within a piece, over two, and the cut piece at the end.
        let places = [5_000..5_001, 12_000..12_300, 40_960..49_152, 99_000..99_001];
        let failing = Failing::new(&bytes, &places);
        let failures = Arc::clone(&failing.failures);
        let mut disk = Disk::new(Box::new(failing), bytes.len() as u64, true);
        let mut expected = bytes.clone();
        let lost = [4_096..8_192, 8_192..12_288, 12_288..16_384, 40_960..49_152, 98_304..100_000];
        for place in &lost[..] {
            expected[place.start..place.end].fill(0);
        }
        for most in [100_000, 1_000, 4_096, 7_777] {
            let mut found: Vec<u8> = Vec::new();
            disk.seek(SeekFrom::Start(0)).unwrap();
            let mut part = vec![0; most];
            loop {
                let count = disk.read(&mut part).unwrap();
                if count == 0 {
                    break;
                }
                found.extend(&part[..count]);
            }
            assert!(found == expected, "{most}");
        }
        assert_eq!(disk.unreadable(10_000), std::slice::from_ref(&(4_096..12_288)));
        assert_eq!(disk.unreadable(u64::MAX), [12_288..16_384, 40_960..49_152, 98_304..100_000]);
        assert_eq!(disk.unreadable(u64::MAX), []);
        assert!(failures.load(Ordering::Relaxed) < 12, "what has failed is not tried again");
    }

    #[test]
    fn one_that_fails_everywhere_is_given_up() {
        let bytes = vec![1; (MOST + 10) * PIECE as usize];
        let failing = Failing::at(&bytes, 0..u64::MAX);
        let failures = Arc::clone(&failing.failures);
        let mut disk = Disk::new(Box::new(failing), bytes.len() as u64, true);
        let error = io::copy(&mut disk, &mut io::sink()).unwrap_err().to_string();
        assert!(error.starts_with("Input/output error; 16385 places of 4096 bytes"), "{error}");
        assert!(failures.load(Ordering::Relaxed) <= 2 * MOST + 4);
        // One that is not patient says so at once.
        let mut disk = Disk::new(Box::new(Failing::at(&bytes, 0..1)), bytes.len() as u64, false);
        assert!(disk.read(&mut [0; 8]).is_err());
    }
}
