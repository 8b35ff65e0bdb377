//! From WGS 84 to metres and back.
//!
//! Projected coordinates are UTM on WGS 84, by `proj4rs` (PROJ's own transverse Mercator: a micrometre of agreement): maps and point-cloud
//! programs know them by their EPSG code. Small shifts - a lever arm, a beam - are made on the ellipsoid itself with its radii of curvature, exact
//! to a millimetre at a hundred metres, so that a point's place does not carry the projection's scale.

use std::sync::OnceLock;

use proj4rs::proj::Proj;
use proj4rs::transform::transform;

/// Semi-major axis of WGS 84.
const SEMI_MAJOR_M: f64 = 6_378_137.0;
/// First eccentricity squared of WGS 84.
const ECCENTRICITY_2: f64 = 6.694_379_990_141_316e-3;

/// Latitude and longitude in degrees (WGS 84), ellipsoid height in metres.
pub type Geodetic = [f64; 3];

/// A place that the projection does not have.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("the place {place} has no UTM coordinates: {why}")]
pub struct Error {
    place: String,
    why: String,
}

impl Error {
    fn new(place: &impl std::fmt::Debug, why: impl ToString) -> Self {
        Self { place: format!("{place:?}"), why: why.to_string() }
    }
}

/// Metres to a degree of latitude and of longitude at a place.
#[must_use]
pub fn metres_per_degree([latitude, _, height]: Geodetic) -> [f64; 2] {
    let (sin, cos) = latitude.to_radians().sin_cos();
    let w2 = 1.0 - ECCENTRICITY_2 * sin * sin;
    let east = SEMI_MAJOR_M / w2.sqrt() + height;
    let north = SEMI_MAJOR_M * (1.0 - ECCENTRICITY_2) / (w2 * w2.sqrt()) + height;
    [north.to_radians(), (east * cos).to_radians()]
}

/// The place some metres to the east, north and up of another. For distances of up to a hundred metres, away from the poles.
#[must_use]
pub fn shifted(from: Geodetic, [east, north, up]: [f64; 3]) -> Geodetic {
    let [per_latitude, per_longitude] = metres_per_degree(from);
    [from[0] + north / per_latitude, from[1] + east / per_longitude, from[2] + up]
}

/// Metres east and north from one place to another nearby.
#[must_use]
pub fn between(from: Geodetic, to: Geodetic) -> [f64; 2] {
    let middle = [(from[0] + to[0]) / 2.0, from[1], (from[2] + to[2]) / 2.0];
    Plane { origin: from, per_degree_m: metres_per_degree(middle) }.metres(to)
}

/// From one direction or longitude to another the short way round, in degrees from -180 to 180.
#[must_use]
pub fn turned_deg(from: f64, to: f64) -> f64 {
    (to - from + 180.0).rem_euclid(360.0) - 180.0
}

/// A flat map that touches the earth at its origin: for a picture, good to a pixel over a hundred miles.
#[derive(Clone, Copy, Debug)]
pub struct Plane {
    origin: Geodetic,
    /// Metres to a degree of latitude and of longitude.
    per_degree_m: [f64; 2],
}

impl Plane {
    /// The one around a place.
    #[must_use]
    pub fn at(origin: Geodetic) -> Self {
        Self { origin, per_degree_m: metres_per_degree(origin) }
    }

    /// Metres east and north of the origin.
    #[must_use]
    pub fn metres(&self, place: Geodetic) -> [f64; 2] {
        let [per_latitude, per_longitude] = self.per_degree_m;
        [turned_deg(self.origin[1], place[1]) * per_longitude, (place[0] - self.origin[0]) * per_latitude]
    }
}

/// A zone of the Universal Transverse Mercator projection.
#[derive(Debug)]
pub struct Utm {
    zone: u8,
    south: bool,
    projection: Proj,
}

fn geographic() -> &'static Proj {
    static LONG_LAT: OnceLock<Proj> = OnceLock::new();
    LONG_LAT.get_or_init(|| Proj::from_proj_string("+proj=longlat +ellps=WGS84").expect("a constant that parses"))
}

