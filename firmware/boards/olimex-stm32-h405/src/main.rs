//! Crossfall on the Olimex STM32-H405: gives the firmware's tasks their peripherals and priorities.
//!
//! | priority | what |
//! |---|---|
//! | 1 | UARTs and pulse: stamp and store, nothing else; no critical section holds them off |
//! | 2 | SysTick: timers; wakes the readers of the above |
//! | 4 | acquisition executor: lines, decoding, link |
//! | 14 | survey executor |
//! | thread | sleeps |
//!
//! Both executors run in interrupts that the hardware does not use here, so that the thread may sleep with `wfi` (embassy's thread
//! executor waits for events, which keeps an emulator's host busy).
#![no_std]
#![no_main]

mod clocks;
mod critical;
mod emulation;
mod fault;
mod in_place;
mod log;
mod pins;
mod pulse;
mod ring;
mod stack;
mod time;
mod uart;
mod watchdog;

use core::cell::RefCell;
use core::fmt::Write as _;
use core::sync::atomic::{AtomicU32, Ordering};

use cortex_m::peripheral::scb::SystemHandler;
use cortex_m_rt::entry;
use crossfall_core::instrument::{Decode, FIRMWARE, Identity, Survey};
use crossfall_firmware::acquisition::{Acquisition, Shared};
use crossfall_firmware::lights::Lights;
use crossfall_firmware::outbox::{Outbox, Queue};
use crossfall_firmware::survey::Profiles;
use crossfall_firmware::work::{Places, WorkQueue, WorkReceiver, WorkSender};
use crossfall_firmware::{lights, link, now, sensors, survey};
use crossfall_protocol::Config;
use crossfall_protocol::message::Level;
use embassy_executor::{InterruptExecutor, Spawner};
use embassy_stm32::interrupt::{InterruptExt, Priority};
use embassy_stm32::peripherals::IWDG;
use embassy_stm32::{Peri, Peripherals, interrupt, pac};
use embassy_time::Timer;
use static_cell::{ConstStaticCell, StaticCell};

use clocks::{Clocks, Source};
use critical::{ANSWER, CEILING, STAMPS};
use emulation::Platform;
use fault::Restart;
use pins::LightPins;
use pulse::Pulses;
use uart::{Line, Port};

/// The link's rate: 22 kB/s of a survey in full flow fill a fifth of it, and 42 MHz divide into it without rest.
const LINK_BAUD: u32 = 1_000_000;

/// Growth of the used stack that is worth telling, in bytes.
const STACK_STEP: usize = 256;

/// What identifies this board in the hello.
const BOARD: &str = "olimex-stm32-h405";

/// Rings of 10 ms at 500 kbaud, 22 ms at 115,200 baud and 2.5 ms of commands; readers come every millisecond and hold 64 bytes meanwhile.
static LIDAR: Port<512, 64> = Port::new(pac::USART3);
static INS: Port<256, 64> = Port::new(pac::UART4);
static LINK: Port<256, 512> = Port::new(pac::USART2);

/// Bench messages on a wire of their own, for who has no probe; nothing is received.
pub static BENCH: Port<1, 256> = Port::new(pac::USART1);
const BENCH_BAUD: u32 = 115_200;

static ACQUISITION: InterruptExecutor = InterruptExecutor::new();
static SURVEY: InterruptExecutor = InterruptExecutor::new();

static PROFILES: Profiles = Profiles::new();

/// Advanced at the survey's priority: proof that it has not stopped.
static ALIVE: AtomicU32 = AtomicU32::new(0);

/// What the acquisition tasks take over from `main`.
struct Parts {
    restart: Restart,
    clocks: Clocks,
    platform: Platform,
    lights: LightPins,
    watchdog: Peri<'static, IWDG>,
    work: WorkSender<'static>,
}

