//! The conventional method, for comparison: obstacles in one frame, by ground segmentation and Euclidean clustering.
//!
//! RANSAC fits a ground plane to the points ahead on each side of the vehicle, least squares over its inliers refines it; points that stand more
//! than a threshold above it are clustered by distance, and clusters of enough points are obstacles. Threshold, distance and size are
//! parameters; how those of [`tuned`] were chosen is told in `docs/risk-map.md`.

use std::collections::HashMap;

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};

/// Parameters of the method.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Conventional {
    /// Height above the plane from which a point is an obstacle's, m.
    pub above_m: f64,
    /// Largest gap within a cluster, m.
    pub gap_m: f64,
    /// Fewest points of a cluster.
    pub least: usize,
    /// Distance within which a point supports a plane, m.
    pub inlier_m: f64,
    /// Farthest point used for the plane, m.
    pub plane_reach_m: f64,
}

/// The parameters chosen on the seed scene, see `docs/risk-map.md`.
#[must_use]
pub fn tuned() -> Conventional {
    Conventional { above_m: 0.04, gap_m: 1.0, least: 6, inlier_m: 0.02, plane_reach_m: 40.0 }
}

impl Conventional {
    /// Obstacle points of a frame, in the sensor's axes.
    #[must_use]
    pub fn obstacles(&self, points: &[[f32; 4]], seed: u64) -> Vec<[f64; 3]> {
        let ahead: Vec<[f64; 3]> = points
            .iter()
            .map(|p| [f64::from(p[0]), f64::from(p[1]), f64::from(p[2])])
            .filter(|p| p[0] > 2.5 && p[0] < 90.0 && p[1].abs() < 12.0 && p.iter().all(|v| v.is_finite()))
            .collect();
        // Two zones: one plane over a crowned road settles on either of its halves and buries the other's curb.
        let (left, right): (Vec<[f64; 3]>, Vec<[f64; 3]>) = ahead.into_iter().partition(|p| p[1] > 0.0);
        let mut standing = Vec::new();
        for zone in [left, right] {
            let Some(plane) = self.plane(&zone, seed) else { continue };
            standing.extend(zone.into_iter().filter(|p| {
                let above = p[2] - plane[0] - plane[1] * p[0] - plane[2] * p[1];
                above > self.above_m && above < 2.5
            }));
        }
        self.clusters(standing)
    }

    /// Ground plane z = a + b x + c y.
    fn plane(&self, points: &[[f64; 3]], seed: u64) -> Option<[f64; 3]> {
        let near: Vec<&[f64; 3]> =
            points.iter().filter(|p| p[0] < self.plane_reach_m && p[1].abs() < 6.0 && p[2] < 0.0).collect();
        if near.len() < 50 {
            return None;
        }
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let thinned: Vec<&[f64; 3]> = near.iter().copied().step_by((near.len() / 4000).max(1)).collect();
        let off = |plane: &[f64; 3], p: &[f64; 3]| (p[2] - plane[0] - plane[1] * p[0] - plane[2] * p[1]).abs();
        let mut best: Option<([f64; 3], usize)> = None;
        for _ in 0..200 {
            let mut pick = || near[rng.next_u32() as usize % near.len()];
            let Some(plane) = through([pick(), pick(), pick()]) else { continue };
            // The ground is near level in the vehicle's axes.
            if plane[1].abs() > 0.2 || plane[2].abs() > 0.2 {
                continue;
            }
            let support = thinned.iter().filter(|p| off(&plane, p) < self.inlier_m).count();
            if best.is_none_or(|(_, most)| support > most) {
                best = Some((plane, support));
            }
        }
        let mut plane = best?.0;
        for _ in 0..3 {
            let inliers = near.iter().filter(|p| off(&plane, p) < self.inlier_m);
            plane = least_squares(inliers.copied()).unwrap_or(plane);
        }
        Some(plane)
    }

    /// Points of clusters that are large enough, by flooding a hash of cells of the gap's size.
    fn clusters(&self, points: Vec<[f64; 3]>) -> Vec<[f64; 3]> {
        let key = |p: &[f64; 3]| [0, 1, 2].map(|axis| (p[axis] / self.gap_m).floor() as i32);
        let mut buckets: HashMap<[i32; 3], Vec<usize>> = HashMap::new();
        for (index, point) in points.iter().enumerate() {
            buckets.entry(key(point)).or_default().push(index);
        }
        let mut seen = vec![false; points.len()];
        let mut kept = Vec::new();
        for start in 0..points.len() {
            if seen[start] {
                continue;
            }
            seen[start] = true;
            let mut cluster = vec![start];
            let mut next = 0;
            while next < cluster.len() {
                let from = points[cluster[next]];
                next += 1;
                let centre = key(&from);
                for dx in -1..=1 {
                    for dy in -1..=1 {
                        for dz in -1..=1 {
                            let near = buckets.get(&[centre[0] + dx, centre[1] + dy, centre[2] + dz]);
                            for &other in near.into_iter().flatten() {
                                let to = points[other];
                                let gap2: f64 = (0..3).map(|k| (to[k] - from[k]) * (to[k] - from[k])).sum();
                                if !seen[other] && gap2 <= self.gap_m * self.gap_m {
                                    seen[other] = true;
                                    cluster.push(other);
                                }
                            }
                        }
                    }
                }
            }
            if cluster.len() >= self.least {
                kept.extend(cluster.into_iter().map(|index| points[index]));
            }
        }
        kept
    }
}

fn through([a, b, c]: [&[f64; 3]; 3]) -> Option<[f64; 3]> {
    let (u, v) = ([b[0] - a[0], b[1] - a[1], b[2] - a[2]], [c[0] - a[0], c[1] - a[1], c[2] - a[2]]);
    let area = u[0] * v[1] - u[1] * v[0];
    if area.abs() < 1.0 {
        return None;
    }
    let slope_x = (u[2] * v[1] - v[2] * u[1]) / area;
    let slope_y = (v[2] * u[0] - u[2] * v[0]) / area;
    Some([a[2] - slope_x * a[0] - slope_y * a[1], slope_x, slope_y])
}

fn least_squares<'a>(points: impl Iterator<Item = &'a [f64; 3]>) -> Option<[f64; 3]> {
    let mut m = [[0.0f64; 4]; 3];
    for p in points {
        let terms = [1.0, p[0], p[1]];
        for (row, a) in m.iter_mut().zip(terms) {
            for (entry, b) in row.iter_mut().zip([1.0, p[0], p[1], p[2]]) {
                *entry += a * b;
            }
        }
    }
    for pivot in 0..3 {
        if m[pivot][pivot].abs() < 1e-9 {
            return None;
        }
        let row = m[pivot];
        for (index, other) in m.iter_mut().enumerate() {
            if index != pivot {
                let factor = other[pivot] / row[pivot];
                for (entry, above) in other.iter_mut().zip(row) {
                    *entry -= factor * above;
                }
            }
        }
    }
    Some([m[0][3] / m[0][0], m[1][3] / m[1][1], m[2][3] / m[2][2]])
}
