//! The machine: started with one TCP connection a UART, fed like a board on a bench, ended on drop. Every wait is bounded.
//!
//! | serial of QEMU | UART | carries |
//! |---|---|---|
//! | 0 | USART1 | bench messages, out of the board |
//! | 1 | USART2 | the link |
//! | 2 | USART3 | the scanner |
//! | 3 | UART4 | the inertial unit |
//! | 4 | UART5 | a byte for each pulse |

use std::io::{self, Read, Write};
use std::net::{TcpListener, TcpStream};
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use crossfall_core::protocol::frame::{MAX_COMMAND_FRAME, Sequencer};
use crossfall_core::protocol::message::Command as BoardCommand;

use super::{Collector, Monitor};

/// Where the board's stack lies (its `memory.x`).
const STACK_END: u32 = 0x1000_0000;
const STACK_SIZE: u32 = 16 * 1024;

/// Introduces a captured counter value on UART5 (the board's `pulse.rs`).
const CAPTURED: u8 = 0xa5;

/// One instruction is 8 ns of the board's time: 125 million a second, about what the silicon does. The board's clock then stands still
/// while the host is busy elsewhere, so that a loaded machine makes a test slower but loses no byte.
const TIME: [&str; 2] = ["-icount", "shift=3"];

/// The last of the ports, for the board's bench wire.
const BENCH_PORT: usize = 6;

/// Waits shorter than this are slept.
const TICK: Duration = Duration::from_millis(10);

/// How long QEMU may take to start and connect.
const START_LIMIT: Duration = Duration::from_secs(20);

/// How the machine is to run.
#[derive(Clone, Debug, Default)]
pub struct Options {
    /// How time passes, if not as it usually does here, such as `-icount shift=0`, and anything else.
    pub arguments: Vec<String>,
}

/// Ways of failing that the emulated board can be made to take.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum Failure {
    /// A panic.
    Panic = 0xf0,
    /// An instruction that there is not.
    HardFault = 0xf1,
    /// A recursion without end.
    StackOverflow = 0xf2,
}

/// One of the board's sensor lines, as the sensor sees it.
#[derive(Debug)]
pub struct SensorEnd {
    stream: TcpStream,
    sent: u64,
}

/// A running board.
#[derive(Debug)]
pub struct Emulator {
    child: Child,
    /// Everything that the board has sent, and what it means.
    pub link: Collector,
    /// The scanner's end of its line.
    pub lidar: SensorEnd,
    /// The inertial unit's end of its line.
    pub ins: SensorEnd,
    pulse: TcpStream,
    commands: TcpStream,
    /// A few bytes a boot: what nobody reads waits in the connection.
    bench: TcpStream,
    sequencer: Sequencer,
    /// QEMU's own view of the machine.
    pub monitor: Monitor,
}

impl Emulator {
    /// Boots an image.
    ///
    /// # Errors
    /// When QEMU is missing, does not start, or does not connect in time.
    pub fn start(image: &Path, options: &Options) -> io::Result<Self> {
        let (mut board, link) = Self::boot(image, options)?;
        board.link = Collector::start(link);
        Ok(board)
    }

    /// Boots an image and leaves its link to the caller, who must read it: QEMU waits for that. [`Emulator::link`] hears nothing then.
    ///
    /// # Errors
    /// As [`Emulator::start`].
    pub(super) fn boot(image: &Path, options: &Options) -> io::Result<(Self, TcpStream)> {
        let listeners = [(); 7].map(|()| TcpListener::bind("127.0.0.1:0"));
        let mut ports = Vec::new();
        for listener in &listeners {
            let listener = listener.as_ref().map_err(|error| io::Error::new(error.kind(), error.to_string()))?;
            listener.set_nonblocking(true)?;
            ports.push(listener.local_addr()?.port());
        }
        // The board sends byte by byte: on the link, the first of the ports, the kernel may join them. An answer must not wait.
        let client = |port: u16| {
            let delay = if port == ports[0] { "" } else { ",nodelay=on" };
            format!("tcp:127.0.0.1:{port}{delay}")
        };
        let mut command = watched();
        command.args(["-M", "olimex-stm32-h405", "-display", "none", "-no-user-config"]);
        // USART1 is QEMU's first serial line.
        for port in [ports[BENCH_PORT], ports[0], ports[1], ports[2], ports[3]] {
            command.arg("-serial").arg(client(port));
        }
        command.arg("-monitor").arg(client(ports[4])).arg("-qtest").arg(client(ports[5])).args(["-qtest-log", "none"]);
        command.arg("-kernel").arg(image);
        if options.arguments.is_empty() {
            command.args(TIME);
        }
        command.args(&options.arguments);
        command.stdin(Stdio::piped()).stdout(Stdio::null()).stderr(Stdio::inherit());
        let child =
            command.spawn().map_err(|error| io::Error::new(error.kind(), format!("cannot start {QEMU}: {error}")))?;
        // From here on a failure must end the process, which a guard's drop does.
        let mut guard = Guard(Some(child));
        let deadline = Instant::now() + START_LIMIT;
        let mut streams = Vec::new();
        for listener in listeners.iter().flatten() {
            streams.push(accept(listener, &mut guard, deadline)?);
        }
        let mut next = streams.into_iter();
        let mut stream = move || next.next().ok_or_else(|| io::Error::other("a connection is missing"));
        let (link, lidar, ins, pulse, monitor) = (stream()?, stream()?, stream()?, stream()?, stream()?);
        let (tests, bench) = (stream()?, stream()?);
        bench.set_nonblocking(true)?;
        let board = Self {
            commands: link.try_clone()?,
            link: Collector::deaf(),
            lidar: SensorEnd { stream: lidar, sent: 0 },
            ins: SensorEnd { stream: ins, sent: 0 },
            pulse,
            bench,
            sequencer: Sequencer::new(),
            monitor: Monitor::open(monitor, tests)?,
            child: guard.release(),
        };
        Ok((board, link))
    }

