//! Units of the core as the host's floats: where binary angles, micrometres and clock drift become them.

use crossfall_core::protocol::Angle;
use crossfall_core::protocol::message::ClockState;
use crossfall_core::scan::Echo;

use crate::section::Place;

/// Binary units of a turn.
const TURN: f64 = 4_294_967_296.0;

/// Degrees of a binary angle, exactly: an angle times 360 has 40 bits.
#[must_use]
pub fn degrees(angle: Angle) -> f64 {
    f64::from(angle.0) * (360.0 / TURN)
}

/// The binary angle nearest to a number of degrees.
#[must_use]
pub fn angle_of(degrees: f64) -> Angle {
    // Through 64 bits: casting on to 32 keeps the angle modulo one turn.
    Angle((degrees / 360.0 * TURN).round() as i64 as i32)
}

/// Metres of micrometres.
#[must_use]
pub fn metres(micrometres: i32) -> f64 {
    f64::from(micrometres) * 1e-6
}

/// Metres of micrometres as viewers get them, in single precision all the way.
#[must_use]
pub fn metres_f32(micrometres: i32) -> f32 {
    micrometres as f32 * 1e-6
}

/// Where in its section a point lies.
#[must_use]
pub fn place(echo: &Echo) -> Place {
    (metres(echo.point.y_um), metres(echo.point.z_um))
}

/// How much faster than GPS the board's clock runs, as a share.
#[must_use]
pub fn drift(clock: &ClockState) -> f64 {
    f64::from(clock.drift) / TURN
}

/// How much faster than GPS the board's clock runs, in millionths.
#[must_use]
pub fn drift_ppm(clock: &ClockState) -> f64 {
    f64::from(clock.drift) / 4_294.967_296
}
