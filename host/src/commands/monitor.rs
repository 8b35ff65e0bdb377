//! `crossfall monitor`: the live view in a terminal, for who is connected by ssh.
//!
//! The lamps, the section and the figures of `crossfall serve`, without a browser. Ctrl-C or q ends it, and a recording with it, whole.

use std::io::{self, IsTerminal};
use std::time::Duration;

use anyhow::Context;
use crossfall::monitor::draw;
use ratatui::crossterm::event::{self, Event, KeyCode, KeyEventKind, KeyModifiers};

use super::serve::{IntoArgs, SourceArgs};
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
    let shown = (|| -> anyhow::Result<()> {
        while !crossfall::interrupt::requested() {
            let (state, section) = (live.hub().state(), live.hub().section());
            terminal.draw(|frame| draw(frame, &state, section.as_deref()))?;
            if !event::poll(PICTURE)? {
                continue;
            }
            let Event::Key(key) = event::read()? else { continue };
            if key.kind == KeyEventKind::Release {
                continue;
            }
            match key.code {
                KeyCode::Char('q') | KeyCode::Esc => break,
                // A terminal in raw mode sends no signal.
                KeyCode::Char('c') if key.modifiers.contains(KeyModifiers::CONTROL) => break,
                KeyCode::Char('r') => live.toggle_recording(),
                KeyCode::Char('m') => live.mark(""),
                KeyCode::Char(' ') => {
                    if let Some(controls) = live.controls() {
                        let mut transport = controls.lock();
                        transport.paused = !transport.paused;
                    }
                }
                _ => {}
            }
        }
        Ok(())
    })();
    ratatui::try_restore()?;
    shown?;
    live.finish();
    let state = live.hub().state();
    let Some(last) = &state.last_recording else { return Ok(Outcome::Done) };
    tell!(
        "{}: {:.1} s, {} frames, {} profiles, {} lost",
        last.file,
        last.seconds,
        last.frames,
        last.profiles,
        last.lost
    );
    if last.restarts > 0 {
        tell!("restarts of the board: {}; what it had not sent before is not known", last.restarts);
    }
    if let Some(error) = &last.error {
        tell!("the recording ended early: {error}");
    }
    Ok(Outcome::lost_if(!last.is_whole()))
}
