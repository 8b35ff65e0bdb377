//! The clock tree (RM0090, section 7): 168 MHz from the board's 8 MHz crystal.
//!
//! Every wait is bounded. When the crystal does not start, the internal 16 MHz oscillator feeds the PLL instead (1 %:
//! the sensors' lines still work, device time drifts and the clock estimator follows it); when even the PLL does not
//! lock, the core runs from the 16 MHz directly. Which of the three it became is reported with the hello.

use embassy_stm32::pac;
use embassy_stm32::pac::rcc::vals::{Hpre, Pllm, Plln, Pllp, Pllsrc, Ppre, Sw};

use crate::emulation::Platform;

/// Where the clocks come from.
#[derive(Clone, Copy, Debug, PartialEq, Eq, defmt::Format)]
pub enum Source {
    /// 168 MHz from the crystal.
    Crystal,
    /// 168 MHz from the internal oscillator: the crystal did not start.
    Internal,
    /// 16 MHz straight from the internal oscillator: the PLL did not lock either.
    InternalSlow,
    /// QEMU's fixed clocks.
    Emulated,
}

/// The frequencies that drivers need.
#[derive(Clone, Copy, Debug)]
pub struct Clocks {
    /// Where they come from.
    pub source: Source,
    /// Core and SysTick.
    pub core_hz: u32,
    /// USART2, USART3, UART4, UART5.
    pub apb1_hz: u32,
    /// USART1.
    pub apb2_hz: u32,
    /// TIM5, before its prescaler.
    pub timer_hz: u32,
}

/// Polls of a ready flag before giving up: about 60 ms at 16 MHz, an order above the crystal's start-up time.
const PATIENCE: u32 = 100_000;

fn wait(mut ready: impl FnMut() -> bool) -> bool {
    (0..PATIENCE).any(|_| ready())
}

/// Brings the clocks up and says what they are. Called once, before any driver.
pub fn start(platform: Platform) -> Clocks {
    if platform == Platform::Emulated {
        // QEMU: the machine's SysTick runs at 168 MHz, timers at 1 GHz; UARTs do not mind their baud rate.
        let (core_hz, apb1_hz, apb2_hz) = (168_000_000, 42_000_000, 84_000_000);
        return Clocks { source: Source::Emulated, core_hz, apb1_hz, apb2_hz, timer_hz: 1_000_000_000 };
    }
    pac::FLASH.acr().modify(|w| {
        w.set_prften(true);
        w.set_icen(true);
        w.set_dcen(true);
    });
    let rcc = pac::RCC;
    rcc.cr().modify(|w| w.set_hseon(true));
    let crystal = wait(|| rcc.cr().read().hserdy());
    if !crystal {
        rcc.cr().modify(|w| w.set_hseon(false));
    }
    // 2 MHz into the PLL (7.3.2: recommended against jitter), x 168 / 2.
    rcc.pllcfgr().modify(|w| {
        w.set_pllsrc(if crystal { Pllsrc::HSE } else { Pllsrc::HSI });
        w.set_pllm(if crystal { Pllm::DIV4 } else { Pllm::DIV8 });
        w.set_plln(Plln::MUL168);
        w.set_pllp(Pllp::DIV2);
    });
    rcc.cr().modify(|w| w.set_pllon(true));
    if !wait(|| rcc.cr().read().pllrdy()) {
        let all_hz = 16_000_000;
        return Clocks {
            source: Source::InternalSlow,
            core_hz: all_hz,
            apb1_hz: all_hz,
            apb2_hz: all_hz,
            timer_hz: all_hz,
        };
    }
    // The dividers first: APB1 may not exceed 42 MHz, APB2 84 MHz. A divided bus clocks its timers at twice its rate.
    rcc.cfgr().modify(|w| {
        w.set_hpre(Hpre::DIV1);
        w.set_ppre1(Ppre::DIV4);
        w.set_ppre2(Ppre::DIV2);
    });
    rcc.cfgr().modify(|w| w.set_sw(Sw::PLL1_P));
    // The switch takes a few cycles of a clock that is known to run.
    let _ = wait(|| rcc.cfgr().read().sws() == Sw::PLL1_P);
    Clocks {
        source: if crystal { Source::Crystal } else { Source::Internal },
        core_hz: 168_000_000,
        apb1_hz: 42_000_000,
        apb2_hz: 84_000_000,
        timer_hz: 84_000_000,
    }
}
