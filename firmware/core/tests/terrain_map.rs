//! Properties of the elevation and risk map, on synthetic ground sampled at the cells' centres.

use crossfall_core::scan::MAX_BEAMS;
use crossfall_core::terrain::{
    Cell, Class, IMAGE_COLUMNS, IMAGE_ROWS, Marks, MovingBox, Pair, Pose, RangePixels, Refusal, Sample, SetUpError,
    Storage, TILE_SIDE, TerrainConfig, TerrainMap, Tile, TileKey,
};
use proptest::prelude::*;

const SIDE: u16 = 12;
/// Height of the sensor above the world's zero, m.
const UP: f32 = 2.0;

struct Memory {
    tiles: Vec<Tile>,
    marks: Vec<Marks>,
    samples: Vec<Sample>,
    pairs: Vec<Pair>,
    pixels: Box<RangePixels>,
}

impl Memory {
    fn new() -> Self {
        let count = usize::from(SIDE) * usize::from(SIDE);
        Self {
            tiles: vec![Tile::EMPTY; count],
            marks: vec![Marks::EMPTY; count],
            samples: vec![Sample::default(); 100_000],
            pairs: vec![Pair::default(); 5000],
            pixels: vec![0; IMAGE_COLUMNS * IMAGE_ROWS].into_boxed_slice().try_into().unwrap(),
        }
    }

    fn map(&mut self) -> TerrainMap<'_> {
        self.map_of(around())
    }

    fn map_of(&mut self, config: TerrainConfig) -> TerrainMap<'_> {
        let storage = Storage {
            tiles: &mut self.tiles,
            marks: &mut self.marks,
            samples: &mut self.samples,
            pairs: &mut self.pairs,
            pixels: Some(&mut self.pixels),
        };
        TerrainMap::new(config, SIDE, storage).unwrap()
    }
}

/// Everything around, centred on the sensor: the grid's symmetry is then the scene's.
fn around() -> TerrainConfig {
    TerrainConfig { ahead_m: 0.0, half_turn: 0.5, nearest_m: 0.5, ..TerrainConfig::default() }
}

/// Points on `ground(x, y)` at the centres of the cells within 8 m of the sensor.
fn frame(ground: impl Fn(f32, f32) -> f32) -> Vec<[f32; 4]> {
    let mut points = Vec::new();
    for iy in -80..80 {
        for ix in -80..80 {
            let (x, y) = (0.1 * ix as f32 + 0.05, 0.1 * iy as f32 + 0.05);
            points.push([x, y, ground(x, y) - UP, 0.0]);
        }
    }
    points
}

fn pose(yaw_quarters: u8, lift_um: i64) -> Pose {
    let (cos, sin) = [(1.0, 0.0), (0.0, 1.0), (-1.0, 0.0), (0.0, -1.0)][usize::from(yaw_quarters & 3)];
    Pose {
        rotation: [[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]],
        position_um: [0, 0, (UP * 1e6) as i64 + lift_um],
    }
}

fn cell(map: &TerrainMap<'_>, ix: i32, iy: i32) -> Option<Cell> {
    let side = TILE_SIDE as i32;
    let tile = map.tile(TileKey { x: ix.div_euclid(side), y: iy.div_euclid(side) })?;
    Some(tile.cell(ix.rem_euclid(side) as usize, iy.rem_euclid(side) as usize))
}

fn all_cells(map: &TerrainMap<'_>) -> Vec<(i32, i32, Cell)> {
    (-96..96)
        .flat_map(|iy| (-96..96).map(move |ix| (ix, iy)))
        .filter_map(|(x, y)| Some((x, y, cell(map, x, y)?)))
        .collect()
}

