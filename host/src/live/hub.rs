//! Where viewers find what is new to them, each at its own pace.

use std::collections::VecDeque;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use crossfall_core::protocol::Config;

use super::state::State;
use super::track_sketch::Sketch;
use super::view::{Section, Strip, encode_strips, encode_track};

/// Moments of the strip charts that are kept: two minutes at nine a second.
const MOST_STRIPS: usize = 1_125;

/// What there is to see.
#[derive(Debug, Default)]
pub struct Hub(Mutex<Scene>);

/// See [`Hub`].
#[derive(Debug, Default)]
pub(super) struct Scene {
    section: Option<(Arc<Section>, Arc<[u8]>)>,
    sections: u64,
    strips: VecDeque<Strip>,
    /// Number of the first one kept.
    first_strip: u64,
    strip_epoch: u32,
    /// The way driven.
    pub sketch: Sketch,
    state: Arc<State>,
    json: Arc<str>,
    states: u64,
    /// The configuration that the board has echoed last.
    pub config: Option<Config>,
}

/// What a viewer has seen already. A new one has seen nothing.
#[derive(Clone, Copy, Debug, Default)]
pub struct Cursor {
    sections: u64,
    strip: u64,
    strip_epoch: u32,
    knots: usize,
    track_epoch: u32,
    states: u64,
}

/// What is new to a viewer, coded.
#[derive(Clone, Debug, Default)]
pub struct News {
    /// The latest section; those before it are skipped.
    pub section: Option<Arc<[u8]>>,
    /// Moments of the strip charts.
    pub strips: Option<Vec<u8>>,
    /// Knots of the track.
    pub track: Option<Vec<u8>>,
    /// The state, as JSON.
    pub state: Option<Arc<str>>,
}

impl Hub {
    /// What this viewer has not seen.
    #[must_use]
    pub fn news(&self, cursor: &mut Cursor) -> News {
        let scene = self.lock();
        let mut news = News::default();
        if cursor.sections != scene.sections {
            cursor.sections = scene.sections;
            news.section = scene.section.as_ref().map(|(_, bytes)| Arc::clone(bytes));
        }
        if cursor.strip_epoch != scene.strip_epoch {
            (cursor.strip_epoch, cursor.strip) = (scene.strip_epoch, 0);
        }
        let next = scene.first_strip + scene.strips.len() as u64;
        if cursor.strip < next {
            let seen = cursor.strip.saturating_sub(scene.first_strip) as usize;
            cursor.strip = next;
            news.strips = Some(encode_strips(scene.strip_epoch, scene.strips.range(seen..)));
        }
        let knots = scene.sketch.knots();
        if cursor.track_epoch != scene.sketch.epoch {
            (cursor.track_epoch, cursor.knots) = (scene.sketch.epoch, 0);
        }
        if cursor.knots < knots.len() {
            let new = knots.get(cursor.knots..).unwrap_or_default();
            news.track = Some(encode_track(scene.sketch.epoch, new.iter()));
            cursor.knots = knots.len();
        }
        if cursor.states != scene.states {
            cursor.states = scene.states;
            news.state = Some(Arc::clone(&scene.json));
        }
        news
    }

    /// The state.
    #[must_use]
    pub fn state(&self) -> Arc<State> {
        Arc::clone(&self.lock().state)
    }

    /// The state as JSON.
    #[must_use]
    pub fn json(&self) -> Arc<str> {
        Arc::clone(&self.lock().json)
    }

    /// The latest section.
    #[must_use]
    pub fn section(&self) -> Option<Arc<Section>> {
        self.lock().section.as_ref().map(|(section, _)| Arc::clone(section))
    }

    /// The configuration that the board has echoed last.
    #[must_use]
    pub fn config(&self) -> Option<Config> {
        self.lock().config
    }

    pub(super) fn lock(&self) -> MutexGuard<'_, Scene> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Scene {
    pub(super) fn show(&mut self, section: Section) {
        let bytes = section.encode().into();
        self.section = Some((Arc::new(section), bytes));
        self.sections += 1;
    }

    pub(super) fn strip(&mut self, strip: Strip) {
        if self.strips.len() == MOST_STRIPS {
            self.strips.pop_front();
            self.first_strip += 1;
        }
        self.strips.push_back(strip);
    }

    /// Time has jumped: charts and track begin anew.
    pub(super) fn forget(&mut self) {
        self.strips.clear();
        self.first_strip = 0;
        self.strip_epoch += 1;
        self.sketch.clear();
    }

    pub(super) fn tell(&mut self, state: State) {
        // A map of strings and numbers: this does not fail.
        self.json = serde_json::to_string(&state).unwrap_or_default().into();
        self.state = Arc::new(state);
        self.states += 1;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn strip(time_s: f64) -> Strip {
        Strip { time_s, values: [0.0; 7] }
    }

    #[test]
    fn a_slow_viewer_gets_the_latest_section_and_every_moment_that_is_kept() {
        let hub = Hub::default();
        let mut cursor = Cursor::default();
        for scan in 0..3 {
            hub.lock().show(Section { scan, ..Section::default() });
            hub.lock().strip(strip(f64::from(scan)));
        }
        let news = hub.news(&mut cursor);
        assert_eq!(news.section.unwrap()[4], 2);
        assert_eq!(news.strips.unwrap().len(), 8 + 3 * 36);
        assert!(hub.news(&mut cursor).section.is_none());
        assert!(hub.news(&mut cursor).strips.is_none());
        for i in 0..2 * MOST_STRIPS {
            hub.lock().strip(strip(i as f64));
        }
        assert_eq!(hub.news(&mut cursor).strips.unwrap().len(), 8 + MOST_STRIPS * 36);
        hub.lock().forget();
        hub.lock().strip(strip(0.0));
        let again = hub.news(&mut cursor).strips.unwrap();
        assert_eq!((again.len(), again[4]), (8 + 36, 1), "another epoch");
    }
}
