//! Rays against triangles in single precision, lane by lane: one ray and many
//! triangles, or many rays and one triangle.
//!
//! The test is that of Möller & Trumbore (1997), with bounds on its rounding errors (a
//! filter in the sense of Shewchuk 1997). What it calls missed or hit, the
//! [exact test](super::triangle) calls so, too; the rest, about one in a thousand of what is
//! tested, is put to that. Hits are thus the same bits whatever lanes, and whatever instruction
//! set, they have passed, fused operations or not.
//!
//! In what follows u = 2⁻²⁴, D is the length of a ray's direction, R the distance from its
//! origin to the farthest point of the tree, and E the length of the longer of a triangle's edges
//! `e1` and `e2` from its first corner. Edges and the way from a corner to the origin are off by u, a
//! cross product of them by at most 4.5 u of the product of lengths, its dot product with a third by
//! 9 u. So with E ≤ 2 R
//!
//! - the weights U and V, at most R·D·E each, are off by 9 u·R·D·E;
//! - the determinant by 9 u·D·E², the third weight, W = det - U - V, by
//!   20 u·R·D·E + 10 u·D·E²;
//! - the depth T by 9 u·R·E².
//!
//! E is taken as √3 times the largest coordinate. All constants below are larger by a tenth and
//! more. Underflow adds less than `f32::MIN_POSITIVE · (1 + R + D)`. Where products might overflow,
//! nothing is certain.

use fearless_simd::prelude::*;
use fearless_simd::{f32x8, f32x16};

use crate::Ray;
use crate::aabb::upper;
use crate::wide::{Block, LANES};

/// Distance between 1 and the next number below, halved: what one rounding may do.
const ROUNDING: f32 = 1.0 / (1 << 24) as f32;

/// Directions count as no shorter than this in bounds, which thus do not underflow before they are
/// multiplied by large edges.
const SHORTEST: f32 = 1.0 / (1u128 << 100) as f32;

/// A number or a point in each lane.
type Point<V> = [V; 3];

/// One point in all lanes.
#[inline(always)]
pub(super) fn splat<S: Simd, V: SimdFloat<S, Element = f32>>(
    simd: S,
    [x, y, z]: [f32; 3],
) -> Point<V> {
    [V::splat(simd, x), V::splat(simd, y), V::splat(simd, z)]
}

/// Rays, one a lane; or one ray in all of them.
#[derive(Clone, Copy)]
pub(super) struct RayLanes<V> {
    pub(super) origin: Point<V>,
    pub(super) direction: Point<V>,
}

impl<S: Simd> RayLanes<f32x8<S>> {
    /// One ray in all lanes.
    #[inline(always)]
    pub(super) fn of_ray(simd: S, ray: &Ray) -> Self {
        Self {
            origin: splat(simd, ray.origin),
            direction: splat(simd, ray.direction),
        }
    }
}

/// Triangles, one a lane; or one triangle in all of them.
#[derive(Clone, Copy)]
pub(super) struct TriangleLanes<V> {
    pub(super) corner: Point<V>,
    /// To the second and the third corner.
    pub(super) edges: [Point<V>; 2],
}

impl<S: Simd> TriangleLanes<f32x8<S>> {
    /// The triangles of a block.
    #[inline(always)]
    pub(super) fn of_block(simd: S, block: &Block) -> Self {
        let point = |rows: &[[f32; LANES]; 3]| {
            [
                f32x8::simd_from(simd, rows[0]),
                f32x8::simd_from(simd, rows[1]),
                f32x8::simd_from(simd, rows[2]),
            ]
        };
        let [a, b, c] = &block.corners;
        Self::new(point(a), point(b), point(c))
    }
}

impl<S: Simd> TriangleLanes<f32x8<S>> {
    /// Triangles with these corners.
    #[inline(always)]
    fn new(a: Point<f32x8<S>>, b: Point<f32x8<S>>, c: Point<f32x8<S>>) -> Self {
        Self {
            corner: a,
            edges: [
                [b[0] - a[0], b[1] - a[1], b[2] - a[2]],
                [c[0] - a[0], c[1] - a[1], c[2] - a[2]],
            ],
        }
    }
}

