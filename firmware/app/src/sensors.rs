//! The sensors' tasks: bytes and pulses into the decode layer, the bring-up's words out to the sensors.

use embassy_time::{Duration, Timer};

use crate::acquisition::Shared;
use crate::line::{PulseInput, SensorLine};

/// Bytes taken from a line at a time.
const CHUNK: usize = 64;

/// After a read a line is left alone for so long, so that the next one finds many bytes: stamps are the bytes' own, so
/// waiting costs no accuracy, and fewer wake-ups cost less.
const PAUSE: Duration = Duration::from_millis(1);

/// Brings the scanner up and takes its bytes, for ever.
pub async fn scanner<L: SensorLine>(shared: &Shared<'_>, mut line: L) -> ! {
    let mut chunk = [0; CHUNK];
    loop {
        let Ok(count) = line.read(&mut chunk).await else { Timer::after(PAUSE).await; continue };
        let mut acquisition = shared.borrow_mut();
        for (k, &byte) in chunk.iter().take(count).enumerate() {
            acquisition.lidar_byte(byte, line.arrival(k), line.lost());
        }
        drop(acquisition);
        if count < CHUNK { Timer::after(PAUSE).await; }
    }
}

/// Brings the inertial unit up and takes its bytes, for ever.
pub async fn inertial<L: SensorLine>(shared: &Shared<'_>, mut line: L) -> ! {
    let mut chunk = [0; CHUNK];
    loop {
        let Ok(count) = line.read(&mut chunk).await else { Timer::after(PAUSE).await; continue };
        let mut acquisition = shared.borrow_mut();
        for (k, &byte) in chunk.iter().take(count).enumerate() {
            acquisition.ins_byte(byte, line.arrival(k), line.lost());
        }
        drop(acquisition);
        if count < CHUNK { Timer::after(PAUSE).await; }
    }
}

/// Takes the pulse per second, for ever.
pub async fn pulse<P: PulseInput>(shared: &Shared<'_>, mut pulses: P) -> ! {
    loop {
        let edge = pulses.edge().await;
        shared.borrow_mut().pulse(edge, pulses.overruns());
    }
}