#[entry]
fn main() -> ! {
    let restart = fault::take();
    let platform = emulation::detect();
    let clocks = clocks::start(platform);
    if platform == Platform::Emulated {
        uart::lines_are_emulated();
    }
    log::start();
    // SAFETY: the one and only time that the peripherals are taken; embassy's own `init`, which would hand them out, waits
    // for ready flags that the emulator does not have and is not used.
    let (peripherals, mut core) = unsafe { (Peripherals::steal(), cortex_m::Peripherals::steal()) };
    let (lights, watchdog) = pins::start(peripherals);

    // SAFETY: before any interrupt is enabled.
    unsafe { core.SCB.set_priority(SystemHandler::SysTick, u8::from(CEILING)) };
    answer_bells();
    interrupt::CAN2_RX0.set_priority(Priority::P4);
    interrupt::CAN2_RX1.set_priority(Priority::P14);
    time::start(&clocks, &mut core.SYST);

    static PLACES: ConstStaticCell<Places> = ConstStaticCell::new(Places::new());
    static WORK: StaticCell<WorkQueue<'static>> = StaticCell::new();
    let (sender, receiver) = WORK.init_with(|| WorkQueue::new(PLACES.take())).split();

    let spawner = SURVEY.start(interrupt::CAN2_RX1);
    spawner.spawn(survey_task(receiver).expect("spawned once"));
    spawner.spawn(heartbeat().expect("spawned once"));
    let parts = Parts { restart, clocks, platform, lights, watchdog, work: sender };
    ACQUISITION.start(interrupt::CAN2_RX0).spawn(acquisition(parts).expect("spawned once"));
    loop {
        cortex_m::asm::wfi();
    }
}

/// Opens the lines, says hello and starts the tasks of the acquisition executor.
#[embassy_executor::task]
async fn acquisition(parts: Parts) {
    let Parts { restart, clocks, platform, lights, watchdog, work } = parts;
    let config = Config::default();
    let mut identity = Identity { firmware: FIRMWARE, board: BOARD, boot: restart.boot, ..Identity::default() };
    for letter in restart.reason().chars() {
        let _cut = identity.restart.push(letter);
    }

    static QUEUED: StaticCell<Queue> = StaticCell::new();
    static DECODE: StaticCell<Decode> = StaticCell::new();
    static OUTBOX: StaticCell<Outbox<'static>> = StaticCell::new();
    static SHARED: StaticCell<Shared<'static>> = StaticCell::new();
    let queue = &*QUEUED.init_with(Queue::new);
    let decode = in_place::decode(DECODE.uninit(), &config, &identity);
    let outbox = OUTBOX.init_with(|| Outbox::new(queue));
    let shared = &*SHARED.init_with(|| RefCell::new(Acquisition::new(decode, outbox, work)));

    let open = |line: interrupt::Interrupt| {
        line.set_priority(STAMPS);
        // SAFETY: the port behind it is open.
        unsafe { line.enable() };
    };
    let lidar = LIDAR.open(clocks.apb1_hz, config.scanner.baud);
    let ins = INS.open(clocks.apb1_hz, config.ins.baud);
    let (commands, frames) = LINK.open(clocks.apb1_hz, LINK_BAUD).split();
    BENCH.open_to_send(clocks.apb2_hz, BENCH_BAUD);
    let pulses = match platform {
        Platform::Silicon => Pulses::capture(),
        Platform::Emulated => Pulses::from_bytes(),
    };
    use Interrupt::{TIM5, UART4, UART5, USART1, USART2, USART3};
    use interrupt::Interrupt;
    for line in [USART1, USART2, USART3, UART4, UART5, TIM5] {
        open(line);
    }

    shared.borrow_mut().start(now());
    tell(shared, &clocks);

    // SAFETY: awaited inside a task of this executor, whose tasks these become.
    let spawner = unsafe { Spawner::for_current_executor().await };
    spawner.spawn(scanner(shared, lidar).expect("spawned once"));
    spawner.spawn(inertial(shared, ins).expect("spawned once"));
    spawner.spawn(pulse(shared, pulses).expect("spawned once"));
    spawner.spawn(link_tasks(shared, queue, commands, frames).expect("spawned once"));
    spawner.spawn(light_tasks(shared, lights).expect("spawned once"));
    spawner.spawn(feed(watchdog).expect("spawned once"));
    spawner.spawn(watch_stack(shared).expect("spawned once"));
    defmt::info!("{} on {}, boot {}, {}", FIRMWARE, BOARD, restart.boot, clocks.source);
}

