//! The watertight ray–triangle test (Woop, Benthin & Wald 2013).
//!
//! Vertices are moved to the ray's frame, where the ray starts at the origin
//! and runs along +z, by a shear that depends on the ray alone. There, the
//! signs of three edge functions decide. Two triangles that share an edge
//! compute that edge's function from the same two points with the same
//! operations, so one of them accepts every ray that crosses it: none slips
//! through. A function that comes out as exactly zero is computed again in
//! double precision, where products of single-precision values are exact.

use crate::Ray;

/// A ray with the shear that turns it into the z axis.
#[derive(Clone, Copy, Debug)]
pub(super) struct ShearedRay {
    origin: [f32; 3],
    /// The axes of the ray's frame; the last is the direction's largest.
    axes: [usize; 3],
    shear: [f32; 3],
}

impl ShearedRay {
    /// Prepares `ray`, or nothing if it cannot hit anything (see [`Ray`]).
    pub(super) fn new(ray: &Ray) -> Option<Self> {
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
        let (mut x, mut y) = ((z + 1) % 3, (z + 2) % 3);
        if ray.direction[z] < 0.0 {
            // Keeps the frame right-handed, and with it the winding of triangles.
            std::mem::swap(&mut x, &mut y);
        }
        let scale = ray.direction[z].recip();
        if !scale.is_finite() {
            return None;
        }
        Some(Self {
            origin: ray.origin,
            axes: [x, y, z],
            shear: [ray.direction[x] * scale, ray.direction[y] * scale, scale],
        })
    }

    /// The distance and the weights of the second and third corner where the
    /// ray's line meets the triangle, from either side.
    #[inline]
    pub(super) fn intersect(&self, corners: &[[f32; 3]; 3]) -> Option<(f32, f32, f32)> {
        let [x, y, z] = self.axes;
        let [a, b, c] = corners.map(|corner| {
            let relative: [f32; 3] = std::array::from_fn(|axis| corner[axis] - self.origin[axis]);
            [
                relative[x] - self.shear[0] * relative[z],
                relative[y] - self.shear[1] * relative[z],
                relative[z] * self.shear[2],
            ]
        });
        let edge = |p: [f32; 3], q: [f32; 3]| p[0] * q[1] - p[1] * q[0];
        let (mut u, mut v, mut w) = (edge(c, b), edge(a, c), edge(b, a));
        if u == 0.0 || v == 0.0 || w == 0.0 {
            let exact = |p: [f32; 3], q: [f32; 3]| {
                (f64::from(p[0]) * f64::from(q[1]) - f64::from(p[1]) * f64::from(q[0])) as f32
            };
            (u, v, w) = (exact(c, b), exact(a, c), exact(b, a));
        }
        if (u < 0.0 || v < 0.0 || w < 0.0) && (u > 0.0 || v > 0.0 || w > 0.0) {
            return None;
        }
        let determinant = u + v + w;
        if determinant == 0.0 {
            return None;
        }
        let t = (u * a[2] + v * b[2] + w * c[2]) / determinant;
        t.is_finite().then(|| (t, v / determinant, w / determinant))
    }
}
