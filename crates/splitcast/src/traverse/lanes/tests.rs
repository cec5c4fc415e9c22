//! What the test in lanes is certain of, against the exact test.

use std::sync::{Mutex, PoisonError};

use proptest::prelude::*;
use rand::rngs::ChaCha8Rng;
use rand::{RngExt, SeedableRng};

use super::*;
use crate::simd::{Kernel, dispatch};
use crate::traverse::triangle::{Crossing, ShearedRay};
use crate::{Aabb, Ray, SimdLevel, force_simd};

/// Rays that are tested at once against one triangle.
const RAYS: usize = 16;

type Triangle = [[f32; 3]; 3];

/// Lane by lane where a range begins and ends.
type Range = [[f32; RAYS]; 2];

/// Eight triangles and 16 rays, each with each.
#[derive(Clone, Debug)]
struct Scene {
    triangles: Vec<Triangle>,
    rays: Vec<Ray>,
}

/// What is said of pairs of a ray and a triangle, one a lane.
#[derive(Debug)]
struct Verdicts {
    missed: u64,
    known: u64,
    sure: u64,
    low: Vec<f32>,
    high: Vec<f32>,
    /// For each range, what may be hit and what surely is.
    within: Vec<(u64, u64)>,
}

impl Verdicts {
    #[inline(always)]
    fn new<S: Simd, V: SimdFloat<S, Element = f32>>(
        simd: S,
        rays: &RayLanes<V>,
        triangles: &TriangleLanes<V>,
        errors: &ErrorLanes<V>,
        ranges: &[Range],
    ) -> Self {
        let passing = Passing::new(rays, triangles, errors);
        let distance = passing.distance(simd, errors);
        let load = |numbers: &[f32; RAYS]| V::from_slice(simd, &numbers[..V::LEN]);
        let within = ranges.iter().map(|[t_min, t_max]| {
            let (t_min, t_max) = (load(t_min), load(t_max));
            let possible = distance.possible(t_min, t_max) & !passing.missed;
            let sure = distance.surely_within(t_min, t_max);
            (possible.to_bitmask(), sure.to_bitmask())
        });
        Self {
            missed: passing.missed.to_bitmask(),
            known: distance.known.to_bitmask(),
            sure: distance.sure.to_bitmask(),
            within: within.collect(),
            low: distance.low.as_slice().to_vec(),
            high: distance.high.as_slice().to_vec(),
        }
    }
}

/// One ray and the triangles of a block.
struct OneRay<'a> {
    ray: &'a Ray,
    block: &'a Block,
    scale: ErrorScale,
    ranges: &'a [Range],
}

impl Kernel for OneRay<'_> {
    type Output = Verdicts;

    #[inline(always)]
    fn run<S: Simd>(self, simd: S) -> Verdicts {
        let splat = |point: [f32; 3]| point.map(|x| f32x8::splat(simd, x));
        let rays = RayLanes {
            origin: splat(self.ray.origin),
            direction: splat(self.ray.direction),
        };
        let triangles = TriangleLanes::of_block(simd, self.block);
        let errors = self.scale.of(simd, &triangles);
        Verdicts::new(simd, &rays, &triangles, &errors, self.ranges)
    }
}

/// Many rays and the triangle in one lane of a block.
struct OneTriangle<'a> {
    rays: &'a [Ray],
    block: &'a Block,
    lane: usize,
    scale: ErrorScale,
    ranges: &'a [Range],
}

impl Kernel for OneTriangle<'_> {
    type Output = Verdicts;

    #[inline(always)]
    fn run<S: Simd>(self, simd: S) -> Verdicts {
        let row = |number: &dyn Fn(&Ray) -> f32| {
            let numbers: [f32; RAYS] = std::array::from_fn(|k| number(&self.rays[k]));
            f32x16::simd_from(simd, numbers)
        };
        let rays = RayLanes {
            origin: [0, 1, 2].map(|axis| row(&|ray| ray.origin[axis])),
            direction: [0, 1, 2].map(|axis| row(&|ray| ray.direction[axis])),
        };
        let all = TriangleLanes::of_block(simd, self.block);
        let errors = self.scale.of(simd, &all).rows();
        Verdicts::new(
            simd,
            &rays,
            &TriangleLanes::of_lane(simd, self.block, self.lane),
            &ErrorLanes::of_row(simd, &errors, self.lane),
            self.ranges,
        )
    }
}

impl Scene {
    fn block(&self) -> Block {
        let row = |number: &dyn Fn(&Triangle) -> f32| {
            std::array::from_fn(|lane| number(&self.triangles[lane]))
        };
        Block {
            corners: [0, 1, 2]
                .map(|corner| [0, 1, 2].map(|axis| row(&|corners| corners[corner][axis]))),
            triangles: std::array::from_fn(|lane| lane as u32),
        }
    }

