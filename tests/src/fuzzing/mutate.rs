//! Seeded mutations: what a fuzzer does, without coverage, on a stable compiler and the same with every run.

/// A small generator with a stream of its own for each seed (Knuth's MMIX constants; the high bits are used).
#[derive(Clone, Debug)]
pub struct Draw(u64);

impl Draw {
    /// A stream.
    #[must_use]
    pub fn new(seed: u64) -> Self {
        Self(seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) ^ 0x2545_f491_4f6c_dd1d)
    }

    /// The next 32 bits.
    pub fn bits(&mut self) -> u32 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 32) as u32
    }

    /// A number below `end`; 0 when that is 0.
    pub fn below(&mut self, end: usize) -> usize {
        if end == 0 { 0 } else { ((u64::from(self.bits()) * end as u64) >> 32) as usize }
    }
}

/// Bytes at which decoders branch.
const TELLING: [u8; 16] =
    [0x00, 0x01, 0x02, 0x03, 0x06, 0x12, 0x13, 0x15, 0x44, 0x7f, 0x80, 0xaa, 0xb0, 0xfe, 0xff, 0x89];

/// One to eight changes: a bit, a byte, a piece removed, doubled, moved or taken from another input, an end cut off.
pub fn mutate(input: &mut Vec<u8>, other: &[u8], draw: &mut Draw) {
    for _ in 0..=draw.below(8) {
        let length = input.len();
        let at = draw.below(length);
        let end = (at + 1 + draw.below(40)).min(length);
        match draw.below(8) {
            0 if length > 0 => input[at] ^= 1 << draw.below(8),
            1 if length > 0 => input[at] = draw.bits() as u8,
            2 if length > 0 => input[at] = TELLING[draw.below(TELLING.len())],
            3 if length > 0 => drop(input.drain(at..end)),
            4 if length > 0 => {
                let piece = input[at..end].to_vec();
                let to = draw.below(length);
                input.splice(to..to, piece);
            }
            5 if length > 0 => input.truncate(at),
            6 => {
                let from = draw.below(other.len());
                let piece = &other[from..(from + 1 + draw.below(200)).min(other.len())];
                input.splice(at..at, piece.iter().copied());
            }
            _ => {
                let to = draw.below(length + 1);
                input.insert(to, draw.bits() as u8);
            }
        }
    }
}