impl Utm {
    /// The zone in which a place lies, the exceptions of Norway and Svalbard left aside.
    ///
    /// # Errors
    /// Beyond 84 degrees north and 80 degrees south.
    pub fn around(place: Geodetic) -> Result<Self, Error> {
        let [latitude, longitude, _] = place;
        if !(-80.0..=84.0).contains(&latitude) {
            return Err(Error::new(&place, "UTM ends at 80 degrees south and 84 degrees north"));
        }
        let zone = (((longitude + 180.0).rem_euclid(360.0) / 6.0) as u8).min(59) + 1;
        let south = latitude < 0.0;
        let text = format!("+proj=utm +zone={zone} +ellps=WGS84 +units=m{}", if south { " +south" } else { "" });
        let projection = Proj::from_proj_string(&text).map_err(|error| Error::new(&place, error))?;
        Ok(Self { zone, south, projection })
    }

    /// The EPSG code: 32601 to 32660 in the north, 32701 to 32760 in the south.
    #[must_use]
    pub fn epsg(&self) -> u16 {
        if self.south { 32_700 + u16::from(self.zone) } else { 32_600 + u16::from(self.zone) }
    }

    /// Easting, northing and ellipsoid height.
    ///
    /// # Errors
    /// For a place too far from the zone.
    pub fn project(&self, place: Geodetic) -> Result<[f64; 3], Error> {
        let mut point = (place[1].to_radians(), place[0].to_radians(), place[2]);
        transform(geographic(), &self.projection, &mut point).map_err(|error| Error::new(&place, error))?;
        Ok([point.0, point.1, place[2]])
    }

    /// Latitude, longitude and ellipsoid height.
    ///
    /// # Errors
    /// For a place that no point of the ellipsoid has.
    pub fn geodetic(&self, place: [f64; 3]) -> Result<Geodetic, Error> {
        let mut point = (place[0], place[1], place[2]);
        transform(&self.projection, geographic(), &mut point).map_err(|error| Error::new(&place, error))?;
        Ok([point.1.to_degrees(), point.0.to_degrees(), place[2]])
    }

    /// How metres on the ground lie on the map near a place.
    ///
    /// # Errors
    /// As of [`Utm::project`].
    pub fn around_place(&self, place: Geodetic) -> Result<Patch, Error> {
        const REACH_M: f64 = 50.0;
        let origin = self.project(place)?;
        let north = self.project(shifted(place, [0.0, REACH_M, 0.0]))?;
        // The projection is conformal: one direction tells all.
        let step = [(north[0] - origin[0]) / REACH_M, (north[1] - origin[1]) / REACH_M];
        Ok(Patch { origin, north: step })
    }
}

/// A zone's coordinate system in words that GIS programs read (OGC WKT 1), by its EPSG code.
#[must_use]
pub fn wkt(epsg: u16) -> String {
    let zone = epsg % 100;
    let meridian = i32::from(zone) * 6 - 183;
    let (letter, false_northing) = if epsg >= 32_700 { ("S", 10_000_000) } else { ("N", 0) };
    format!(
        "PROJCS[\"WGS 84 / UTM zone {zone}{letter}\",GEOGCS[\"WGS 84\",DATUM[\"WGS_1984\",SPHEROID[\"WGS 84\",6378137,298.257223563,\
         AUTHORITY[\"EPSG\",\"7030\"]],AUTHORITY[\"EPSG\",\"6326\"]],PRIMEM[\"Greenwich\",0,AUTHORITY[\"EPSG\",\"8901\"]],\
         UNIT[\"degree\",0.0174532925199433,AUTHORITY[\"EPSG\",\"9122\"]],AUTHORITY[\"EPSG\",\"4326\"]],\
         PROJECTION[\"Transverse_Mercator\"],PARAMETER[\"latitude_of_origin\",0],PARAMETER[\"central_meridian\",{meridian}],\
         PARAMETER[\"scale_factor\",0.9996],PARAMETER[\"false_easting\",500000],PARAMETER[\"false_northing\",{false_northing}],\
         UNIT[\"metre\",1,AUTHORITY[\"EPSG\",\"9001\"]],AXIS[\"Easting\",EAST],AXIS[\"Northing\",NORTH],AUTHORITY[\"EPSG\",\"{epsg}\"]]"
    )
}