fn curb(height: f32) -> impl Fn(f32, f32) -> f32 {
    move |_, y| if y > 3.0 { height } else { 0.0 }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    #[test]
    fn a_plane_road_has_no_risk_whatever_its_gradient(along in -0.15f32..0.15, across in -0.05f32..0.05) {
        let mut memory = Memory::new();
        let mut map = memory.map();
        let points = frame(|x, y| along * x + across * y);
        for _ in 0..3 {
            let report = map.integrate(&points, &pose(0, 0), 100_000, &[], |_| {});
            prop_assert_eq!(report.refused, None);
        }
        map.refresh_all();
        let cells = all_cells(&map);
        prop_assert!(cells.len() > 20_000);
        for (x, y, cell) in cells {
            prop_assert_eq!(cell.risk, 0, "at {} {}: {:?}", x, y, cell);
        }
    }

    #[test]
    fn an_update_never_lets_a_variance_grow(seed in any::<u64>(), frames in 2usize..6) {
        let mut memory = Memory::new();
        let mut map = memory.map();
        let mut state = seed | 1;
        let mut noise = || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            ((state >> 40) as f32 / (1u32 << 24) as f32 - 0.5) * 0.04
        };
        let mut before: Vec<(i32, i32, Cell)> = Vec::new();
        for _ in 0..frames {
            let mut points = frame(|x, _| 0.03 * x);
            for point in &mut points {
                point[2] += noise();
            }
            map.integrate(&points, &pose(0, 0), 100_000, &[], |_| {});
            for (x, y, old) in &before {
                let new = cell(&map, *x, *y).unwrap();
                if let Some(variance) = old.variance_mm2() {
                    prop_assert!(new.variance_mm2().unwrap() <= variance, "at {} {}", x, y);
                }
            }
            before = all_cells(&map);
        }
    }

    #[test]
    fn risk_knows_neither_yaw_nor_height(quarters in 0u8..4, lift_quarter_mm in -4_000_000i64..4_000_000, height in 0.06f32..0.2) {
        let points = frame(curb(height));
        let judge = |yaw: u8, lift_um: i64| {
            let mut memory = Memory::new();
            let mut map = memory.map();
            for _ in 0..3 {
                map.integrate(&points, &pose(yaw, lift_um), 100_000, &[], |_| {});
            }
            map.refresh_all();
            // Back into the sensor's axes, so that every cell has its counterpart.
            (-70..70)
                .flat_map(|iy: i32| (-70..70).map(move |ix: i32| (ix, iy)))
                .map(|(ix, iy)| {
                    let (x, y) = [(ix, iy), (-iy - 1, ix), (-ix - 1, -iy - 1), (iy, -ix - 1)][usize::from(yaw)];
                    cell(&map, x, y).unwrap().risk
                })
                .collect::<Vec<u8>>()
        };
        let straight = judge(0, 0);
        prop_assert!(straight.iter().filter(|risk| **risk >= 128).count() >= 140);
        prop_assert_eq!(&straight, &judge(0, lift_quarter_mm * 250));
        // A median of an even number of differences may fall one quarter millimetre to the other side.
        for (a, b) in straight.iter().zip(judge(quarters, 0)) {
            prop_assert!(a.abs_diff(b) <= 3, "{} {}", a, b);
        }
    }
}

#[test]
fn a_curb_a_drop_a_bump_and_a_hole_are_told_apart() {
    let told = |ground: &dyn Fn(f32, f32) -> f32, at: (i32, i32)| {
        let mut memory = Memory::new();
        let mut map = memory.map();
        for _ in 0..3 {
            map.integrate(&frame(ground), &pose(0, 0), 100_000, &[], |_| {});
        }
        map.refresh_all();
        cell(&map, at.0, at.1).unwrap().class
    };
    let bump = |x: f32, _: f32| if (x - 5.0).abs() < 0.4 { 0.04 * (1.0 + ((x - 5.0) * 7.854).cos()) } else { 0.0 };
    assert_eq!(told(&curb(0.12), (20, 30)), Class::Curb);
    assert_eq!(told(&curb(-0.12), (20, 30)), Class::Drop);
    assert_eq!(told(&bump, (48, 0)), Class::Bump);
    assert_eq!(told(&|x, y| if (x - 4.0).hypot(y) < 0.3 { -0.08 } else { 0.0 }, (42, 1)), Class::Drop);
    assert_eq!(told(&|_, _| 0.0, (40, 1)), Class::Free);
}

#[test]
fn a_frame_that_cannot_be_trusted_changes_nothing_and_says_why() {
    let mut memory = Memory::new();
    let mut map = memory.map();
    let points = frame(curb(0.1));
    for _ in 0..3 {
        map.integrate(&points, &pose(0, 0), 100_000, &[], |_| {});
    }
    let before = all_cells(&map);
    let mut refuse = |points: &[[f32; 4]], pose: &Pose, why| {
        let report = map.integrate(points, pose, 100_000, &[], |_| {});
        assert_eq!(report.refused, Some(why));
        assert!(before == all_cells(&map), "{why:?} changed the map");
    };
    let nothing = [[f32::NAN; 4], [f32::INFINITY, 0.0, 0.0, 0.0]];
    refuse(&[], &pose(0, 0), Refusal::NoPoints);
    refuse(&nothing, &pose(0, 0), Refusal::NoPoints);
    let mut skewed = pose(0, 0);
    skewed.rotation[0][1] = 0.5;
    refuse(&points, &skewed, Refusal::Pose);
    skewed.rotation[0][1] = f32::NAN;
    refuse(&points, &skewed, Refusal::Pose);
    let mut away = pose(0, 0);
    away.position_um[0] = 5_000_000;
    refuse(&points, &away, Refusal::Jump);
    away.position_um[0] = i64::MAX;
    refuse(&points, &away, Refusal::Pose);
}

