//! Numbers one at a time or eight at a time.
//!
//! Light is computed by formulas over [`Lanes`], written once: paths take them with `f32`,
//! previews with eight pixels in the lanes of a vector. Both do the same operations in the same
//! order and fuse none, so they give the same bits on every instruction set, as long as
//! no number is NaN.

use std::ops::{Add, BitAnd, Div, Mul, Neg, Not, Sub};

use fearless_simd::prelude::*;
use fearless_simd::{Simd, f32x8, mask32x8};
use glam::Vec3;

/// Numbers in a vector.
pub(crate) const LANES: usize = 8;

/// A number, or one in each lane.
pub(crate) trait Lanes:
    Copy
    + Neg<Output = Self>
    + Add<Output = Self>
    + Sub<Output = Self>
    + Mul<Output = Self>
    + Div<Output = Self>
    + Add<f32, Output = Self>
    + Sub<f32, Output = Self>
    + Mul<f32, Output = Self>
    + Div<f32, Output = Self>
{
    /// A truth, or one in each lane.
    type Mask: Copy + BitAnd<Output = Self::Mask> + Not<Output = Self::Mask>;

    /// `number` in as many lanes as there are here.
    fn splat(self, number: f32) -> Self;

    fn min(self, other: Self) -> Self;
    fn max(self, other: Self) -> Self;
    fn abs(self) -> Self;
    fn sqrt(self) -> Self;

    /// Without what follows the point, for numbers that fit an `i32`.
    fn trunc(self) -> Self;

    fn is_below(self, other: Self) -> Self::Mask;

    /// This where `mask` holds, else `other`.
    fn or(self, mask: Self::Mask, other: Self) -> Self;

    /// The entries of a table whose numbers these are, which must not be beyond its ends.
    fn entries(self, table: &[Vec3]) -> Vector<Self>;

    /// Clamped to the range from `low` to `high`.
    #[inline(always)]
    fn within(self, low: f32, high: f32) -> Self {
        self.max(self.splat(low)).min(self.splat(high))
    }

    /// What is missing to 1.
    #[inline(always)]
    fn rest(self) -> Self {
        self.splat(1.0) - self
    }

    /// The fifth power.
    #[inline(always)]
    fn fifth_power(self) -> Self {
        let square = self * self;
        square * square * self
    }
}

impl Lanes for f32 {
    type Mask = bool;

    #[inline(always)]
    fn splat(self, number: f32) -> Self {
        number
    }

    #[inline(always)]
    fn min(self, other: Self) -> Self {
        f32::min(self, other)
    }

    #[inline(always)]
    fn max(self, other: Self) -> Self {
        f32::max(self, other)
    }

    #[inline(always)]
    fn abs(self) -> Self {
        f32::abs(self)
    }

    #[inline(always)]
    fn sqrt(self) -> Self {
        f32::sqrt(self)
    }

    #[inline(always)]
    fn trunc(self) -> Self {
        // A machine's general `trunc` may be a call.
        self as i32 as f32
    }

    #[inline(always)]
    fn is_below(self, other: Self) -> bool {
        self < other
    }

    #[inline(always)]
    fn or(self, mask: bool, other: Self) -> Self {
        if mask { self } else { other }
    }

    #[inline(always)]
    fn entries(self, table: &[Vec3]) -> Vector<Self> {
        table[self as i32 as usize].into()
    }
}

impl<S: Simd> Lanes for f32x8<S> {
    type Mask = mask32x8<S>;

    #[inline(always)]
    fn splat(self, number: f32) -> Self {
        SimdBase::splat(self.token(), number)
    }

    #[inline(always)]
    fn min(self, other: Self) -> Self {
        SimdBase::min(self, other)
    }

    #[inline(always)]
    fn max(self, other: Self) -> Self {
        SimdBase::max(self, other)
    }

    #[inline(always)]
    fn abs(self) -> Self {
        SimdBase::abs(self)
    }

    #[inline(always)]
    fn sqrt(self) -> Self {
        SimdFloat::sqrt(self)
    }

    #[inline(always)]
    fn trunc(self) -> Self {
        SimdFloat::trunc(self)
    }

    #[inline(always)]
    fn is_below(self, other: Self) -> Self::Mask {
        self.simd_lt(other)
    }

    #[inline(always)]
    fn or(self, mask: Self::Mask, other: Self) -> Self {
        mask.select(self, other)
    }

    #[inline(always)]
    fn entries(self, table: &[Vec3]) -> Vector<Self> {
        let mut rows = [[0.0; LANES]; 3];
        for lane in 0..LANES {
            let entry = table[self[lane] as i32 as usize];
            rows[0][lane] = entry.x;
            rows[1][lane] = entry.y;
            rows[2][lane] = entry.z;
        }
        Vector::load(self.token(), &rows)
    }
}

/// A vector in space, or one in each lane.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Vector<L> {
    pub(crate) x: L,
    pub(crate) y: L,
    pub(crate) z: L,
}

impl From<Vec3> for Vector<f32> {
    #[inline(always)]
    fn from(Vec3 { x, y, z }: Vec3) -> Self {
        Self { x, y, z }
    }
}

