//! The test of a ray against a triangle, for libraries that ship none which
//! could be used here: Möller and Trumbore's, in single precision, from both sides.

use splitcast::Ray;

/// A triangle, prepared for tests.
#[derive(Clone, Copy, Debug)]
pub(super) struct Triangle {
    corner: [f32; 3],
    /// From the corner to the other two.
    edges: [[f32; 3]; 2],
}

impl Triangle {
    pub(super) fn new([a, b, c]: [[f32; 3]; 3]) -> Self {
        Self {
            corner: a,
            edges: [minus(b, a), minus(c, a)],
        }
    }

    /// Distance at which a ray hits, if that is between its ends.
    #[inline(always)]
    pub(super) fn hit(&self, ray: &Ray) -> Option<f32> {
        let [first, second] = self.edges;
        let across = cross(ray.direction, second);
        let inverse = 1.0 / dot(first, across);
        let from_corner = minus(ray.origin, self.corner);
        let u = dot(from_corner, across) * inverse;
        let around = cross(from_corner, first);
        let v = dot(ray.direction, around) * inverse;
        let t = dot(second, around) * inverse;
        // All fail on what is not a number, so that rays in the triangle's plane miss.
        let hits = u >= 0.0 && v >= 0.0 && u + v <= 1.0 && t >= ray.t_min && t <= ray.t_max;
        hits.then_some(t)
    }
}

#[inline(always)]
fn minus(a: [f32; 3], b: [f32; 3]) -> [f32; 3] {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

#[inline(always)]
fn dot(a: [f32; 3], b: [f32; 3]) -> f32 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

#[inline(always)]
fn cross(a: [f32; 3], b: [f32; 3]) -> [f32; 3] {
    [
        a[1] * b[2] - a[2] * b[1],
        a[2] * b[0] - a[0] * b[2],
        a[0] * b[1] - a[1] * b[0],
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn both_sides_are_hit_between_the_ends_only() {
        let triangle = Triangle::new([[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]);
        for side in [-1.0, 1.0] {
            let ray = Ray::new([0.25, 0.25, 2.0 * side], [0.0, 0.0, -side]);
            assert_eq!(triangle.hit(&ray), Some(2.0));
            assert_eq!(triangle.hit(&ray.with_range(2.5, 9.0)), None);
            assert_eq!(triangle.hit(&ray.with_range(0.0, 1.5)), None);
        }
        let beside = Ray::new([0.75, 0.75, 2.0], [0.0, 0.0, -1.0]);
        assert_eq!(triangle.hit(&beside), None);
        let in_plane = Ray::new([-1.0, 0.25, 0.0], [1.0, 0.0, 0.0]);
        assert_eq!(triangle.hit(&in_plane), None);
    }
}
