//! The drive as a few hundred places along the road.

use crate::drive::{Drive, Unit};
use crate::geodesy::Geodetic;
use crate::intervals::{Estimate, Sample, Samples};
use crate::side::WhichSlope;

use super::BINS;

/// The places.
#[derive(Debug)]
pub struct Bins {
    /// What is counted.
    pub unit: Unit,
    /// Where the first begins, in the unit.
    pub from: f64,
    /// Where the last ends.
    pub to: f64,
    /// The length of one.
    pub width: f64,
    /// Those that have scans, in order.
    pub list: Vec<Bin>,
}

/// One place.
#[derive(Clone, Debug)]
pub struct Bin {
    /// Its middle.
    pub at: f64,
    /// Scans in it, also those that have no part in the slopes.
    pub scans: u64,
    /// Where its first scan was.
    pub place: Option<Geodetic>,
    /// The four slopes, where found in sections that can be relied on.
    pub slopes: [Option<Estimate>; 4],
}

impl Bins {
    /// Sorts a drive's scans into bins of a round length.
    pub fn of(drive: &Drive) -> Self {
        let (unit, (from, to)) = (drive.unit(), drive.extent());
        let width = round_length(((to - from).max(1.0) / BINS as f64).max(drive.least_place()));
        let mut bins = Self { unit, from, to: to.max(from + 1.0), width, list: Vec::new() };
        let mut open: Option<(i64, Bin, [Samples; 4])> = None;
        for (i, scan) in drive.scans.iter().enumerate() {
            let Some(at) = drive.at(unit, i) else { continue };
            let number = ((at - from) / width).floor() as i64;
            if open.as_ref().is_none_or(|(open, _, _)| *open != number) {
                bins.close(open.take());
                let bin = Bin { at: from + (number as f64 + 0.5) * width, scans: 0, place: None, slopes: [None; 4] };
                open = Some((number, bin, Default::default()));
            }
            let Some((_, bin, samples)) = &mut open else { continue };
            bin.scans += 1;
            bin.place = bin.place.or(scan.place[0].is_finite().then_some(scan.place));
            for (slope, samples) in WhichSlope::ALL.into_iter().zip(samples) {
                let found = scan.reliable(slope);
                found.into_iter().for_each(|(value, ci95)| samples.push(Sample::new(value, ci95, at)));
            }
        }
        bins.close(open);
        bins
    }

    fn close(&mut self, open: Option<(i64, Bin, [Samples; 4])>) {
        if let Some((_, mut bin, samples)) = open {
            bin.slopes = samples.map(|samples| samples.estimate());
            self.list.push(bin);
        }
    }

    /// Runs of neighbouring bins in which a slope was found.
    pub fn runs(&self, slope: WhichSlope) -> impl Iterator<Item = Vec<(f64, Estimate)>> {
        let found: Vec<_> = self.list.iter().filter_map(|bin| Some((bin.at, bin.slopes[slope.index()]?))).collect();
        let width = self.width;
        let runs: Vec<_> = found.chunk_by(|a, b| b.0 - a.0 < 2.5 * width).map(<[_]>::to_vec).collect();
        runs.into_iter()
    }
}

/// The next of 1, 2, 5, 10, ... that is at least as long.
pub fn round_length(least: f64) -> f64 {
    let decade = 10_f64.powf(least.log10().floor());
    [1.0, 2.0, 5.0]
        .into_iter()
        .map(|step| step * decade)
        .find(|step| *step >= least * 0.999_999)
        .unwrap_or(10.0 * decade)
}

#[cfg(test)]
mod tests {
    use crossfall_core::protocol::message::flags;

    use super::*;
    use crate::drive::Scan;
    use crate::report::tables;

    #[test]
    fn what_says_itself_unreliable_is_counted_and_has_no_part() {
        let scans = (0..900).map(|number| {
            // The right side is doubtful where the left one lost its attitude, and further.
            let (left, right) = match number {
                100..220 => (flags::NO_ATTITUDE, flags::NO_ATTITUDE),
                220..260 => (0, flags::DOUBTFUL),
                _ => (0, 0),
            };
            let slope = |flags: u16| if flags == 0 { (-8.0, 0.1) } else { (-30.0, 0.1) };
            Scan {
                slopes: [slope(left), (f32::NAN, f32::NAN), slope(right), (7.0, 0.1)],
                flags: [left, right],
                ..Scan::at(number, f64::from(number))
            }
        });
        let drive = Drive { scans: scans.collect(), ..Drive::default() };
        let bins = Bins::of(&drive);
        assert_eq!(bins.list.iter().map(|bin| bin.scans).sum::<u64>(), 900);
        for (slope, found) in [(0, 780), (1, 0), (2, 740), (3, 740)] {
            let estimates = || bins.list.iter().filter_map(|bin| bin.slopes[slope]);
            assert_eq!(estimates().map(|one| one.count).sum::<u64>(), found, "{slope}");
            assert!(estimates().all(|one| (one.value - if slope == 3 { 7.0 } else { -8.0 }).abs() < 1e-6), "{slope}");
            assert!((drive.found(WhichSlope::ALL[slope]) - found as f64 / 900.0).abs() < 1e-9);
        }
        let miles = tables::miles(&drive);
        assert!(miles.contains("<td>900</td><td>160</td><td>\u{2212}8.00"), "{miles}");
        assert!(!miles.contains("<td>13 %") && miles.contains("<td>0 %"), "nothing steeper than 1:4: {miles}");
    }

    #[test]
    fn lengths_are_round() {
        for (least, length) in [(1.0, 1.0), (1.1, 2.0), (0.03, 0.05), (6.0, 10.0), (229.0, 500.0)] {
            assert!((round_length(least) - length).abs() < 1e-9 * length, "{least}");
        }
    }
}