    /// One edge of the pulse per second, captured at this value of the board's counter.
    ///
    /// # Errors
    /// When QEMU has gone.
    pub fn pulse_at(&mut self, counter: u32) -> io::Result<()> {
        let [a, b, c, d] = counter.to_le_bytes();
        self.pulse.write_all(&[CAPTURED, a, b, c, d])
    }

    /// One edge of the pulse per second, whenever the byte that stands for it gets there.
    ///
    /// # Errors
    /// When QEMU has gone.
    pub fn pulse(&mut self) -> io::Result<()> {
        self.pulse.write_all(b"p")
    }

    /// One edge of the pulse per second at a known instant: the machine stands still while the byte that stands for the edge gets to its
    /// receiver, and its interrupt is the first thing that happens then. The answer is the counter's value at that instant.
    ///
    /// # Errors
    /// When QEMU has gone or the byte does not arrive.
    pub fn pulse_exactly(&mut self) -> io::Result<u32> {
        self.monitor.halt()?;
        let counter = self.monitor.counter()?;
        self.pulse()?;
        let deadline = Instant::now() + START_LIMIT;
        while !self.monitor.pulse_waits()? {
            if Instant::now() > deadline {
                return Err(io::Error::new(io::ErrorKind::TimedOut, "the pulse does not arrive"));
            }
        }
        self.monitor.go_on()?;
        Ok(counter)
    }

    /// Makes the board fail on purpose, see the board's `emulation.rs`.
    ///
    /// # Errors
    /// When QEMU has gone.
    pub fn provoke(&mut self, failure: Failure) -> io::Result<()> {
        self.pulse.write_all(&[failure as u8])
    }

    /// Sends a command; the answer is the sequence number that its reply will name.
    ///
    /// # Errors
    /// When QEMU has gone.
    pub fn command(&mut self, command: &BoardCommand) -> io::Result<u16> {
        let sequence = self.sequencer.take();
        let mut frame = [0; MAX_COMMAND_FRAME];
        let length = command.encode(sequence, &mut frame).map_err(io::Error::other)?;
        self.commands.write_all(&frame[..length])?;
        Ok(sequence)
    }

    /// Bytes on the link's receive line that need not be a command.
    ///
    /// # Errors
    /// When QEMU has gone.
    pub fn link_bytes(&mut self, bytes: &[u8]) -> io::Result<()> {
        self.commands.write_all(bytes)
    }

    /// What the board has sent on its bench wire since the last call.
    ///
    /// # Errors
    /// When QEMU has gone.
    pub fn bench_bytes(&mut self) -> io::Result<Vec<u8>> {
        let mut bytes = Vec::new();
        match self.bench.read_to_end(&mut bytes) {
            Ok(_) => Err(io::ErrorKind::UnexpectedEof.into()),
            Err(error) if error.kind() == io::ErrorKind::WouldBlock => Ok(bytes),
            Err(error) => Err(error),
        }
    }

    /// Bytes of the board's stack that have ever been used, and how many there are.
    ///
    /// # Errors
    /// When QEMU has gone.
    pub fn stack(&mut self) -> io::Result<(u32, u32)> {
        Ok((self.monitor.stack_used(STACK_END, STACK_SIZE)?, STACK_SIZE))
    }

