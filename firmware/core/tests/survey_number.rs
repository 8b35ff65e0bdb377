//! The number of the survey in `instrument::FIRMWARE` stands for the bits of its profiles: a log of another number need not recompute, and `verify` says so.

mod scenes;

use crossfall_core::instrument::FIRMWARE;
use crossfall_core::profile::{Workspace, measure};
use crossfall_core::protocol::config::Method;
use crossfall_core::protocol::frame::MAX_MESSAGE_FRAME;
use crossfall_core::protocol::message::{Message, Profile};
use crossfall_core::protocol::{Angle, Config, DeviceTime};
use scenes::{Family, Random, scene};

#[test]
fn profiles_of_this_number_have_these_bits() {
    // FNV-1a, 64 bits, over profiles as they are written.
    let mut digest = 0xcbf2_9ce4_8422_2325u64;
    let mut work = Workspace::new();
    for (method, sections) in [(Method::Measuring, 150), (Method::Seed, 10)] {
        let mut config = Config::default();
        config.survey.method = method;
        let mut random = Random::new(7);
        let families = [
            Family::plain("3.5 mm", 0.0035),
            Family::grass("10 mm grass", 0.010),
            Family { guardrail: true, ..Family::plain("guardrail", 0.010) },
            Family { undulation_m: 0.008, ..Family::plain("waves", 0.0035) },
            Family { cut: true, ..Family::plain("cut", 0.010) },
        ];
        for family in &families {
            for index in 0..sections {
                let scene = scene(family, &mut random, index);
                let (left, right, flags) = measure(&scene.scan, &scene.track, &config, &mut work);
                let profile =
                    Profile { scan: index, time: DeviceTime(0), method, flags, roll: Angle::ZERO, left, right };
                let mut frame = [0; MAX_MESSAGE_FRAME];
                let length = Message::Profile(profile).encode(0, &mut frame).expect("room");
                for byte in &frame[..length] {
                    digest = (digest ^ u64::from(*byte)).wrapping_mul(0x0100_0000_01b3);
                }
            }
        }
    }
    // Whoever changes the bits takes the next number and the digest that comes of it.
    assert!(FIRMWARE.ends_with(" survey 2"), "{FIRMWARE}");
    assert_eq!(digest, 0x535c_6cde_ff54_d89f, "{digest:#018x}");
}
