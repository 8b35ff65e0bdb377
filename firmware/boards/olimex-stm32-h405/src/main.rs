//! Crossfall on the Olimex STM32-H405.
#![no_std]
#![no_main]

mod clocks;
mod emulation;
mod fault;
mod pins;
mod pulse;
mod stack;
mod time;
mod uart;
mod watchdog;

use cortex_m_rt::entry;
use embassy_executor::InterruptExecutor;
use embassy_stm32::interrupt::{InterruptExt, Priority};
use embassy_stm32::{Peripherals, interrupt, pac};
use embassy_time::Timer;
use embedded_io_async::{Read, Write};
use rtt_target as _;

use emulation::Platform;
use uart::{Line, Port};

static LINK: Port<256, 512> = Port::new(pac::USART2);
static LIDAR: Port<512, 64> = Port::new(pac::USART3);
static INS: Port<256, 64> = Port::new(pac::UART4);

static ACQUISITION: InterruptExecutor = InterruptExecutor::new();

#[embassy_executor::task]
async fn hello(mut link: Line<256, 512>) {
    loop {
        let mut b = [0; 32];
        let _ = embassy_futures_select(&mut link, &mut b).await;
    }
}
async fn embassy_futures_select(link: &mut Line<256, 512>, b: &mut [u8]) {
    Timer::after_millis(500).await;
    let _ = link.write_all(b"hello ").await;
    let mut t = embassy_time::Instant::now().as_micros();
    for i in 0..12 {
        b[11 - i] = b'0' + (t % 10) as u8;
        t /= 10;
    }
    let _ = link.write_all(&b[..12]).await;
    let _ = link.write_all(b"\n").await;
}

#[entry]
fn main() -> ! {
    let restart = fault::take();
    let platform = emulation::detect();
    let clocks = clocks::start(platform);
    let mut core = cortex_m::Peripherals::take().unwrap();
    // SAFETY:
    let p = unsafe { Peripherals::steal() };
    pins::start();
    time::start(&clocks, &mut core.SYST);
    let link = LINK.open(clocks.apb1_hz, 1_000_000);
    interrupt::USART2.set_priority(Priority::P1);
    unsafe { interrupt::USART2.enable() };
    interrupt::SPI1.set_priority(Priority::P6);
    let spawner = ACQUISITION.start(interrupt::SPI1);
    spawner.spawn(hello(link).unwrap());
    loop {
        cortex_m::asm::wfi();
    }
}

#[interrupt]
unsafe fn SPI1() {
    unsafe { ACQUISITION.on_interrupt() }
}

#[interrupt]
fn USART2() {
    LINK.on_interrupt(time::counter());
}
