//! The returns of a short stretch of road, in metres from where it begins: what a picture of the cloud shows.

use std::path::Path;

use crossfall_core::protocol::message::Message;

use super::{Class, Error, Room};
use crate::geodesy::Utm;
use crate::interrupt;
use crate::walk::Walk;

/// Metres forward, to the left and up from the scanner's first place on the stretch, forward being its heading there.
pub type Local = [f64; 3];

/// A stretch.
#[derive(Clone, Debug, Default)]
pub struct Stretch {
    /// Its returns.
    pub returns: Vec<(Local, Class)>,
    /// Its sections, in order.
    pub sections: Vec<Across>,
    /// The way of the scanner over it.
    pub length_m: f64,
}

/// One section's returns from right to left.
#[derive(Clone, Debug)]
pub struct Across {
    /// Metres along the road from the beginning of the stretch.
    pub at_m: f64,
    /// The returns of its first mirror turn, those far from every surface left out: the next turn is a foot further along the road.
    pub places: Vec<Local>,
}

/// A turn sees the ground within half of its 13.32 ms.
const TURN_S: f64 = 0.010;

impl Stretch {
    /// Reads the scans between two stations of a log, in metres.
    ///
    /// # Errors
    /// When the log cannot be read, a place is not on the map, or the user asks to stop.
    pub fn read(log: &Path, from_m: f64, to_m: f64) -> Result<Self, Error> {
        let mut walk = Walk::open(log)?;
        let mut room = Room::default();
        let mut stretch = Self::default();
        let mut frame: Option<(Utm, [f64; 3], f64)> = None;
        while let Some(step) = walk.next(|message, track| {
            let Message::Profile(profile) = message else { return false };
            track.at(profile.time).station_m.is_some_and(|station| (from_m..to_m).contains(&station))
        }) {
            let Some(((place, turn), station_m)) =
                step.position.geodetic.zip(step.position.turn).zip(step.position.station_m)
            else {
                continue;
            };
            if frame.is_none() {
                let utm = Utm::around(place)?;
                let origin = utm.project(place)?;
                frame = Some((utm, origin, turn.azimuth));
            }
            let Some((utm, origin, azimuth)) = &frame else { continue };
            if !room.place(&step, utm, 0)? {
                continue;
            }
            let (sin, cos) = azimuth.sin_cos();
            let local = |place: [f64; 3]| {
                let (east, north) = (place[0] - origin[0], place[1] - origin[1]);
                [east * sin + north * cos, north * sin - east * cos, place[2] - origin[2]]
            };
            let at_m = station_m - from_m;
            let returns = room.returns.iter().map(|one| (local(one.place), one.class));
            let first = room.returns.iter().map(|one| one.gps_time).fold(f64::INFINITY, f64::min);
            let surface = |class: Class| class != Class::Other && class != Class::Vegetation;
            let across = room.returns.iter().filter(|one| surface(one.class) && one.gps_time - first < TURN_S);
            stretch.sections.push(Across { at_m, places: across.map(|one| local(one.place)).collect() });
            stretch.returns.extend(returns);
            stretch.length_m = at_m;
        }
        interrupt::check()?;
        Ok(stretch)
    }
}