    /// The bounds for some of the rays.
    fn scale(&self, rays: &[Ray]) -> ErrorScale {
        let bounds = Aabb::of_points(self.triangles.as_flattened());
        let largest = |bound: &dyn Fn(&Ray) -> f32| rays.iter().map(bound).fold(0.0, upper);
        ErrorScale::new(
            largest(&|ray| length_bound(ray.direction)),
            largest(&|ray| length_bound(bounds.farthest(ray.origin))),
        )
    }

    /// Compares both forms of the test with the exact one.
    fn check(&self) -> Result<(), TestCaseError> {
        let block = self.block();
        let cross = |ray: &Ray, triangle: &Triangle| ShearedRay::new(ray)?.intersect(triangle);
        for ray in &self.rays {
            let exact: Vec<_> = self.triangles.iter().map(|t| cross(ray, t)).collect();
            let (ranges, scale) = (ranges(&exact), self.scale(std::slice::from_ref(ray)));
            let what = format!("{ray:?}");
            check(&exact, &ranges, &what, &|| {
                dispatch(OneRay {
                    ray,
                    block: &block,
                    scale,
                    ranges: &ranges,
                })
            })?;
        }
        let scale = self.scale(&self.rays);
        for (lane, triangle) in self.triangles.iter().enumerate() {
            let exact: Vec<_> = self.rays.iter().map(|ray| cross(ray, triangle)).collect();
            let ranges = ranges(&exact);
            let what = format!("{triangle:?}");
            check(&exact, &ranges, &what, &|| {
                dispatch(OneTriangle {
                    rays: &self.rays,
                    block: &block,
                    lane,
                    scale,
                    ranges: &ranges,
                })
            })?;
        }
        Ok(())
    }
}

/// Ranges that begin or end at hits, just before or just behind them, and others.
fn ranges(exact: &[Option<Crossing>]) -> Vec<Range> {
    let (least, most) = (f32::NEG_INFINITY, f32::INFINITY);
    let ends = |range: &dyn Fn(f32) -> (f32, f32), shift: usize| -> Range {
        let mut ends = [[0.0; RAYS]; 2];
        for lane in 0..exact.len() {
            let crossing = exact[(lane + shift) % exact.len()];
            (ends[0][lane], ends[1][lane]) = range(crossing.map_or(1.0, |crossing| crossing.t));
        }
        ends
    };
    vec![
        ends(&|_| (least, most), 0),
        ends(&|_| (0.0, most), 0),
        ends(&|t| (t, t), 0),
        ends(&|t| (least, t), 0),
        ends(&|t| (t, most), 0),
        ends(&|t| (least, t.next_down()), 0),
        ends(&|t| (t.next_up(), most), 0),
        ends(&|t| (t - 1e-6 * t.abs(), t + 1e-6 * t.abs()), 0),
        // What another hit leaves.
        ends(&|t| (least, t), 1),
        ends(&|t| (t, most), 1),
    ]
}

/// Nothing may be called certain that the exact test does not say, too, on any instruction set.
fn check(
    exact: &[Option<Crossing>],
    ranges: &[Range],
    what: &str,
    verdicts: &dyn Fn() -> Verdicts,
) -> Result<(), TestCaseError> {
    for level in available() {
        let found = forced(level, verdicts);
        for (lane, crossing) in exact.iter().enumerate() {
            let is_in = |set: u64| set >> lane & 1 != 0;
            let (low, high) = (found.low[lane], found.high[lane]);
            let place = || format!("lane {lane} of {what}, {level}: {crossing:?}, {found:?}");
            prop_assert!(!is_in(found.missed & found.sure), "{}", place());
            if let Some(Crossing { t, .. }) = crossing {
                prop_assert!(!is_in(found.missed), "{}", place());
                let between = low <= *t && *t <= high;
                prop_assert!(between || !is_in(found.known), "{}", place());
            }
            for ([t_min, t_max], (possible, sure)) in ranges.iter().zip(&found.within) {
                let range = t_min[lane]..=t_max[lane];
                let hit = crossing.is_some_and(|crossing| range.contains(&crossing.t));
                prop_assert!(is_in(*possible) || !hit, "{range:?}: {}", place());
                prop_assert!(hit || !is_in(*sure), "{range:?}: {}", place());
            }
        }
    }
    Ok(())
}

fn available() -> impl Iterator<Item = SimdLevel> {
    (SimdLevel::ALL.iter().copied()).filter(|level| level.is_available())
}

