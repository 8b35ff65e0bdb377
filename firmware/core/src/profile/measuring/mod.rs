//! The measuring mode: slopes from the levelled raw points at the limit of the scanner's noise, with honest intervals.
//!
//! One side is worked off going outward: road line and departure, then twice search, robust fit and extents (adjacent and
//! opposing slope; in a cut the adjacent one rises and faces nothing), then the hinges as intersections of neighbouring lines. `docs/profile.md` has the method at length.

mod hinge;
mod line;
mod magnitude;
mod road;
mod sample;
mod search;
mod slope;

use crossfall_protocol::Config;
use crossfall_protocol::config::Survey;
use crossfall_protocol::message::{Hinge, Side, flags};

use crate::scan::{self, RawScan, RollTrack};
use crate::trig;
use hinge::{Ground, Place, Want};
use road::Road;
use sample::{GRAIN_BITS, Noise, Outward, Sample};
use search::Wanted;
use slope::Found;

pub use sample::Samples;

/// Measures both sides of a scan, left and right. What was in `samples` before does not matter.
pub fn measure(scan: &RawScan, track: &RollTrack, config: &Config, samples: &mut Samples) -> (Side, Side) {
    samples.clear();
    scan::for_each_return(scan, track, &config.scanner, sample::REACH_UM, |echo| sample::take(&echo, samples));
    if config.scanner.mirrored {
        samples.reverse();
    }
    let (unit_um, survey) = (scan.unit_um(), &config.survey);
    let left = measure_side(sample::side(samples, road::INNER), Outward::Left, unit_um, survey);
    sample::turn_round(samples);
    (left, measure_side(sample::side(samples, road::INNER), Outward::Right, unit_um, survey))
}

/// Measures one side, whose samples go outward.
fn measure_side(samples: &mut [Sample], outward: Outward, unit_um: i32, survey: &Survey) -> Side {
    let mut side = Side::default();
    let prior = prior_noise(survey, unit_um);
    let Some(road) = road::find(samples, prior) else {
        side.flags = flags::NO_ROAD;
        return side;
    };
    side.road = Some(trig::slope_angle(road.fit.line.slope_q30));
    let Some(departed) = road.departure else {
        side.flags = flags::END_UNSEEN;
        return side;
    };
    let departure = departed.u;
    let departure_um = outward.lateral_um(departure);
    side.edge = Some(Hinge { y_um: departure_um, ci95_um: 0, departure_um });
    let limits = &survey.limits;
    let (least_q14, most_q14) = (trig::slope(limits.min_slope) >> 16, trig::slope(limits.max_slope) >> 16);
    let wanted = |rising: bool| Wanted {
        least_q14: if rising { least_q14 - SLACK_Q14 } else { -most_q14 - SLACK_Q14 },
        most_q14: if rising { most_q14 + SLACK_Q14 } else { -least_q14 + SLACK_Q14 },
        shortest: limits.min_length_um >> GRAIN_BITS,
        longest: limits.max_length_um >> GRAIN_BITS,
        obstruction: (limits.obstruction_um >> GRAIN_BITS).clamp(1, (1 << 15) - 1),
    };
    // The threshold hides the slope's first samples from the departure: they belong to its run.
    let from = sample::inward_of(samples, road.fit.line.place_at(departure - sample::millimetres(500)));
    let start = departure - sample::millimetres(100);
    let mut noise = road.noise;
    // In a cut the slope beside the road is the one that rises from it; what lies behind its top is another matter.
    let (mut bank, mut cut) = (None, road.noise);
    if road.is_below(samples, &departed) {
        let line = &road.fit.line;
        let lowest = line.height_at(departure) - SUNK;
        bank = slope::measure(samples, (from, start), None, &wanted(true), &mut cut)
            .filter(|bank| bank.fit.line.height_at(departure) > lowest);
    }
    let rises = bank.is_some();
    if rises {
        noise = cut;
    } else {
        bank = slope::measure(samples, (from, start), None, &wanted(false), &mut noise);
    }
    let Some(adjacent) = bank else { return side };
    let from = adjacent.run.last + 1;
    let start = samples.get(adjacent.run.last).map_or(start, |s| s.u);
    let opposing =
        if rises { None } else { slope::measure(samples, (from, start), Some(&adjacent), &wanted(true), &mut noise) };
    let outermost = opposing.as_ref().unwrap_or(&adjacent);
    let beyond = hinge::ground_beyond(samples, outermost, &noise);
    let floor = opposing.as_ref().and_then(|opposing| hinge::ground_between(samples, &adjacent, opposing, &noise));
    let section = Section { outward, road, departure, adjacent, floor, opposing, beyond, noise };
    section.report(&mut side, samples, &wanted(rises), &wanted(true));
    side
}

/// A bank whose line passes so far below the edge of the road begins further out than one that stands beside it: it is the far side of a ditch.
const SUNK: i32 = sample::millimetres(500);

