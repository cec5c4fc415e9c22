//! Rejects triangles that a ray surely misses, eight at a time.
//!
//! The [test](super::triangle) in single precision, with a bound on its
//! rounding errors (a filter in the sense of Shewchuk 1997): it rejects nearly
//! everything that a ray is tested against and nothing that the ray hits, so
//! that hits are the same bits whatever filter, and whatever instruction set,
//! they have passed.

use fearless_simd::prelude::*;
use fearless_simd::{f32x4, f32x8};

use super::triangle::ShearedRay;
use crate::Mesh;

/// Triangles in a block, one a lane: [`CostModel`](crate::CostModel) counts in
/// the same blocks unless told otherwise.
pub(super) const BLOCK: usize = 8;

/// A point of each triangle of a block.
type Points<S> = [f32x8<S>; 3];

/// A sheared ray, prepared for triangles in single precision.
pub(super) struct BlockFilter<S: Simd> {
    simd: S,
    axes: [usize; 3],
    /// In the order of `axes`, as all that follows.
    origin: [f32; 3],
    shear: [f32; 2],
    /// Bounds the rounding error of a corner in the ray's frame.
    corner_error: f32,
    /// How far a step of 1 in `t` leads along the last axis.
    depth_per_t: f32,
    /// Bounds the error of a comparison between a corner's depth and that of a `t`.
    depth_error: f32,
}

impl<S: Simd> BlockFilter<S> {
    /// Prepares a ray for triangles no farther than `reach` from its origin
    /// on any axis.
    #[inline(always)]
    pub(super) fn new(simd: S, &ShearedRay { ray, axes }: &ShearedRay<'_>, reach: f32) -> Self {
        let [x, y, z] = axes;
        let depth_per_t = ray.direction[z];
        // In units of 2⁻²⁴ of the reach: the corner relative to the origin 1, the shear 1,
        // the corner's depth in it 1, their product 1, the difference 2. 8 leaves room, and
        // the constant covers underflow.
        let corner_error = reach * (8.0 / (1 << 24) as f32) + f32::MIN_POSITIVE;
        Self {
            simd,
            axes,
            origin: [ray.origin[x], ray.origin[y], ray.origin[z]],
            shear: [
                ray.direction[x] / depth_per_t,
                ray.direction[y] / depth_per_t,
            ],
            corner_error,
            depth_per_t,
            // Where the depth of a `t` is beyond two reaches, no rounding makes up for the
            // distance to a corner. Elsewhere, in the same units: the corner's depth 1, that
            // of `t` 2, the sum with this 2, the rounding of a hit's `t` 1; underflow of the
            // latter takes up to 2⁻¹⁵⁰ steps.
            depth_error: corner_error + depth_per_t.abs() * f32::MIN_POSITIVE,
        }
    }

    /// Those of the first `count` triangles of `references`, at most a block,
    /// that the ray may hit at `t_min <= t <= t_max`, as a set of bits.
    #[inline(always)]
    pub(super) fn candidates(
        &self,
        mesh: Mesh<'_>,
        references: &[u32],
        count: usize,
        t_min: f32,
        t_max: f32,
    ) -> u32 {
        let corners = match references.first_chunk() {
            // Not only the triangles asked for: loading the next leaf's as well needs no
            // decisions.
            Some(block) => self.corners(mesh, block),
            None => {
                let mut block = [references[0]; BLOCK];
                for (place, &triangle) in block.iter_mut().zip(references) {
                    *place = triangle;
                }
                self.corners(mesh, &block)
            }
        };
        !self.misses(&corners, t_min, t_max) & ((1 << count.min(BLOCK)) - 1)
    }

    // In what follows, no closure and no array method touches vectors: their bodies are not
    // always inlined and then lack the instruction set.

    /// The corners of a block's triangles.
    #[inline(always)]
    fn corners(&self, mesh: Mesh<'_>, block: &[u32; BLOCK]) -> [Points<S>; 3] {
        let triangles = mesh.triangles();
        let vertices = [
            &triangles[block[0] as usize],
            &triangles[block[1] as usize],
            &triangles[block[2] as usize],
            &triangles[block[3] as usize],
            &triangles[block[4] as usize],
            &triangles[block[5] as usize],
            &triangles[block[6] as usize],
            &triangles[block[7] as usize],
        ];
        [
            self.points(mesh, &vertices, 0),
            self.points(mesh, &vertices, 1),
            self.points(mesh, &vertices, 2),
        ]
    }

