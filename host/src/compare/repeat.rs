//! Repeat drives over one road: how much their slopes vary (the median-slope paper's figure 7b).

use serde::Serialize;

use super::align::aligned;
use super::matching::{Course, Placed, pairs, place};
use super::{Agreement, Drive, Kind, Options};
use crate::profiles::left_out;
use crate::side::Side;
use crate::way::Way;

/// One drive held against the first.
#[derive(Clone, Debug, Serialize)]
pub struct Pair {
    /// The drive.
    pub drive: String,
    /// Adjacent slopes.
    pub adjacent: Agreement,
    /// Opposing slopes.
    pub opposing: Agreement,
    /// Both.
    pub all: Agreement,
    /// The same after shifting the drive by what makes the slopes agree best; absent where there are too few, and of medians over stretches.
    pub aligned: Option<Aligned>,
    /// Roll of the vehicle at the same places: how differently the two drives lay on the road, and how both units were mounted.
    pub roll: Agreement,
    /// Rows of the drive that lie nowhere on the first drive's track.
    pub off_track: usize,
    /// Rows that were left out because they say themselves unreliable.
    pub unreliable: usize,
}

/// Agreement after shifting.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct Aligned {
    /// Mean of the shifts along the road, in metres.
    pub shift_m: f64,
    /// Number of stretches with a shift of their own.
    pub stretches: usize,
    /// Adjacent slopes.
    pub adjacent: Agreement,
    /// Opposing slopes.
    pub opposing: Agreement,
    /// Both.
    pub all: Agreement,
}

/// All drives held against the first.
#[derive(Clone, Debug, Serialize)]
pub struct Repeat {
    /// The first drive, which gives the stations.
    pub reference: String,
    /// How drives were matched, what was left out; for a reader.
    pub remarks: Vec<String>,
    /// Every other drive.
    pub pairs: Vec<Pair>,
    /// Adjacent slopes of all drives.
    pub adjacent: Agreement,
    /// Opposing slopes of all drives.
    pub opposing: Agreement,
    /// Both, of all drives.
    pub all: Agreement,
    /// The same after shifting every drive.
    pub aligned: Option<Aligned>,
    /// What was compared, for the picture.
    #[serde(skip)]
    pub dots: Vec<Dot>,
}

/// One slope measured on two drives.
#[derive(Clone, Copy, Debug)]
pub struct Dot {
    /// Which slope.
    pub kind: Kind,
    /// Number of the drive that was held against the first, from 0.
    pub drive: usize,
    /// In the first drive, in degrees.
    pub first_deg: f64,
    /// In the other.
    pub other_deg: f64,
}

/// A difference and the half width of both intervals together.
type Difference = (f64, Option<f64>);

/// Differences of adjacent and of opposing slopes.
#[derive(Clone, Debug, Default)]
struct Differences([Vec<Difference>; 2]);

impl Differences {
    fn of(first: &[Course], other: &[Course], within_m: f64, mut each: impl FnMut(Kind, f64, f64)) -> Self {
        let mut found = Self::default();
        for (a, b) in first.iter().zip(other) {
            let list = &mut found.0[a.kind as usize];
            for (a_sample, b_sample) in pairs(&a.samples, &b.samples, 0.0, within_m) {
                let half = a_sample.ci95_deg.zip(b_sample.ci95_deg).map(|(a, b)| a.hypot(b));
                list.push((b_sample.slope_deg - a_sample.slope_deg, half));
                each(a.kind, a_sample.slope_deg, b_sample.slope_deg);
            }
        }
        found
    }

    fn extend(&mut self, other: &Self) {
        for (mine, theirs) in self.0.iter_mut().zip(&other.0) {
            mine.extend(theirs);
        }
    }

    fn agreements(&self) -> [Agreement; 3] {
        let [adjacent, opposing] = &self.0;
        let all: Vec<Difference> = adjacent.iter().chain(opposing).copied().collect();
        [Agreement::of(adjacent), Agreement::of(opposing), Agreement::of(&all)]
    }
}

