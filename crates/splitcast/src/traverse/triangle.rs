//! The watertight ray–triangle test (Woop, Benthin & Wald 2013) in double
//! precision.
//!
//! Vertices are moved to the ray's frame, where the ray starts at the origin
//! and runs along the last axis, by a shear that depends on the ray alone.
//! There, the signs of three edge functions decide. Two triangles that share
//! an edge compute that edge's function from the same two points, so one of
//! them accepts every ray that crosses it: none slips through.
//!
//! In single precision the signs are wrong now and then, and rays that pass
//! beside a triangle seen edge-on hit it, at any distance. In double precision
//! a corner in the ray's frame is off by a few 2⁻⁵³ of its distance, and
//! products have twice that precision, so that the edge function of two given
//! points has the right sign. A hit is thus the true hit of a triangle that is
//! as good as the given one, and traversal can rely on `t` up to its last
//! rounding. Nearly everything that a ray is tested against never gets here:
//! see the [test in lanes](super::lanes).

use std::ops::{Add, Div, Mul, Sub};

use fearless_simd::f64x8;
use fearless_simd::prelude::*;

use crate::Ray;

/// A ray with the shear that turns it into its last axis.
#[derive(Clone, Copy, Debug)]
pub(super) struct ShearedRay<'r> {
    pub(super) ray: &'r Ray,
    /// The axes of the ray's frame; the last is the direction's largest.
    pub(super) axes: [usize; 3],
}

/// Where a ray meets a triangle, seen from either side.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Crossing {
    /// Distance in lengths of the direction; finite, never -0.
    pub(super) t: f32,
    /// Weight of the second corner.
    pub(super) u: f32,
    /// Weight of the third corner, at most `1 - u`.
    pub(super) v: f32,
}

impl<'r> ShearedRay<'r> {
    /// Prepares `ray`, or gives nothing if it cannot hit anything (see [`Ray`]).
    #[inline(always)]
    pub(super) fn new(ray: &'r Ray) -> Option<Self> {
        let finite = |[x, y, z]: [f32; 3]| x.is_finite() & y.is_finite() & z.is_finite();
        // Written so that NaN bounds fail.
        if !(finite(ray.origin) & finite(ray.direction) & (ray.t_min <= ray.t_max)) {
            return None;
        }
        let [x, y, z] = ray.direction;
        let (x, y, z) = (x.abs(), y.abs(), z.abs());
        let axes = frame_axes(largest_axis(x, y, z));
        (ray.direction[axes[2]] != 0.0).then_some(Self { ray, axes })
    }

    /// Where the ray's line meets the triangle, whatever the ray's range. A
    /// triangle without area is never met.
    #[inline(always)]
    pub(super) fn intersect(&self, corners: &[[f32; 3]; 3]) -> Option<Crossing> {
        let ray = self.ray;
        let triangle = TriangleInFrame::new(
            self.axes,
            &widened(ray.origin),
            &widened(ray.direction),
            &corners.map(widened),
        );
        let mut edges = triangle.edges();
        let doubtful = triangle.doubtful_below();
        if !(edges[0].abs() > doubtful && edges[1].abs() > doubtful && edges[2].abs() > doubtful) {
            edges = triangle.exact_edges();
        }
        let [u, v, w] = edges;
        if (u < 0.0 || v < 0.0 || w < 0.0) && (u > 0.0 || v > 0.0 || w > 0.0) {
            return None;
        }
        let [t, u, v] = triangle.crossing(edges);
        // Not finite either if the determinant is zero or anything overflowed.
        let t = t as f32;
        if !t.is_finite() || area_normal(&corners.map(widened)) == [0.0; 3] {
            return None;
        }
        Some(Crossing::new(t, u as f32, v as f32))
    }
}

impl Crossing {
    /// A crossing from numbers that may be -0 and weights whose sum may be 1 and a rounding.
    #[inline(always)]
    pub(super) fn new(t: f32, u: f32, v: f32) -> Self {
        // Adding 0 makes -0 positive.
        let u = u + 0.0;
        Self {
            t: t + 0.0,
            u,
            v: (v + 0.0).min(1.0 - u),
        }
    }
}

