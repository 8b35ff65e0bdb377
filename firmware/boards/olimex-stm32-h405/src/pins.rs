//! Which pin does what. `docs/hardware.md` has the wiring.
pub fn start() {
    use embassy_stm32::pac;
    pac::RCC.ahb1enr().modify(|w| {
        w.set_gpioaen(true);
        w.set_gpioben(true);
        w.set_gpiocen(true);
        w.set_gpioden(true);
    });
    pac::RCC.apb1enr().modify(|w| {
        w.set_usart2en(true);
        w.set_usart3en(true);
        w.set_uart4en(true);
        w.set_uart5en(true);
    });
}
