//! The logs in use, typed. Lengths and offsets are those of the manual's log pages; a body may be longer than
//! documented (later firmware appends fields), never shorter.

use crossfall_protocol::message::Fix;
use crossfall_protocol::{Angle, DeviceTime};

use super::frame::Header;
use super::ieee::Number;
use crate::clock::{GpsTime, WEEK_US};

/// Message numbers.
pub mod id {
    /// INSPVAS, the short-header form of [`INSPVA`].
    pub const INSPVAS: u16 = 508;
    /// INSPVA: position, velocity, attitude.
    pub const INSPVA: u16 = 507;
    /// INSATTS, the short-header form of [`INSATT`].
    pub const INSATTS: u16 = 319;
    /// INSATT: attitude.
    pub const INSATT: u16 = 263;
    /// INSPVAX: position, velocity, attitude and their deviations.
    pub const INSPVAX: u16 = 1465;
    /// RAWIMUS, the short-header form of [`RAWIMU`].
    pub const RAWIMUS: u16 = 325;
    /// RAWIMU: increments of velocity and angle.
    pub const RAWIMU: u16 = 268;
    /// BESTPOS: the position without inertial data.
    pub const BESTPOS: u16 = 42;
    /// TIME: GPS and UTC time.
    pub const TIME: u16 = 101;
}

/// A frame, decoded.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Event<'a> {
    /// Its header.
    pub header: Header,
    /// Its contents.
    pub log: Log<'a>,
}

/// Contents of a frame.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Log<'a> {
    /// INSPVA(S), INSATT(S), INSPVAX; the last with its detail.
    Solution(InsSolution, Option<InspvaxDetail>),
    /// RAWIMU(S).
    RawImu(RawImu),
    /// BESTPOS.
    Position(Position),
    /// TIME.
    Time(TimeLog),
    /// Another message number, or a response: the body.
    Other(&'a [u8]),
    /// A known log of which this field cannot be true: not a number, out of its range, or not there.
    BadField(&'static str),
}

/// What an INS status allows.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Quality {
    /// Solution good or alignment complete (3, 7).
    Good,
    /// High variance or free inertial (2, 6): usable, to be flagged.
    Degraded,
    /// Aligning (1): position and velocity are those of the satellites, the angles are not known yet: zeros or rough ones are sent.
    Aligning,
    /// Anything else: inactive, waiting. Every field may be zero.
    Unusable,
}

impl Quality {
    /// That of an INS status, as sent.
    #[must_use]
    pub fn of(status: u8) -> Self {
        match status {
            3 | 7 => Self::Good,
            2 | 6 => Self::Degraded,
            1 => Self::Aligning,
            _ => Self::Unusable,
        }
    }

    /// Whether roll, pitch and azimuth are the vehicle's.
    #[must_use]
    pub fn has_attitude(self) -> bool {
        matches!(self, Self::Good | Self::Degraded)
    }

    /// Whether position and velocity are the vehicle's, where the log has them.
    #[must_use]
    pub fn has_position(self) -> bool {
        self != Self::Unusable
    }
}

/// The name of an INS status (INSPVAX, inertial solution status).
#[must_use]
pub fn state_name(status: u8) -> &'static str {
    match status {
        0 => "inactive",
        1 => "aligning",
        2 => "high variance",
        3 => "solution good",
        6 => "free inertial, no satellites",
        7 => "alignment complete",
        8 => "finding its orientation",
        9 => "waiting for its first position",
        10 => "waiting for its axes",
        11 => "initializing biases",
        12 => "movement detected",
        _ => "state unknown",
    }
}

/// A pose as the receiver gives it. Angles by its signs: roll positive = right side down, pitch positive = nose up,
/// azimuth clockwise from north.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct InsSolution {
    /// GPS week of the instant at which it is valid.
    pub week: u16,
    /// Microseconds into that week.
    pub gps_us: u64,
    /// Roll.
    pub roll: Angle,
    /// Pitch.
    pub pitch: Angle,
    /// Azimuth.
    pub azimuth: Angle,
    /// Position and velocity; absent from attitude-only logs and when one of its fields cannot be true.
    pub fix: Option<Fix>,
    /// INS status as sent.
    pub status: u8,
    /// Arrival of the frame's first byte.
    pub arrival: DeviceTime,
}

impl InsSolution {
    /// The instant at which it is valid.
    #[must_use]
    pub fn gps_time(&self) -> GpsTime {
        GpsTime { week: self.week, us: self.gps_us }
    }

    /// What its status allows.
    #[must_use]
    pub fn quality(&self) -> Quality {
        Quality::of(self.status)
    }
}

