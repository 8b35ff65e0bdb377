//! A ring between an interrupt and a task: one producer, one consumer, no lock.
//!
//! Interrupts that stamp are never held off (`critical.rs`), so what they share with tasks may not rely on a critical section. Either end owns
//! one of two counters and reads the other; a place is written before its counter says so.

use core::sync::atomic::{AtomicU8, AtomicU32, Ordering};

/// One place of a ring.
pub trait Place {
    /// What it holds.
    type Value: Copy;
    /// A place before anything was in it.
    const EMPTY: Self;
    fn get(&self) -> Self::Value;
    fn set(&self, value: Self::Value);
}

impl Place for AtomicU8 {
    type Value = u8;
    const EMPTY: Self = Self::new(0);

    fn get(&self) -> u8 {
        self.load(Ordering::Relaxed)
    }

    fn set(&self, value: u8) {
        self.store(value, Ordering::Relaxed);
    }
}

impl Place for AtomicU32 {
    type Value = u32;
    const EMPTY: Self = Self::new(0);

    fn get(&self) -> u32 {
        self.load(Ordering::Relaxed)
    }

    fn set(&self, value: u32) {
        self.store(value, Ordering::Relaxed);
    }
}

/// `N` places, a power of two.
pub struct Ring<P, const N: usize> {
    places: [P; N],
    /// Values ever put in and ever taken out; their difference is what the ring holds.
    put: AtomicU32,
    taken: AtomicU32,
}

impl<P: Place, const N: usize> Ring<P, N> {
    /// An empty ring.
    pub const fn new() -> Self {
        const { assert!(N.is_power_of_two()) };
        Self { places: [const { P::EMPTY }; N], put: AtomicU32::new(0), taken: AtomicU32::new(0) }
    }

    /// Values that it holds.
    pub fn held(&self) -> usize {
        self.put.load(Ordering::Acquire).wrapping_sub(self.taken.load(Ordering::Acquire)) as usize
    }

    /// Puts a value in, if there is room; the answer is whether there was. For the producer only.
    pub fn push(&self, value: P::Value) -> bool {
        if self.held() >= N {
            return false;
        }
        let put = self.put.load(Ordering::Relaxed);
        self.places[put as usize % N].set(value);
        self.put.store(put.wrapping_add(1), Ordering::Release);
        true
    }

    /// Value `k`, counted from the oldest, of those that it holds. For the consumer only.
    pub fn peek(&self, k: usize) -> P::Value {
        let at = (self.taken.load(Ordering::Relaxed) as usize).wrapping_add(k);
        self.places[at % N].get()
    }

    /// Lets go of the oldest values, of which there are at least so many. For the consumer only.
    pub fn let_go(&self, count: usize) {
        let taken = self.taken.load(Ordering::Relaxed);
        self.taken.store(taken.wrapping_add(count as u32), Ordering::Release);
    }

    /// Takes the oldest value out. For the consumer only.
    pub fn pop(&self) -> Option<P::Value> {
        if self.held() == 0 {
            return None;
        }
        let value = self.peek(0);
        self.let_go(1);
        Some(value)
    }
}