impl From<Vector<f32>> for Vec3 {
    #[inline(always)]
    fn from(Vector { x, y, z }: Vector<f32>) -> Self {
        Self { x, y, z }
    }
}

impl<S: Simd> Vector<f32x8<S>> {
    /// The vectors whose coordinates are in `rows`.
    #[inline(always)]
    pub(crate) fn load(simd: S, rows: &[[f32; LANES]; 3]) -> Self {
        Self {
            x: f32x8::simd_from(simd, rows[0]),
            y: f32x8::simd_from(simd, rows[1]),
            z: f32x8::simd_from(simd, rows[2]),
        }
    }

    /// Their coordinates.
    #[inline(always)]
    pub(crate) fn rows(self) -> [[f32; LANES]; 3] {
        [self.x.into(), self.y.into(), self.z.into()]
    }
}

impl<L: Lanes> Vector<L> {
    /// `vector` in as many lanes as `like` has.
    #[inline(always)]
    pub(crate) fn splat(like: L, vector: Vec3) -> Self {
        Self {
            x: like.splat(vector.x),
            y: like.splat(vector.y),
            z: like.splat(vector.z),
        }
    }

    #[inline(always)]
    pub(crate) fn dot(self, other: Self) -> L {
        self.x * other.x + self.y * other.y + self.z * other.z
    }

    #[inline(always)]
    pub(crate) fn dot_with(self, other: Vec3) -> L {
        self.dot(Self::splat(self.x, other))
    }

    #[inline(always)]
    pub(crate) fn cross(self, other: Self) -> Self {
        Self {
            x: self.y * other.z - other.y * self.z,
            y: self.z * other.x - other.z * self.x,
            z: self.x * other.y - other.x * self.y,
        }
    }

    #[inline(always)]
    pub(crate) fn abs(self) -> Self {
        Self {
            x: self.x.abs(),
            y: self.y.abs(),
            z: self.z.abs(),
        }
    }

    /// The largest coordinate of each lane.
    #[inline(always)]
    pub(crate) fn largest(self) -> L {
        self.x.max(self.y).max(self.z)
    }

    #[inline(always)]
    pub(crate) fn max(self, other: Self) -> Self {
        Self {
            x: self.x.max(other.x),
            y: self.y.max(other.y),
            z: self.z.max(other.z),
        }
    }

    /// With its coordinates multiplied by those of `other`.
    #[inline(always)]
    pub(crate) fn times(self, other: Self) -> Self {
        Self {
            x: self.x * other.x,
            y: self.y * other.y,
            z: self.z * other.z,
        }
    }

    /// From here the given share of the way to `other`.
    #[inline(always)]
    pub(crate) fn lerp(self, other: Self, share: L) -> Self {
        self * share.rest() + other * share
    }

    /// This where `mask` holds, else `other`.
    #[inline(always)]
    pub(crate) fn or(self, mask: L::Mask, other: Self) -> Self {
        Self {
            x: self.x.or(mask, other.x),
            y: self.y.or(mask, other.y),
            z: self.z.or(mask, other.z),
        }
    }

    #[inline(always)]
    pub(crate) fn length(self) -> L {
        self.dot(self).sqrt()
    }

    #[inline(always)]
    pub(crate) fn normalize(self) -> Self {
        self * (self.x.splat(1.0) / self.length())
    }

    /// Of unit length, or `other` where it is too short or too long for that.
    #[inline(always)]
    pub(crate) fn normalize_or(self, other: Self) -> Self {
        let inverse = self.x.splat(1.0) / self.length();
        let zero = inverse.splat(0.0);
        let is_proper = zero.is_below(inverse) & inverse.is_below(zero.splat(f32::INFINITY));
        (self * inverse).or(is_proper, other)
    }
}

impl<L: Lanes> Neg for Vector<L> {
    type Output = Self;

    #[inline(always)]
    fn neg(self) -> Self {
        Self {
            x: -self.x,
            y: -self.y,
            z: -self.z,
        }
    }
}

impl<L: Lanes> Add for Vector<L> {
    type Output = Self;

    #[inline(always)]
    fn add(self, other: Self) -> Self {
        Self {
            x: self.x + other.x,
            y: self.y + other.y,
            z: self.z + other.z,
        }
    }
}

impl<L: Lanes> Sub for Vector<L> {
    type Output = Self;

    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        Self {
            x: self.x - other.x,
            y: self.y - other.y,
            z: self.z - other.z,
        }
    }
}

impl<L: Lanes> Mul<L> for Vector<L> {
    type Output = Self;

    #[inline(always)]
    fn mul(self, factor: L) -> Self {
        Self {
            x: self.x * factor,
            y: self.y * factor,
            z: self.z * factor,
        }
    }
}

impl<L: Lanes> Div<L> for Vector<L> {
    type Output = Self;

    #[inline(always)]
    fn div(self, divisor: L) -> Self {
        Self {
            x: self.x / divisor,
            y: self.y / divisor,
            z: self.z / divisor,
        }
    }
}
