//! QEMU's human monitor: looks into the machine without disturbing it.

use std::io::{self, Read, Write};
use std::net::TcpStream;
use std::time::Duration;

/// Ends every answer.
const PROMPT: &[u8] = b"(qemu) ";

/// What cortex-m-rt paints the stack with.
const STACK_PAINT: &str = "0xcccccccc";

/// Bus clock of the UARTs, by which the board computes its dividers.
const UART_BUS_HZ: u32 = 42_000_000;

/// Register of the counter that stamps everything (TIM5_CNT; RM0090, 18.4.10).
const COUNTER: u32 = 0x4000_0c24;

/// Registers that hold the UARTs' dividers (USART_BRR; RM0090, 30.6.3).
const SCANNER_DIVIDER: u32 = 0x4000_4808;
const INS_DIVIDER: u32 = 0x4000_4c08;

/// Status of UART5, which takes the pulse, and its flag for a byte that has not been read (USART_SR, RXNE; RM0090, 30.6.1).
const PULSE_STATUS: u32 = 0x4000_5000;
const UNREAD: u32 = 1 << 5;

/// The monitor of a running machine.
#[derive(Debug)]
pub struct Monitor {
    stream: TcpStream,
}

impl Monitor {
    pub(super) fn open(stream: TcpStream) -> io::Result<Self> {
        stream.set_read_timeout(Some(Duration::from_secs(5)))?;
        let mut monitor = Self { stream };
        monitor.answer()?;
        Ok(monitor)
    }

    /// Gives one command and returns its answer, echo included.
    ///
    /// # Errors
    /// When QEMU has gone or stays silent for five seconds.
    pub fn ask(&mut self, command: &str) -> io::Result<String> {
        writeln!(self.stream, "{command}")?;
        self.answer()
    }

    /// One word of the machine's memory or registers.
    ///
    /// # Errors
    /// As [`Monitor::ask`], and when the answer holds no word.
    pub fn word(&mut self, address: u32) -> io::Result<u32> {
        let answer = self.ask(&format!("xp /1wx {address:#x}"))?;
        let word = answer.lines().rev().find_map(|line| line.split_once(": 0x"));
        word.and_then(|(_, digits)| u32::from_str_radix(digits.trim(), 16).ok())
            .ok_or_else(|| io::Error::other(format!("no word at {address:#x}: {answer:?}")))
    }

    /// Bytes of a painted stack that have ever been used.
    ///
    /// # Errors
    /// As [`Monitor::ask`].
    pub(super) fn stack_used(&mut self, end: u32, size: u32) -> io::Result<u32> {
        let answer = self.ask(&format!("xp /{}wx {end:#x}", size / 4))?;
        let words =
            answer.lines().filter_map(|line| line.split_once(": ")).flat_map(|(_, words)| words.split_whitespace());
        let untouched = words.take_while(|&word| word == STACK_PAINT).count() as u32;
        Ok(size - 4 * untouched)
    }

    /// The board's microsecond counter, which wraps.
    ///
    /// # Errors
    /// As [`Monitor::word`].
    pub fn counter(&mut self) -> io::Result<u32> {
        self.word(COUNTER)
    }

    /// Whether a pulse's byte has reached its receiver and the board has not read it yet. Looking does not change that.
    pub(super) fn pulse_waits(&mut self) -> io::Result<bool> {
        Ok(self.word(PULSE_STATUS)? & UNREAD != 0)
    }

    /// The rate in baud to which the board has set the scanner's line: QEMU carries bytes at any rate, so a sensor that
    /// is to mind its rate must ask.
    ///
    /// # Errors
    /// As [`Monitor::word`].
    pub fn scanner_baud(&mut self) -> io::Result<u32> {
        self.baud(SCANNER_DIVIDER)
    }

    /// Likewise the inertial unit's line.
    ///
    /// # Errors
    /// As [`Monitor::word`].
    pub fn ins_baud(&mut self) -> io::Result<u32> {
        self.baud(INS_DIVIDER)
    }

    fn baud(&mut self, register: u32) -> io::Result<u32> {
        Ok(UART_BUS_HZ / self.word(register)?.max(1))
    }

    fn answer(&mut self) -> io::Result<String> {
        let mut text = Vec::new();
        let mut chunk = [0; 1024];
        while !text.ends_with(PROMPT) {
            match self.stream.read(&mut chunk)? {
                0 => return Err(io::ErrorKind::UnexpectedEof.into()),
                count => text.extend_from_slice(&chunk[..count]),
            }
        }
        Ok(String::from_utf8_lossy(&text).into_owned())
    }
}