    /// One corner of each triangle, its coordinates in the order of the axes.
    #[inline(always)]
    fn points(&self, mesh: Mesh<'_>, vertices: &[&[u32; 3]; BLOCK], corner: usize) -> Points<S> {
        let positions = mesh.positions();
        let [x, y, z] = self.transposed([
            &positions[vertices[0][corner] as usize],
            &positions[vertices[1][corner] as usize],
            &positions[vertices[2][corner] as usize],
            &positions[vertices[3][corner] as usize],
        ]);
        let [other_x, other_y, other_z] = self.transposed([
            &positions[vertices[4][corner] as usize],
            &positions[vertices[5][corner] as usize],
            &positions[vertices[6][corner] as usize],
            &positions[vertices[7][corner] as usize],
        ]);
        let points: Points<S> = [x.combine(other_x), y.combine(other_y), z.combine(other_z)];
        [
            points[self.axes[0]],
            points[self.axes[1]],
            points[self.axes[2]],
        ]
    }

    /// Four points as vectors of their x, y and z.
    #[inline(always)]
    fn transposed(&self, [a, b, c, d]: [&[f32; 3]; 4]) -> [f32x4<S>; 3] {
        let a = f32x4::simd_from(self.simd, [a[0], a[1], a[2], 0.0]);
        let b = f32x4::simd_from(self.simd, [b[0], b[1], b[2], 0.0]);
        let c = f32x4::simd_from(self.simd, [c[0], c[1], c[2], 0.0]);
        let d = f32x4::simd_from(self.simd, [d[0], d[1], d[2], 0.0]);
        let (ac, bd) = (a.zip_low(c), b.zip_low(d));
        [
            ac.zip_low(bd),
            ac.zip_high(bd),
            a.zip_high(c).zip_low(b.zip_high(d)),
        ]
    }

    /// The triangles that the ray surely misses between `t_min` and `t_max`,
    /// as a set of bits.
    #[inline(always)]
    fn misses(&self, corners: &[Points<S>; 3], t_min: f32, t_max: f32) -> u32 {
        let depth = [
            corners[0][2] - self.origin[2],
            corners[1][2] - self.origin[2],
            corners[2][2] - self.origin[2],
        ];
        let x = self.sheared(corners, &depth, 0);
        let y = self.sheared(corners, &depth, 1);
        let corner_error = f32x8::splat(self.simd, self.corner_error);

        // The barycentric mean of the corners' depths lies between them.
        let (start, end) = (t_min * self.depth_per_t, t_max * self.depth_per_t);
        let (near, far) = if self.depth_per_t < 0.0 {
            (end, start)
        } else {
            (start, end)
        };
        let out_of_range = lowest(depth).simd_gt(far + self.depth_error)
            | highest(depth).simd_lt(near - self.depth_error);

        // Many triangles lie on one side of the ray on one of the axes.
        let (low_x, high_x) = (lowest(x), highest(x));
        let (low_y, high_y) = (lowest(y), highest(y));
        let beside =
            low_x.max(low_y).simd_gt(corner_error) | high_x.min(high_y).simd_lt(-corner_error);

        // With e the corners' error and w the largest |x| plus the largest |y|, an edge function
        // is off by at most 2we + 2e² for the corners and w²·2⁻²⁴ for its own rounding. Here
        // w is at most 4 reaches and so w·2⁻²⁴ at most e / 2; the rest is room, and MIN_POSITIVE
        // covers what underflow takes.
        let edges = [
            x[2] * y[1] - y[2] * x[1],
            x[0] * y[2] - y[0] * x[2],
            x[1] * y[0] - y[1] * x[0],
        ];
        let width = high_x.max(-low_x) + high_y.max(-low_y);
        let error = corner_error * ((width + corner_error) * 4.0) + f32::MIN_POSITIVE;
        let outside = lowest(edges).simd_lt(-error) & highest(edges).simd_gt(error);

        (out_of_range | beside | outside).to_bitmask() as u32
    }

    /// The corners on the first or second axis of the ray's frame.
    #[inline(always)]
    fn sheared(&self, corners: &[Points<S>; 3], depth: &[f32x8<S>; 3], k: usize) -> Points<S> {
        let (origin, shear) = (self.origin[k], self.shear[k]);
        [
            (corners[0][k] - origin) - depth[0] * shear,
            (corners[1][k] - origin) - depth[1] * shear,
            (corners[2][k] - origin) - depth[2] * shear,
        ]
    }
}

/// The lowest of three numbers; if one is NaN, any of them.
#[inline(always)]
fn lowest<S: Simd>([a, b, c]: [f32x8<S>; 3]) -> f32x8<S> {
    a.min(b).min(c)
}

