//! The link's tasks: frames out, commands in, profiles and log lines into the stream, time.

use crossfall_protocol::frame::{BoardDecoder, DELIMITER, Event};
use crossfall_protocol::message::Level;
use embassy_time::{Duration, Ticker, Timer};
use embedded_io_async::{Read, Write};

use crate::acquisition::Shared;
use crate::now;
use crate::outbox::Queue;
use crate::survey::ProfileReceiver;

/// Bytes handed to the link at a time.
const CHUNK: usize = 128;

/// How often time is looked at: how late a status can be.
const TICK: Duration = Duration::from_millis(20);

/// How long a line that has failed is left alone before it is tried again.
const AFTER_ERROR: Duration = Duration::from_millis(100);

/// Writes frames to the link for ever.
pub async fn send<W: Write>(queue: &Queue, mut link: W) -> ! {
    let mut chunk = [0; CHUNK];
    // Whatever a restart has cut off ends here: it must not take the hello, which tells of the restart, with it.
    let _unsent = link.write_all(&[DELIMITER]).await;
    loop {
        let count = queue.read(&mut chunk).await;
        let bytes = chunk.get(..count).unwrap_or_default();
        // What a failing link loses is for the host to see by the frames' checks and numbers.
        if link.write_all(bytes).await.is_err() {
            Timer::after(AFTER_ERROR).await;
        }
    }
}

/// Reads commands from the link for ever.
pub async fn receive<R: Read>(shared: &Shared<'_>, mut link: R) -> ! {
    let mut decoder = BoardDecoder::new();
    let mut chunk = [0; CHUNK];
    loop {
        let count = match link.read(&mut chunk).await {
            Ok(count) if count > 0 => count,
            // The far end has gone (0) or the line has failed: both may mend.
            _ => {
                Timer::after(AFTER_ERROR).await;
                continue;
            }
        };
        let mut rest = chunk.get(..count).unwrap_or_default();
        while let Some(event) = decoder.next(&mut rest) {
            match event {
                Event::Frame(frame) => {
                    while !shared.borrow().has_room() {
                        Timer::after_millis(1).await;
                    }
                    shared.borrow_mut().command(frame.sequence, &frame.body, now());
                }
                Event::Rejected(rejected) => shared.borrow_mut().rejected_command(rejected.sequence),
            }
        }
    }
}

/// Puts the survey's results into the stream for ever.
pub async fn profiles(shared: &Shared<'_>, profiles: ProfileReceiver<'_>) -> ! {
    loop {
        let profile = profiles.receive().await;
        shared.borrow_mut().profile(profile);
    }
}

/// Puts the bytes of a defmt stream into the link's stream for ever.
pub async fn log<R: Read>(shared: &Shared<'_>, mut source: R) -> ! {
    let mut chunk = [0; CHUNK];
    loop {
        match source.read(&mut chunk).await {
            Ok(count) if count > 0 => {
                let piece = chunk.get(..count).unwrap_or_default();
                shared.borrow_mut().log(now(), Level::Defmt, piece);
            }
            _ => Timer::after(AFTER_ERROR).await,
        }
    }
}

/// Lets time pass for ever, so that there is a status every second even when all sensors are silent.
pub async fn time(shared: &Shared<'_>) -> ! {
    let mut ticker = Ticker::every(TICK);
    loop {
        ticker.next().await;
        shared.borrow_mut().tick(now());
    }
}
