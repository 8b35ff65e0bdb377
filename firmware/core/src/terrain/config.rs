//! What a user may want to change, with its defaults.

/// Configuration of the map.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TerrainConfig {
    /// Side of a cell, m: 0.05 to 0.5. The differentiation spans five cells, so this sets its scale too.
    pub cell_m: f32,
    /// Points nearer than this to the sensor belong to the vehicle, m.
    pub nearest_m: f32,
    /// Points further than this are not used, m.
    pub farthest_m: f32,
    /// How far ahead of the sensor the window's centre lies, m.
    pub ahead_m: f32,
    /// Part of a turn to each side of straight ahead whose points are used: 0.3 leaves out what lies behind. There the
    /// body's motion within the turn is furthest from the pose, and the map knows the ground better from ahead.
    pub half_turn: f32,
    /// Standard deviation of a range, mm.
    pub range_sigma_mm: f32,
    /// Floor of a point's height sigma, mm.
    pub floor_sigma_mm: f32,
    /// Height sigma for each metre of range that the alignment leaves, mm.
    pub tilt_sigma_mm_per_m: f32,
    /// A point this far above its tile's ground stands, m.
    pub tall_above_m: f32,
    /// A point this far above its tile's ground hangs over the road and is left out, m.
    pub overhang_m: f32,
    /// Radius of the wheel that takes the step, mm.
    pub wheel_radius_mm: f32,
    /// The sensor is a line across the road that the vehicle pushes on: every place is seen once. What stands is believed at its first
    /// hit, nothing is looked through, and frames are placed by their poses alone, as there is no map yet to fit them to.
    pub push_broom: bool,
    /// Every how manyth frame a touched tile's risk is told anew: 1 to 8.
    pub refresh_every: u8,
}

impl Default for TerrainConfig {
    fn default() -> Self {
        Self {
            cell_m: 0.1,
            nearest_m: 2.2,
            farthest_m: 90.0,
            ahead_m: 26.0,
            half_turn: 0.3,
            range_sigma_mm: 20.0,
            floor_sigma_mm: 4.0,
            tilt_sigma_mm_per_m: 0.15,
            tall_above_m: 0.35,
            overhang_m: 2.6,
            wheel_radius_mm: 320.0,
            push_broom: false,
            refresh_every: 4,
        }
    }
}

impl TerrainConfig {
    /// Whether every number is finite and within its range.
    #[must_use]
    pub fn is_sound(&self) -> bool {
        let within = |value: f32, low: f32, high: f32| value >= low && value <= high;
        within(self.cell_m, 0.05, 0.5)
            && within(self.nearest_m, 0.0, 50.0)
            && within(self.farthest_m, self.nearest_m, 250.0)
            && within(self.ahead_m, -200.0, 200.0)
            && within(self.half_turn, 0.1, 0.5)
            && within(self.range_sigma_mm, 0.0, 1000.0)
            && within(self.floor_sigma_mm, 0.5, 1000.0)
            && within(self.tilt_sigma_mm_per_m, 0.0, 100.0)
            && within(self.tall_above_m, 0.05, 5.0)
            && within(self.overhang_m, self.tall_above_m, 20.0)
            && within(self.wheel_radius_mm, 50.0, 2000.0)
            && (1..=8).contains(&self.refresh_every)
    }
}
