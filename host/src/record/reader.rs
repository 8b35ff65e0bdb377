//! The thread that drains the port, and connects again when it is gone. Between two reads it writes what is to be said to the board.

use std::io::{self, ErrorKind};
use std::sync::Arc;
use std::thread;
use std::time::{Duration, Instant};

use super::buffer::{Buffer, Event};
use super::device::{Device, Port, question, takes_none};
use super::{Clock, Outbox, SILENCE};

/// The first and the longest pause between two attempts to connect; each is twice the one before.
const PAUSES: (Duration, Duration) = (Duration::from_millis(100), Duration::from_secs(2));

/// Bytes of one read at most: 40 ms of a link of 1 Mbaud.
const READ_BYTES: usize = 4096;

/// Starts the reader. It ends when the buffer says so: after a read, a pause or an attempt to connect.
pub fn spawn(device: Device, port: Box<dyn Port>, outbox: Outbox, clock: Clock, buffer: Arc<Buffer>) -> io::Result<()> {
    let reader = Reader { device, outbox, clock, buffer, pause: PAUSES.0, gone: false, mute: false };
    // Not joined: an attempt to connect may take seconds, and the log does not wait for it.
    thread::Builder::new().name("reader".to_owned()).spawn(move || reader.run(port)).map(drop)
}

struct Reader {
    device: Device,
    outbox: Outbox,
    clock: Clock,
    buffer: Arc<Buffer>,
    pause: Duration,
    /// Whether the recording knows that there is no connection. It is told of a new one when that has brought something.
    gone: bool,
    /// Whether nothing can be written on this connection.
    mute: bool,
}

impl Reader {
    fn run(mut self, port: Box<dyn Port>) {
        let mut port = Some(port);
        while let Some(open) = port {
            port = self.drain(open).and_then(|why| {
                if !self.gone {
                    self.gone = true;
                    self.buffer.put(Event::Gone { why: why.to_string() });
                }
                self.connect()
            });
        }
        self.buffer.end();
    }

    /// Reads until the connection is lost, which it returns, or until it is asked to end.
    fn drain(&mut self, mut port: Box<dyn Port>) -> Option<io::Error> {
        let mut bytes = [0; READ_BYTES];
        let mut heard = Instant::now();
        self.mute = false;
        // What was to be said while nothing was connected would now come too late.
        self.outbox.clear();
        while !self.buffer.stopped_within(Duration::ZERO) {
            match port.read(&mut bytes) {
                Ok(0) => return Some(io::Error::new(ErrorKind::UnexpectedEof, "closed by the other end")),
                Ok(count) => {
                    let receive_ns = self.clock.now_ns();
                    if self.gone {
                        self.gone = false;
                        self.buffer.put(Event::Back);
                    }
                    self.pause = PAUSES.0;
                    self.buffer.put(Event::Bytes { receive_ns, bytes: bytes[..count].to_vec() });
                    heard = Instant::now();
                }
                Err(error) => match error.kind() {
                    ErrorKind::TimedOut | ErrorKind::WouldBlock | ErrorKind::Interrupted => {}
                    _ => return Some(error),
                },
            }
            while let Some(frame) = self.outbox.take() {
                if let Err(error) = self.write(&mut port, &frame) {
                    return Some(error);
                }
            }
            // Asking shows a connection that is dead without a word, and wakes a board that was plugged in behind it.
            if heard.elapsed() > SILENCE {
                heard = Instant::now();
                if let Err(error) = self.write(&mut port, &question()) {
                    return Some(error);
                }
            }
        }
        None
    }

    /// Says something. That a device takes no commands is told once, and costs nothing of what it sends.
    fn write(&mut self, port: &mut dyn Port, frame: &[u8]) -> io::Result<()> {
        if self.mute {
            return Ok(());
        }
        match port.write_all(frame) {
            Err(error) if takes_none(&error) => {
                self.mute = true;
                self.buffer.put(Event::Mute { why: error.to_string() });
                Ok(())
            }
            written => written,
        }
    }

    fn connect(&mut self) -> Option<Box<dyn Port>> {
        loop {
            if self.buffer.stopped_within(self.pause) {
                return None;
            }
            self.pause = (self.pause * 2).min(PAUSES.1);
            if let Ok(port) = self.device.connect() {
                return Some(port);
            }
        }
    }
}