/// Double-precision numbers: one, or one a lane. All operations round as IEEE 754 says, so
/// that lanes give what one number gives.
pub(super) trait Real:
    Copy
    + Add<Output = Self>
    + Sub<Output = Self>
    + Mul<Output = Self>
    + Mul<f64, Output = Self>
    + Div<Output = Self>
{
    /// The absolute value.
    fn size(self) -> Self;

    /// The larger of two numbers that are not NaN.
    fn or_larger(self, other: Self) -> Self;

    /// The square root.
    fn root(self) -> Self;
}

impl Real for f64 {
    #[inline(always)]
    fn size(self) -> Self {
        self.abs()
    }

    #[inline(always)]
    fn or_larger(self, other: Self) -> Self {
        if other > self { other } else { self }
    }

    #[inline(always)]
    fn root(self) -> Self {
        self.sqrt()
    }
}

impl<S: Simd> Real for f64x8<S> {
    #[inline(always)]
    fn size(self) -> Self {
        self.abs()
    }

    #[inline(always)]
    fn or_larger(self, other: Self) -> Self {
        self.max(other)
    }

    #[inline(always)]
    fn root(self) -> Self {
        self.sqrt()
    }
}

/// A triangle in a ray's frame.
pub(super) struct TriangleInFrame<F> {
    corners: [[F; 3]; 3],
    /// The direction along the last axis.
    speed: F,
}

impl<F: Real> TriangleInFrame<F> {
    /// Corners of a triangle, and a ray's origin and direction, whose largest component is on
    /// the last of `axes`.
    #[inline(always)]
    pub(super) fn new(
        [x, y, z]: [usize; 3],
        origin: &[F; 3],
        direction: &[F; 3],
        corners: &[[F; 3]; 3],
    ) -> Self {
        let speed = direction[z];
        let (shear_x, shear_y) = (direction[x] / speed, direction[y] / speed);
        let mut sheared = *corners;
        for k in 0..3 {
            let depth = corners[k][z] - origin[z];
            sheared[k] = [
                (corners[k][x] - origin[x]) - shear_x * depth,
                (corners[k][y] - origin[y]) - shear_y * depth,
                depth,
            ];
        }
        Self {
            corners: sheared,
            speed,
        }
    }

    /// The edge functions.
    #[inline(always)]
    pub(super) fn edges(&self) -> [F; 3] {
        let [a, b, c] = &self.corners;
        [difference(c, b), difference(a, c), difference(b, a)]
    }

    /// Edge functions as small as this may have the wrong sign. Beside the products that they are
    /// differences of, they are off by 2⁻⁵² at most; what is larger than 2⁻²⁰ of those
    /// gives distance and weights to the last rounding, too.
    #[inline(always)]
    pub(super) fn doubtful_below(&self) -> F {
        let [a, b, c] = &self.corners;
        let x = a[0].size().or_larger(b[0].size()).or_larger(c[0].size());
        let y = a[1].size().or_larger(b[1].size()).or_larger(c[1].size());
        x * y * (1.0 / (1 << 20) as f64)
    }

    /// Distance, and weights of the second and the third corner, from edge functions.
    #[inline(always)]
    pub(super) fn crossing(&self, [u, v, w]: [F; 3]) -> [F; 3] {
        let [a, b, c] = &self.corners;
        let determinant = u + v + w;
        [
            (u * a[2] + v * b[2] + w * c[2]) / (determinant * self.speed),
            v / determinant,
            w / determinant,
        ]
    }
}

impl TriangleInFrame<f64> {
    /// The edge functions with the right signs.
    #[inline(always)]
    fn exact_edges(&self) -> [f64; 3] {
        let [a, b, c] = self.corners;
        [edge(c, b), edge(a, c), edge(b, a)]
    }
}

/// The axes of a ray's frame, given the one on which its direction is largest.
#[inline(always)]
pub(super) const fn frame_axes(largest: usize) -> [usize; 3] {
    [(largest + 1) % 3, (largest + 2) % 3, largest]
}

/// The axis of the largest of three sizes, the first of equal ones.
#[inline(always)]
pub(super) fn largest_axis(x: f32, y: f32, z: f32) -> usize {
    if (x >= y) & (x >= z) {
        0
    } else if y >= z {
        1
    } else {
        2
    }
}