/// The highest of three numbers; if one is NaN, any of them.
#[inline(always)]
fn highest<S: Simd>([a, b, c]: [f32x8<S>; 3]) -> f32x8<S> {
    a.max(b).max(c)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::simd::{Kernel, dispatch};
    use crate::{Aabb, Ray, SimdLevel, force_simd};

    /// The candidates among all triangles of a mesh, at most a block.
    struct Candidates<'a> {
        mesh: Mesh<'a>,
        ray: Ray,
    }

    impl Kernel for Candidates<'_> {
        type Output = u32;

        #[inline(always)]
        fn run<S: Simd>(self, simd: S) -> u32 {
            let reach = Aabb::of_points(self.mesh.positions()).reach(self.ray.origin);
            let Some(sheared) = ShearedRay::new(&self.ray) else {
                return 0;
            };
            let references: Vec<u32> = (0..self.mesh.triangles().len() as u32).collect();
            BlockFilter::new(simd, &sheared, reach).candidates(
                self.mesh,
                &references,
                references.len(),
                self.ray.t_min,
                self.ray.t_max,
            )
        }
    }

    /// The candidates on every instruction set, which have to be the same.
    fn candidates(corners: &[[[f32; 3]; 3]], ray: Ray) -> u32 {
        let triangles: Vec<[u32; 3]> = (0..corners.len() as u32)
            .map(|i| [3 * i, 3 * i + 1, 3 * i + 2])
            .collect();
        let mesh = Mesh::new(corners.as_flattened(), &triangles).unwrap();
        let levels = SimdLevel::ALL.iter().filter(|level| level.is_available());
        let found: Vec<u32> = levels
            .map(|&level| {
                force_simd(Some(level)).unwrap();
                let candidates = dispatch(Candidates { mesh, ray });
                force_simd(None).unwrap();
                candidates
            })
            .collect();
        assert!(found.iter().all(|&bits| bits == found[0]), "{found:?}");
        found[0]
    }

    proptest! {
        #[test]
        fn filtering_loses_no_hit(
            corners in prop::collection::vec(
                prop::array::uniform3(prop::array::uniform3(-1.0f32..1.0)), 1..=BLOCK),
            aim in 0..BLOCK,
            origin in prop::array::uniform3(-1.0f32..1.0),
            weights in prop::array::uniform2(0.0f32..=0.5),
            scale in -40i32..=30,
            stretch in -60i32..=60,
            nudge in -3i32..=3,
        ) {
            // Towards a point of a triangle, often on its edge, or a few roundings beside it.
            let factor = 2f32.powi(scale);
            let corners: Vec<[[f32; 3]; 3]> = corners
                .iter()
                .map(|corners| corners.map(|c| c.map(|x| x * factor)))
                .collect();
            let origin = origin.map(|x| x * factor);
            let weights = weights.map(|w| (w * 8.0).round() / 8.0);
            let direction = std::array::from_fn(|k| {
                let [a, b, c] = corners[aim % corners.len()].map(|corner| corner[k]);
                let target = a + weights[0] * (b - a) + weights[1] * (c - a);
                let beside = 1.0 + nudge as f32 * f32::EPSILON * (k as f32 - 1.0);
                (target - origin[k]) * beside * 2f32.powi(stretch)
            });
            let line = Ray::new(origin, direction).with_range(f32::NEG_INFINITY, f32::INFINITY);
            let Some(sheared) = ShearedRay::new(&line) else {
                return Ok(());
            };
            let candidate = candidates(&corners, line);
            for (i, corners_i) in corners.iter().enumerate() {
                let Some(hit) = sheared.intersect(corners_i) else {
                    continue;
                };
                prop_assert!(candidate >> i & 1 == 1, "{:?}", hit);
                // Ranges that the hit is just in.
                for (t_min, t_max) in [
                    (hit.t, hit.t),
                    (f32::NEG_INFINITY, hit.t),
                    (hit.t, f32::INFINITY),
                ] {
                    let found = candidates(&corners, line.with_range(t_min, t_max));
                    prop_assert!(found >> i & 1 == 1, "{:?}", hit);
                }
            }
        }
    }

    #[test]
    fn what_lies_beside_or_out_of_range_is_rejected() {
        let [a, b, c] = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
        let moved = |by: [f32; 3]| [a, b, c].map(|p| std::array::from_fn(|k| p[k] + by[k]));
        let corners = [
            moved([0.0, 0.0, 1.0]),
            moved([2.0, 0.0, 1.0]),   // beside on one axis
            moved([-0.6, -0.6, 1.0]), // beside the longest edge
            moved([0.0, 0.0, -1.0]),  // behind
            moved([0.0, 0.0, 4.0]),   // too far
        ];
        for flip in [1.0, -1.0] {
            let corners = corners.map(|t| t.map(|[x, y, z]| [x, y, z * flip]));
            let ray = Ray::new([0.25, 0.25, 0.0], [0.0, 0.0, flip]);
            assert_eq!(candidates(&corners, ray.with_range(0.0, 3.0)), 0b00001);
            assert_eq!(candidates(&corners, ray.with_range(-2.0, 9.0)), 0b11001);
        }
    }
}
