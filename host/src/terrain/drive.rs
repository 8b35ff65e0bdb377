//! A simulated drive with a spinning LiDAR: the vehicle's motion, and what else moves. `drive_folder` writes it.

use anyhow::{Result, anyhow, ensure};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use serde::{Deserialize, Serialize};

use super::lidar::{Cuboid, Lidar, SensorPose, gaussian, rotation, spin};
use super::scene::Road;

/// What a moving or standing body looks like.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Shape {
    /// 4.4 x 1.8 x 1.45 m with 0.18 m of clearance between its wheels.
    Car,
    /// 0.5 x 0.5 x 1.75 m.
    Pedestrian,
    /// A wall or house, 10 x 4 x 5 m.
    House,
    /// A post 0.15 m thick and 3 m tall.
    Post,
}

/// A body beside or on the road.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Body {
    /// What it is.
    pub shape: Shape,
    /// Station at time zero, m.
    pub at_m: f64,
    /// Lateral position at time zero, m.
    pub lateral_m: f64,
    /// Speed along the road, m/s; negative is oncoming.
    #[serde(default)]
    pub speed_mps: f64,
    /// Speed across the road, m/s; positive to the left.
    #[serde(default)]
    pub across_mps: f64,
}

/// Noise of the reported poses, one standard deviation a frame, white.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct PoseNoise {
    /// Horizontal, m, on each axis.
    pub horizontal_m: f64,
    /// Vertical, m.
    pub vertical_m: f64,
    /// About each axis, degrees.
    pub angle_deg: f64,
}

impl Default for PoseNoise {
    fn default() -> Self {
        Self { horizontal_m: 0.02, vertical_m: 0.01, angle_deg: 0.05 }
    }
}

/// A drive: road, sensor, vehicle and bodies.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct TerrainScene {
    /// Seed of all noise.
    pub seed: u64,
    /// Number of frames.
    pub frames: u32,
    /// Vehicle speed, m/s.
    pub speed_mps: f64,
    /// Lateral position of the vehicle on the road, m.
    pub lateral_m: f64,
    /// Amplitude of the body's pitch, degrees, at 1.1 Hz.
    pub pitch_deg: f64,
    /// Amplitude of the body's roll, degrees, at 0.7 Hz.
    pub roll_deg: f64,
    /// World position of the road's origin, m.
    pub origin_m: [f64; 3],
    /// The sensor.
    pub lidar: Lidar,
    /// Noise of the reported poses.
    pub pose_noise: PoseNoise,
    /// The ground.
    pub road: Road,
    /// Bodies on and beside it.
    pub bodies: Vec<Body>,
}

impl Default for TerrainScene {
    fn default() -> Self {
        Self {
            seed: 1,
            frames: 40,
            speed_mps: 7.0,
            lateral_m: 0.0,
            pitch_deg: 0.4,
            roll_deg: 0.5,
            origin_m: [0.0; 3],
            lidar: Lidar::default(),
            pose_noise: PoseNoise::default(),
            road: Road::default(),
            bodies: Vec::new(),
        }
    }
}

/// One simulated frame.
pub struct SimulatedFrame {
    /// Points in the sensor's axes: x, y, z, intensity.
    pub points: Vec<[f32; 4]>,
    /// The pose as reported, noise included, in the world frame (the scene's origin added).
    pub reported: SensorPose,
    /// The pose as it was.
    pub truth: SensorPose,
    /// Seconds since the first frame.
    pub time_s: f64,
}

impl TerrainScene {
    /// Checks what the simulation divides by and draws from.
    ///
    /// # Errors
    /// Says which number is out of its range.
    pub fn check(&self) -> Result<()> {
        self.lidar.elevations_deg().map_err(|what| anyhow!(what))?;
        ensure!((16..=20_000).contains(&self.lidar.columns), "lidar.columns must be 16 to 20000");
        ensure!(self.lidar.rate_hz > 0.0 && self.lidar.rate_hz <= 100.0, "lidar.rate_hz must be above 0, at most 100");
        ensure!((0.3..=10.0).contains(&self.lidar.height_m), "lidar.height_m must be 0.3 to 10 m");
        ensure!((1.0..=500.0).contains(&self.lidar.max_range_m), "lidar.max_range_m must be 1 to 500 m");
        ensure!(self.frames <= 100_000, "frames must be at most 100000");
        ensure!(self.road.bumps.iter().all(|bump| bump.length_m > 0.01), "a bump must be longer than 1 cm");
        ensure!(self.road.left_curb_m > self.road.right_curb_m, "the left curb must lie left of the right curb");
        ensure!(self.road.curvature_per_m.abs() <= 0.05, "curvature must be within 1/20 m");
        ensure!(
            self.road.profile.windows(2).all(|pair| pair[0].at_m < pair[1].at_m),
            "the profile's knots must ascend"
        );
        Ok(())
    }

    /// Station of the vehicle at a time, m.
    #[must_use]
    pub fn station(&self, time_s: f64) -> f64 {
        self.speed_mps * time_s
    }