/// What INSPVAX tells beyond a pose. Deviations are one sigma.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct InspvaxDetail {
    /// Position type.
    pub position_type: u32,
    /// Geoid above ellipsoid.
    pub undulation_mm: i32,
    /// Latitude, longitude, height.
    pub position_sigma_mm: [u32; 3],
    /// North, east, up.
    pub velocity_sigma_mm_s: [u32; 3],
    /// Roll, pitch, azimuth.
    pub attitude_sigma: [Angle; 3],
    /// Extended solution status.
    pub extended_status: u32,
    /// Seconds since the last update from position or zero velocity.
    pub update_age_s: u16,
}

/// Raw inertial data over one interval, in the unit's own increments (HG1700: gyro 2^-33 rad; acceleration 2^-27 or
/// 2^-26 ft/s by type), axes as SPAN's: x right, y forward, z up, with y as the log has it, negated.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RawImu {
    /// End of the interval.
    pub time: GpsTime,
    /// The inertial unit's status word.
    pub status: u32,
    /// Velocity increments: x, -y, z.
    pub acceleration: [i32; 3],
    /// Angle increments: x, -y, z.
    pub rotation: [i32; 3],
}

/// A position without inertial data.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Position {
    /// Instant, from the header.
    pub time: GpsTime,
    /// Solution status, 0 = computed.
    pub solution_status: u32,
    /// Position type.
    pub position_type: u32,
    /// Latitude in 1e-9 degrees.
    pub latitude_ndeg: i64,
    /// Longitude in 1e-9 degrees.
    pub longitude_ndeg: i64,
    /// Height above mean sea level.
    pub height_msl_mm: i32,
    /// Geoid above ellipsoid: the ellipsoid height is the sum of both.
    pub undulation_mm: i32,
    /// Datum number, 61 = WGS 84.
    pub datum: u32,
    /// One sigma of latitude, longitude, height.
    pub sigma_mm: [u32; 3],
    /// Base station.
    pub station: [u8; 4],
    /// Age of differential data.
    pub differential_age_ms: u32,
    /// Age of the solution.
    pub solution_age_ms: u32,
    /// Satellites tracked.
    pub satellites_tracked: u8,
    /// Satellites in the solution.
    pub satellites_used: u8,
}

/// GPS and UTC time.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TimeLog {
    /// Instant, from the header.
    pub time: GpsTime,
    /// Clock model status, 0 = valid.
    pub clock_status: u32,
    /// Receiver clock less GPS time.
    pub offset_ns: i64,
    /// Its deviation, one sigma.
    pub offset_sigma_ns: i64,
    /// UTC less GPS time.
    pub utc_offset_us: i64,
    /// UTC year.
    pub year: u32,
    /// UTC month.
    pub month: u8,
    /// UTC day.
    pub day: u8,
    /// UTC hour.
    pub hour: u8,
    /// UTC minute.
    pub minute: u8,
    /// UTC milliseconds into the minute.
    pub ms: u32,
    /// UTC status, 1 = valid.
    pub utc_status: u32,
}

/// A body, read field by field. A field that is not there or is not a finite number is named by the error.
struct Fields<'a>(&'a [u8]);

