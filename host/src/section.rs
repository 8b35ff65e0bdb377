//! One levelled section out of a log: what the survey saw and what it made of it.

use std::path::Path;

use crossfall_core::protocol::message::{self, Message, Profile, Slope};

use crate::container::Error;
use crate::interrupt;
use crate::side::Side;
use crate::statistics::median;
use crate::units::{degrees, metres};
use crate::walk::Walk;

/// A place in a section: metres to the left of the sensor and above it.
pub type Place = (f64, f64);

/// A section.
#[derive(Clone, Debug)]
pub struct Section {
    /// Points as measured, without roll and mounting offset.
    pub raw: Vec<Place>,
    /// Points with every beam turned by the roll of its own instant.
    pub levelled: Vec<Place>,
    /// What the board made of it.
    pub profile: Profile,
}

/// What a line of a section is fitted to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Part {
    /// The road, from under the sensor to its edge.
    Road,
    /// The adjacent slope.
    Adjacent,
    /// The opposing slope.
    Opposing,
}

/// A fitted line between two places.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Fitted {
    /// What it is fitted to.
    pub part: Part,
    /// On which side.
    pub side: Side,
    /// Its end towards the vehicle.
    pub inner: Place,
    /// Its other end.
    pub outer: Place,
    /// Inclination in degrees, positive = rising outward.
    pub slope_deg: f64,
    /// Half width of its 95 % interval; absent where the method gives none.
    pub ci95_deg: Option<f64>,
    /// Points that support it; 0 for a road.
    pub points: u16,
}

impl Fitted {
    /// Height of the line at a lateral distance.
    #[must_use]
    pub fn height(&self, y_m: f64) -> f64 {
        self.inner.1 + self.slope_deg.to_radians().tan() * self.side.outward() * (y_m - self.inner.0)
    }

    /// Whether a lateral distance is between its ends.
    #[must_use]
    pub fn spans(&self, y_m: f64) -> bool {
        (self.inner.0.min(self.outer.0)..=self.inner.0.max(self.outer.0)).contains(&y_m)
    }
}

impl Section {
    /// The fitted lines.
    #[must_use]
    pub fn lines(&self) -> Vec<Fitted> {
        lines(&self.profile, &self.levelled)
    }
}

/// The fitted lines of a profile over its levelled points: left side before right, from the road outward. A profile tells slopes and lateral
/// places; heights are those of the points there.
#[must_use]
pub fn lines(profile: &Profile, points: &[Place]) -> Vec<Fitted> {
    let mut lines = Vec::new();
    let mut room = Vec::new();
    for side in Side::BOTH {
        lines.extend(of_side(side.of(profile), side, points, &mut room).into_iter().flatten());
    }
    lines
}

fn of_side(found: &message::Side, side: Side, points: &[Place], room: &mut Vec<f64>) -> [Option<Fitted>; 3] {
    let mut through = |part: Part, slope_deg: f64, from: f64, to: f64| {
        let rise = slope_deg.to_radians().tan() * side.outward();
        let base = height_at_sensor(points, rise, (from, to), room)?;
        let place = |y: f64| (y, base + rise * y);
        Some(Fitted { part, side, inner: place(from), outer: place(to), slope_deg, ci95_deg: None, points: 0 })
    };
    let road = found.road.zip(found.edge);
    let road = road.and_then(|(slope, edge)| through(Part::Road, degrees(slope), 0.0, metres(edge.y_um)));
    let mut slope = |part: Part, slope: Option<Slope>| {
        let slope = slope?;
        let ci95 = degrees(slope.ci95);
        let fitted = through(part, degrees(slope.angle), metres(slope.start.y_um), metres(slope.end.y_um))?;
        Some(Fitted { ci95_deg: (ci95 > 0.0).then_some(ci95), points: slope.points, ..fitted })
    };
    let adjacent = slope(Part::Adjacent, found.adjacent);
    [road, adjacent, slope(Part::Opposing, found.opposing)]
}

/// The height under the sensor of a line whose rise to the left is known: the median of what the points between two lateral distances make of it;
/// nothing without points.
fn height_at_sensor(points: &[Place], rise: f64, (from, to): (f64, f64), room: &mut Vec<f64>) -> Option<f64> {
    let (low, high) = (from.min(to), from.max(to));
    room.clear();
    room.extend(points.iter().filter(|(y, _)| (low..=high).contains(y)).map(|(y, z)| z - rise * y));
    median(room)
}