    /// Whether the emulator still runs.
    pub fn is_running(&mut self) -> bool {
        matches!(self.child.try_wait(), Ok(None))
    }
}

impl Drop for Emulator {
    fn drop(&mut self) {
        end(&mut self.child);
    }
}

/// QEMU's name.
pub const QEMU: &str = "qemu-system-arm";

/// Runs QEMU, whose arguments follow, and kills it when standard input ends: on purpose, or because this process has gone, however it
/// went. A process group of its own keeps a Ctrl-C in the terminal away from it, so that the drive can end in order.
#[cfg(unix)]
fn watched() -> Command {
    use std::os::unix::process::CommandExt;
    const WATCH: &str = "exec 3<&0 4>&2 2>/dev/null; \"$@\" </dev/null 2>&4 3<&- 4>&- & machine=$!; \
        { exec 4>&-; read -r _ <&3; kill -9 $machine; } & watch=$!; exec 3<&- 4>&-; \
        wait $machine; code=$?; kill $watch; exit $code";
    let mut command = Command::new("sh");
    command.args(["-c", WATCH, "sh", QEMU]).process_group(0);
    command
}

/// Where there is no such shell, QEMU alone: a killed process leaves it behind.
#[cfg(not(unix))]
fn watched() -> Command {
    Command::new(QEMU)
}

/// Ends the machine and waits for it.
fn end(child: &mut Child) {
    // The end of its input is the order to end.
    drop(child.stdin.take());
    if cfg!(not(unix)) {
        let _gone = child.kill();
    }
    let _gone = child.wait();
}

impl SensorEnd {
    /// Sends bytes to the board as fast as it takes them.
    ///
    /// # Errors
    /// When QEMU has gone.
    pub fn send(&mut self, bytes: &[u8]) -> io::Result<()> {
        self.stream.write_all(bytes)?;
        self.sent += bytes.len() as u64;
        Ok(())
    }

    /// Bytes sent so far. What the board has taken of them is in its status: QEMU, on a busy host, may be seconds behind.
    #[must_use]
    pub fn sent(&self) -> u64 {
        self.sent
    }

    /// What the board has sent, after waiting for it at most `patience`; empty when that is nothing.
    ///
    /// # Errors
    /// When QEMU has gone.
    pub fn receive(&mut self, patience: Duration) -> io::Result<Vec<u8>> {
        // The system rounds the patience of a read up to its tick, which may be 10 ms: short waits are slept.
        let short = patience < TICK;
        if short {
            std::thread::sleep(patience);
        }
        self.stream.set_nonblocking(short)?;
        self.stream.set_read_timeout(Some(patience.max(TICK)))?;
        let mut bytes = vec![0; 1024];
        let read = self.stream.read(&mut bytes);
        self.stream.set_nonblocking(false)?;
        match read {
            Ok(0) => Err(io::ErrorKind::UnexpectedEof.into()),
            Ok(count) => {
                bytes.truncate(count);
                Ok(bytes)
            }
            Err(error) if matches!(error.kind(), io::ErrorKind::WouldBlock | io::ErrorKind::TimedOut) => Ok(Vec::new()),
            Err(error) => Err(error),
        }
    }
}

/// Ends the process unless released.
struct Guard(Option<Child>);

impl Guard {
    fn release(mut self) -> Child {
        self.0.take().expect("released once")
    }
}

impl Drop for Guard {
    fn drop(&mut self) {
        if let Some(child) = &mut self.0 {
            end(child);
        }
    }
}

fn accept(listener: &TcpListener, guard: &mut Guard, deadline: Instant) -> io::Result<TcpStream> {
    loop {
        match listener.accept() {
            Ok((stream, _)) => {
                stream.set_nonblocking(false)?;
                stream.set_nodelay(true)?;
                // Nothing here waits for ever, whatever state QEMU is in.
                stream.set_write_timeout(Some(START_LIMIT))?;
                return Ok(stream);
            }
            Err(error) if error.kind() == io::ErrorKind::WouldBlock => {}
            Err(error) => return Err(error),
        }
        if let Some(status) = guard.0.as_mut().and_then(|child| child.try_wait().transpose()).transpose()? {
            return Err(io::Error::other(format!("{QEMU} ended with {status}")));
        }
        if Instant::now() > deadline {
            return Err(io::Error::new(io::ErrorKind::TimedOut, format!("{QEMU} did not connect")));
        }
        std::thread::sleep(Duration::from_millis(5));
    }
}