/// The map near one place, as a plane: exact to a tenth of a millimetre within a hundred metres.
#[derive(Clone, Copy, Debug)]
pub struct Patch {
    origin: [f64; 3],
    /// The map's step for a metre to the north.
    north: [f64; 2],
}

impl Patch {
    /// Map coordinates of the place some metres to the east, north and up.
    #[must_use]
    pub fn place(&self, [east, north, up]: [f64; 3]) -> [f64; 3] {
        let [n0, n1] = self.north;
        [self.origin[0] + north * n0 + east * n1, self.origin[1] + north * n1 - east * n0, self.origin[2] + up]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A place in zone 31. Its coordinates below are Krüger's series to the third order of n, evaluated apart.
    const PARIS: Geodetic = [48.858_222, 2.2945, 35.0];

    #[test]
    fn a_known_place_has_its_coordinates() {
        let utm = Utm::around(PARIS).unwrap();
        let [east, north, height] = utm.project(PARIS).unwrap();
        assert_eq!((utm.epsg(), height), (32_631, 35.0));
        assert!((east - 448_251.818).abs() < 1e-3 && (north - 5_411_935.123).abs() < 1e-3, "{east} {north}");
    }

    #[test]
    fn places_come_back() {
        for place in [PARIS, [-33.9, 151.2, 4.0], [40.8, -77.86, 350.0], [0.1, -179.99, 0.0], [60.0, 179.99, 9.0]] {
            let utm = Utm::around(place).unwrap();
            let back = utm.geodetic(utm.project(place).unwrap()).unwrap();
            let [east, north] = between(place, back);
            assert!(east.hypot(north) < 1e-6, "{place:?} {back:?}");
        }
        assert!(Utm::around([85.0, 0.0, 0.0]).is_err());
    }

    #[test]
    fn a_patch_is_the_projection_nearby() {
        for place in [PARIS, [40.8, -77.86, 350.0], [-45.0, 5.9, 2_000.0]] {
            let utm = Utm::around(place).unwrap();
            let patch = utm.around_place(place).unwrap();
            for shift in [[30.0, 0.0, 1.0], [-20.0, 25.0, -3.0], [0.0, -60.0, 0.0]] {
                let (ours, exact) = (patch.place(shift), utm.project(shifted(place, shift)).unwrap());
                assert!((ours[0] - exact[0]).hypot(ours[1] - exact[1]) < 1e-3, "{ours:?} {exact:?}");
                assert!((ours[2] - exact[2]).abs() < 1e-9);
            }
        }
    }

    #[test]
    fn a_plane_goes_on_across_the_date_line() {
        let plane = Plane::at([10.0, 179.999, 0.0]);
        let [east, north] = plane.metres([10.001, -179.999, 0.0]);
        assert!((east - 219.3).abs() < 0.1 && (north - 110.6).abs() < 0.1, "{east} {north}");
        assert_eq!((turned_deg(-170.0, 170.0), turned_deg(350.0, 20.0)), (-20.0, 30.0));
    }

    #[test]
    fn shifts_and_distances_agree() {
        let [east, north] = between(PARIS, shifted(PARIS, [12.0, -34.0, 0.0]));
        assert!((east - 12.0).abs() < 1e-3 && (north + 34.0).abs() < 1e-3, "{east} {north}");
        // A minute of latitude at 45 degrees is 1852.2 m, by definition of the nautical mile to within its rounding.
        assert!((metres_per_degree([45.0, 0.0, 0.0])[0] / 60.0 - 1_852.2).abs() < 0.1);
    }
}
