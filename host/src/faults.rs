//! Faults on purpose: what cables, plugs, receivers and drivers do to a stream of bytes, by a specification and a seed.
//!
//! [`Injector`] stands between whoever sends pieces of a stream (telegrams, chunks, reads) and whoever receives them. The same specification and
//! the same pieces give the same faults on every platform. Faults of bytes (flip, drop, burst) strike each byte independently; faults of pieces
//! (duplicate, reorder, truncate, stall) each piece. Everything done is counted, so that a test can balance what was sent against what came.
//! [`Faulty`] is an injector for each line of a capture.

mod spec;

use std::collections::BTreeMap;
use std::fmt;

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};

use crate::capture::{Channel, Chunk};
use crate::container::Error;
pub use spec::{Rates, Spec};

/// A bounce of a pulse's edge, and the least shift of whatever comes twice.
const BOUNCE_NS: u64 = 1_000_000;

/// What was done.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counts {
    /// Pieces that came in.
    pub pieces: u64,
    /// Bytes that came in.
    pub bytes: u64,
    /// Bytes of which one bit was flipped.
    pub flipped: u64,
    /// Bytes (or pulses) that were lost.
    pub dropped: u64,
    /// Bursts of noise.
    pub bursts: u64,
    /// Bytes replaced by them, one in 256 by itself.
    pub noise: u64,
    /// Pieces that came twice.
    pub duplicated: u64,
    /// Bytes that came twice.
    pub duplicated_bytes: u64,
    /// Pieces that changed places with the next one.
    pub reordered: u64,
    /// Pieces that lost their end.
    pub truncated: u64,
    /// Bytes of these ends.
    pub truncated_bytes: u64,
    /// Times that everything came late.
    pub stalled: u64,
}

impl fmt::Display for Counts {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { pieces, bytes, flipped, dropped, bursts, duplicated, reordered, truncated, stalled, .. } = self;
        write!(
            f,
            "of {pieces} pieces and {bytes} bytes {flipped} flipped, {dropped} dropped, {bursts} bursts, {duplicated} duplicated, \
             {reordered} reordered, {truncated} truncated, {stalled} stalls"
        )
    }
}

/// Bytes that arrive together, or a pulse, which has none.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Piece {
    /// When the first byte arrives, in nanoseconds.
    pub at_ns: u64,
    /// They.
    pub bytes: Vec<u8>,
}

/// Faults of one line.
#[derive(Clone, Debug)]
pub struct Injector {
    rates: Rates,
    random: ChaCha8Rng,
    /// Bytes to the next strike of flip, drop and burst.
    next: [u64; 3],
    /// Bytes of noise that are still to come of a burst.
    noise: u64,
    /// A piece that lets the next one go first.
    held: Option<Piece>,
    /// Nothing arrives before.
    late_ns: u64,
    counts: Counts,
}

impl Injector {
    /// Faults at these rates. Lines of different numbers have independent faults of one seed.
    #[must_use]
    pub fn new(rates: Rates, seed: u64, line: u64) -> Self {
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        random.set_stream(line);
        let mut injector =
            Self { rates, random, next: [0; 3], noise: 0, held: None, late_ns: 0, counts: Counts::default() };
        injector.next = [rates.flip, rates.drop, rates.burst].map(|rate| injector.wait(rate));
        injector
    }

    /// What was done so far.
    #[must_use]
    pub fn counts(&self) -> Counts {
        self.counts
    }

    /// Takes a piece; gives those that arrive of it and of earlier ones, in the order of their times.
    pub fn pass(&mut self, mut piece: Piece, out: &mut impl FnMut(Piece)) {
        self.counts.pieces += 1;
        self.counts.bytes += piece.bytes.len() as u64;
        if piece.bytes.is_empty() {
            return self.pulse(piece, out);
        }
        if self.chance(self.rates.truncate) {
            let kept = self.below(piece.bytes.len() as u64) as usize;
            self.counts.truncated += 1;
            self.counts.truncated_bytes += (piece.bytes.len() - kept) as u64;
            piece.bytes.truncate(kept);
        }
        piece.bytes = self.bytes(&piece.bytes);
        self.stall(&mut piece);
        if let Some(mut held) = self.held.take() {
            // They change places: the bytes, not the times.
            std::mem::swap(&mut held.at_ns, &mut piece.at_ns);
            self.emit(piece, out);
            return self.emit(held, out);
        }
        if self.chance(self.rates.reorder) {
            self.counts.reordered += 1;
            self.held = Some(piece);
            return;
        }
        self.emit(piece, out);
    }

    /// The stream has ended: what was held back for a next piece arrives.
    pub fn finish(&mut self, out: &mut impl FnMut(Piece)) {
        if let Some(held) = self.held.take() {
            self.emit(held, out);
        }
    }

    fn emit(&mut self, piece: Piece, out: &mut impl FnMut(Piece)) {
        if piece.bytes.is_empty() {
            return;
        }
        let again = self.chance(self.rates.duplicate).then(|| piece.clone());
        out(piece);
        if let Some(again) = again {
            self.counts.duplicated += 1;
            self.counts.duplicated_bytes += again.bytes.len() as u64;
            out(again);
        }
    }

