//! Poses and the gate that a new pose must pass.
//!
//! Positions are integer micrometres, so that a map far from the world's origin is as fine as one at it; rotations
//! are f32 (6e-8: 4 um at 60 m). Only additions, multiplications, divisions and square roots are used on floats,
//! all exactly rounded by IEEE 754, and nothing is contracted: the same bits on every target.

/// Position and attitude of the sensor in the world.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pose {
    /// Sensor to world, row-major.
    pub rotation: [[f32; 3]; 3],
    /// Micrometres.
    pub position_um: [i64; 3],
}

impl Pose {
    /// Whether the matrix is a rotation, within 1 %.
    #[must_use]
    pub fn is_rigid(&self) -> bool {
        let [a, b, c] = self.rotation;
        let near = |value: f32, wanted: f32| (value - wanted).abs() < 0.01;
        near(dot(a, a), 1.0)
            && near(dot(b, b), 1.0)
            && near(dot(a, b), 0.0)
            && near(dot(cross(a, b), c), 1.0)
            && near(dot(c, c), 1.0)
    }
}

pub(crate) fn dot(a: [f32; 3], b: [f32; 3]) -> f32 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

fn cross(a: [f32; 3], b: [f32; 3]) -> [f32; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

/// Follows the motion of the sensor and tells a jump from driving.
///
/// The next position is predicted at constant velocity. A pose off by more than half a metre and a fifth of the
/// distance moved, or turned by more than about 15 degrees (a spin of 150 degrees a second), is a jump. The frame is held back;
/// when the next ones continue from there, the vehicle really is there and the track starts again.
#[derive(Clone, Debug, Default)]
pub(crate) struct Track {
    last: Option<([i64; 3], [[f32; 3]; 3])>,
    /// Micrometres moved a second; none right after a start.
    velocity: Option<[f32; 3]>,
}

/// How a pose continues a track.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Step {
    Continues,
    Jumps,
}

impl Track {
    /// Judges a pose `dt_us` after the last one and takes it over if it continues the track.
    pub(crate) fn advance(&mut self, pose: &Pose, dt_us: u32) -> Step {
        let seconds = dt_us.max(1000) as f32 * 1e-6;
        let Some((position, rotation)) = self.last else {
            self.last = Some((pose.position_um, pose.rotation));
            return Step::Continues;
        };
        let mut moved = [0.0; 3];
        for ((out, now), before) in moved.iter_mut().zip(pose.position_um).zip(position) {
            *out = now.wrapping_sub(before) as f32;
        }
        let distance = libm::sqrtf(dot(moved, moved));
        let off = match self.velocity {
            Some(v) => {
                let d = [moved[0] - v[0] * seconds, moved[1] - v[1] * seconds, moved[2] - v[2] * seconds];
                libm::sqrtf(dot(d, d))
            }
            // Nothing is known of the speed: anything up to 70 m/s is driving.
            None => (distance - 70e6 * seconds).max(0.0),
        };
        // Trace of the relative rotation: 1 + 2 cos(angle); 0.966 is 15 degrees.
        let trace: f32 = rotation.iter().zip(pose.rotation).map(|(a, b)| dot(*a, b)).sum();
        let turned = (trace - 1.0) * 0.5 < 0.966 - 0.1 * (seconds - 0.1).clamp(0.0, 1.0);
        if off > 0.5e6 + 0.2 * distance + 4e6 * seconds * seconds || turned {
            return Step::Jumps;
        }
        self.velocity = Some([moved[0] / seconds, moved[1] / seconds, moved[2] / seconds]);
        self.last = Some((pose.position_um, pose.rotation));
        Step::Continues
    }
}
