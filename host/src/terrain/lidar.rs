//! A spinning LiDAR, cast ray by ray against the ground and against boxes.
//!
//! The head turns clockwise seen from above, from straight behind through left, ahead and right to straight behind again; the frame's
//! stamp is the instant at which it looks forward, in the middle of the turn. Every ray leaves from where the sensor
//! is at that ray's own instant, and is written in the sensor's axes of that instant: the frame carries the distortion
//! that a real spinning sensor's raw frame has.
//!
//! The ground is met by marching: a step is never longer than the height above ground divided by the steepest closing
//! rate, so nothing wider than a curb's face is stepped over, and a bisection finishes.

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};
use serde::{Deserialize, Serialize};

use super::scene::Road;

/// The sensor's layout.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Lidar {
    /// 64 (as HDL-64E), 32 (as HDL-32E) or 16 (as VLP-16).
    pub rings: u8,
    /// Columns a turn.
    pub columns: u32,
    /// Turns a second.
    pub rate_hz: f64,
    /// Height above the ground, m.
    pub height_m: f64,
    /// Standard deviation of a range, m.
    pub range_noise_m: f64,
    /// Longest range, m.
    pub max_range_m: f64,
}

impl Default for Lidar {
    fn default() -> Self {
        Self { rings: 64, columns: 2000, rate_hz: 10.0, height_m: 1.9, range_noise_m: 0.02, max_range_m: 120.0 }
    }
}

impl Lidar {
    /// Elevation angles of the rings, degrees, highest first. Data sheets: HDL-64E upper block +2 to -8.33 in thirds,
    /// lower -8.83 to -24.33 in halves; HDL-32E +10.67 to -30.67 in 4/3; VLP-16 +15 to -15 in twos.
    ///
    /// # Errors
    /// Names the number of rings when there is no such layout.
    pub fn elevations_deg(&self) -> Result<Vec<f64>, String> {
        match self.rings {
            64 => Ok((0..32)
                .map(|ring| 2.0 - f64::from(ring) / 3.0)
                .chain((0..32).map(|ring| -8.83 - 0.5 * f64::from(ring)))
                .collect()),
            32 => Ok((0..32).map(|ring| 10.67 - f64::from(ring) * 4.0 / 3.0).collect()),
            16 => Ok((0..16).map(|ring| 15.0 - 2.0 * f64::from(ring)).collect()),
            other => Err(format!("a LiDAR of {other} rings is not known: 64, 32 and 16 are")),
        }
    }
}

/// A box in the world: a body, a wheel base apart from the ground, a wall.
#[derive(Clone, Copy, Debug)]
pub struct Cuboid {
    /// World position of the centre of its bottom, m.
    pub base: [f64; 3],
    /// Heading, radians.
    pub yaw: f64,
    /// Half length, half width, height, m.
    pub size: [f64; 3],
    /// Velocity, m/s in the world.
    pub velocity: [f64; 2],
}

/// Position and attitude of the sensor at one instant.
#[derive(Clone, Copy, Debug)]
pub struct SensorPose {
    /// Sensor to world, row-major.
    pub rotation: [[f64; 3]; 3],
    /// World position, m.
    pub position: [f64; 3],
}

impl SensorPose {
    /// Turns a vector from the sensor's axes to the world's.
    #[must_use]
    pub fn turn(&self, v: [f64; 3]) -> [f64; 3] {
        let row = |r: &[f64; 3]| r[0] * v[0] + r[1] * v[1] + r[2] * v[2];
        [row(&self.rotation[0]), row(&self.rotation[1]), row(&self.rotation[2])]
    }

    /// The sensor's axes of a place in the world.
    #[must_use]
    pub fn back(&self, place: [f64; 3]) -> [f64; 3] {
        let from = [0, 1, 2].map(|axis| place[axis] - self.position[axis]);
        [0, 1, 2].map(|axis| (0..3).map(|row| self.rotation[row][axis] * from[row]).sum())
    }
}