/// Does something on one instruction set, which no other test here changes meanwhile.
fn forced<R>(level: SimdLevel, action: impl FnOnce() -> R) -> R {
    static FORCED: Mutex<()> = Mutex::new(());
    let _guard = FORCED.lock().unwrap_or_else(PoisonError::into_inner);
    force_simd(Some(level)).expect("it is available");
    let result = action();
    force_simd(None).expect("always possible");
    result
}

fn point() -> impl Strategy<Value = [f32; 3]> {
    prop::array::uniform3(-1.0f32..1.0)
}

/// A point of a triangle's plane by weights of its edges.
fn on_plane([a, b, c]: &Triangle, [u, v]: [f32; 2]) -> [f32; 3] {
    std::array::from_fn(|k| a[k] + u * (b[k] - a[k]) + v * (c[k] - a[k]))
}

/// Triangles of every shape in a cube of size 2: plain ones, slivers, small ones, and ones with
/// corners on a coarse grid, many of them without area.
fn triangle() -> impl Strategy<Value = Triangle> {
    (0..6, prop::array::uniform3(point()), -0.5f32..1.5, 1..28).prop_map(
        |(shape, corners, along, exponent)| {
            let [a, b, c] = corners;
            let small = 0.5f32.powi(exponent);
            match shape {
                0 => [a, b, on_plane(&corners, [along, small])],
                1 => [
                    a,
                    on_plane(&corners, [small, 0.0]),
                    on_plane(&corners, [0.0, small]),
                ],
                2 => [a, on_plane(&corners, [small, 0.0]), c],
                3 => corners.map(|p| p.map(|x| (x * 2.0).round() * 0.5)),
                _ => corners,
            }
        },
    )
}

/// How a ray is aimed at a triangle.
#[derive(Clone, Copy, Debug)]
struct Aim {
    start: Start,
    origin: [f32; 3],
    /// Weights of the target, which is often exactly on an edge.
    target: [f32; 2],
    /// Roundings by which it passes beside the target, on each axis.
    nudge: [i32; 3],
}

#[derive(Clone, Copy, Debug)]
enum Start {
    Near,
    /// At up to a million sizes, given by its exponent.
    Far(i32),
    /// In the triangle's plane, given by weights.
    Grazing([f32; 2]),
    /// At the target.
    Surface,
}

fn aim() -> impl Strategy<Value = Aim> {
    let start = prop_oneof![
        3 => Just(Start::Near),
        1 => (1..=20).prop_map(Start::Far),
        1 => prop::array::uniform2(-2.0f32..2.0).prop_map(Start::Grazing),
        1 => Just(Start::Surface),
    ];
    let target = prop_oneof![
        prop::array::uniform2(-0.25f32..1.25),
        prop::array::uniform2(0..=8).prop_map(|w| w.map(|w| w as f32 / 8.0)),
    ];
    (start, point(), target, prop::array::uniform3(-3..=3)).prop_map(
        |(start, origin, target, nudge)| Aim {
            start,
            origin,
            target,
            nudge,
        },
    )
}

impl Aim {
    fn ray(&self, triangle: &Triangle) -> Ray {
        let target = on_plane(triangle, self.target);
        let origin = match self.start {
            Start::Near => self.origin,
            Start::Far(exponent) => self.origin.map(|x| x * 2f32.powi(exponent)),
            Start::Grazing(weights) => on_plane(triangle, weights),
            Start::Surface => target,
        };
        let direction = match self.start {
            Start::Surface => self.origin,
            _ => std::array::from_fn(|k| target[k] - origin[k]),
        };
        let nudged = |k: usize| direction[k] * (1.0 + self.nudge[k] as f32 * f32::EPSILON);
        Ray::new(origin, [nudged(0), nudged(1), nudged(2)])
    }
}

fn scene() -> impl Strategy<Value = Scene> {
    let stretch = prop_oneof![4 => -60..=60, 1 => -140..=100];
    (
        prop::collection::vec(triangle(), LANES),
        prop::collection::vec(aim(), RAYS),
        -40..=39,
        stretch,
    )
        .prop_map(|(triangles, aims, scale, stretch)| {
            let factor = 2f32.powi(scale);
            let scaled = |p: [f32; 3]| p.map(|x| x * factor);
            // Not in one step, which might overflow.
            let half = 2f32.powi((stretch - scale) / 2);
            let rest = 2f32.powi(stretch - scale - (stretch - scale) / 2);
            let rays = aims.iter().enumerate().map(|(k, aim)| {
                let ray = aim.ray(&triangles[k % LANES]);
                let direction = scaled(ray.direction).map(|x| x * half * rest);
                Ray::new(scaled(ray.origin), direction)
            });
            let rays = rays.collect();
            let triangles = triangles.iter().map(|t| t.map(scaled)).collect();
            Scene { triangles, rays }
        })
}

