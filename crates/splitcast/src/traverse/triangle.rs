//! The watertight ray–triangle test (Woop, Benthin & Wald 2013), in double
//! precision behind a single-precision filter.
//!
//! Vertices are moved to the ray's frame, where the ray starts at the origin
//! and runs along the last axis, by a shear that depends on the ray alone.
//! There, the signs of three edge functions decide. Two triangles that share
//! an edge compute that edge's function from the same two points, so one of
//! them accepts every ray that crosses it: none slips through.
//!
//! In single precision the signs are wrong now and then, and rays that pass
//! beside a triangle seen edge-on hit it, at any distance. Single precision
//! therefore only rejects what is outside beyond its rounding errors (a
//! filter in the sense of Shewchuk 1997): nearly everything that a ray is
//! tested against. The rest is decided in double precision, where a corner in
//! the ray's frame is off by a few 2⁻⁵³ of its distance, and with products of
//! twice that precision, so that the edge function of two given points has
//! the right sign. A hit is thus the true hit of a triangle that is as good as
//! the given one, and traversal can rely on `t` up to its last rounding.

use crate::{Mesh, Ray};

/// A ray with the shear that turns it into its last axis.
#[derive(Clone, Copy, Debug)]
pub(super) struct ShearedRay {
    origin: [f32; 3],
    direction: [f32; 3],
    /// The axes of the ray's frame; the last is the direction's largest.
    axes: [usize; 3],
    shear: [f32; 2],
    /// Bounds the rounding error of a corner in the ray's frame.
    corner_error: f32,
}

/// Where a ray meets a triangle, seen from either side.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Crossing {
    /// Distance in lengths of the direction; finite, never -0.
    pub(super) t: f32,
    /// Weight of the second corner.
    pub(super) u: f32,
    /// Weight of the third corner, at most `1 - u`.
    pub(super) v: f32,
}

impl ShearedRay {
    /// Prepares `ray` for triangles no farther than `reach` from its origin
    /// on any axis, or gives nothing if it cannot hit anything (see [`Ray`]).
    /// With an infinite reach nothing is filtered.
    pub(super) fn new(ray: &Ray, reach: f32) -> Option<Self> {
        let finite = |v: [f32; 3]| v.iter().all(|x| x.is_finite());
        // Written so that NaN bounds fail.
        if !(finite(ray.origin) && finite(ray.direction) && ray.t_min <= ray.t_max) {
            return None;
        }
        let size = ray.direction.map(f32::abs);
        let z = if size[0] >= size[1] && size[0] >= size[2] {
            0
        } else if size[1] >= size[2] {
            1
        } else {
            2
        };
        let (x, y) = ((z + 1) % 3, (z + 2) % 3);
        let [dx, dy, dz] = [x, y, z].map(|axis| ray.direction[axis]);
        (dz != 0.0).then_some(Self {
            origin: ray.origin,
            direction: ray.direction,
            axes: [x, y, z],
            shear: [dx / dz, dy / dz],
            // In units of 2⁻²⁴ of the reach: the corner relative to the origin 1, the shear 1,
            // the corner's depth in it 1, their product 1, the difference 2. 8 leaves room.
            corner_error: reach * (8.0 / (1 << 24) as f32),
        })
    }

    /// Where the ray's line meets the triangle, whatever the ray's range. A
    /// triangle without area is never met.
    #[inline(always)]
    pub(super) fn intersect(&self, corners: &[[f32; 3]; 3]) -> Option<Crossing> {
        if self.surely_misses(corners) {
            return None;
        }
        self.resolve(corners)
    }

    /// Whether single precision is enough to see that the ray misses.
    #[inline(always)]
    fn surely_misses(&self, corners: &[[f32; 3]; 3]) -> bool {
        let [x, y, z] = self.axes;
        let [a, b, c] = corners.map(|corner| {
            let depth = corner[z] - self.origin[z];
            [
                (corner[x] - self.origin[x]) - self.shear[0] * depth,
                (corner[y] - self.origin[y]) - self.shear[1] * depth,
            ]
        });
        let edge = |p: [f32; 2], q: [f32; 2]| p[0] * q[1] - p[1] * q[0];
        let edges = [edge(c, b), edge(a, c), edge(b, a)];
        // With e the corners' error and w the largest |x| plus the largest |y|, an edge function
        // is off by at most 2we + 2e² for the corners and w²·2⁻²⁴ for its own rounding. Here
        // w is at most 4 reaches and so w·2⁻²⁴ at most e / 2; the rest is room, and MIN_POSITIVE
        // covers what underflow takes.
        let largest = |k: usize| larger(larger(a[k].abs(), b[k].abs()), c[k].abs());
        let width = largest(0) + largest(1);
        let error = self.corner_error * (4.0 * (width + self.corner_error)) + f32::MIN_POSITIVE;
        let below = edges.iter().fold(false, |any, &e| any | (e < -error));
        let above = edges.iter().fold(false, |any, &e| any | (e > error));
        below & above
    }

