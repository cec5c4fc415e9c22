//! The ranges of some rays: what can be said of all of them at once.

use fearless_simd::f32x8;
use fearless_simd::prelude::*;

use super::descend::{FARTHEST, ORDINARY, slack};
use super::lanes::{ErrorScale, length_bound};
use crate::aabb::{lower, upper};
use crate::{Aabb, Ray};

/// Directions of rays that share a descent differ by no more than this share of their length on any axis,
const WIDEST_TURN: f32 = 0.05;

/// and their origins by no more than this share of the tree's size: beyond, rays share too little of
/// their way.
const WIDEST_SPREAD: f32 = 0.04;

/// The ranges of origins and directions of some rays.
#[derive(Clone, Copy, Debug)]
pub(super) struct Intervals {
    pub(super) origins: Aabb,
    pub(super) directions: Aabb,
    /// The lowest distance of interest.
    pub(super) t_min: f32,
}

impl Intervals {
    /// The ranges of no rays.
    pub(super) const NONE: Self = Self {
        origins: Aabb::EMPTY,
        directions: Aabb::EMPTY,
        t_min: f32::INFINITY,
    };

    /// The ranges of these rays and others.
    #[inline(always)]
    pub(super) fn join(&mut self, other: &Self) {
        for (own, other) in [
            (&mut self.origins, &other.origins),
            (&mut self.directions, &other.directions),
        ] {
            for axis in 0..3 {
                own.min[axis] = lower(own.min[axis], other.min[axis]);
                own.max[axis] = upper(own.max[axis], other.max[axis]);
            }
        }
        self.t_min = lower(self.t_min, other.t_min);
    }

    /// Whether rays are alike enough to share a descent through a tree of such bounds.
    #[inline(always)]
    pub(super) fn are_narrow(&self, bounds: &Aabb) -> bool {
        let mut length = 0.0;
        let mut size = 0.0;
        let (mut turn, mut spread, mut place) = (0.0, 0.0, 0.0);
        let mut parallel = 0;
        for axis in 0..3 {
            let (low, high) = (self.directions.min[axis], self.directions.max[axis]);
            length = upper(length, upper(-low, high));
            turn = upper(turn, high - low);
            parallel += u32::from(low <= 0.0 && high >= 0.0);
            let (first, last) = (self.origins.min[axis], self.origins.max[axis]);
            spread = upper(spread, last - first);
            size = upper(size, bounds.max[axis] - bounds.min[axis]);
            place = upper(place, upper(-first, last));
        }
        self.t_min >= 0.0
            && place <= FARTHEST
            && ORDINARY.contains(&length)
            && parallel < 2
            && turn <= WIDEST_TURN * length
            && spread <= WIDEST_SPREAD * size
    }

    /// By how much boxes within `bounds` are widened for these rays.
    #[inline(always)]
    pub(super) fn slack(&self, bounds: &Aabb) -> f32 {
        let (near, far) = (
            bounds.reach(self.origins.min),
            bounds.reach(self.origins.max),
        );
        slack(bounds, upper(near, far))
    }

    /// What bounds the errors for all of the rays.
    #[inline(always)]
    pub(super) fn errors(&self, bounds: &Aabb) -> ErrorScale {
        let near = bounds.farthest(self.origins.min);
        let far = bounds.farthest(self.origins.max);
        let mut length = [0.0; 3];
        let mut reach = [0.0; 3];
        for axis in 0..3 {
            length[axis] = upper(-self.directions.min[axis], self.directions.max[axis]);
            reach[axis] = upper(near[axis], far[axis]);
        }
        ErrorScale::new(length_bound(length), length_bound(reach))
    }
}

/// Finds the ranges of rays that come one after the other: a ray's eight numbers in the lanes.
#[derive(Clone, Copy)]
pub(super) struct RangeLanes<S: Simd> {
    lowest: f32x8<S>,
    highest: f32x8<S>,
    sum: f32x8<S>,
}

impl<S: Simd> RangeLanes<S> {
    /// Before the first ray.
    #[inline(always)]
    pub(super) fn new(simd: S) -> Self {
        Self {
            lowest: f32x8::splat(simd, f32::INFINITY),
            highest: f32x8::splat(simd, f32::NEG_INFINITY),
            sum: f32x8::splat(simd, 0.0),
        }
    }

    /// Takes a ray into account.
    #[inline(always)]
    pub(super) fn add(&mut self, simd: S, ray: &Ray) {
        let ([x, y, z], [u, v, w]) = (ray.origin, ray.direction);
        let row = f32x8::simd_from(simd, [x, y, z, u, v, w, ray.t_min, ray.t_max]);
        self.lowest = row.min(self.lowest);
        self.highest = row.max(self.highest);
        self.sum += row;
    }

    /// The sum of all directions.
    #[inline(always)]
    pub(super) fn direction(&self) -> [f32; 3] {
        let [_, _, _, x, y, z, ..]: [f32; 8] = self.sum.into();
        [x, y, z]
    }

    /// The ranges; far from [narrow](Intervals::are_narrow) if any ray has a part that is not a number.
    #[inline(always)]
    pub(super) fn intervals(&self) -> Intervals {
        // Minimum and maximum need not know of what is not a number, sums do.
        if self.sum.simd_eq(self.sum).to_bitmask() & 0x7f != 0x7f {
            return Intervals {
                directions: Aabb::EVERYTHING,
                ..Intervals::NONE
            };
        }
        let ([a, b, c, d, e, f, t_min, _], [g, h, i, j, k, l, ..]): ([f32; 8], [f32; 8]) =
            (self.lowest.into(), self.highest.into());
        let aabb = |min, max| Aabb { min, max };
        Intervals {
            origins: aabb([a, b, c], [g, h, i]),
            directions: aabb([d, e, f], [j, k, l]),
            t_min,
        }
    }
}