/// A candidate may miss the limits by about 0.6 degrees: its base is short and noisy. The measured slope may not.
const SLACK_Q14: i32 = 170;

/// The configured noise in grains; rounding to the scanner's unit adds unit^2 / 12.
fn prior_noise(survey: &Survey, unit_um: i32) -> Noise {
    let grains = |um: i32| (um.clamp(0, 60_000) >> GRAIN_BITS) as u32;
    let (range, unit, rough) =
        (grains(survey.measuring.range_sigma_um), grains(unit_um), grains(survey.measuring.roughness_um));
    Noise {
        range: (range * range + unit * unit / 12).isqrt().clamp(1, Noise::MAX_RANGE),
        rough2: (rough * rough).clamp(Noise::MIN_ROUGH2, Noise::MAX_ROUGH2),
    }
}

/// One side with its slopes found but not yet bounded.
struct Section {
    outward: Outward,
    road: Road,
    departure: i32,
    adjacent: Found,
    /// The ground between the slopes.
    floor: Option<Ground>,
    opposing: Option<Found>,
    /// The ground beyond the outermost slope.
    beyond: Option<Ground>,
    noise: Noise,
}

/// The hinges of a section, from the road outward.
struct Hinges {
    edge: Place,
    foot: Place,
    /// Foot and top of the opposing slope.
    facing: Option<(Place, Place)>,
}

impl Section {
    fn hinges(&self, samples: &[Sample], want: Want) -> Hinges {
        let Self { adjacent, floor, opposing, beyond, noise, .. } = self;
        let edge = hinge::edge(&self.road.fit, self.departure, adjacent, want);
        match opposing {
            Some(opposing) => {
                let (foot, start) = hinge::across(samples, adjacent, opposing, floor, noise, want);
                Hinges { edge, foot, facing: Some((start, hinge::end(samples, opposing, beyond, noise, want))) }
            }
            None => Hinges { edge, foot: hinge::end(samples, adjacent, beyond, noise, want), facing: None },
        }
    }

    /// The noise of one of the slopes: what both have told of it, but each its own where one of them undulates.
    fn noise_of(&self, slope: &Found) -> Noise {
        let undulates = self.adjacent.undulates || self.opposing.is_some_and(|opposing| opposing.undulates);
        if undulates { slope.noise } else { self.noise }
    }

    /// Fits the slopes anew between the hinges that they make; whether one has moved.
    fn settle(&mut self, samples: &mut [Sample]) -> bool {
        let Hinges { edge, foot, facing } = self.hinges(samples, Want::Places);
        let adjacent = self.adjacent;
        let mut moved = self.adjacent.settle(samples, &edge, &foot, &self.noise_of(&adjacent));
        let noise = self.opposing.map_or(self.noise, |opposing| self.noise_of(&opposing));
        if let (Some(opposing), Some((start, top))) = (&mut self.opposing, &facing) {
            moved |= opposing.settle(samples, start, top, &noise);
        }
        moved
    }

    /// Settles road and slopes between their hinges and fills in what was found.
    fn report(mut self, side: &mut Side, samples: &mut [Sample], beside: &Wanted, beyond: &Wanted) {
        if self.settle(samples) {
            self.settle(samples);
        }
        let (departure, adjacent) = (self.departure, self.adjacent);
        self.road.settle(samples, |road| hinge::edge(road, departure, &adjacent, Want::Places).u);
        let Hinges { edge, foot, facing } = self.hinges(samples, Want::Intervals);
        side.edge = Some(edge.message(self.outward));
        // What is there and cannot be told is said, not guessed.
        let untold = |slope: &Found| if slope.is_told() { 0 } else { flags::DOUBTFUL };
        side.flags |= untold(&self.adjacent) | self.opposing.as_ref().map_or(0, untold);
        if self.adjacent.is_told() && self.adjacent.within(&edge, &foot, beside) {
            side.adjacent = Some(self.adjacent.message(self.outward, &edge, &foot));
            side.flags |=
                self.adjacent.marks(samples, &edge, &foot, &self.noise_of(&self.adjacent), beside.obstruction);
            side.flags |= hinge::rounded(samples, &edge, &self.road.fit.line, &self.adjacent.fit.line, &self.noise);
        }
        match (self.opposing, facing) {
            (Some(opposing), Some((start, top))) if opposing.is_told() && opposing.within(&start, &top, beyond) => {
                side.opposing = Some(opposing.message(self.outward, &start, &top));
                side.flags |= opposing.marks(samples, &start, &top, &self.noise_of(&opposing), beyond.obstruction);
                side.flags |= if top.seen { 0 } else { flags::END_UNSEEN };
            }
            _ => side.flags |= if foot.seen { 0 } else { flags::END_UNSEEN },
        }
    }
}
