//! What places of a drive are counted by: stations in metres where the vehicle moved; scans where it stood, or where no speed tells stations.
//! Pictures and the report share it, so that both have the same axis.

use super::Drive;
use crate::statistics::median;

/// A vehicle that came no further stood.
const STOOD_M: f64 = 1.0;

/// What is counted along a drive.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Unit {
    /// Stations, in metres: those of the table, and what `--station` takes.
    Metres,
    /// Scans from the start.
    Scans {
        /// Whether speeds are known and the vehicle stood; otherwise nothing tells stations.
        stood: bool,
    },
}

impl Unit {
    /// Its name behind a number.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Metres => "m",
            Self::Scans { .. } => "scans",
        }
    }

    /// What stands over slopes that are drawn along it.
    #[must_use]
    pub fn heading(self) -> &'static str {
        match self {
            Self::Metres => "Slopes along the road",
            Self::Scans { .. } => "Slopes, scan by scan",
        }
    }

    /// What stands at its axis.
    #[must_use]
    pub fn axis(self) -> &'static str {
        match self {
            Self::Metres => "station, metres",
            Self::Scans { stood: true } => "scans (the vehicle stood)",
            Self::Scans { stood: false } => "scans (the log has no speed to tell stations from)",
        }
    }
}

impl Drive {
    /// What its places are counted by.
    #[must_use]
    pub fn unit(&self) -> Unit {
        match self.span_m() {
            Some((from, to)) if to - from > STOOD_M => Unit::Metres,
            span => Unit::Scans { stood: span.is_some() },
        }
    }

    /// Where it begins and where it ends, in its [unit](Drive::unit).
    #[must_use]
    pub fn extent(&self) -> (f64, f64) {
        match (self.unit(), self.span_m()) {
            (Unit::Metres, Some(span)) => span,
            _ => (0.0, self.scans.len() as f64),
        }
    }

    /// Where one of its scans is, in a unit.
    #[must_use]
    pub fn at(&self, unit: Unit, scan: usize) -> Option<f64> {
        match unit {
            Unit::Scans { .. } => Some(scan as f64),
            Unit::Metres => self.scans.get(scan).map(|scan| scan.station_m).filter(|station| station.is_finite()),
        }
    }

    /// Length of the shortest place that scans can be gathered into, in its unit: a mean and a spread take two of them.
    #[must_use]
    pub fn least_place(&self) -> f64 {
        let between = |unit| match unit {
            Unit::Scans { .. } => Some(1.0),
            Unit::Metres => {
                let steps = self.scans.windows(2).map(|pair| pair[1].station_m - pair[0].station_m);
                median(&mut steps.filter(|step| *step > 0.0).collect::<Vec<_>>())
            }
        };
        2.0 * between(self.unit()).unwrap_or_default()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::drive::Scan;

    fn drive(stations: &[f64]) -> Drive {
        Drive { scans: (0..).zip(stations).map(|(i, at)| Scan::at(i, *at)).collect(), ..Drive::default() }
    }

    #[test]
    fn a_vehicle_that_stood_is_told_from_a_log_without_speed() {
        let moved = drive(&[f64::NAN, 11.0, 11.6, 11.6, 12.2, 13.2]);
        assert_eq!((moved.unit(), moved.extent()), (Unit::Metres, (11.0, 13.2)));
        assert!((moved.least_place() - 1.2).abs() < 1e-9, "what stands still between has no spacing");
        assert_eq!((moved.at(Unit::Metres, 0), moved.at(Unit::Metres, 1)), (None, Some(11.0)));
        let stood = drive(&[0.0, 0.0, 0.1]);
        assert_eq!((stood.unit(), stood.extent()), (Unit::Scans { stood: true }, (0.0, 3.0)));
        assert_eq!((stood.at(stood.unit(), 2), stood.least_place()), (Some(2.0), 2.0));
        assert_eq!(drive(&[f64::NAN; 2]).unit(), Unit::Scans { stood: false });
    }
}