/// Holds every drive against the first; there must be two at least, else there is nothing in the answer.
#[must_use]
pub fn repeat(drives: &[Drive], options: &Options) -> Option<Repeat> {
    let (reference, others) = drives.split_first().filter(|(_, others)| !others.is_empty())?;
    let mut remarks = Vec::new();
    let way = reference.way();
    let positioned = |drive: &Drive| drive.rows.iter().any(|row| row.position.geodetic.is_some());
    let way = way.filter(|_| others.iter().all(positioned));
    if way.is_none() {
        let why = if drives.iter().all(positioned) { "the first drive stood" } else { "not every log has positions" };
        remarks.push(format!(
            "{why}: drives are matched by the way travelled since each began, and must have begun at one place"
        ));
    }
    let first = place(&reference.rows, way.as_ref(), options);
    note(&reference.name, &first, &mut remarks);
    let (mut together, mut shifted, mut shifts) = (Differences::default(), Differences::default(), Vec::new());
    let (mut found, mut dots) = (Vec::new(), Vec::new());
    for (number, drive) in others.iter().enumerate() {
        let other = place(&drive.rows, way.as_ref(), options);
        note(&drive.name, &other, &mut remarks);
        if !other.forward {
            remarks.push(format!(
                "{}: goes the other way along the road, where left is right: nothing of it is compared",
                drive.name
            ));
        }
        let courses = if other.forward { &other.courses[..] } else { &[] };
        let within_m = options.over_m.map_or(options.within_m, |over_m| over_m / 2.0);
        let differences = Differences::of(&first.courses, courses, within_m, |kind, first_deg, other_deg| {
            dots.push(Dot { kind, drive: number, first_deg, other_deg });
        });
        together.extend(&differences);
        // Medians lie on one grid of stretches: shifts by less than half of one pair the same medians.
        let moved = options.over_m.is_none().then(|| aligned(&first.courses, courses, within_m));
        let aligned = moved.and_then(|(moved, moves)| {
            let moved = Differences::of(&first.courses, &moved, within_m, |_, _, _| ());
            let aligned = summed(&moved, &moves)?;
            shifted.extend(&moved);
            shifts.extend(moves);
            Some(aligned)
        });
        let [adjacent, opposing, all] = differences.agreements();
        found.push(Pair {
            drive: drive.name.clone(),
            adjacent,
            opposing,
            all,
            aligned,
            roll: roll(reference, drive, way.as_ref(), options),
            off_track: other.off_track,
            unreliable: other.unreliable,
        });
    }
    let [adjacent, opposing, all] = together.agreements();
    let aligned = summed(&shifted, &shifts);
    let reference = reference.name.clone();
    Some(Repeat { reference, remarks, pairs: found, adjacent, opposing, all, aligned, dots })
}

fn summed(differences: &Differences, shifts: &[f64]) -> Option<Aligned> {
    let [adjacent, opposing, all] = differences.agreements();
    (!shifts.is_empty()).then(|| Aligned {
        shift_m: shifts.iter().sum::<f64>() / shifts.len() as f64,
        stretches: shifts.len(),
        adjacent,
        opposing,
        all,
    })
}

fn note(name: &str, placed: &Placed, remarks: &mut Vec<String>) {
    if placed.unreliable > 0 {
        remarks.push(format!("{name}: {}", left_out(placed.unreliable as u64, "section")));
    }
}

/// Roll at the same places.
fn roll(first: &Drive, other: &Drive, way: Option<&Way>, options: &Options) -> Agreement {
    let along = |drive: &Drive| {
        let mut samples: Vec<_> = drive
            .rows
            .iter()
            .filter(|row| row.side == Side::Left)
            .filter_map(|row| {
                let station_m = match way {
                    Some(way) => way.station_m(row.position.geodetic?)?,
                    None => row.position.station_m?,
                };
                Some(super::matching::Sample { station_m, slope_deg: row.roll_deg, ci95_deg: None })
            })
            .collect();
        samples.sort_by(|a, b| a.station_m.total_cmp(&b.station_m));
        samples
    };
    let (first, other) = (along(first), along(other));
    let differences: Vec<Difference> =
        pairs(&first, &other, 0.0, options.within_m).map(|(a, b)| (b.slope_deg - a.slope_deg, None)).collect();
    Agreement::of(&differences)
}
