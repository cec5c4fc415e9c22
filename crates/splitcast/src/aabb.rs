//! Axis-aligned bounding boxes.

/// An axis-aligned box, closed on all sides: `min[axis] <= x <= max[axis]`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Aabb {
    /// Lower corner.
    pub min: [f32; 3],
    /// Upper corner.
    pub max: [f32; 3],
}

impl Aabb {
    /// The box of nothing: growing it by a point gives that point.
    pub const EMPTY: Self = Self {
        min: [f32::INFINITY; 3],
        max: [f32::NEG_INFINITY; 3],
    };

    /// The box of all space.
    pub(crate) const EVERYTHING: Self = Self {
        min: [f32::NEG_INFINITY; 3],
        max: [f32::INFINITY; 3],
    };

    /// The smallest box around `points`, [`Aabb::EMPTY`] for none.
    pub fn of_points(points: &[[f32; 3]]) -> Self {
        points.iter().fold(Self::EMPTY, |mut bounds, &point| {
            bounds.grow(point);
            bounds
        })
    }

    /// Whether no point lies inside.
    pub fn is_empty(&self) -> bool {
        (0..3).any(|axis| self.min[axis] > self.max[axis])
    }

    /// Enlarges the box to hold `point`.
    #[inline]
    pub fn grow(&mut self, point: [f32; 3]) {
        for ((min, max), x) in self.min.iter_mut().zip(&mut self.max).zip(point) {
            *min = min.min(x);
            *max = max.max(x);
        }
    }

    /// The smallest box around both.
    #[inline]
    #[must_use]
    pub fn union(mut self, other: &Self) -> Self {
        for axis in 0..3 {
            self.min[axis] = self.min[axis].min(other.min[axis]);
            self.max[axis] = self.max[axis].max(other.max[axis]);
        }
        self
    }

    /// Edge lengths, zero for an empty box.
    #[inline]
    pub fn extent(&self) -> [f32; 3] {
        std::array::from_fn(|axis| (self.max[axis] - self.min[axis]).max(0.0))
    }

    /// Half the surface area: the SAH only ever takes ratios of areas.
    #[inline]
    pub fn half_area(&self) -> f32 {
        let [x, y, z] = self.extent();
        x * y + y * z + z * x
    }

    /// The largest distance on any one axis from `point` to a point of the box.
    #[inline]
    pub fn reach(&self, point: [f32; 3]) -> f32 {
        let mut reach = 0.0;
        for axis in 0..3 {
            reach = upper(reach, (self.min[axis] - point[axis]).abs());
            reach = upper(reach, (self.max[axis] - point[axis]).abs());
        }
        reach
    }

    /// The largest distance on each axis from `point` to a point of the box.
    #[inline]
    pub(crate) fn farthest(&self, point: [f32; 3]) -> [f32; 3] {
        let on = |axis: usize| {
            let (min, max) = (self.min[axis], self.max[axis]);
            upper((min - point[axis]).abs(), (max - point[axis]).abs())
        };
        [on(0), on(1), on(2)]
    }

    /// The two halves that a plane across `axis` at `position` leaves.
    #[inline]
    pub fn split(&self, axis: usize, position: f32) -> (Self, Self) {
        let (mut left, mut right) = (*self, *self);
        left.max[axis] = position;
        right.min[axis] = position;
        (left, right)
    }
}

/// The lower of two numbers: unlike `f32::min`, a single instruction.
#[inline(always)]
pub(crate) fn lower(a: f32, b: f32) -> f32 {
    if b < a { b } else { a }
}

/// The higher of two numbers: unlike `f32::max`, a single instruction.
#[inline(always)]
pub(crate) fn upper(a: f32, b: f32) -> f32 {
    if b > a { b } else { a }
}