/// Boxes around the triangles of a block, in the rows of a node's bounds.
#[inline(always)]
pub(super) fn boxes_of<S: Simd>(simd: S, block: &Block) -> [[f32; LANES]; 6] {
    let mut rows = [[0.0; LANES]; 6];
    for axis in 0..3 {
        let a = f32x8::simd_from(simd, block.corners[0][axis]);
        let b = f32x8::simd_from(simd, block.corners[1][axis]);
        let c = f32x8::simd_from(simd, block.corners[2][axis]);
        rows[2 * axis] = a.min(b).min(c).into();
        rows[2 * axis + 1] = a.max(b).max(c).into();
    }
    rows
}

impl<S: Simd> TriangleLanes<f32x16<S>> {
    /// One triangle of a block in all lanes.
    #[inline(always)]
    pub(super) fn of_lane(simd: S, block: &Block, lane: usize) -> Self {
        let [a, b, c] = block.corners_of(lane);
        Self {
            corner: splat(simd, a),
            edges: [
                splat(simd, [b[0] - a[0], b[1] - a[1], b[2] - a[2]]),
                splat(simd, [c[0] - a[0], c[1] - a[1], c[2] - a[2]]),
            ],
        }
    }
}

/// What bounds the errors for rays, whatever the triangle.
#[derive(Clone, Copy, Debug)]
pub(super) struct ErrorScale {
    /// Of weights, for each unit of E, and of E².
    weight: [f32; 2],
    /// Of the determinant and of the depth, for each unit of E².
    determinant: f32,
    depth: f32,
    /// What underflow adds.
    tiny: f32,
}

impl ErrorScale {
    /// For rays with directions no longer than `length`, no farther than `reach` from any point of
    /// the tree.
    #[inline(always)]
    pub(super) fn new(length: f32, reach: f32) -> Self {
        let length = upper(length, SHORTEST);
        // No product exceeds 6 R·D·E or 6 R·E², where E is at most 2 R.
        let largest = (length + reach) * reach * reach * 32.0;
        let unit = if largest.is_finite() {
            ROUNDING
        } else {
            f32::INFINITY
        };
        // Units of the largest coordinate instead of E: factors of √3 and 3.
        Self {
            weight: [
                (20.0 * 1.75 * 1.1) * unit * length * reach,
                (10.0 * 3.0 * 1.1) * unit * length,
            ],
            determinant: (9.0 * 3.0 * 1.1) * unit * length,
            depth: (9.0 * 3.0 * 1.1) * unit * reach,
            tiny: f32::MIN_POSITIVE * (1.0 + reach + length),
        }
    }

    /// Bounds for each triangle.
    #[inline(always)]
    pub(super) fn of<S: Simd, V: SimdFloat<S, Element = f32>>(
        &self,
        simd: S,
        triangles: &TriangleLanes<V>,
    ) -> ErrorLanes<V> {
        let [[a, b, c], [d, e, f]] = triangles.edges;
        let size = (a.abs().max(b.abs()).max(c.abs())).max(d.abs().max(e.abs()).max(f.abs()));
        let splat = |x: f32| V::splat(simd, x);
        let square = size * size;
        ErrorLanes {
            weight: size.mul_add(
                size.mul_add(splat(self.weight[1]), splat(self.weight[0])),
                splat(self.tiny),
            ),
            determinant: square.mul_add(splat(self.determinant), splat(self.tiny)),
            depth: square.mul_add(splat(self.depth), splat(self.tiny)),
        }
    }
}

/// Bounds on errors for a triangle in each lane.
#[derive(Clone, Copy)]
pub(super) struct ErrorLanes<V> {
    pub(super) weight: V,
    pub(super) determinant: V,
    pub(super) depth: V,
}

impl<S: Simd> ErrorLanes<f32x8<S>> {
    /// The bounds of each kind, lane by lane.
    #[inline(always)]
    pub(super) fn rows(self) -> [[f32; LANES]; 3] {
        [
            self.weight.into(),
            self.determinant.into(),
            self.depth.into(),
        ]
    }
}

impl<S: Simd> ErrorLanes<f32x16<S>> {
    /// Those of one triangle in all lanes.
    #[inline(always)]
    pub(super) fn of_row(simd: S, rows: &[[f32; LANES]; 3], lane: usize) -> Self {
        let splat = |row: usize| f32x16::splat(simd, rows[row][lane % LANES]);
        Self {
            weight: splat(0),
            determinant: splat(1),
            depth: splat(2),
        }
    }
}

/// Where a ray's line passes a triangle, in each lane.
pub(super) struct Passing<S: Simd, V: SimdFloat<S>> {
    /// Whether it surely misses.
    pub(super) missed: V::Mask,
    /// Whether it surely hits.
    hit: V::Mask,
    determinant: V,
    depth: V,
}

