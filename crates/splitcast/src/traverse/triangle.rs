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

use crate::{Mesh, Ray};

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
        let axes = if (x >= y) & (x >= z) {
            [1, 2, 0]
        } else if y >= z {
            [2, 0, 1]
        } else {
            [0, 1, 2]
        };
        (ray.direction[axes[2]] != 0.0).then_some(Self { ray, axes })
    }

    /// Where the ray's line meets the triangle, whatever the ray's range. A
    /// triangle without area is never met.
    #[inline(always)]
    pub(super) fn intersect(&self, corners: &[[f32; 3]; 3]) -> Option<Crossing> {
        let [x, y, z] = self.axes;
        let [dx, dy, dz] = [x, y, z].map(|axis| f64::from(self.ray.direction[axis]));
        let shear = [dx / dz, dy / dz];
        let origin = [x, y, z].map(|axis| f64::from(self.ray.origin[axis]));
        let mut sheared = [[0.0; 3]; 3];
        for k in 0..3 {
            let depth = f64::from(corners[k][z]) - origin[2];
            sheared[k] = [
                (f64::from(corners[k][x]) - origin[0]) - shear[0] * depth,
                (f64::from(corners[k][y]) - origin[1]) - shear[1] * depth,
                depth,
            ];
        }
        let [a, b, c] = sheared;
        let mut edges = [difference(c, b), difference(a, c), difference(b, a)];
        // Beside products of this size, a plain difference is off by 2⁻⁵² at most: what is larger
        // by 2³² has the right sign, and gives distance and weights to the last rounding.
        let width = |k: usize| a[k].abs().max(b[k].abs()).max(c[k].abs());
        let doubtful = width(0) * width(1) * (1.0 / (1 << 20) as f64);
        if !edges.iter().all(|edge| edge.abs() > doubtful) {
            edges = [edge(c, b), edge(a, c), edge(b, a)];
        }
        let [u, v, w] = edges;
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

/// The edge function `p[0] · q[1] - p[1] · q[0]`, antisymmetric to the last bit, with an error of
/// 2⁻⁵² of the products.
#[inline(always)]
fn difference(p: [f64; 3], q: [f64; 3]) -> f64 {
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
#[inline(always)]
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