/// Slopes of small pieces along a section: at each lateral distance, that of a window such as a four-foot level would lie on.
///
/// A least-squares line through the points of the window; windows with fewer than four points are left out. Slopes in degrees, positive =
/// rising outward.
#[must_use]
pub fn local_slopes(points: &[Place], window_m: f64) -> Vec<(f64, f64)> {
    let mut slopes = Vec::new();
    let reach = points.iter().map(|point| point.0.abs()).fold(0.0, f64::max).min(30.0);
    let steps = (reach / 0.1) as i32;
    for step in -steps..=steps {
        let at = f64::from(step) * 0.1;
        let near = points.iter().filter(|point| (point.0 - at).abs() <= window_m / 2.0);
        let (mut n, mut sy, mut sz, mut syy, mut syz) = (0.0, 0.0, 0.0, 0.0, 0.0);
        for &(y, z) in near {
            let y = y - at;
            (n, sy, sz, syy, syz) = (n + 1.0, sy + y, sz + z, syy + y * y, syz + y * z);
        }
        let spread = n * syy - sy * sy;
        if n >= 4.0 && spread > 1e-6 {
            let slope = ((n * syz - sy * sz) / spread).atan().to_degrees();
            slopes.push((at, if at >= 0.0 { slope } else { -slope }));
        }
    }
    slopes
}

/// The section of a scan, by the scan's number; nothing when the log has no profile of it.
///
/// # Errors
/// When the file cannot be read or is no log.
pub fn of_scan(path: &Path, number: u32) -> Result<Option<Section>, Error> {
    let mut walk = Walk::open(path)?;
    let wanted = |message: &Message<'_>| matches!(message, Message::Profile(profile) if profile.scan == number);
    let found = walk.next(|message, _| wanted(message)).map(|step| step.section());
    interrupt::check()?;
    Ok(found)
}

#[cfg(test)]
mod tests {
    use crossfall_core::protocol::Angle;
    use crossfall_core::protocol::message::Hinge;

    use super::*;

    #[test]
    fn a_line_goes_through_the_middle_of_its_points() {
        let points: Vec<Place> = (0..50).map(|i| f64::from(i) * 0.1).map(|y| (-3.0 - y, -2.0 - 0.1 * y)).collect();
        let hinge = |y_um| Hinge { y_um, ..Hinge::default() };
        let (angle, ci95) = (Angle::from_microdegrees(-5_710_593), Angle::from_microdegrees(100_000));
        let slope =
            |start, end| Slope { angle, ci95, points: 40, start: hinge(start), end: hinge(end), ..Slope::default() };
        // Of a road without an edge no end is known; nothing lies where the opposing slope is said to be.
        let (adjacent, opposing) = (Some(slope(-3_000_000, -7_000_000)), Some(slope(-9_000_000, -10_000_000)));
        let said = message::Side { road: Some(angle), adjacent, opposing, ..message::Side::default() };
        let [None, Some(found), None] = of_side(&said, Side::Right, &points, &mut Vec::new()) else {
            panic!("one line")
        };
        assert_eq!((found.part, found.side, found.points), (Part::Adjacent, Side::Right, 40));
        assert!((found.ci95_deg.unwrap() - 0.1).abs() < 1e-6);
        assert!((found.inner.1 + 2.0).abs() < 1e-6 && (found.outer.1 + 2.4).abs() < 1e-6, "{found:?}");
        assert_eq!((found.inner.0, found.outer.0), (-3.0, -7.0));
    }

    #[test]
    fn local_slopes_are_those_of_the_ground() {
        let points: Vec<Place> = (-100..=100)
            .map(|i| {
                let y = f64::from(i) * 0.1;
                (y, if y.abs() < 4.0 { 0.0 } else { -(y.abs() - 4.0) * 0.1 })
            })
            .collect();
        let slopes = local_slopes(&points, 1.2);
        let at = |y: f64| slopes.iter().find(|one| (one.0 - y).abs() < 1e-9).unwrap().1;
        assert!(at(0.0).abs() < 1e-9);
        // Falling outward on both sides.
        for y in [7.0, -7.0] {
            assert!((at(y) + 0.1_f64.atan().to_degrees()).abs() < 1e-9, "{}", at(y));
        }
    }
}
