//! `crossfall monitor`: the live view in a terminal, for who is connected by ssh.
//!
//! The lamps, the section and the figures of `crossfall serve`, without a browser. Ctrl-C or q ends it, and a recording with it, whole.

use std::io::{self, IsTerminal};
use std::sync::mpsc::{self, Receiver, RecvTimeoutError};
use std::thread;
use std::time::Duration;

use anyhow::Context;
use crossfall::monitor::draw;
use ratatui::crossterm::event::{self, Event, KeyCode, KeyEventKind, KeyModifiers};

use super::serve::{IntoArgs, SourceArgs, verdict};
use super::{Outcome, tell};

/// How often the picture changes.
const PICTURE: Duration = Duration::from_millis(100);

/// Show a drive live in the terminal
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  crossfall monitor --device serial:/dev/ttyUSB0 --config my.toml
  crossfall monitor drive.log.mcap --speed 10

Keys: r records or stops, m drops a marker, space halts a replay, q ends.")]
pub struct Args {
    #[command(flatten)]
    source: SourceArgs,
    #[command(flatten)]
    into: IntoArgs,
}

pub fn run(args: &Args) -> anyhow::Result<Outcome> {
    let config = args.source.config()?;
    anyhow::ensure!(
        io::stdout().is_terminal(),
        "the monitor draws on a terminal, and stdout is none; `crossfall serve` shows the same in a browser"
    );
    let live = args.source.start(args.into.logs(), config)?;
    let mut terminal = ratatui::try_init().context("no terminal to draw on")?;
    let typed = keys();
    let shown = (|| -> anyhow::Result<()> {
        while !crossfall::interrupt::requested() {
            let (state, section) = (live.hub().state(), live.hub().section());
            terminal.draw(|frame| draw(frame, &state, section.as_deref()))?;
            let key = match typed.recv_timeout(PICTURE) {
                Ok(Event::Key(key)) if key.kind != KeyEventKind::Release => key,
                Ok(_) | Err(RecvTimeoutError::Timeout) => continue,
                Err(RecvTimeoutError::Disconnected) => anyhow::bail!("the terminal gives no keys any more"),
            };
            match key.code {
                KeyCode::Char('q') | KeyCode::Esc => break,
                // A terminal in raw mode sends no signal.
                KeyCode::Char('c') if key.modifiers.contains(KeyModifiers::CONTROL) => break,
                KeyCode::Char('r') => live.toggle_recording(),
                KeyCode::Char('m') => live.mark(""),
                KeyCode::Char(' ') => live.toggle_pause(),
                _ => {}
            }
        }
        Ok(())
    })();
    // Before anything that needs the terminal: it may have been closed, and the log is whole all the same.
    live.finish();
    let restored = terminal.show_cursor().and_then(|()| ratatui::try_restore());
    // Where it cannot be restored, its end would complain about that on a stderr that is most likely the same terminal, and panic.
    std::mem::forget(terminal);
    // A terminal that has gone asks for the end as its hang-up does, which may come later or never; what was recorded says how it ended.
    if !crossfall::interrupt::requested()
        && let Err(error) = shown.and(restored.map_err(anyhow::Error::from))
    {
        tell!("the terminal has gone: {error:#}");
    }
    if let Some(last) = &live.hub().state().last_recording {
        tell!("{}: {:.1} s, {} frames, {} profiles", last.file, last.seconds, last.frames, last.profiles);
    }
    Ok(verdict(&live))
}

/// What is typed, from a thread of its own that ends with the process: of a terminal that has been closed crossterm reads the end for ever.
fn keys() -> Receiver<Event> {
    let (tell, typed) = mpsc::channel();
    thread::spawn(move || {
        while let Ok(event) = event::read()
            && tell.send(event).is_ok()
        {}
    });
    typed
}