/// The rotation of yaw, then pitch (nose down positive), then roll, all in radians (z up, x forward, y left).
#[must_use]
pub fn rotation(yaw: f64, pitch: f64, roll: f64) -> [[f64; 3]; 3] {
    let (sy, cy) = (libm::sin(yaw), libm::cos(yaw));
    let (sp, cp) = (libm::sin(pitch), libm::cos(pitch));
    let (sr, cr) = (libm::sin(roll), libm::cos(roll));
    [
        [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
        [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
        [-sp, cp * sr, cp * cr],
    ]
}

/// A number from the normal distribution.
pub fn gaussian(rng: &mut ChaCha8Rng) -> f64 {
    let unit = |word: u32| (f64::from(word) + 0.5) / 4_294_967_296.0;
    let radius = libm::sqrt(-2.0 * libm::log(unit(rng.next_u32())));
    radius * libm::cos(2.0 * core::f64::consts::PI * unit(rng.next_u32()))
}

/// One turn of the sensor: `pose_at(dt)` is the sensor's pose `dt` seconds from the frame's stamp.
///
/// # Errors
/// An unknown ring layout.
pub fn spin(
    lidar: &Lidar,
    road: &Road,
    bodies: &[Cuboid],
    pose_at: impl Fn(f64) -> SensorPose + Sync,
    seed: u64,
) -> Result<Vec<[f32; 4]>, String> {
    let elevations = lidar.elevations_deg()?;
    let rays: Vec<(f64, f64)> =
        elevations.iter().map(|deg| (libm::cos(deg.to_radians()), libm::sin(deg.to_radians()))).collect();
    let column = |index: u32| -> Vec<[f32; 4]> {
        let phase = f64::from(index) / f64::from(lidar.columns) - 0.5;
        let dt = phase / lidar.rate_hz;
        let pose = pose_at(dt);
        let azimuth = -2.0 * core::f64::consts::PI * phase;
        let (sin, cos) = (libm::sin(azimuth), libm::cos(azimuth));
        let mut rng = ChaCha8Rng::seed_from_u64(seed ^ (u64::from(index) << 32));
        let mut points = Vec::with_capacity(rays.len());
        for &(flat, up) in &rays {
            let direction = [flat * cos, flat * sin, up];
            let Some((range, intensity)) = cast(road, bodies, dt, pose.position, pose.turn(direction), lidar) else {
                continue;
            };
            let range = range + lidar.range_noise_m * gaussian(&mut rng);
            points.push([
                (direction[0] * range) as f32,
                (direction[1] * range) as f32,
                (direction[2] * range) as f32,
                intensity,
            ]);
        }
        points
    };
    let workers = std::thread::available_parallelism().map_or(1, usize::from).min(16) as u32;
    let share = lidar.columns.div_ceil(workers);
    let column = &column;
    let parts: Vec<Vec<[f32; 4]>> = std::thread::scope(|scope| {
        let handles: Vec<_> = (0..workers)
            .map(|worker| {
                let (from, to) = (worker * share, ((worker + 1) * share).min(lidar.columns));
                scope.spawn(move || (from..to).flat_map(column).collect())
            })
            .collect();
        handles.into_iter().map(|handle| handle.join().unwrap_or_default()).collect()
    });
    Ok(parts.concat())
}

fn cast(
    road: &Road,
    bodies: &[Cuboid],
    dt: f64,
    from: [f64; 3],
    direction: [f64; 3],
    lidar: &Lidar,
) -> Option<(f64, f32)> {
    let nearest = bodies.iter().filter_map(|body| body.meet(dt, from, direction)).fold(f64::INFINITY, f64::min);
    let limit = nearest.min(lidar.max_range_m);
    match ground(road, from, direction, limit) {
        Some(range) => Some((range, 0.3)),
        None if nearest <= lidar.max_range_m => Some((nearest, 0.7)),
        None => None,
    }
}

fn ground(road: &Road, from: [f64; 3], direction: [f64; 3], limit: f64) -> Option<f64> {
    let above =
        |t: f64| from[2] + direction[2] * t - road.height(from[0] + direction[0] * t, from[1] + direction[1] * t);
    let steep = 0.22f64.max(road.steepest_bump());
    let mut t = 0.8;
    let mut clear = above(t);
    if clear <= 0.0 {
        return None;
    }
    while t < limit {
        let closing = steep - direction[2];
        if closing <= 0.0 {
            return None;
        }
        let next = t + (clear / closing).max(0.02);
        let left = above(next);
        if left <= 0.0 {
            let (mut low, mut high) = (t, next);
            for _ in 0..20 {
                let middle = 0.5 * (low + high);
                if above(middle) > 0.0 { low = middle } else { high = middle }
            }
            return (high < limit).then_some(high);
        }
        // A ray 30 m above any ground on its way up never comes back.
        if left > 30.0 && direction[2] > 0.0 {
            return None;
        }
        (t, clear) = (next, left);
    }
    None
}

impl Cuboid {
    /// Distance at which a ray enters the box `dt` seconds from the frame's stamp.
    fn meet(&self, dt: f64, from: [f64; 3], direction: [f64; 3]) -> Option<f64> {
        let (sin, cos) = (libm::sin(self.yaw), libm::cos(self.yaw));
        let dx = from[0] - self.base[0] - self.velocity[0] * dt;
        let dy = from[1] - self.base[1] - self.velocity[1] * dt;
        // Most rays pass far to the side of a box: leave before the slab test.
        let reach = self.size[0] + self.size[1];
        let side = dx * direction[1] - dy * direction[0];
        if side * side > reach * reach {
            return None;
        }
        let origin = [dx * cos + dy * sin, dy * cos - dx * sin, from[2] - self.base[2]];
        let ray = [direction[0] * cos + direction[1] * sin, direction[1] * cos - direction[0] * sin, direction[2]];
        let low = [-self.size[0], -self.size[1], 0.0];
        let (mut enter, mut leave) = (0.0f64, f64::INFINITY);
        for axis in 0..3 {
            let inverse = 1.0 / ray[axis];
            let (a, b) = ((low[axis] - origin[axis]) * inverse, (self.size[axis] - origin[axis]) * inverse);
            enter = enter.max(a.min(b));
            leave = leave.min(a.max(b));
        }
        (enter > 0.0 && enter <= leave).then_some(enter)
    }
}