/// At what distance rays hit, in each lane.
pub(super) struct Distance<S: Simd, V: SimdFloat<S>> {
    /// Lowest and highest value that the distance may have; of no meaning where
    /// it is not [known](Self::known).
    pub(super) low: V,
    pub(super) high: V,
    /// Whether a distance can be told.
    known: V::Mask,
    /// Whether the line surely hits the triangle, at such a distance.
    pub(super) sure: V::Mask,
}

impl<S: Simd, V: SimdFloat<S, Element = f32>> Passing<S, V> {
    /// Looks on which sides of a triangle's edges rays pass.
    #[inline(always)]
    pub(super) fn new(
        rays: &RayLanes<V>,
        triangles: &TriangleLanes<V>,
        errors: &ErrorLanes<V>,
    ) -> Self {
        let RayLanes { origin, direction } = rays;
        let TriangleLanes { corner, edges } = triangles;
        let across = cross(direction, &edges[1]);
        let way = [
            origin[0] - corner[0],
            origin[1] - corner[1],
            origin[2] - corner[2],
        ];
        let beside = cross(&way, &edges[0]);
        let determinant = dot(&edges[0], &across);
        let u = dot(&way, &across);
        let v = dot(direction, &beside);
        let w = determinant - u - v;
        let (lowest, highest) = (u.min(v).min(w), u.max(v).max(w));
        let (least, most) = (-errors.weight, errors.weight);
        Self {
            missed: lowest.simd_lt(least) & highest.simd_gt(most),
            hit: lowest.simd_gt(most) | highest.simd_lt(least),
            determinant,
            depth: dot(&edges[1], &beside),
        }
    }

    /// Finds at what distance that is.
    #[inline(always)]
    pub(super) fn distance(&self, simd: S, errors: &ErrorLanes<V>) -> Distance<S, V> {
        let inverse = V::splat(simd, 1.0) / self.determinant;
        let t = self.depth * inverse;
        let (inverse, size) = (inverse.abs(), t.abs());
        let error = size.mul_add(errors.determinant, errors.depth) * inverse;
        let slack = size.mul_add(V::splat(simd, 4.0 * ROUNDING), error * 1.4);
        // 1 / (1 - 0.25) is below 1.4. The exact test finds no hit at a distance that overflows.
        let known =
            (errors.determinant * inverse).simd_lt(0.25) & (size + slack).simd_lt(f32::INFINITY);
        Distance {
            low: t - slack,
            high: t + slack,
            known,
            sure: self.hit & known,
        }
    }
}

impl<S: Simd, V: SimdFloat<S, Element = f32>> Distance<S, V> {
    /// Whether it may lie in a range.
    #[inline(always)]
    pub(super) fn possible(&self, t_min: V, t_max: V) -> V::Mask {
        !(self.known & (self.high.simd_lt(t_min) | self.low.simd_gt(t_max)))
    }

    /// Whether a hit surely lies in a range.
    #[inline(always)]
    pub(super) fn surely_within(&self, t_min: V, t_max: V) -> V::Mask {
        self.sure & self.low.simd_ge(t_min) & self.high.simd_le(t_max)
    }
}

/// The cross product. Signs are changed on the first vector's side, the ray's: compilers would keep the
/// negatives of what belongs to a triangle for all rays, and have too few registers for that.
#[inline(always)]
fn cross<S: Simd, V: SimdFloat<S, Element = f32>>(a: &Point<V>, b: &Point<V>) -> Point<V> {
    [
        (-a[2]).mul_add(b[1], a[1] * b[2]),
        (-a[0]).mul_add(b[2], a[2] * b[0]),
        (-a[1]).mul_add(b[0], a[0] * b[1]),
    ]
}

#[inline(always)]
fn dot<S: Simd, V: SimdFloat<S, Element = f32>>(a: &Point<V>, b: &Point<V>) -> V {
    a[0].mul_add(b[0], a[1].mul_add(b[1], a[2] * b[2]))
}

/// The length of a vector, or a little more; up to √3 times that where squares may overflow or underflow.
#[inline(always)]
pub(super) fn length_bound([x, y, z]: [f32; 3]) -> f32 {
    let square = x * x + y * y + z * z;
    let length = if (1e-30..1e30).contains(&square) {
        square.sqrt()
    } else {
        x.abs() + y.abs() + z.abs()
    };
    length * 1.000_001
}

#[cfg(test)]
mod tests;
