//! A board on the bench, without a bench: the image in QEMU surveys a simulated drive, and what there is of it here is its link.
//!
//! `record`, `serve` and `monitor` take it for a device like any other (`--device emulated`). The drive is played by a thread of its own, by the
//! board's clock; when it has come to its end, so has the connection, and who connects again sees a board that was switched on.

use std::io::{self, ErrorKind, Read, Write};
use std::net::TcpStream;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::Duration;

use super::scanner::{Mode, Scanner};
use super::{Emulator, Options, Step, at_line_rates, find_image, half_the_scans, require_qemu};
use crate::capture::{self, Chunk};
use crate::simulate::{self, scene::Scene};

/// Seconds of the drive.
const SECONDS: f64 = 900.0;

/// How long a read of the link waits.
const READ: Duration = Duration::from_millis(100);

/// How long the scanner's bring-up goes on before the drive begins anyway.
const SET_UP: Duration = Duration::from_secs(60);

/// The link of a board that surveys a drive. The board is switched off with it.
#[derive(Debug)]
pub struct Bench {
    link: TcpStream,
    off: Arc<AtomicBool>,
    player: Option<JoinHandle<()>>,
}

impl Bench {
    /// Simulates a drive, switches the board on and begins to play. The image is the one named, or that of the repository around.
    ///
    /// # Errors
    /// When QEMU or the image is missing, or QEMU does not start.
    pub fn start(image: Option<&Path>) -> io::Result<Self> {
        let missing = |what| io::Error::new(ErrorKind::NotFound, what);
        require_qemu().map_err(missing)?;
        let image = find_image(image).map_err(missing)?;
        let drive = Drive::simulate().map_err(io::Error::other)?;
        let (board, link) = Emulator::boot(&image, &Options::default())?;
        link.set_read_timeout(Some(READ))?;
        let off = Arc::new(AtomicBool::new(false));
        let told = Arc::clone(&off);
        let player = std::thread::Builder::new().name("emulated drive".to_owned()).spawn(move || {
            // The board has gone, or is to go: either way the link's end says so.
            let _ = play(board, &drive, &told);
        })?;
        Ok(Self { link, off, player: Some(player) })
    }
}

impl Read for Bench {
    fn read(&mut self, into: &mut [u8]) -> io::Result<usize> {
        self.link.read(into)
    }
}

impl Write for Bench {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.link.write(bytes)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.link.flush()
    }
}

impl Drop for Bench {
    fn drop(&mut self) {
        self.off.store(true, Ordering::Relaxed);
        // QEMU waits for whoever does not read its link: nobody will any more.
        let _ = self.link.shutdown(std::net::Shutdown::Both);
        if let Some(player) = self.player.take() {
            let _ = player.join();
        }
    }
}

/// Sets the scanner up and plays the drive, until it ends or the board is switched off.
fn play(mut board: Emulator, drive: &Drive, off: &AtomicBool) -> io::Result<()> {
    let is_off = || off.load(Ordering::Relaxed);
    let mut scanner = Scanner::waiting_at(9_600);
    scanner.holds_start = true;
    board.converse(&mut scanner, SET_UP, |scanner| is_off() || scanner.mode == Mode::Continuous)?;
    let steps = drive.chunks()?.take_while(|_| !is_off()).map(Step::Bytes);
    board.play(&mut scanner, steps, |_| ())?;
    Ok(())
}

/// A simulated drive at the rates that the emulated lines carry, in a file that goes with it.
struct Drive {
    file: tempfile::TempPath,
}

impl Drive {
    fn simulate() -> Result<Self, Box<dyn std::error::Error + Send + Sync>> {
        let mut scene = Scene::default();
        scene.drive.seconds = SECONDS;
        at_line_rates(&mut scene);
        let file = tempfile::Builder::new().prefix("crossfall-bench").suffix(".mcap").tempfile()?.into_temp_path();
        let mut writer = capture::Writer::create(&file)?;
        simulate::simulate(&scene, &mut writer, |_| ())?;
        writer.finish()?;
        Ok(Self { file })
    }

    fn chunks(&self) -> io::Result<impl Iterator<Item = Chunk>> {
        let reader = capture::Reader::open(&self.file).map_err(io::Error::other)?;
        Ok(half_the_scans(reader.map_while(Result::ok)))
    }
}
