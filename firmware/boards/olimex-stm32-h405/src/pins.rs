//! Which pin does what. `docs/hardware.md` has the wiring; alternate functions are those of the datasheet's table 9.

use embassy_stm32::gpio::{AfType, AnyPin, Flex, Level, Output, OutputType, Pin, Pull, Speed};
use embassy_stm32::peripherals::IWDG;
use embassy_stm32::{Peri, Peripherals, pac};

/// Alternate functions of TIM5, USART1 to USART3, UART4.
const TIM3_5: u8 = 2;
const USART1_3: u8 = 7;
const UART4_6: u8 = 8;

/// The three lights.
pub struct LightPins {
    /// PC12: the board's own LED, which lights when the pin is low.
    pub running: Inverted,
    /// PC6.
    pub lock: Output<'static>,
    /// PC7.
    pub fault: Output<'static>,
}

/// An output whose light is on when the pin is low.
pub struct Inverted(Output<'static>);

impl embedded_hal::digital::ErrorType for Inverted {
    type Error = core::convert::Infallible;
}

impl embedded_hal::digital::OutputPin for Inverted {
    fn set_low(&mut self) -> Result<(), Self::Error> {
        self.0.set_high();
        Ok(())
    }

    fn set_high(&mut self) -> Result<(), Self::Error> {
        self.0.set_low();
        Ok(())
    }
}

/// Clocks the ports and the lines' peripherals and gives every pin its function. What it does not use comes back.
pub fn start(p: Peripherals) -> (LightPins, Peri<'static, IWDG>) {
    pac::RCC.ahb1enr().modify(|w| {
        w.set_gpioaen(true);
        w.set_gpioben(true);
        w.set_gpiocen(true);
    });
    pac::RCC.apb1enr().modify(|w| {
        w.set_tim5en(true);
        w.set_usart2en(true);
        w.set_usart3en(true);
        w.set_uart4en(true);
        w.set_uart5en(true);
    });
    pac::RCC.apb2enr().modify(|w| w.set_usart1en(true));
    send(p.PA2, USART1_3);
    receive(p.PA3, USART1_3);
    send(p.PB10, USART1_3);
    receive(p.PB11, USART1_3);
    send(p.PC10, UART4_6);
    receive(p.PC11, UART4_6);
    receive(p.PA1, TIM3_5);
    send(p.PA9, USART1_3);
    let lights = LightPins {
        running: Inverted(Output::new(p.PC12, Level::Low, Speed::Low)),
        lock: Output::new(p.PC6, Level::Low, Speed::Low),
        fault: Output::new(p.PC7, Level::Low, Speed::Low),
    };
    (lights, p.IWDG)
}

fn send(pin: Peri<'static, impl Pin>, function: u8) {
    attach(pin.into(), function, AfType::output(OutputType::PushPull, Speed::Medium));
}

/// Pulled up: an open line is idle, not a break.
fn receive(pin: Peri<'static, impl Pin>, function: u8) {
    attach(pin.into(), function, AfType::input(Pull::Up));
}

fn attach(pin: Peri<'static, AnyPin>, function: u8, kind: AfType) {
    let mut pin = Flex::new(pin);
    pin.set_as_af_unchecked(function, kind);
    // Dropping it would take the function away again.
    core::mem::forget(pin);
}
