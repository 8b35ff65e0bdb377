//! `/metrics`: the counters for whoever watches many instruments, as Prometheus text.

use std::fmt::Write;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use axum::extract::State;
use axum::http::header;
use axum::response::{IntoResponse, Response};

use super::Served;
use crate::live::{self, Light};

/// What the server itself counts.
#[derive(Debug, Default)]
pub struct Counts {
    refused: AtomicU64,
    commands: AtomicU64,
    sections: AtomicU64,
}

impl Counts {
    /// A request was turned away.
    pub fn refused(&self) {
        self.refused.fetch_add(1, Ordering::Relaxed);
    }

    /// A command was passed on.
    pub fn commanded(&self) {
        self.commands.fetch_add(1, Ordering::Relaxed);
    }

    /// A section was sent to a viewer.
    pub fn section_sent(&self) {
        self.sections.fetch_add(1, Ordering::Relaxed);
    }
}

/// The page.
pub async fn page(State(served): State<Arc<Served>>) -> Response {
    let state = served.live.hub().state();
    let (steers, viewers) = served.steering.state();
    let body = text(&state, viewers, steers.is_some(), &served.metrics);
    ([(header::CONTENT_TYPE, "text/plain; version=0.0.4")], body).into_response()
}

fn text(state: &live::State, viewers: u64, steered: bool, counts: &Counts) -> String {
    let mut out = String::new();
    let mut family = |name: &str, kind: &str, help: &str, samples: &[(String, f64)]| {
        // Writing to a string does not fail.
        let _ = writeln!(out, "# HELP crossfall_{name} {help}\n# TYPE crossfall_{name} {kind}");
        for (labels, value) in samples {
            let _ = writeln!(out, "crossfall_{name}{labels} {value}");
        }
    };
    let one = |value: f64| vec![(String::new(), value)];
    let lamps = [
        ("lidar", &state.lamps.lidar),
        ("ins", &state.lamps.ins),
        ("pulse", &state.lamps.pulse),
        ("disk", &state.lamps.disk),
        ("link", &state.lamps.link),
    ];
    let lit = lamps.map(|(name, lamp)| {
        let value = match lamp.light {
            Light::Off => 0.0,
            Light::Good => 1.0,
            Light::Warn => 2.0,
            Light::Bad => 3.0,
        };
        (format!("{{part=\"{name}\"}}"), value)
    });
    family("lamp", "gauge", "State of a part: 0 off, 1 good, 2 warning, 3 bad.", &lit);
    let losses: Vec<_> =
        state.losses.iter().map(|(name, count)| (format!("{{counter=\"{name}\"}}"), *count as f64)).collect();
    family("losses_total", "counter", "Losses by counter, since the board booted or the server began.", &losses);
    family("faults_total", "counter", "Faults told to the operator.", &one(state.fault_count as f64));
    family("profiles_total", "counter", "Sections measured.", &one(state.motion.profiles as f64));
    family("markers_total", "counter", "Markers in the stream.", &one(state.marker_count as f64));
    family("scan_rate_hertz", "gauge", "Scans a second.", &one(state.motion.scan_hz));
    if let Some(speed) = state.motion.speed_m_s {
        family("speed_metres_per_second", "gauge", "Speed over ground.", &one(speed));
    }
    if let Some(station) = state.motion.station_m {
        family("station_metres", "gauge", "Way since the first pose.", &one(station));
    }
    let recording = state.recording.phase != live::Phase::Idle;
    family("recording", "gauge", "Whether a log is being written.", &one(f64::from(u8::from(recording))));
    family("recording_bytes", "gauge", "Bytes of frames in it.", &one(state.recording.bytes as f64));
    let lost = state.recording.lost;
    family("recording_frames_lost", "gauge", "Frames damaged or missing in it.", &one(lost.frames_lost as f64));
    family("recording_bytes_lost", "gauge", "Bytes that found no room in it.", &one(lost.bytes_lost as f64));
    family("recording_unknown_gaps", "gauge", "Gaps in it of unknown length.", &one(lost.unknown_gaps as f64));
    family("viewers", "gauge", "Viewers connected.", &one(viewers as f64));
    family("steered", "gauge", "Whether a viewer holds the control.", &one(f64::from(u8::from(steered))));
    family(
        "unviewed_frames_total",
        "counter",
        "Frames that viewers were not shown.",
        &one(state.unviewed_frames as f64),
    );
    for (name, help, count) in [
        ("sections_sent_total", "Sections sent to viewers.", &counts.sections),
        ("requests_refused_total", "Requests without the right to look.", &counts.refused),
        ("commands_total", "Commands asked for.", &counts.commands),
    ] {
        family(name, "counter", help, &one(count.load(Ordering::Relaxed) as f64));
    }
    out
}