    /// The sensor's pose in the scene's own frame.
    #[must_use]
    pub fn sensor(&self, time_s: f64) -> SensorPose {
        let tau = 2.0 * core::f64::consts::PI;
        let station = self.station(time_s);
        let (x, y, yaw) = self.road.place(station, self.lateral_m);
        // The body follows the chord between its axles, 2.7 m apart, and sways on its springs.
        let ahead = self.road.smooth_height(station + 1.35, self.lateral_m);
        let behind = self.road.smooth_height(station - 1.35, self.lateral_m);
        let left = self.road.smooth_height(station, self.lateral_m + 0.75);
        let right = self.road.smooth_height(station, self.lateral_m - 0.75);
        let pitch = -libm::atan2(ahead - behind, 2.7)
            + self.pitch_deg.to_radians() * libm::sin(tau * 1.1 * time_s)
            + 0.3 * self.pitch_deg.to_radians() * libm::sin(tau * 2.3 * time_s + 1.0);
        let roll = libm::atan2(left - right, 1.5) + self.roll_deg.to_radians() * libm::sin(tau * 0.7 * time_s + 0.4);
        let heave = 0.01 * libm::sin(tau * 1.3 * time_s + 2.0);
        let rotation = rotation(yaw, pitch, roll);
        let up = self.lidar.height_m + heave;
        let ground = 0.5 * (ahead + behind);
        let position = [x + rotation[0][2] * up, y + rotation[1][2] * up, ground + rotation[2][2] * up];
        SensorPose { rotation, position }
    }

    fn cuboids(&self, time_s: f64) -> Vec<Cuboid> {
        let mut all = Vec::new();
        for body in &self.bodies {
            let station = body.at_m + body.speed_mps * time_s;
            let lateral = body.lateral_m + body.across_mps * time_s;
            let (x, y, heading) = self.road.place(station, lateral);
            let z = self.road.smooth_height(station, lateral);
            let (sin, cos) = (libm::sin(heading), libm::cos(heading));
            let velocity = [body.speed_mps * cos - body.across_mps * sin, body.speed_mps * sin + body.across_mps * cos];
            let mut part = |along: f64, left: f64, up: f64, size: [f64; 3]| {
                all.push(Cuboid {
                    base: [x + along * cos - left * sin, y + along * sin + left * cos, z + up],
                    yaw: heading,
                    size,
                    velocity,
                });
            };
            match body.shape {
                Shape::Car => {
                    part(0.0, 0.0, 0.18, [2.2, 0.9, 0.62]);
                    part(-0.2, 0.0, 0.80, [1.3, 0.8, 0.65]);
                    for (along, left) in [(1.35, 0.78), (1.35, -0.78), (-1.35, 0.78), (-1.35, -0.78)] {
                        part(along, left, 0.0, [0.3, 0.1, 0.6]);
                    }
                }
                Shape::Pedestrian => part(0.0, 0.0, 0.0, [0.25, 0.25, 1.75]),
                Shape::House => part(0.0, 0.0, -0.5, [5.0, 2.0, 5.5]),
                Shape::Post => part(0.0, 0.0, -0.1, [0.075, 0.075, 3.1]),
            }
        }
        all
    }

    /// Simulates one frame.
    ///
    /// # Errors
    /// An unknown LiDAR layout.
    pub fn frame(&self, index: u32) -> Result<SimulatedFrame> {
        let time_s = f64::from(index) / self.lidar.rate_hz;
        let seed = self.seed.wrapping_mul(0x9E37_79B9_7F4A_7C15).wrapping_add(u64::from(index) * 2 + 1);
        let points = spin(&self.lidar, &self.road, &self.cuboids(time_s), |dt| self.sensor(time_s + dt), seed)
            .map_err(|what| anyhow!(what))?;
        let shift = |pose: SensorPose| SensorPose {
            position: [0, 1, 2].map(|axis| pose.position[axis] + self.origin_m[axis]),
            ..pose
        };
        let truth = shift(self.sensor(time_s));
        let mut rng = ChaCha8Rng::seed_from_u64(seed.wrapping_add(1) ^ 0xA5A5);
        let noise = self.pose_noise;
        let tilt = [0, 1, 2].map(|_| noise.angle_deg.to_radians() * gaussian(&mut rng));
        let wobble = rotation(tilt[0], tilt[1], tilt[2]);
        let mut turned = [[0.0; 3]; 3];
        for (row, out) in truth.rotation.iter().zip(&mut turned) {
            for (column, value) in out.iter_mut().enumerate() {
                *value = (0..3).map(|k| row[k] * wobble[k][column]).sum();
            }
        }
        let position = [
            truth.position[0] + noise.horizontal_m * gaussian(&mut rng),
            truth.position[1] + noise.horizontal_m * gaussian(&mut rng),
            truth.position[2] + noise.vertical_m * gaussian(&mut rng),
        ];
        Ok(SimulatedFrame { points, reported: SensorPose { rotation: turned, position }, truth, time_s })
    }
}