#[inline(always)]
fn widened([x, y, z]: [f32; 3]) -> [f64; 3] {
    [f64::from(x), f64::from(y), f64::from(z)]
}

/// The edge function `p[0] · q[1] - p[1] · q[0]`, antisymmetric to the last bit, with an error of
/// 2⁻⁵² of the products.
#[inline(always)]
fn difference<F: Real>(p: &[F; 3], q: &[F; 3]) -> F {
    p[0] * q[1] - p[1] * q[0]
}

/// The same with an error of some 2⁻¹⁰⁴ of the products.
#[inline(always)]
fn edge(p: [f64; 3], q: [f64; 3]) -> f64 {
    let (high, low) = two_product(p[0], q[1]);
    let (other_high, other_low) = two_product(p[1], q[0]);
    (high - other_high) + (low - other_low)
}

/// A product as its rounded value and the exact rest (Dekker 1971). Written
/// without `mul_add`, which is slow where the hardware has no such instruction.
#[inline(always)]
fn two_product(a: f64, b: f64) -> (f64, f64) {
    let split = |x: f64| {
        let scaled = x * ((1 << 27) + 1) as f64;
        let high = scaled - (scaled - x);
        (high, x - high)
    };
    let ((a_high, a_low), (b_high, b_low)) = (split(a), split(b));
    let product = a * b;
    let rest = ((a_high * b_high - product) + a_high * b_low + a_low * b_high) + a_low * b_low;
    (product, rest)
}

/// The unit normal of a triangle by the right-hand rule of its corners;
/// zero for one without area.
#[inline(always)]
pub(super) fn unit_normal(corners: &[[f32; 3]; 3]) -> [f32; 3] {
    let normal = area_normal(&corners.map(widened));
    if normal == [0.0; 3] {
        return [0.0; 3];
    }
    let [x, y, z] = unit(normal);
    [x as f32, y as f32, z as f32]
}

/// A vector divided by its length.
#[inline(always)]
pub(super) fn unit<F: Real>([x, y, z]: [F; 3]) -> [F; 3] {
    let length = (x * x + y * y + z * z).root();
    [x / length, y / length, z / length]
}

/// The cross product of two edges. Zero for corners on one line: differences
/// of single-precision numbers, and products of those, are exact in double
/// precision unless their magnitudes are far apart.
#[inline(always)]
pub(super) fn area_normal<F: Real>([a, b, c]: &[[F; 3]; 3]) -> [F; 3] {
    let p = [b[0] - a[0], b[1] - a[1], b[2] - a[2]];
    let q = [c[0] - a[0], c[1] - a[1], c[2] - a[2]];
    [
        p[1] * q[2] - p[2] * q[1],
        p[2] * q[0] - p[0] * q[2],
        p[0] * q[1] - p[1] * q[0],
    ]
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    /// Integers that double precision holds exactly and whose products it does not.
    fn whole() -> impl Strategy<Value = i64> {
        -(1i64 << 53)..(1i64 << 53)
    }

    proptest! {
        #[test]
        fn edge_functions_have_the_right_sign(x in whole(), y in whole(), dx in -2i64..=2, dy in -2i64..=2) {
            let (other_x, other_y) = (x / 2 + dx, y / 2 + dy);
            let exact = i128::from(x) * i128::from(other_y) - i128::from(y) * i128::from(other_x);
            let p = [x as f64, y as f64, 0.0];
            let q = [other_x as f64, other_y as f64, 0.0];
            prop_assert_eq!(edge(p, q), exact as f64);
            prop_assert_eq!(edge(q, p), -exact as f64);
        }
    }

    #[test]
    fn a_triangle_without_area_has_no_normal() {
        let corners = [[0.1, 0.7, -3.0], [0.3, 2.1, -9.0], [0.2, 1.4, -6.0f32]].map(widened);
        let [a, b, _] = corners;
        assert_eq!(area_normal(&[a, b, b]), [0.0; 3]);
        assert_eq!(area_normal(&[a, a, a]), [0.0; 3]);
        assert_eq!(area_normal(&[[0.0; 3], a, a.map(|x| 2.0 * x)]), [0.0; 3]);
        assert_ne!(area_normal(&[[0.0, 0.0, 1.0], a, b]), [0.0; 3]);
    }
}
