//! Where a board is: behind a serial port, behind a TCP address (a serial server, an emulator), or in QEMU.

use std::fmt;
use std::io::{self, ErrorKind, Read, Write};
use std::net::{TcpStream, ToSocketAddrs};
use std::path::PathBuf;
use std::str::FromStr;
use std::time::Duration;

use crossfall_core::protocol::message::Command;

use super::outbox::framed;
use crate::emulated::Bench;

/// The board's baud rate on the link (docs/hardware.md).
pub const BAUD: u32 = 1_000_000;

/// How long a read waits: as long as an end may have to wait for the reader.
const READ: Duration = Duration::from_millis(100);

/// How long an address may take to answer.
const CONNECT: Duration = Duration::from_secs(2);

/// What a board is read from and written to. Reads end with [`ErrorKind::TimedOut`] or [`ErrorKind::WouldBlock`] when nothing comes.
pub trait Port: Read + Write + Send {}

impl<T: Read + Write + Send> Port for T {}

/// `serial:PATH`, `serial:PATH@BAUD`, `tcp:HOST:PORT`, `emulated` or `emulated:IMAGE`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Device {
    /// A serial port, 8N1 without flow control.
    Serial {
        /// Its name: `/dev/ttyUSB0`, `COM3`.
        path: String,
        /// Bits a second.
        baud: u32,
    },
    /// A TCP server.
    Tcp {
        /// Host and port.
        address: String,
    },
    /// The board in QEMU, on a simulated drive.
    Emulated {
        /// Its image, if not the one that was built in this repository.
        image: Option<PathBuf>,
    },
}

impl FromStr for Device {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        const EXPECTED: &str = "expected serial:PATH, serial:PATH@BAUD, tcp:HOST:PORT or emulated";
        match text.split_once(':') {
            Some(("serial", place)) => {
                let (path, baud) = match place.rsplit_once('@') {
                    None => (place, BAUD),
                    Some((path, baud)) => match baud.parse() {
                        Ok(baud) if baud > 0 => (path, baud),
                        _ => return Err(format!("`{baud}` is no baud rate; {EXPECTED}")),
                    },
                };
                if path.is_empty() {
                    return Err(format!("no path; {EXPECTED}"));
                }
                Ok(Self::Serial { path: path.to_owned(), baud })
            }
            Some(("tcp", address)) => match address.rsplit_once(':') {
                Some((host, port)) if !host.is_empty() && port.parse::<u16>().is_ok_and(|port| port > 0) => {
                    Ok(Self::Tcp { address: address.to_owned() })
                }
                _ => Err(format!("`{address}` is no host and port; {EXPECTED}")),
            },
            None if text == "emulated" => Ok(Self::Emulated { image: None }),
            Some(("emulated", image)) if !image.is_empty() => Ok(Self::Emulated { image: Some(image.into()) }),
            _ => Err(EXPECTED.to_owned()),
        }
    }
}

impl fmt::Display for Device {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Serial { path, baud } => write!(f, "serial:{path}@{baud}"),
            Self::Tcp { address } => write!(f, "tcp:{address}"),
            Self::Emulated { image: None } => f.write_str("emulated"),
            Self::Emulated { image: Some(image) } => write!(f, "emulated:{}", image.display()),
        }
    }
}

impl Device {
    /// Opens the port and asks the board who it is and how it is configured. The survey goes on undisturbed.
    ///
    /// # Errors
    /// What the operating system says.
    pub fn connect(&self) -> io::Result<Box<dyn Port>> {
        let mut port: Box<dyn Port> = match self {
            Self::Serial { path, baud } => Box::new(serialport::new(path, *baud).timeout(READ).open()?),
            Self::Tcp { address } => {
                let stream = connect(address)?;
                stream.set_nodelay(true)?;
                stream.set_read_timeout(Some(READ))?;
                stream.set_write_timeout(Some(CONNECT))?;
                Box::new(stream)
            }
            Self::Emulated { image } => Box::new(Bench::start(image.as_deref())?),
        };
        match port.write_all(&question()) {
            Err(error) if !takes_none(&error) => Err(error),
            // Who can only be listened to is recorded as it comes.
            _ => Ok(port),
        }
    }
}

/// The question who the board is and how it is configured. Its answer carries number 0.
pub(super) fn question() -> Vec<u8> {
    // It has no fields: there is room for it in any frame.
    framed(&Command::Identify, 0).unwrap_or_default()
}

/// Whether a failed write says that the device can be read all the same.
pub(super) fn takes_none(error: &io::Error) -> bool {
    matches!(error.kind(), ErrorKind::PermissionDenied | ErrorKind::ReadOnlyFilesystem | ErrorKind::Unsupported)
}

/// Connects to a TCP server, waiting for it at most [`CONNECT`].
pub(crate) fn connect(address: &str) -> io::Result<TcpStream> {
    let mut failed = io::Error::new(ErrorKind::NotFound, "the name has no address");
    for address in address.to_socket_addrs()? {
        match TcpStream::connect_timeout(&address, CONNECT) {
            Ok(stream) => return Ok(stream),
            Err(error) => failed = error,
        }
    }
    Err(failed)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn devices_are_read_as_written() {
        let serial = |path: &str, baud| Ok(Device::Serial { path: path.to_owned(), baud });
        assert_eq!("serial:/dev/ttyUSB0".parse(), serial("/dev/ttyUSB0", BAUD));
        assert_eq!("serial:COM3@115200".parse(), serial("COM3", 115_200));
        assert_eq!("tcp:localhost:4000".parse(), Ok(Device::Tcp { address: "localhost:4000".to_owned() }));
        assert_eq!("tcp:[::1]:4000".parse(), Ok(Device::Tcp { address: "[::1]:4000".to_owned() }));
        assert_eq!("emulated".parse(), Ok(Device::Emulated { image: None }));
        assert_eq!("emulated:a.elf".parse(), Ok(Device::Emulated { image: Some("a.elf".into()) }));
        for wrong in [
            "",
            "serial:",
            "serial:@9600",
            "serial:a@fast",
            "serial:a@0",
            "tcp:4000",
            "tcp:host:",
            "tcp::1",
            "tcp:h:70000",
            "udp:h:1",
            "emulate",
            "emulated:",
        ] {
            assert!(wrong.parse::<Device>().unwrap_err().contains("expected serial:PATH"), "{wrong}");
        }
    }
}
