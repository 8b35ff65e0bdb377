//! Proves at link time that nothing in the core and in the protocol can panic.
//!
//! Its panic handler calls a function that does not exist. Whatever the optimiser cannot show to be free of panics keeps that call,
//! and the image does not link. Both layers of the instrument are run over inputs that the compiler cannot know, with all
//! that a board does with their events, for both kinds of scanner. What the map of elevation
//! and risk does is proved by an image of its own, `proof_map`: both do not fit into the chip's flash.
#![no_std]
#![no_main]

use core::hint::black_box;
use core::panic::PanicInfo;

use cortex_m_rt::entry;
use crossfall_core::instrument::{Decode, Event, Identity, Survey};
use crossfall_core::scan::RawScan;
use crossfall_core::sensors::cola;
use crossfall_core::sensors::lms2xx::{self, bring_up as scanner_up};
use crossfall_core::sensors::novatel::{self, bring_up as unit_up};
use crossfall_protocol::frame::{self, BoardDecoder, MAX_MESSAGE_FRAME, Sequencer};
use crossfall_protocol::message::Message;
use crossfall_protocol::ranges::MAX_CODE;
use crossfall_protocol::{Config, DeviceTime};
use embassy_stm32 as _;

unsafe extern "C" {
    /// Defined nowhere.
    fn the_core_can_panic() -> !;
}

#[panic_handler]
fn panic(_: &PanicInfo) -> ! {
    // SAFETY: never linked.
    unsafe { the_core_can_panic() }
}

#[entry]
fn main() -> ! {
    let mut decode = Decode::new(black_box(Config::default()), black_box(Identity::default()));
    let mut survey = Survey::new();
    let mut scanner = scanner_up::BringUp::new(black_box(scanner_up::Settings::default()));
    let mut unit = unit_up::BringUp::default();
    let mut commands = BoardDecoder::new();
    let mut other = Decode::with_scanner(cola::Decoder::default(), black_box(Config::default()), Identity::default());
    loop {
        let (byte, at): (u8, DeviceTime) = black_box((0, DeviceTime(0)));
        decode.start(at, &mut |event| stream(&mut survey, &event));
        let heard = &mut |event: &lms2xx::Event<'_>| scanner.event(event, at, &mut |action| _ = black_box(action));
        decode.hear_lidar(byte, at, heard, &mut |event| stream(&mut survey, &event));
        scanner.tick(at, &mut |action| _ = black_box(action));
        let heard = &mut |event: &novatel::Event<'_>| unit.event(event, at, &mut |action| _ = black_box(action));
        decode.hear_ins(byte, at, heard, &mut |event| stream(&mut survey, &event));
        unit.tick(at, &mut |action| _ = black_box(action));
        decode.pulse(at, &mut |event| stream(&mut survey, &event));
        decode.tick(at, &mut |event| stream(&mut survey, &event));
        decode.cut_lidar(&mut |event| stream(&mut survey, &event));
        other.lidar_byte(byte, at, &mut |event| stream(&mut survey, &event));
        other.finish(at, &mut |event| stream(&mut survey, &event));
        decode.finish(at, &mut |event| stream(&mut survey, &event));
        let bytes: [u8; 64] = black_box([0; 64]);
        let mut rest = &bytes[..];
        while let Some(event) = commands.next(&mut rest) {
            if let frame::Event::Frame(frame) = event {
                decode.command(frame.sequence, &frame.body, at, &mut |event| stream(&mut survey, &event));
            }
        }
    }
}

/// What a board and a host do with an event: through the survey, into a frame, and back.
fn stream(survey: &mut Survey, event: &Event<'_>) {
    survey.take(event, &mut |profile| _ = black_box(profile));
    let (mut code, mut out) = ([0; MAX_CODE], [0; MAX_MESSAGE_FRAME]);
    let message: Message<'_> = event.message(&mut code);
    let _ = black_box(Sequencer::new().message(&message, &mut out));
    let mut room = RawScan::EMPTY;
    let _ = black_box(Event::of(&black_box(message), &mut room).is_ok());
    black_box(&out);
}
