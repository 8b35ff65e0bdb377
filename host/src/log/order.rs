//! Frames in the order in which they were written, each once, whatever a disk has made of their blocks.
//!
//! A writer numbers its records. So a block that a disk has written twice shows by records whose numbers, times and frames were read before: they are left
//! out, and counted. Blocks in each other's place show by numbers that are ahead of what comes next, and by frames with the numbers in between a
//! little further on: these are read first, and passed over when their place is reached. Frames are told apart over the last [`SLOTS`] records.
//!
//! A frame whose record's head lies in another block proves neither number nor time. It has those that the record beside it says.
//!
//! Costs nothing where numbers go on by one: one comparison and one entry a frame.

use std::collections::{BTreeMap, HashSet};
use std::ops::Range;

use super::salvage;
use crate::container::Message;

/// Records that are known again.
const SLOTS: usize = 1 << 16;

/// Records among which one is looked for that does not say its number.
const RECENT: u32 = 1 << 12;

/// Numbers that must be missing before they are looked for further on: one frame is lost more easily than a block is moved.
const LEAST_MISSING: u32 = 2;

/// What has been read.
#[derive(Debug, Default)]
pub struct Order {
    /// Of each record number and time, in the slot of the number; 0 where none is.
    heads: Vec<u64>,
    /// Of its frame, beside it.
    prints: Vec<u64>,
    /// Number of the record that was read last, and its time.
    last: Option<(u32, u64)>,
    /// Records that were read before their place was reached.
    ahead: HashSet<u32>,
    /// Frames under way that were read before: where, and how many.
    twice: Option<(Range<u64>, u64)>,
    /// All of these.
    frames_twice: u64,
}

/// Messages in their order.
#[derive(Debug, Default)]
pub struct Settled {
    pub messages: Vec<Message>,
    /// What is to be told before which of them, and where it was found.
    pub told: Vec<(usize, Range<u64>, String)>,
    /// Bytes of copies of records that were cut.
    pub broken: u64,
}

impl Order {
    /// Takes note of messages as long as they follow each other; how many do.
    pub fn follow(&mut self, messages: &[Message]) -> usize {
        if self.twice.is_some() {
            return 0;
        }
        for (number, message) in messages.iter().enumerate() {
            if self.last.is_some_and(|(last, _)| message.sequence != last.wrapping_add(1))
                || !salvage::is_certain(message)
            {
                return number;
            }
            self.note(message);
        }
        messages.len()
    }

    /// Puts messages into their order, of which the first `straight` are in it. `look` finds the frames behind a place of the file.
    pub fn settle(
        &mut self,
        mut messages: Vec<Message>,
        straight: usize,
        mut look: impl FnMut(u64) -> Vec<Message>,
    ) -> Settled {
        let mut rest = messages.split_off(straight).into_iter().peekable();
        let mut settled = Settled { messages, ..Settled::default() };
        // Number of the record that was left out just before.
        let mut left_out = None;
        while let Some(message) = rest.next() {
            if !salvage::is_certain(&message) {
                let behind = rest.peek().filter(|next| salvage::is_certain(next) && self.is_known(next));
                let beside = left_out.map(|left: u32| left.wrapping_add(1));
                left_out = self.headless(beside.or_else(|| behind.map(|next| next.sequence.wrapping_sub(1))), &message);
                match left_out {
                    Some(number) => self.leave_out(number, &message),
                    None => settled.messages.push(message),
                }
                continue;
            }
            if self.is_known(&message) {
                left_out = Some(message.sequence);
                self.leave_out(message.sequence, &message);
                continue;
            }
            if self.has_head(&message) && !salvage::is_frame(&message.data) {
                settled.broken += extent(&message).end - message.offset;
                continue;
            }
            left_out = None;
            if let Some((place, what)) = self.told_twice() {
                settled.told.push((settled.messages.len(), place, what));
            }
            let missing = self.last.map_or(0, |(last, _)| message.sequence.wrapping_sub(last).wrapping_sub(1));
            self.number(missing, &settled.messages);
            if (LEAST_MISSING..SLOTS as u32).contains(&missing) {
                self.read_ahead(&message, look(message.offset), &mut settled);
            }
            self.note(&message);
            settled.messages.push(message);
        }
        settled
    }

    /// Takes note of the frames without a number that were read last, if they are as many as numbers are missing behind them.
    fn number(&mut self, missing: u32, messages: &[Message]) {
        let Some((last, _)) = self.last else { return };
        let headless = messages.iter().rev().take_while(|message| !salvage::is_certain(message)).count();
        if headless > 0 && missing as usize == headless {
            for (message, step) in messages[messages.len() - headless..].iter().zip(1..) {
                let number = last.wrapping_add(step);
                self.enter(message, number);
                self.heads[number as usize % SLOTS] = UNTOLD;
            }
        }
    }

