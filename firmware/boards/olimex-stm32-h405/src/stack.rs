//! How much stack was ever used.
//!
//! cortex-m-rt paints the stack at start-up; what is no longer paint has been used. One stack serves all priorities.

use cortex_m_rt::STACK_PAINT_VALUE;

unsafe extern "C" {
    static _stack_end: u32;
    static _stack_start: u32;
}

/// The lowest address of the stack and the one above its highest.
fn bounds() -> (*const u32, *const u32) {
    (&raw const _stack_end, &raw const _stack_start)
}

/// Bytes of stack there are.
pub fn size() -> usize {
    let (end, start) = bounds();
    start as usize - end as usize
}

/// Bytes of stack used at most since boot. Walks the untouched part: up to 4,096 loads.
pub fn high_water() -> usize {
    let (mut at, start) = bounds();
    // SAFETY: from `_stack_end` to `_stack_start` is RAM that belongs to the stack; volatile, as code below us may be
    // writing to it, which changes at most when the walk stops.
    while at < start && unsafe { at.read_volatile() } == STACK_PAINT_VALUE {
        at = at.wrapping_add(1);
    }
    start as usize - at as usize
}