impl Fields<'_> {
    fn bytes<const N: usize>(&self, at: usize) -> Result<[u8; N], &'static str> {
        self.0.get(at..).and_then(|rest| rest.first_chunk()).copied().ok_or("length")
    }

    fn u8(&self, at: usize) -> Result<u8, &'static str> {
        self.bytes(at).map(u8::from_le_bytes)
    }

    fn u32(&self, at: usize) -> Result<u32, &'static str> {
        self.bytes(at).map(u32::from_le_bytes)
    }

    fn i32(&self, at: usize) -> Result<i32, &'static str> {
        self.bytes(at).map(i32::from_le_bytes)
    }

    /// A double that `convert` accepts.
    fn f64<T>(&self, at: usize, name: &'static str, convert: fn(Number) -> Option<T>) -> Result<T, &'static str> {
        Number::from_f64_bits(u64::from_le_bytes(self.bytes(at)?)).and_then(convert).ok_or(name)
    }

    /// A float that `convert` accepts.
    fn f32<T>(&self, at: usize, name: &'static str, convert: fn(Number) -> Option<T>) -> Result<T, &'static str> {
        Number::from_f32_bits(u32::from_le_bytes(self.bytes(at)?)).and_then(convert).ok_or(name)
    }

    /// Week u32 and seconds f64.
    fn time(&self, at: usize) -> Result<GpsTime, &'static str> {
        let week = self.u32(at)?;
        let seconds = self.f64(at + 4, "seconds", Some)?;
        instant(week, seconds).ok_or("time")
    }

    fn latitude(&self, at: usize) -> Result<i64, &'static str> {
        self.f64(at, "latitude", |n| n.is_within(90).then(|| n.scaled(1_000_000_000)).flatten())
    }

    fn longitude(&self, at: usize) -> Result<i64, &'static str> {
        self.f64(at, "longitude", |n| n.is_within(180).then(|| n.scaled(1_000_000_000)).flatten())
    }

    fn millimetres(&self, at: usize, name: &'static str) -> Result<i32, &'static str> {
        self.f64(at, name, |n| n.scaled_i32(1_000))
    }

    /// Latitude, longitude, height, and north, east and up velocity: six doubles.
    fn fix(&self, position: usize, velocity: usize) -> Result<Fix, &'static str> {
        Ok(Fix {
            latitude_ndeg: self.latitude(position)?,
            longitude_ndeg: self.longitude(position + 8)?,
            height_mm: self.millimetres(position + 16, "height")?,
            velocity_mm_s: [
                self.millimetres(velocity, "north velocity")?,
                self.millimetres(velocity + 8, "east velocity")?,
                self.millimetres(velocity + 16, "up velocity")?,
            ],
        })
    }

    /// Roll, pitch and azimuth: three doubles.
    fn attitude(&self, at: usize) -> Result<[Angle; 3], &'static str> {
        Ok([
            self.f64(at, "roll", |n| n.is_within(180).then(|| n.degrees()).flatten())?,
            self.f64(at + 8, "pitch", |n| n.is_within(90).then(|| n.degrees()).flatten())?,
            self.f64(at + 16, "azimuth", Number::degrees)?,
        ])
    }

    fn ins_status(&self, at: usize) -> Result<u8, &'static str> {
        u8::try_from(self.u32(at)?).map_err(|_| "status")
    }

    /// Three floats, times 1000.
    fn sigmas(&self, at: usize, name: &'static str) -> Result<[u32; 3], &'static str> {
        let milli = |at| self.f32(at, name, |n| n.scaled_u32(1_000));
        Ok([milli(at)?, milli(at + 4)?, milli(at + 8)?])
    }
}

/// A log and the number of its fields that could not be true.
type Checked<'a> = (Log<'a>, u32);

impl<'a> Log<'a> {
    /// Reads a body.
    pub(super) fn read(header: &Header, body: &'a [u8]) -> Checked<'a> {
        let fields = Fields(body);
        let log = match header.id {
            _ if header.response => Ok((Self::Other(body), 0)),
            id::INSPVAS | id::INSPVA => fields.inspva(header),
            id::INSATTS | id::INSATT => fields.insatt(header),
            id::INSPVAX => fields.inspvax(header),
            id::RAWIMUS | id::RAWIMU => fields.rawimu(),
            id::BESTPOS => fields.bestpos(header),
            id::TIME => fields.time_log(header),
            _ => Ok((Self::Other(body), 0)),
        };
        log.unwrap_or_else(|field| (Self::BadField(field), 1))
    }
}

/// The logs.
impl<'a> Fields<'_> {
    /// A pose from roll, pitch and azimuth at `attitude` and the INS status at `status`. A position or velocity that
    /// cannot be true costs the fix and is counted, the attitude stands.
    fn solution(
        &self,
        arrival: DeviceTime,
        time: GpsTime,
        attitude: usize,
        status: usize,
        fix: Option<Result<Fix, &'static str>>,
    ) -> Result<(InsSolution, u32), &'static str> {
        let [roll, pitch, azimuth] = self.attitude(attitude)?;
        let status = self.ins_status(status)?;
        let bad = u32::from(matches!(fix, Some(Err(_))));
        let fix = fix.and_then(Result::ok);
        let GpsTime { week, us: gps_us } = time;
        Ok((InsSolution { week, gps_us, roll, pitch, azimuth, fix, status, arrival }, bad))
    }

    fn inspva(&self, header: &Header) -> Result<Checked<'a>, &'static str> {
        let (solution, bad) = self.solution(header.arrival, self.time(0)?, 60, 84, Some(self.fix(12, 36)))?;
        Ok((Log::Solution(solution, None), bad))
    }

    fn insatt(&self, header: &Header) -> Result<Checked<'a>, &'static str> {
        let (solution, bad) = self.solution(header.arrival, self.time(0)?, 12, 36, None)?;
        Ok((Log::Solution(solution, None), bad))
    }