/// What of the start is not as it should be goes into the stream.
fn tell(shared: &Shared<'_>, clocks: &Clocks) {
    let text = match clocks.source {
        Source::Crystal | Source::Emulated => return,
        Source::Internal => "clocks: the crystal does not start; 168 MHz from the internal oscillator, good to 1 %",
        Source::InternalSlow => "clocks: neither crystal nor PLL start; 16 MHz from the internal oscillator",
    };
    shared.borrow_mut().log(now(), Level::Warn, text.as_bytes());
}

#[embassy_executor::task]
async fn scanner(shared: &'static Shared<'static>, line: Line<512, 64>) {
    sensors::scanner(shared, line).await
}

#[embassy_executor::task]
async fn inertial(shared: &'static Shared<'static>, line: Line<256, 64>) {
    sensors::inertial(shared, line).await
}

#[embassy_executor::task]
async fn pulse(shared: &'static Shared<'static>, pulses: Pulses) {
    sensors::pulse(shared, pulses).await
}

#[embassy_executor::task]
async fn link_tasks(
    shared: &'static Shared<'static>,
    queue: &'static Queue,
    commands: uart::Receiver<256, 512>,
    frames: uart::Sender<256, 512>,
) {
    embassy_futures::join::join5(
        link::send(queue, frames),
        link::receive(shared, commands),
        link::profiles(shared, PROFILES.receiver()),
        link::log(shared, &log::PIPE),
        link::time(shared),
    )
    .await;
}

#[embassy_executor::task]
async fn light_tasks(shared: &'static Shared<'static>, pins: LightPins) {
    let LightPins { running, lock, fault } = pins;
    lights::lights(shared, Lights { running, lock, fault }).await
}

#[embassy_executor::task]
async fn feed(watchdog: Peri<'static, IWDG>) {
    watchdog::feed(watchdog, || ALIVE.load(Ordering::Relaxed)).await
}

#[embassy_executor::task]
async fn survey_task(work: WorkReceiver<'static>) {
    static STATE: StaticCell<Survey> = StaticCell::new();
    survey::survey(in_place::survey(STATE.uninit()), work, PROFILES.sender()).await
}

#[embassy_executor::task]
async fn heartbeat() {
    loop {
        ALIVE.store(ALIVE.load(Ordering::Relaxed).wrapping_add(1), Ordering::Relaxed);
        Timer::after_millis(100).await;
    }
}

/// Tells how much stack has ever been used, whenever that has become noticeably more.
#[embassy_executor::task]
async fn watch_stack(shared: &'static Shared<'static>) {
    let mut told = 0;
    loop {
        let used = stack::high_water();
        if used >= told + STACK_STEP {
            told = used;
            let mut line: heapless::String<48> = heapless::String::new();
            if write!(line, "stack: {used} of {} bytes used at most", stack::size()).is_ok() {
                shared.borrow_mut().log(now(), Level::Info, line.as_bytes());
            }
        }
        Timer::after_secs(10).await;
    }
}

#[interrupt]
fn CAN2_RX0() {
    // SAFETY: this is the executor's interrupt, enabled by its start.
    unsafe { ACQUISITION.on_interrupt() }
}

#[interrupt]
fn CAN2_RX1() {
    // SAFETY: likewise.
    unsafe { SURVEY.on_interrupt() }
}

/// Turns the interrupt on that wakes what the stamping ones have rung for.
fn answer_bells() {
    ANSWER.set_priority(CEILING);
    // SAFETY: it shares nothing with code that runs before.
    unsafe { ANSWER.enable() };
}

#[interrupt]
fn CAN1_RX0() {
    LIDAR.answer();
    INS.answer();
    LINK.answer();
    pulse::answer();
}

#[interrupt]
fn USART1() {
    BENCH.on_interrupt(time::counter());
}

#[interrupt]
fn USART2() {
    LINK.on_interrupt(time::counter());
}

#[interrupt]
fn USART3() {
    LIDAR.on_interrupt(time::counter());
}

#[interrupt]
fn UART4() {
    INS.on_interrupt(time::counter());
}
