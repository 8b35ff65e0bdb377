//! Looks into the machine without disturbing it, and holds it.
//!
//! Words are read by QEMU's test protocol (its `-qtest`), which takes a line at a time. The human monitor takes a character at a time and draws
//! each, in the same loop that carries the sensors' bytes: a look cost as much there as twenty of these. It only halts the machine and lets it go.

use std::io::{self, Read, Write};
use std::net::TcpStream;
use std::time::Duration;

/// Ends every answer of the human monitor, and of the test protocol.
const PROMPT: &[u8] = b"(qemu) ";
const LINE: &[u8] = b"\n";

/// What cortex-m-rt paints the stack with, as hexadecimal digits.
const STACK_PAINT: &[u8] = b"cccccccc";

/// Bus clock of the UARTs, by which the board computes its dividers.
const UART_BUS_HZ: u32 = 42_000_000;

/// Register of the counter that stamps everything (TIM5_CNT; RM0090, 18.4.10).
const COUNTER: u32 = 0x4000_0c24;

/// Register that holds the divider of the scanner's UART (USART_BRR; RM0090, 30.6.3).
const SCANNER_DIVIDER: u32 = 0x4000_4808;

/// Status of UART5, which takes the pulse, and its flag for a byte that has not been read (USART_SR, RXNE; RM0090, 30.6.1).
const PULSE_STATUS: u32 = 0x4000_5000;
const UNREAD: u32 = 1 << 5;

/// The view into a running machine.
#[derive(Debug)]
pub struct Monitor {
    human: TcpStream,
    tests: TcpStream,
}

impl Monitor {
    pub(super) fn open(human: TcpStream, tests: TcpStream) -> io::Result<Self> {
        human.set_read_timeout(Some(Duration::from_secs(5)))?;
        tests.set_read_timeout(Some(Duration::from_secs(5)))?;
        let mut monitor = Self { human, tests };
        answer(&mut monitor.human, PROMPT)?;
        Ok(monitor)
    }

    /// Halts the machine and its clock.
    ///
    /// # Errors
    /// When QEMU has gone or stays silent for five seconds.
    pub(super) fn halt(&mut self) -> io::Result<()> {
        self.ask("stop")
    }

    /// Lets a halted machine go on.
    ///
    /// # Errors
    /// As [`Monitor::halt`].
    pub(super) fn go_on(&mut self) -> io::Result<()> {
        self.ask("cont")
    }

    fn ask(&mut self, command: &str) -> io::Result<()> {
        writeln!(self.human, "{command}")?;
        answer(&mut self.human, PROMPT).map(drop)
    }

    /// What the test protocol answers to a command, in hexadecimal digits.
    fn look(&mut self, command: &str) -> io::Result<String> {
        // In one piece: QEMU answers whole lines.
        self.tests.write_all(format!("{command}\n").as_bytes())?;
        let answer = answer(&mut self.tests, LINE)?;
        match answer.trim().strip_prefix("OK 0x") {
            Some(digits) => Ok(digits.to_owned()),
            None => Err(io::Error::other(format!("QEMU answered {command:?} with {answer:?}"))),
        }
    }

    /// One word of the machine's memory or registers.
    ///
    /// # Errors
    /// As [`Monitor::halt`], and when the answer holds no word.
    pub fn word(&mut self, address: u32) -> io::Result<u32> {
        let digits = self.look(&format!("readl {address:#x}"))?;
        u64::from_str_radix(&digits, 16)
            .ok()
            .and_then(|word| u32::try_from(word).ok())
            .ok_or_else(|| io::Error::other(format!("no word at {address:#x}: {digits:?}")))
    }

    /// Bytes of a painted stack that have ever been used.
    ///
    /// # Errors
    /// As [`Monitor::word`].
    pub(super) fn stack_used(&mut self, end: u32, size: u32) -> io::Result<u32> {
        let digits = self.look(&format!("read {end:#x} {size:#x}"))?;
        let untouched = digits.as_bytes().chunks(STACK_PAINT.len()).take_while(|&word| word == STACK_PAINT).count();
        Ok(size.saturating_sub(4 * untouched as u32))
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
        Ok(UART_BUS_HZ / self.word(SCANNER_DIVIDER)?.max(1))
    }
}

/// Reads up to what ends an answer.
fn answer(stream: &mut TcpStream, end: &[u8]) -> io::Result<String> {
    let mut text = Vec::new();
    let mut chunk = [0; 4096];
    while !text.ends_with(end) {
        match stream.read(&mut chunk)? {
            0 => return Err(io::ErrorKind::UnexpectedEof.into()),
            count => text.extend_from_slice(&chunk[..count]),
        }
    }
    Ok(String::from_utf8_lossy(&text).into_owned())
}