#[test]
fn a_vehicle_that_went_on_from_elsewhere_begins_a_new_map() {
    let mut memory = Memory::new();
    let mut map = memory.map();
    let points = frame(curb(0.1));
    map.integrate(&points, &pose(0, 0), 100_000, &[], |_| {});
    map.integrate(&points, &pose(0, 0), 100_000, &[], |_| {});
    let mut away = pose(0, 0);
    away.position_um[0] = 500_000_000;
    assert_eq!(map.integrate(&points, &away, 100_000, &[], |_| {}).refused, Some(Refusal::Jump));
    away.position_um[0] += 700_000;
    let report = map.integrate(&points, &away, 100_000, &[], |_| {});
    assert_eq!((report.refused, report.restarted), (None, true));
    assert!(cell(&map, 5000, 0).is_some_and(|cell| cell.height.is_some()) && cell(&map, 0, 0).is_none());
}

#[test]
fn nan_points_among_sound_ones_are_counted_and_change_nothing() {
    let points = frame(curb(0.1));
    let run = |points: &[[f32; 4]]| {
        let mut memory = Memory::new();
        let mut map = memory.map();
        let report = map.integrate(points, &pose(0, 0), 100_000, &[], |_| {});
        map.refresh_all();
        (report.points.not_finite, all_cells(&map))
    };
    let mut spoilt = points.clone();
    for k in 0..100 {
        spoilt.insert(k * 7, [f32::NAN, 1.0, 1.0, 0.0]);
        spoilt.insert(k * 11, [1.0, f32::NEG_INFINITY, 1.0, 0.0]);
    }
    let (sound, clean) = (run(&points), run(&spoilt));
    assert_eq!((sound.0, clean.0), (0, 200));
    assert!(sound.1 == clean.1);
}

#[test]
fn what_lies_in_a_box_never_enters_the_map() {
    let body = |x: f32, y: f32| if (x - 5.0).abs() < 1.0 && y.abs() < 0.5 { 0.3 } else { 0.0 };
    let run = |boxes: &[MovingBox]| {
        let mut memory = Memory::new();
        let mut map = memory.map();
        let report = map.integrate(&frame(body), &pose(0, 0), 100_000, boxes, |_| {});
        map.refresh_all();
        (report.points.boxed, all_cells(&map).iter().filter(|(_, _, cell)| cell.risk >= 128).count())
    };
    let outline = MovingBox { centre_um: [5_000_000, 0], half_m: [1.2, 0.7], heading: [1.0, 0.0] };
    let (none, open) = run(&[]);
    let (boxed, closed) = run(&[outline]);
    assert!(none == 0 && open > 50 && boxed >= 200 && closed == 0, "{none} {open} {boxed} {closed}");
}

#[test]
fn what_is_seen_beneath_a_standing_body_is_left_out_and_what_is_seen_past_it_is_not() {
    let mut memory = Memory::new();
    let mut map = memory.map();
    // A road of which a strip across is not known yet.
    let mut road = frame(|_, _| 0.0);
    road.retain(|point| (point[0] - 5.75).abs() > 0.01);
    map.integrate(&road, &pose(0, 0), 100_000, &[], |_| {});
    // A bumper 0.5 to 0.9 m up, 5 m ahead and 2 m wide; beneath it, 0.7 m behind, a wheel's foot; and the road beside the body.
    let mut points: Vec<[f32; 4]> = Vec::new();
    for k in -20..=20 {
        let y = 0.05 * k as f32;
        points.extend((5..=9).map(|up| [5.0, y, 0.1 * up as f32 - UP, 0.0]));
        points.push([5.7, y, 0.06 - UP, 0.0]);
        points.push([5.7, y + 3.0, 0.03 - UP, 0.0]);
    }
    let report = map.integrate(&points, &pose(0, 0), 100_000, &[], |_| {});
    assert_eq!((report.points.standing, report.points.beside_standing, report.points.fused), (205, 41, 41));
    map.refresh_all();
    let known = |rows: std::ops::Range<i32>| rows.filter(|iy| cell(&map, 57, *iy).unwrap().height.is_some()).count();
    assert_eq!((known(-9..9), known(25..35)), (0, 10));
}