proptest! {
    #![proptest_config(ProptestConfig {
        cases: 4 * ProptestConfig::default().cases,
        failure_persistence: None,
        ..ProptestConfig::default()
    })]

    #[test]
    fn what_is_certain_is_what_the_exact_test_says(scene in scene()) {
        scene.check()?;
    }
}

/// A filter that lets everything through would pass the test above.
#[test]
fn few_ordinary_rays_are_left_open() {
    for (size, most) in [(0.3, 0.0003), (0.03, 0.002), (0.003, 0.02)] {
        let mut random = ChaCha8Rng::seed_from_u64(1);
        let mut point = |size: f32| [0; 3].map(|_| size * random.random_range(-1.0f32..1.0));
        let (mut open, mut hits, mut total) = ([0; 2], 0, 0);
        for _ in 0..2000 {
            let corners = |_| {
                let middle = point(1.0);
                [0; 3].map(|_| {
                    let offset = point(size);
                    std::array::from_fn(|k| middle[k] + offset[k])
                })
            };
            let triangles: Vec<Triangle> = (0..LANES).map(corners).collect();
            let target = triangles[0];
            let rays = (0..RAYS).map(|_| {
                let origin = point(1.0);
                let weights = point(1.0);
                let aimed = on_plane(&target, [weights[0], weights[1]]);
                Ray::new(origin, std::array::from_fn(|k| aimed[k] - origin[k]))
            });
            let rays = rays.collect();
            let scene = Scene { triangles, rays };
            let block = scene.block();
            let everything = [[[0.0; RAYS], [f32::INFINITY; RAYS]]];
            let mut count = |form: usize, verdicts: Verdicts, lanes: usize| {
                let (possible, sure) = verdicts.within[0];
                open[form] += (possible & !sure).count_ones();
                hits += sure.count_ones();
                total += lanes;
            };
            for ray in &scene.rays {
                let one_ray = OneRay {
                    ray,
                    block: &block,
                    scale: scene.scale(std::slice::from_ref(ray)),
                    ranges: &everything,
                };
                count(0, dispatch(one_ray), LANES);
            }
            for lane in 0..LANES {
                let one_triangle = OneTriangle {
                    rays: &scene.rays,
                    block: &block,
                    lane,
                    scale: scene.scale(&scene.rays),
                    ranges: &everything,
                };
                count(1, dispatch(one_triangle), RAYS);
            }
        }
        let share = |open: u32| f64::from(open) / (total / 2) as f64;
        assert!(hits > 5000, "{size}: {hits}");
        assert!(
            open.iter().all(|&open| share(open) < most),
            "{size}: {open:?} of {total}"
        );
    }
}

/// Where a hit's distance is about `f32::MAX`, the exact test finds none if it rounds up.
#[test]
fn no_hit_is_sure_where_its_distance_may_overflow() {
    let corners = |z: f32| [[-1e5, -1e5, z], [1e5, -1e5, z], [0.0, 1e5, z]];
    for k in 0..500 {
        let z = 1.0 + k as f32 * 2f32.powi(-21);
        let scene = Scene {
            triangles: vec![corners(z), corners(-z), corners(z.next_down())]
                .into_iter()
                .cycle()
                .take(LANES)
                .collect(),
            rays: vec![Ray::new([0.0; 3], [0.0, 0.0, z * 2f32.powi(-128)]); RAYS],
        };
        scene.check().unwrap();
    }
}

/// Bounds of errors are small numbers times the direction's length, which may be small itself.
#[test]
fn bounds_do_not_vanish_with_the_direction() {
    let mut random = ChaCha8Rng::seed_from_u64(2);
    let mut number = |size: f32| size * random.random_range(-1.0f32..1.0);
    for exponent in 120..=148 {
        for _ in 0..100 {
            let mut flat = || [0; 3].map(|_| [number(9e11), number(9e11), 0.0]);
            let triangles: Vec<Triangle> = (0..LANES).map(|_| flat()).collect();
            // From edges: farther away, distances overflow.
            let rays = (0..RAYS).map(|k| {
                let origin = on_plane(&triangles[k % LANES], [number(0.5) + 0.5, 0.0]);
                Ray::new(origin, [0; 3].map(|_| number(4.0) * 0.5f32.powi(exponent)))
            });
            let rays = rays.collect();
            Scene { triangles, rays }.check().unwrap();
        }
    }
}
