//! Rays and hits.

/// A ray: the points `origin + t * direction` for `t_min <= t <= t_max`.
///
/// The direction need not be of unit length; `t` counts in its lengths. A ray
/// with a NaN or infinite component in origin or direction, a zero direction,
/// a NaN bound, or `t_min > t_max` hits nothing. Triangles without area are
/// never hit.
#[derive(Clone, Copy, Debug, PartialEq)]
#[repr(C)]
pub struct Ray {
    /// Start of the ray.
    pub origin: [f32; 3],
    /// Direction, of any non-zero length.
    pub direction: [f32; 3],
    /// Hits nearer than this do not count. May be negative.
    pub t_min: f32,
    /// Hits farther than this do not count. May be infinite.
    pub t_max: f32,
}

impl Ray {
    /// The half line from `origin` along `direction`: `t` from 0 to infinity.
    #[inline]
    pub fn new(origin: [f32; 3], direction: [f32; 3]) -> Self {
        Self {
            origin,
            direction,
            t_min: 0.0,
            t_max: f32::INFINITY,
        }
    }

    /// The same ray, limited to `t_min <= t <= t_max`.
    #[inline]
    #[must_use]
    pub fn with_range(mut self, t_min: f32, t_max: f32) -> Self {
        self.t_min = t_min;
        self.t_max = t_max;
        self
    }

    /// The point at `t`.
    #[inline]
    pub fn at(&self, t: f32) -> [f32; 3] {
        std::array::from_fn(|axis| self.origin[axis] + t * self.direction[axis])
    }
}

/// Where a ray meets a triangle, from whichever side.
///
/// The point is `(1 - u - v) · a + u · b + v · c` of the triangle's corners
/// a, b and c. `u`, `v` and `1 - u - v` as computed in single precision are
/// all from 0 to 1.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hit {
    /// Distance along the ray in lengths of its direction.
    pub t: f32,
    /// Weight of the triangle's second corner.
    pub u: f32,
    /// Weight of the triangle's third corner.
    pub v: f32,
    /// Index of the triangle in the mesh.
    pub triangle: u32,
    /// Geometric normal of unit length: it points to the side from which the
    /// corners run counter-clockwise, whichever side the ray came from.
    pub normal: [f32; 3],
}