#[test]
fn a_frame_that_does_not_lie_on_the_map_is_left_out_and_three_begin_it_anew() {
    let mut memory = Memory::new();
    let mut map = memory.map();
    let ground = |x: f32, y: f32| 0.2 * (1.7 * x).sin() + 0.2 * (1.3 * y).cos();
    for _ in 0..4 {
        map.integrate(&frame(ground), &pose(0, 0), 100_000, &[], |_| {});
    }
    let other = frame(|x, y| -ground(x, y));
    let reports = [0; 3].map(|_| map.integrate(&other, &pose(0, 0), 100_000, &[], |_| {}));
    assert_eq!(reports.map(|report| report.refused), [Some(Refusal::Misfit), Some(Refusal::Misfit), None]);
    assert!(reports[2].restarted);
}

#[test]
fn storage_or_numbers_that_do_not_fit_are_refused_by_name() {
    let refusal = |config: TerrainConfig, side: u16, marks: usize, samples: usize, pairs: usize| {
        let mut memory = Memory::new();
        let storage = Storage {
            tiles: &mut memory.tiles,
            marks: memory.marks.get_mut(..marks).unwrap(),
            samples: memory.samples.get_mut(..samples).unwrap(),
            pairs: memory.pairs.get_mut(..pairs).unwrap(),
            pixels: Some(&mut memory.pixels),
        };
        TerrainMap::new(config, side, storage).err()
    };
    let sound = TerrainConfig::default();
    assert_eq!(refusal(sound, SIDE, 144, 1, 256), None);
    let mut memory = Memory::new();
    let Memory { tiles, marks, samples, pairs, .. } = &mut memory;
    let blind = TerrainMap::new(sound, SIDE, Storage { tiles, marks, samples, pairs, pixels: None });
    assert_eq!(blind.err(), Some(SetUpError::RangeImage));
    assert_eq!(refusal(sound, 0, 144, 1, 256), Some(SetUpError::Side));
    assert_eq!(refusal(sound, 256, 144, 1, 256), Some(SetUpError::Side));
    assert_eq!(refusal(sound, SIDE + 1, 144, 1, 256), Some(SetUpError::TileStorage));
    assert_eq!(refusal(sound, SIDE, 143, 1, 256), Some(SetUpError::TileStorage));
    assert_eq!(refusal(sound, SIDE, 144, 0, 256), Some(SetUpError::Scratch));
    assert_eq!(refusal(sound, SIDE, 144, 1, 255), Some(SetUpError::Scratch));
    for config in [
        TerrainConfig { cell_m: f32::NAN, ..sound },
        TerrainConfig { cell_m: 0.0, ..sound },
        TerrainConfig { farthest_m: 1.0, ..sound },
        TerrainConfig { refresh_every: 0, ..sound },
    ] {
        assert_eq!(refusal(config, SIDE, 144, 1, 256), Some(SetUpError::Configuration), "{config:?}");
    }
}

#[test]
fn points_beyond_the_storage_are_counted_and_the_others_are_mapped() {
    let mut memory = Memory::new();
    memory.samples.truncate(1000);
    let mut map = memory.map();
    let points = frame(|_, _| 0.0);
    let report = map.integrate(&points, &pose(0, 0), 100_000, &[], |_| {});
    let counts = report.points;
    assert_eq!((counts.given, counts.fused), (25_600, 1000));
    assert_eq!(counts.out_of_range + counts.over_capacity + counts.fused, counts.given, "{counts:?}");
}

