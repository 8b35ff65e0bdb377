//! One line to a board: a TCP connection or a serial port, never waited for longer than stated.

use std::io::{self, ErrorKind, Read, Write};
use std::net::{Shutdown, TcpStream};
use std::thread;
use std::time::{Duration, Instant};

use super::{Error, STALLED};
use crate::interrupt;
use crate::record::{Device, connect};

/// How long a full line is left before it is tried again.
const FULL: Duration = Duration::from_micros(500);

/// How long the far end may take to read the last bytes.
const LAST: Duration = Duration::from_secs(1);

/// An open line.
pub struct Line {
    name: String,
    port: Port,
}

enum Port {
    /// Not blocking.
    Tcp(TcpStream),
    Serial(Box<dyn serialport::SerialPort>),
}

impl Line {
    /// Opens a line.
    ///
    /// # Errors
    /// When it does not open.
    pub fn open(device: &Device) -> Result<Self, Error> {
        let name = device.to_string();
        match open(device) {
            Ok(port) => Ok(Self { name, port }),
            Err(source) => Err(Error::Connect { device: name, source }),
        }
    }

    /// Its name, as the user gave it.
    #[must_use]
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Sends all of these bytes, waiting for room at most [`STALLED`]. `seconds` is where the drive is.
    ///
    /// # Errors
    /// When the line is lost or has no room for so long; when the user asks to stop meanwhile.
    pub fn send(&mut self, mut bytes: &[u8], seconds: f64) -> Result<(), Error> {
        let mut stalled: Option<Instant> = None;
        while !bytes.is_empty() {
            let written = match &mut self.port {
                Port::Tcp(stream) => stream.write(bytes),
                Port::Serial(port) => port.write(bytes),
            };
            match written {
                Ok(0) => return Err(self.lost(ErrorKind::WriteZero.into(), seconds)),
                Ok(count) => {
                    bytes = &bytes[count..];
                    stalled = None;
                }
                Err(error) if waits(&error) => {
                    if stalled.get_or_insert_with(Instant::now).elapsed() > STALLED {
                        let what = format!("it has read nothing for {} s", STALLED.as_secs());
                        return Err(self.lost(io::Error::new(ErrorKind::TimedOut, what), seconds));
                    }
                    if interrupt::requested() {
                        return Err(Error::Interrupted { seconds });
                    }
                    thread::sleep(FULL);
                }
                Err(error) => return Err(self.lost(error, seconds)),
            }
        }
        Ok(())
    }

    /// What the board has said since, into `into`; 0 when it has said nothing. Never waits.
    ///
    /// # Errors
    /// When the line is lost.
    pub fn hear(&mut self, into: &mut [u8], seconds: f64) -> Result<usize, Error> {
        let read = match &mut self.port {
            Port::Tcp(stream) => match stream.read(into) {
                Ok(0) => Err(io::Error::new(ErrorKind::UnexpectedEof, "closed at the other end")),
                read => read,
            },
            Port::Serial(port) => match port.bytes_to_read() {
                Ok(0) => Ok(0),
                Ok(_) => port.read(into),
                Err(error) => Err(error.into()),
            },
        };
        match read {
            Err(error) if waits(&error) => Ok(0),
            Err(error) => Err(self.lost(error, seconds)),
            Ok(count) => Ok(count),
        }
    }

    /// Closes the line once the far end has what was sent: a connection that is closed with something unread would take back bytes that
    /// are still under way.
    pub fn close(self) {
        match self.port {
            Port::Tcp(mut stream) => {
                let _gone = stream.shutdown(Shutdown::Write);
                let end = Instant::now() + LAST;
                let mut unread = [0; 256];
                while Instant::now() < end {
                    match stream.read(&mut unread) {
                        Ok(0) => return,
                        Err(error) if !waits(&error) => return,
                        Err(_) => thread::sleep(FULL),
                        Ok(_) => {}
                    }
                }
            }
            Port::Serial(mut port) => {
                let _gone = port.flush();
            }
        }
    }

    fn lost(&self, source: io::Error, seconds: f64) -> Error {
        Error::Lost { device: self.name.clone(), seconds, source }
    }
}

fn open(device: &Device) -> io::Result<Port> {
    match device {
        Device::Tcp { address } => {
            let stream = connect(address)?;
            stream.set_nodelay(true)?;
            stream.set_nonblocking(true)?;
            Ok(Port::Tcp(stream))
        }
        Device::Serial { path, baud } => Ok(Port::Serial(serialport::new(path, *baud).timeout(FULL).open()?)),
        Device::Emulated { .. } => Err(io::Error::new(ErrorKind::Unsupported, "an emulated board has its own sensors")),
    }
}

fn waits(error: &io::Error) -> bool {
    matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut | ErrorKind::Interrupted)
}