    /// Of frames found further on those that were written before this one, in front of it.
    fn read_ahead(&mut self, message: &Message, found: Vec<Message>, settled: &mut Settled) {
        let Some((last, last_ns)) = self.last else { return };
        let missing = message.sequence.wrapping_sub(last).wrapping_sub(1);
        // A number that is ahead alone is a damaged one.
        let behind = found.iter().find(|one| one.offset > message.offset && salvage::is_certain(one));
        if behind.is_none_or(|behind| behind.sequence != message.sequence.wrapping_add(1)) {
            return;
        }
        // By how far each is behind the last one, of which 1 is the next.
        let mut between: BTreeMap<u32, (Message, Option<Message>)> = BTreeMap::new();
        let mut doubtful = None;
        for one in found {
            if !salvage::is_certain(&one) {
                doubtful = Some(one);
                continue;
            }
            let (before, step) = (doubtful.take(), one.sequence.wrapping_sub(last));
            let fits = (1..=missing).contains(&step) && (last_ns..=message.log_time).contains(&one.log_time);
            if fits && !self.is_known(&one) {
                between.entry(step).or_insert((one, before));
            }
        }
        let (mut taken, mut places): (Vec<Message>, Option<Range<u64>>) = (Vec::new(), None);
        let (mut before_step, mut before_ns) = (0, last_ns);
        for (step, (one, headless)) in between {
            if one.log_time < before_ns {
                continue;
            }
            let place = extent(&one);
            places = Some(places.map_or(place.clone(), |all| all.start.min(place.start)..all.end.max(place.end)));
            if let Some(mut headless) = headless.filter(|_| step > before_step + 1) {
                headless.sequence = one.sequence.wrapping_sub(1);
                self.enter(&headless, headless.sequence);
                taken.push(headless);
            }
            self.enter(&one, one.sequence);
            (before_step, before_ns) = (step, one.log_time);
            taken.push(one);
        }
        let Some(places) = places else { return };
        // Those without a number that stand here belong to what comes, or are one of it: the other is left out when its place is reached.
        let certain = settled.messages.iter().rposition(salvage::is_certain).map_or(0, |last| last + 1);
        let mut headless = settled.messages.split_off(certain);
        let here = headless.first().map_or(message.offset, |first| first.offset);
        let prints: HashSet<u64> = headless.iter().map(|one| print(&one.data)).collect();
        let moved = |one: &&Message| !prints.contains(&print(&one.data));
        let ahead = self.ahead.len();
        self.ahead.extend(taken.iter().filter(moved).map(|one| one.sequence));
        if self.ahead.len() > ahead {
            let what =
                format!("{} frames stand behind later ones; they are read in their order", self.ahead.len() - ahead);
            settled.told.push((certain, places, what));
        }
        let taken_prints: HashSet<u64> = taken.iter().map(|one| print(&one.data)).collect();
        headless.retain(|one| !taken_prints.contains(&print(&one.data)));
        // Places rise: what is read here has the place of what it stands before.
        for one in &mut taken {
            one.offset = here;
        }
        settled.messages.append(&mut taken);
        settled.messages.append(&mut headless);
    }

    /// Frames that stand twice, once those behind them have come or none does.
    pub fn told_twice(&mut self) -> Option<(Range<u64>, String)> {
        let (place, count) = self.twice.take()?;
        let what = match count {
            1 => "1 frame stands here a second time, and is read once".to_owned(),
            _ => format!("{count} frames stand here a second time, and are read once"),
        };
        Some((place, what))
    }

    /// Frames that stood in the file a second time, so far.
    pub fn frames_twice(&self) -> u64 {
        self.frames_twice
    }

    fn leave_out(&mut self, number: u32, message: &Message) {
        if self.ahead.remove(&number) {
            return;
        }
        self.frames_twice += 1;
        let place = extent(message);
        let (all, count) = self.twice.take().unwrap_or((place.clone(), 0));
        self.twice = Some((all.start..all.end.max(place.end), count + 1));
    }

    fn note(&mut self, message: &Message) {
        self.last = Some((message.sequence, message.log_time));
        self.enter(message, message.sequence);
    }

    fn enter(&mut self, message: &Message, number: u32) {
        if self.heads.is_empty() {
            (self.heads, self.prints) = (vec![0; SLOTS], vec![0; SLOTS]);
        }
        let slot = number as usize % SLOTS;
        (self.heads[slot], self.prints[slot]) = (head(message), print(&message.data));
    }

    fn has_head(&self, message: &Message) -> bool {
        self.heads.get(message.sequence as usize % SLOTS).is_some_and(|&found| found == head(message))
    }

    fn has_print(&self, number: u32, message: &Message) -> bool {
        let slot = number as usize % SLOTS;
        self.heads.get(slot).is_some_and(|&head| head != 0) && self.prints.get(slot) == Some(&print(&message.data))
    }

    /// The number of a frame whose record does not say it, if it was read before: as the record beside it says, or among the last ones.
    fn headless(&self, beside: Option<u32>, message: &Message) -> Option<u32> {
        let recent = self.last.into_iter().flat_map(|(last, _)| (0..RECENT).map(move |back| last.wrapping_sub(back)));
        let mut likely = beside.into_iter().chain(self.ahead.iter().copied()).chain(recent);
        likely.find(|&number| self.has_print(number, message))
    }

    fn is_known(&self, message: &Message) -> bool {
        let untold = self.heads.get(message.sequence as usize % SLOTS) == Some(&UNTOLD);
        (untold || self.has_head(message)) && self.has_print(message.sequence, message)
    }
}

fn extent(message: &Message) -> Range<u64> {
    message.offset..salvage::end(message)
}

/// In place of a number and a time that no record tells.
const UNTOLD: u64 = 1;

/// Number and time of a record in one number, never 0. No writer gives both to two records.
fn head(message: &Message) -> u64 {
    message.log_time.wrapping_mul(0x9e37_79b9_7f4a_7c15).wrapping_add(u64::from(message.sequence)).max(UNTOLD + 1)
}

/// A frame's first and last bytes, which have its own number and its CRC, and its length.
fn print(data: &[u8]) -> u64 {
    let first = data.first_chunk().map_or(0, |bytes| u64::from_le_bytes(*bytes));
    let last = data.last_chunk().map_or(0, |bytes| u64::from_le_bytes(*bytes));
    let short = if data.len() < 8 { u64::from(crc32fast::hash(data)) } else { 0 };
    first.wrapping_mul(0xff51_afd7_ed55_8ccd) ^ last.rotate_left(32) ^ (data.len() as u64) << 1 ^ short
}
