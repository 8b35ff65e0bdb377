//! Which bytes are due next, and when: the merge of a capture's lines.

use std::iter::Peekable;

use crossfall_core::protocol::Config;

use super::{MAX_WAITING, PIECE_NS, due};
use crate::capture::Chunk;
use crate::container;
use crate::sensor_line::Wire;

/// What is due.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Due {
    /// Bytes of the scanner.
    Lidar,
    /// Bytes of the inertial unit.
    Ins,
    /// A pulse.
    Pulse,
    /// A chunk of a line that boards do not have.
    Unplayed,
}

/// See the module.
pub struct Schedule<I: Iterator> {
    chunks: Peekable<I>,
    lidar: Wire,
    ins: Wire,
    damage: Vec<String>,
}

impl<I: Iterator<Item = Result<Chunk, container::Error>>> Schedule<I> {
    /// Over chunks in the order of their times.
    pub fn new(chunks: I, config: &Config) -> Self {
        Self {
            chunks: chunks.peekable(),
            lidar: Wire::new(config.scanner.baud),
            ins: Wire::new(config.ins.baud),
            damage: Vec::new(),
        }
    }

    /// The next piece, whose bytes replace what `piece` holds, and when it is due, in nanoseconds of device time.
    pub fn next(&mut self, piece: &mut Vec<u8>) -> Option<(Due, u64)> {
        piece.clear();
        loop {
            let (lidar, ins) = (self.lidar.next_arrival(), self.ins.next_arrival());
            let waiting = lidar.min(ins);
            let crowded = self.lidar.waiting() + self.ins.waiting() > MAX_WAITING;
            match self.chunks.peek() {
                Some(Err(_)) => {
                    if let Some(Err(error)) = self.chunks.next() {
                        self.damage.push(error.to_string());
                    }
                }
                Some(Ok(chunk)) if chunk.device_time_ns <= waiting && !(crowded && waiting < u64::MAX) => {
                    let Some(Ok(chunk)) = self.chunks.next() else { continue };
                    let at_ns = chunk.device_time_ns;
                    match due(chunk.channel) {
                        Due::Lidar => self.lidar.push(chunk),
                        Due::Ins => self.ins.push(chunk),
                        immediate => return Some((immediate, at_ns)),
                    }
                }
                _ if waiting == u64::MAX => return None,
                _ if lidar <= ins => {
                    self.lidar.take_until(lidar.saturating_add(PIECE_NS), piece);
                    return Some((Due::Lidar, lidar));
                }
                _ => {
                    self.ins.take_until(ins.saturating_add(PIECE_NS), piece);
                    return Some((Due::Ins, ins));
                }
            }
        }
    }

    /// What of the capture could not be read.
    pub fn damage(self) -> Vec<String> {
        self.damage
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::capture::Channel;

    fn chunk(channel: Channel, device_time_ns: u64, data: &[u8]) -> Result<Chunk, container::Error> {
        Ok(Chunk { channel, device_time_ns, data: data.to_vec() })
    }

    fn all(chunks: Vec<Result<Chunk, container::Error>>) -> Vec<(Due, u64, Vec<u8>)> {
        let mut schedule = Schedule::new(chunks.into_iter(), &Config::default());
        let mut piece = Vec::new();
        std::iter::from_fn(|| schedule.next(&mut piece).map(|(due, at)| (due, at, piece.clone()))).collect()
    }

    #[test]
    fn a_burst_goes_out_in_pieces_each_on_time() {
        // 20 us a byte at 500 kbaud: 25 bytes in half a millisecond.
        let telegram: Vec<u8> = (0..60).collect();
        let pieces = all(vec![chunk(Channel::Lidar, 7_000, &telegram)]);
        let at: Vec<_> = pieces.iter().map(|(_, at, bytes)| (*at, bytes.len())).collect();
        assert_eq!(at, [(7_000, 25), (507_000, 25), (1_007_000, 10)]);
        assert_eq!(pieces.iter().flat_map(|(.., bytes)| bytes.clone()).collect::<Vec<_>>(), telegram);
    }

    #[test]
    fn lines_interleave_and_a_pulse_is_not_held_up_by_a_burst() {
        let pieces = all(vec![
            chunk(Channel::Lidar, 0, &[1; 100]),
            chunk(Channel::Ins, 600_000, b"x"),
            chunk(Channel::Pps, 700_000, b""),
            chunk(Channel::Ins2, 700_001, b"y"),
        ]);
        let order: Vec<_> = pieces.iter().map(|(due, at, _)| (*due, *at)).collect();
        assert_eq!(
            order,
            [
                (Due::Lidar, 0),
                (Due::Lidar, 500_000),
                (Due::Ins, 600_000),
                (Due::Pulse, 700_000),
                (Due::Unplayed, 700_001),
                (Due::Lidar, 1_000_000),
                (Due::Lidar, 1_500_000),
            ]
        );
    }

    #[test]
    fn chunks_that_all_claim_one_instant_are_held_in_bounded_room() {
        let chunks = (0..4_000).map(|_| chunk(Channel::Lidar, 5, &[0; 1_000]));
        let mut schedule = Schedule::new(chunks, &Config::default());
        let (mut piece, mut bytes) = (Vec::new(), 0);
        while schedule.next(&mut piece).is_some() {
            bytes += piece.len();
            assert!(schedule.lidar.waiting() <= MAX_WAITING + 1_000);
        }
        assert_eq!(bytes, 4_000_000);
    }

    #[test]
    fn damage_is_told_and_what_follows_is_played() {
        let chunks =
            vec![chunk(Channel::Ins, 1, b"a"), Err(container::Error::Interrupted), chunk(Channel::Ins, 90_000, b"b")];
        let mut schedule = Schedule::new(chunks.into_iter(), &Config::default());
        let mut piece = Vec::new();
        let mut bytes = Vec::new();
        while schedule.next(&mut piece).is_some() {
            bytes.extend(&piece);
        }
        assert_eq!((bytes.as_slice(), schedule.damage()), (&b"ab"[..], vec!["interrupted".to_owned()]));
    }
}
