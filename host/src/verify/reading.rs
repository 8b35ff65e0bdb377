//! The stream itself: frames whole, none missing, times sane. What the second survey needs is handed to it on the way.

use std::path::PathBuf;

use crossfall_core::instrument::FIRMWARE;
use crossfall_core::protocol::frame::Gap;
use crossfall_core::protocol::message::{Hello, Message};
use crossfall_core::protocol::{Config, schema};

use super::beside::{Beside, Verdict};
use super::times::Times;
use super::{Report, Told};
use crate::stream::{Item, Place, Stream};

/// A log under verification.
pub struct Reading<'scope> {
    survey: Beside<'scope>,
    times: Times,
    report: Report,
    told: Told,
    /// Where the first firmware of another build said hello, and its name.
    stranger: Option<(Place, String)>,
    /// The board speaks another version of the messages: what they seem to say is not the survey's.
    unknown_schema: bool,
}

impl<'scope> Reading<'scope> {
    /// Nothing read yet; `survey` will recompute.
    pub fn beside(survey: Beside<'scope>) -> Self {
        Self {
            survey,
            times: Times::default(),
            report: Report::default(),
            told: Told::default(),
            stranger: None,
            unknown_schema: false,
        }
    }

    /// Reads the whole stream. `known` is the configuration that the log's own head says was in force.
    pub fn read(&mut self, stream: &mut Stream, known: Option<&Config>, mut progress: impl FnMut(usize, u64)) {
        let mut beginning = true;
        let mut last = Place::default();
        let mut problems = Vec::new();
        while let Some((place, item)) = stream.next() {
            progress(place.file, place.offset);
            if std::mem::take(&mut beginning) && !is_boot(place, &item) {
                self.survey.begin_midway(known);
            }
            last = place;
            self.survey.at(place);
            match item {
                Item::Damage(error) => {
                    problems.push(error.what());
                    self.survey.gap();
                }
                Item::Rejected { fault, bytes } => {
                    self.report.bad_frames += 1;
                    problems.push(format!("broken frame of {bytes} bytes: {fault}"));
                    self.survey.gap();
                }
                Item::Message { message, gap } => {
                    self.gap(gap, &message, &mut problems);
                    self.times.check(place.receive_ns, &message, &mut problems);
                    self.message(place, &message, gap == Gap::Restarted, &mut problems);
                }
            }
            self.told.note(place, problems.drain(..));
        }
        self.survey.at(last);
        if stream.frames() == 0 {
            self.told.note(last, ["the log holds no frame".to_owned()]);
        }
    }

    /// What the sequence numbers say of the way from the message before.
    fn gap(&mut self, gap: Gap, message: &Message<'_>, problems: &mut Vec<String>) {
        match gap {
            Gap::None => {}
            Gap::Missing(count) => {
                let plural = if count == 1 { "" } else { "s" };
                problems.push(format!("{count} frame{plural} missing before this one"));
                self.survey.gap();
            }
            Gap::Unknown => {
                problems.push("frames missing before this one, too many for their numbers to count".to_owned());
                self.survey.gap();
            }
            Gap::Restarted => {
                self.times.restart();
                self.survey.restart();
                if !matches!(message, Message::Hello(_)) {
                    problems.push("the sequence begins again without a hello".to_owned());
                }
            }
        }
    }

    fn message(&mut self, place: Place, message: &Message<'_>, restarted: bool, problems: &mut Vec<String>) {
        match message {
            Message::Hello(hello) => self.hello(place, hello, restarted, problems),
            Message::Scan(_) => self.report.scans += 1,
            Message::Profile(_) => self.report.profiles += 1,
            _ => {}
        }
        if !self.unknown_schema {
            self.survey.take(message);
        }
    }

    fn hello(&mut self, place: Place, hello: &Hello<'_>, restarted: bool, problems: &mut Vec<String>) {
        self.report.boots += u64::from(self.report.boots == 0 || restarted);
        if hello.firmware != FIRMWARE {
            self.stranger.get_or_insert_with(|| (place, hello.firmware.to_owned()));
        }
        self.unknown_schema = hello.schema != schema::HASH;
        if self.unknown_schema {
            let (theirs, ours) = (hello.schema, schema::HASH);
            problems.push(format!("message schema {theirs:016x}, this program knows {ours:016x}"));
        }
    }

    /// The verdict, once the survey has caught up. `name` is the file of a number, where there are several.
    pub fn finish(self, stream: &Stream, name: impl Fn(usize) -> Option<PathBuf>) -> Report {
        let Self { survey, times, mut report, mut told, stranger, .. } = self;
        let (by_survey, Verdict { reproduced, unverifiable, joined }) = survey.finish();
        if let Some((place, firmware)) = stranger.filter(|_| by_survey.count > 0) {
            let what =
                format!("made by {firmware:?}, this is {FIRMWARE:?}: profiles of another survey need not recompute");
            told.note(place, [what]);
        }
        report.frames = stream.frames();
        report.missing_frames = stream.missing();
        report.unknown_gaps = stream.unknown_gaps();
        report.seconds = times.seconds();
        (report.profiles_reproduced, report.profiles_unverifiable) = (reproduced, unverifiable);
        report.tell(told, by_survey, name);
        report.ok = report.problem_count == 0 && reproduced + joined == report.profiles;
        report
    }
}

/// Whether a stream that begins with this begins with the board: its first word has the number 0.
fn is_boot(place: Place, item: &Item<'_>) -> bool {
    place.sequence == Some(0) && matches!(item, Item::Message { message: Message::Hello(_), .. })
}