/// The whole map of a drive over a curb, a bump, a wall and noise, as one number: it changes with a single bit of any cell, and then either a
/// defect has come in or the number is to be set anew with the reason.
#[test]
fn the_same_frames_give_the_bits_that_they_always_gave() {
    let mut memory = Memory::new();
    let mut map = memory.map();
    let mut state = 1u64;
    let mut noise = || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        ((state >> 40) as f32 / (1u32 << 24) as f32 - 0.5) * 0.04
    };
    for step in 0..8i64 {
        // 0.3 m a frame along x.
        let ahead = 0.3 * step as f32;
        let mut points = frame(|x, y| {
            let bump = (0.3 - (x + ahead - 4.0).abs()).max(0.0) * 0.3;
            let wall = if y < -6.0 && x > 2.0 { 0.9 } else { 0.0 };
            0.02 * x + if y > 3.0 { 0.12 } else { bump } + wall
        });
        for point in &mut points {
            point[2] += noise();
        }
        let mut at = pose(0, 0);
        at.position_um[0] += 300_000 * step;
        assert_eq!(map.integrate(&points, &at, 100_000, &[], |_| {}).refused, None, "frame {step}");
    }
    map.refresh_all();
    // FNV-1a, 64 bits.
    let mut digest = 0xcbf2_9ce4_8422_2325u64;
    let mut take = |value: u64| {
        for byte in value.to_le_bytes() {
            digest = (digest ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3);
        }
    };
    for (x, y, cell) in all_cells(&map) {
        take((x as u32 as u64) << 32 | u64::from(y as u32));
        take(cell.height.map_or(u64::MAX, |height| u64::from(height as u32)));
        take(u64::from(cell.weight) << 32 | u64::from(cell.scatter_mm) << 24 | u64::from(cell.risk) << 16);
        take(u64::from(cell.tall) << 16 | (cell.class as u64) << 8 | u64::from(cell.confidence));
    }
    assert_eq!(digest, 0x281d_2538_ca38_ad3c, "{digest:#018x}");
}

#[test]
fn a_push_brooms_window_of_64_by_64_cells_fits_into_64_kib() {
    const TILES: usize = 4 * 4;
    let (tiles, marks) = (&mut [const { Tile::EMPTY }; TILES], &mut [const { Marks::EMPTY }; TILES]);
    // A scan a frame.
    let (samples, pairs) = (&mut [Sample::default(); MAX_BEAMS], &mut [Pair::default(); 256]);
    let lent = size_of_val(tiles) + size_of_val(marks) + size_of_val(samples) + size_of_val(pairs);
    let all = lent + size_of::<TerrainMap<'_>>();
    println!("{lent} bytes lent, {all} in all");
    assert!(all <= 64 << 10, "{all} bytes");

    let config = TerrainConfig { push_broom: true, ..around() };
    let mut map = TerrainMap::new(config, 4, Storage { tiles, marks, samples, pairs, pixels: None }).unwrap();
    // Lines across the road, with a wall on the left, pushed on by 0.1 m each.
    let line: Vec<[f32; 4]> = (-30..30)
        .map(|step| 0.1 * step as f32 + 0.05)
        .map(|y| [0.0, y, if y > 2.5 { 1.0 } else { 0.0 } - UP, 0.0])
        .collect();
    for step in 0..10i64 {
        let mut at = pose(0, 0);
        at.position_um[0] += 50_000 + 100_000 * step;
        assert_eq!(map.integrate(&line, &at, 50_000, &[], |_| {}).refused, None, "line {step}");
    }
    map.refresh_all();
    let wall = (0..10).filter(|x| cell(&map, *x, 27).is_some_and(|cell| cell.tall)).count();
    let road =
        (0..10).filter(|x| cell(&map, *x, 0).is_some_and(|cell| cell.height.is_some() && cell.risk == 0)).count();
    assert_eq!((wall, road), (10, 10));
}

/// 25 m of road train on cells of 5 cm: no vehicle is too long for the map, and what is no vehicle is counted.
#[test]
fn a_long_vehicle_is_left_out_whatever_the_cells_and_a_senseless_box_is_counted() {
    let body = |x: f32, y: f32| if (-4.0..7.5).contains(&x) && y.abs() < 1.0 { 0.3 } else { 0.0 };
    let run = |boxes: &[MovingBox]| {
        let mut memory = Memory::new();
        let mut map = memory.map_of(TerrainConfig { cell_m: 0.05, ..around() });
        let report = map.integrate(&frame(body), &pose(0, 0), 100_000, boxes, |_| {});
        (report.points.boxed, report.boxes_refused)
    };
    let train = MovingBox { centre_um: [-4_800_000, 0], half_m: [12.7, 1.5], heading: [1.0, 0.0] };
    let (boxed, refused) = run(&[train]);
    assert!(boxed > 1500 && refused == 0, "{boxed} points boxed, {refused} refused");
    let whale = MovingBox { half_m: [24.0, 1.5], ..train };
    let nowhere = MovingBox { half_m: [f32::NAN, 1.0], ..train };
    let far = MovingBox { centre_um: [i64::MAX, i64::MIN], ..train };
    assert_eq!(run(&[whale, nowhere, far]), (0, 2));
}
