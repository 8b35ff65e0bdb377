//! Boxes of moving objects: what lies inside them never enters the map.

use super::geometry::Pose;
use super::marks::Board;
use super::project::Projection;
use super::window::Window;

/// The outline of a moving object in the world.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MovingBox {
    /// Centre, micrometres in the world.
    pub centre_um: [i64; 2],
    /// Half length and half width, m. A margin for the detector's error is the caller's to add.
    pub half_m: [f32; 2],
    /// Cosine and sine of the heading of its length.
    pub heading: [f32; 2],
}

/// Half length and half width together up to which a box is drawn, m: no vehicle is half as large. It bounds the work of a box.
const LARGEST_M: f32 = 25.0;

/// Draws the boxes into the marks, cell by cell; how many were not drawn, because they have no sensible size.
pub(crate) fn mark_boxes(
    boxes: &[MovingBox],
    projection: &Projection,
    cell_um: i64,
    pose: &Pose,
    window: &Window<'_>,
    marks: &mut Board<'_>,
) -> u32 {
    let mut refused = 0;
    let cells = i32::from(window.side) * 16;
    let per_cell = 1.0 / cell_um.max(1) as f32;
    for body in boxes {
        let mut centre = [0.0f32; 2];
        for (axis, value) in centre.iter_mut().enumerate() {
            let away = body.centre_um.get(axis).zip(pose.position_um.get(axis)).map_or(0, |(a, b)| a.wrapping_sub(*b));
            *value = away as f32 * per_cell + projection.origin.get(axis).copied().unwrap_or(0.0);
        }
        // The diagonal is at most the sum of the sides.
        let reach_m = body.half_m[0] + body.half_m[1];
        if !(reach_m > 0.0 && reach_m <= LARGEST_M && centre[0].is_finite() && centre[1].is_finite()) {
            refused += 1;
            continue;
        }
        let half = body.half_m.map(|half| half * 1e6 * per_cell);
        let reach = half[0] + half[1];
        let span =
            |middle: f32| ((middle - reach) as i32).max(0)..((middle + reach) as i32).saturating_add(1).clamp(0, cells);
        for iy in span(centre[1]) {
            for ix in span(centre[0]) {
                let (u, v) = (ix as f32 + 0.5 - centre[0], iy as f32 + 0.5 - centre[1]);
                let along = u * body.heading[0] + v * body.heading[1];
                let across = v * body.heading[0] - u * body.heading[1];
                if along.abs() > half[0] + 0.5 || across.abs() > half[1] + 0.5 {
                    continue;
                }
                let slot = window.slot(ix as u32 >> 4, iy as u32 >> 4);
                marks.cover(slot, ((iy & 15) << 4 | (ix & 15)) as u8, window);
            }
        }
    }
    refused
}