    fn inspvax(&self, header: &Header) -> Result<Checked<'a>, &'static str> {
        let time = header.gps_time().ok_or("time")?;
        let (solution, bad) = self.solution(header.arrival, time, 60, 0, Some(self.fix(8, 36)))?;
        let detail = self.inspvax_detail();
        let bad = bad + u32::from(detail.is_err());
        Ok((Log::Solution(solution, detail.ok()), bad))
    }

    /// What is told beside the pose; a field of it that cannot be true costs this and is counted, the pose stands.
    fn inspvax_detail(&self) -> Result<InspvaxDetail, &'static str> {
        let sigma = |at| self.f32(at, "attitude deviation", Number::degrees);
        Ok(InspvaxDetail {
            position_type: self.u32(4)?,
            undulation_mm: self.f32(32, "undulation", |n| n.scaled_i32(1_000))?,
            position_sigma_mm: self.sigmas(84, "position deviation")?,
            velocity_sigma_mm_s: self.sigmas(96, "velocity deviation")?,
            attitude_sigma: [sigma(108)?, sigma(112)?, sigma(116)?],
            extended_status: self.u32(120)?,
            update_age_s: self.bytes(124).map(u16::from_le_bytes)?,
        })
    }

    fn rawimu(&self) -> Result<Checked<'a>, &'static str> {
        let raw = RawImu {
            time: self.time(0)?,
            status: self.u32(12)?,
            acceleration: [self.i32(24)?, self.i32(20)?, self.i32(16)?],
            rotation: [self.i32(36)?, self.i32(32)?, self.i32(28)?],
        };
        Ok((Log::RawImu(raw), 0))
    }

    fn bestpos(&self, header: &Header) -> Result<Checked<'a>, &'static str> {
        let milliseconds = |at| self.f32(at, "age", |n| n.scaled_u32(1_000));
        let position = Position {
            time: header.gps_time().ok_or("time")?,
            solution_status: self.u32(0)?,
            position_type: self.u32(4)?,
            latitude_ndeg: self.latitude(8)?,
            longitude_ndeg: self.longitude(16)?,
            height_msl_mm: self.millimetres(24, "height")?,
            undulation_mm: self.f32(32, "undulation", |n| n.scaled_i32(1_000))?,
            datum: self.u32(36)?,
            sigma_mm: self.sigmas(40, "position deviation")?,
            station: self.bytes(52)?,
            differential_age_ms: milliseconds(56)?,
            solution_age_ms: milliseconds(60)?,
            satellites_tracked: self.u8(64)?,
            satellites_used: self.u8(65)?,
        };
        Ok((Log::Position(position), 0))
    }

    fn time_log(&self, header: &Header) -> Result<Checked<'a>, &'static str> {
        let nanoseconds = |at, name| self.f64(at, name, |n| n.scaled(1_000_000_000));
        let time = TimeLog {
            time: header.gps_time().ok_or("time")?,
            clock_status: self.u32(0)?,
            offset_ns: nanoseconds(4, "clock offset")?,
            offset_sigma_ns: nanoseconds(12, "clock deviation")?,
            utc_offset_us: self.f64(20, "UTC offset", |n| n.scaled(1_000_000))?,
            year: self.u32(28)?,
            month: self.u8(32)?,
            day: self.u8(33)?,
            hour: self.u8(34)?,
            minute: self.u8(35)?,
            ms: self.u32(36)?,
            utc_status: self.u32(40)?,
        };
        Ok((Log::Time(time), 0))
    }
}

/// A week and seconds into it, as in a log's body, rounded to the nearest microsecond; none outside the week.
fn instant(week: u32, seconds: Number) -> Option<GpsTime> {
    let week = u16::try_from(week).ok()?;
    let us = u64::try_from(seconds.scaled(1_000_000)?).ok()?;
    match us {
        ..WEEK_US => Some(GpsTime { week, us }),
        // The last half microsecond of a week rounds into the next.
        WEEK_US => Some(GpsTime { week: week.checked_add(1)?, us: 0 }),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn seconds_of_the_week_end_with_it() {
        let at = |week, seconds: f64| instant(week, Number::from_f64_bits(seconds.to_bits()).unwrap());
        assert_eq!(at(2209, 604_799.999_999_1), Some(GpsTime { week: 2209, us: WEEK_US - 1 }));
        assert_eq!(at(2209, 604_799.999_999_9), Some(GpsTime { week: 2210, us: 0 }));
        assert_eq!(at(2209, 604_800.1), None);
        assert_eq!(at(2209, -1.0), None);
        assert_eq!(at(65_536, 1.0), None);
    }
}