    /// The test itself.
    fn resolve(&self, corners: &[[f32; 3]; 3]) -> Option<Crossing> {
        let [x, y, z] = self.axes;
        let [dx, dy, dz] = [x, y, z].map(|axis| f64::from(self.direction[axis]));
        let shear = [dx / dz, dy / dz];
        let [a, b, c] = corners.map(|corner| {
            let relative = |axis: usize| f64::from(corner[axis]) - f64::from(self.origin[axis]);
            let depth = relative(z);
            [
                relative(x) - shear[0] * depth,
                relative(y) - shear[1] * depth,
                depth,
            ]
        });
        let (u, v, w) = (edge(c, b), edge(a, c), edge(b, a));
        if (u < 0.0 || v < 0.0 || w < 0.0) && (u > 0.0 || v > 0.0 || w > 0.0) {
            return None;
        }
        let determinant = u + v + w;
        let t = ((u * a[2] + v * b[2] + w * c[2]) / (determinant * dz)) as f32;
        // Not finite either if the determinant is zero or anything overflowed.
        if !t.is_finite() || area_normal(corners) == [0.0; 3] {
            return None;
        }
        // Adding 0 makes -0 positive.
        let u = (v / determinant) as f32 + 0.0;
        Some(Crossing {
            t: t + 0.0,
            u,
            v: ((w / determinant) as f32 + 0.0).min(1.0 - u),
        })
    }
}

/// The edge function `p[0] · q[1] - p[1] · q[0]`, antisymmetric to the last
/// bit, with an error of some 2⁻¹⁰⁴ of the products.
fn edge(p: [f64; 3], q: [f64; 3]) -> f64 {
    let (high, low) = two_product(p[0], q[1]);
    let (other_high, other_low) = two_product(p[1], q[0]);
    (high - other_high) + (low - other_low)
}

/// A product as its rounded value and the exact rest (Dekker 1971). Written
/// without `mul_add`, which is slow where the hardware has no such instruction.
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

#[inline(always)]
fn larger(a: f32, b: f32) -> f32 {
    if a > b { a } else { b }
}

/// The unit normal of triangle `index` by the right-hand rule of its corners;
/// zero for one without area.
pub(super) fn unit_normal(mesh: Mesh<'_>, index: u32) -> [f32; 3] {
    let normal = area_normal(&mesh.corners(index));
    let length = normal.iter().map(|x| x * x).sum::<f64>().sqrt();
    if length > 0.0 {
        normal.map(|x| (x / length) as f32)
    } else {
        [0.0; 3]
    }
}

/// The cross product of two edges. Zero for corners on one line: differences
/// of single-precision numbers, and products of those, are exact in double
/// precision unless their magnitudes are far apart.
fn area_normal(corners: &[[f32; 3]; 3]) -> [f64; 3] {
    let [a, b, c] = corners.map(|corner| corner.map(f64::from));
    let p: [f64; 3] = std::array::from_fn(|k| b[k] - a[k]);
    let q: [f64; 3] = std::array::from_fn(|k| c[k] - a[k]);
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

        #[test]
        fn filtering_loses_no_hit(
            corners in prop::array::uniform3(prop::array::uniform3(-1.0f32..1.0)),
            origin in prop::array::uniform3(-1.0f32..1.0),
            weights in prop::array::uniform2(0.0f32..=0.5),
            scale in -40i32..=30,
            nudge in -3i32..=3,
        ) {
            // Towards a point of the triangle, often on its edge, or a few roundings beside it.
            let factor = 2f32.powi(scale);
            let corners = corners.map(|c: [f32; 3]| c.map(|x| x * factor));
            let origin = origin.map(|x| x * factor);
            let weights = weights.map(|w| (w * 8.0).round() / 8.0);
            let direction = std::array::from_fn(|k| {
                let [a, b, c] = corners.map(|corner| corner[k]);
                let target = a + weights[0] * (b - a) + weights[1] * (c - a);
                (target - origin[k]) * (1.0 + nudge as f32 * f32::EPSILON * (k as f32 - 1.0))
            });
            let ray = Ray::new(origin, direction);
            let reach = crate::Aabb::of_points(&corners).reach(origin);
            let filtered = ShearedRay::new(&ray, reach).map(|ray| ray.intersect(&corners));
            let exact = ShearedRay::new(&ray, f32::INFINITY).map(|ray| ray.intersect(&corners));
            prop_assert_eq!(filtered, exact);
        }
    }

    #[test]
    fn a_triangle_without_area_has_no_normal() {
        let corners = [[0.1, 0.7, -3.0], [0.3, 2.1, -9.0], [0.2, 1.4, -6.0f32]];
        let [a, b, _] = corners;
        assert_eq!(area_normal(&[a, b, b]), [0.0; 3]);
        assert_eq!(area_normal(&[a, a, a]), [0.0; 3]);
        assert_eq!(area_normal(&[[0.0; 3], a, a.map(|x| 2.0 * x)]), [0.0; 3]);
        assert_ne!(area_normal(&[[0.0, 0.0, 1.0], a, b]), [0.0; 3]);
    }
}
