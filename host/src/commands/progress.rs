//! Progress on stderr, only on a terminal.

use std::time::Duration;

use indicatif::{ProgressBar, ProgressStyle};

/// A bar that vanishes when it is done; nothing at all when stderr is no terminal.
pub struct Progress(ProgressBar);

impl Progress {
    /// Work of a known extent.
    pub fn new(what: &'static str, extent: u64) -> Self {
        let bar = ProgressBar::new(extent);
        // The template is a constant: it parses.
        if let Ok(style) = ProgressStyle::with_template("{msg:>10} {bar:40} {percent:>3} %  {eta}") {
            bar.set_style(style);
        }
        bar.set_message(what);
        bar.enable_steady_tick(Duration::from_millis(200));
        Self(bar)
    }

    /// Work without a known end: what it has come to, see [`Progress::say`].
    pub fn spinner() -> Self {
        let bar = ProgressBar::new_spinner();
        bar.enable_steady_tick(Duration::from_millis(200));
        Self(bar)
    }

    /// What it has come to.
    pub fn say(&self, text: impl FnOnce() -> String) {
        if !self.0.is_hidden() {
            self.0.set_message(text());
        }
    }

    /// Does something that writes to stderr.
    pub fn aside<T>(&self, write: impl FnOnce() -> T) -> T {
        self.0.suspend(write)
    }

    /// How far it is.
    pub fn at(&self, position: u64) {
        self.0.set_position(position);
    }
}

impl Drop for Progress {
    fn drop(&mut self) {
        self.0.finish_and_clear();
    }
}