    /// A pulse has no bytes: it is lost, late, or bounces.
    fn pulse(&mut self, mut piece: Piece, out: &mut impl FnMut(Piece)) {
        if self.chance(self.rates.drop) {
            self.counts.dropped += 1;
            return;
        }
        self.stall(&mut piece);
        let at_ns = piece.at_ns;
        out(piece);
        if self.chance(self.rates.duplicate) {
            self.counts.duplicated += 1;
            self.late_ns = at_ns + BOUNCE_NS;
            out(Piece { at_ns: self.late_ns, bytes: Vec::new() });
        }
    }

    fn stall(&mut self, piece: &mut Piece) {
        if self.chance(self.rates.stall) {
            self.counts.stalled += 1;
            self.late_ns = self.late_ns.max(piece.at_ns.saturating_add(self.rates.stall_ms.saturating_mul(1_000_000)));
        }
        piece.at_ns = piece.at_ns.max(self.late_ns);
    }

    fn bytes(&mut self, bytes: &[u8]) -> Vec<u8> {
        let quiet = self.noise == 0 && self.next.iter().all(|&next| next > bytes.len() as u64);
        if quiet {
            self.next = self.next.map(|next| next - bytes.len() as u64);
            return bytes.to_vec();
        }
        let mut out = Vec::with_capacity(bytes.len());
        for &byte in bytes {
            let [flip, drop, burst] = [0, 1, 2].map(|fault| self.strikes(fault));
            if burst {
                self.counts.bursts += 1;
                self.noise = self.rates.burst_bytes;
            }
            if drop {
                self.counts.dropped += 1;
            } else if self.noise > 0 {
                self.noise -= 1;
                self.counts.noise += 1;
                out.push(self.random.next_u32() as u8);
            } else if flip {
                self.counts.flipped += 1;
                out.push(byte ^ 1 << (self.random.next_u32() % 8));
            } else {
                out.push(byte);
            }
        }
        out
    }

    fn strikes(&mut self, fault: usize) -> bool {
        self.next[fault] -= 1;
        if self.next[fault] > 0 {
            return false;
        }
        let rate = [self.rates.flip, self.rates.drop, self.rates.burst][fault];
        self.next[fault] = self.wait(rate);
        true
    }

    /// Bytes until the next strike: geometric.
    fn wait(&mut self, rate: f64) -> u64 {
        if rate <= 0.0 {
            return u64::MAX;
        }
        if rate >= 1.0 {
            return 1;
        }
        let steps = libm::log(1.0 - self.unit()) / libm::log1p(-rate);
        // At most 2^53, which no stream has bytes.
        1 + steps.clamp(0.0, 9.0e15) as u64
    }

    fn chance(&mut self, rate: f64) -> bool {
        rate > 0.0 && self.unit() < rate
    }

    fn below(&mut self, end: u64) -> u64 {
        ((u128::from(self.random.next_u64()) * u128::from(end)) >> 64) as u64
    }

    /// Uniform in [0, 1).
    fn unit(&mut self) -> f64 {
        (self.random.next_u64() >> 11) as f64 / (1_u64 << 53) as f64
    }
}

/// The chunks of a capture, with an injector on each line that the specification names; still in the order of their times.
pub struct Faulty<I> {
    chunks: I,
    lines: BTreeMap<Channel, Injector>,
    /// What is late on one line waits here while the others go on, by time and order of coming.
    late: BTreeMap<(u64, u64), Chunk>,
    came: u64,
    /// Nothing of before this comes any more.
    now_ns: u64,
}

impl<I: Iterator<Item = Result<Chunk, Error>>> Faulty<I> {
    /// Faults over chunks.
    pub fn new(chunks: I, spec: &Spec) -> Self {
        let lines = Channel::ALL.into_iter().zip(0..);
        let lines =
            lines.filter_map(|(line, number)| Some((line, Injector::new(spec.rates(line)?, spec.seed, number))));
        Self { chunks, lines: lines.collect(), late: BTreeMap::new(), came: 0, now_ns: 0 }
    }

    /// What was done to each line.
    pub fn counts(&self) -> impl Iterator<Item = (Channel, Counts)> + '_ {
        self.lines.iter().map(|(line, injector)| (*line, injector.counts()))
    }
}

impl<I: Iterator<Item = Result<Chunk, Error>>> Iterator for Faulty<I> {
    type Item = Result<Chunk, Error>;

    fn next(&mut self) -> Option<Self::Item> {
        loop {
            if let Some(due) = self.late.first_entry().filter(|due| due.key().0 <= self.now_ns) {
                return Some(Ok(due.remove()));
            }
            let Self { lines, late, came, .. } = self;
            let mut keep = |channel: Channel, piece: Piece| {
                *came += 1;
                late.insert((piece.at_ns, *came), of(channel, piece));
            };
            match self.chunks.next() {
                Some(Ok(Chunk { channel, device_time_ns, data })) => {
                    self.now_ns = device_time_ns;
                    let piece = Piece { at_ns: device_time_ns, bytes: data };
                    match lines.get_mut(&channel) {
                        None => keep(channel, piece),
                        Some(injector) => injector.pass(piece, &mut |piece| keep(channel, piece)),
                    }
                }
                Some(Err(error)) => return Some(Err(error)),
                None => {
                    for (&channel, injector) in lines {
                        injector.finish(&mut |piece| keep(channel, piece));
                    }
                    self.now_ns = u64::MAX;
                    return self.late.pop_first().map(|(_, chunk)| Ok(chunk));
                }
            }
        }
    }
}

fn of(channel: Channel, piece: Piece) -> Chunk {
    Chunk { channel, device_time_ns: piece.at_ns, data: piece.bytes }
}

#[cfg(test)]
mod tests;
