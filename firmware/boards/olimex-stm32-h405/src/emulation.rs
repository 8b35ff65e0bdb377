//! Whether the image runs on silicon or in QEMU's `olimex-stm32-h405`: asked once, at boot, of the hardware itself.
//!
//! One image serves both, so that what the tests run is what a user flashes. The differences are kept to the callers of
//! [`detect`]: clocks are not to be switched (QEMU's RCC has no ready flags), timers 2 to 5 run from 1 GHz, lines have no
//! rate of their own (`uart.rs`), and the pulse per second, which has no pin in QEMU, arrives as a byte on UART5.

use core::hint::black_box;

use embassy_stm32::pac;
use embassy_stm32::pac::flash::vals::Latency;

/// What the image runs on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Platform {
    /// An STM32F405.
    Silicon,
    /// QEMU.
    Emulated,
}

/// Tells silicon from QEMU: the flash's wait states, once set, read back on silicon (RM0090, 3.9.1) and as 0 in QEMU.
///
/// Sets five wait states, which is what 168 MHz needs and any lower clock tolerates.
pub fn detect() -> Platform {
    pac::FLASH.acr().modify(|w| w.set_latency(Latency::WS5));
    match pac::FLASH.acr().read().latency() {
        Latency::WS5 => Platform::Silicon,
        _ => Platform::Emulated,
    }
}

/// Makes the board fail as it never should, so that tests see what it then says of itself. Called for bytes of UART5, which
/// only the emulated board listens to.
pub fn provoke(byte: u8) {
    match byte {
        0xf0 => panic!("provoked by the bench"),
        0xf1 => cortex_m::asm::udf(),
        0xf2 => {
            black_box(descend(black_box(u32::MAX)));
        }
        _ => {}
    }
}

/// Takes stack until there is none.
#[expect(unconditional_recursion, reason = "it is to overflow the stack")]
#[inline(never)]
fn descend(depth: u32) -> u32 {
    let frame = black_box([depth; 32]);
    descend(frame[7].wrapping_sub(1)).wrapping_add(frame[3])
}
