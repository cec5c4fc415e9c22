//! The nearest hit of a ray so far, known up to rounding errors: the exact test is left for the end, but
//! where these errors leave open which of two hits is nearer, or whether there is one.

use fearless_simd::f32x8;
use fearless_simd::prelude::*;

use super::complete;
use super::lanes::{ErrorLanes, Passing};
use super::triangle::{Crossing, ShearedRay, unit_normal};
use crate::wide::{Blocks, LANES};
use crate::{Hit, Ray};

/// No place of a triangle.
pub(super) const NONE: u32 = u32::MAX;

/// What is asked about rays.
pub(super) trait Query {
    /// Whether it is enough to know that there is a hit.
    const ANY: bool;
}

/// The nearest hits.
pub(super) struct ClosestHits;

impl Query for ClosestHits {
    const ANY: bool = false;
}

/// Whether there are hits.
pub(super) struct AnyHits;

impl Query for AnyHits {
    const ANY: bool = true;
}

/// What a ray hits.
#[derive(Clone, Copy, Debug)]
#[repr(C)]
pub(super) struct Nearest {
    /// The hit's distance is from `low` to `high`; the ray's `t_max` while there is none. Below all if the
    /// ray looks for nothing (any more).
    pub(super) low: f32,
    pub(super) high: f32,
    /// The triangle's place, or [`NONE`].
    pub(super) place: u32,
}

impl Nearest {
    /// Nothing yet within a range that ends at `t_max`.
    #[inline(always)]
    pub(super) fn before(t_max: f32) -> Self {
        Self {
            low: t_max,
            high: t_max,
            place: NONE,
        }
    }

    /// Whether there is a hit.
    #[inline(always)]
    pub(super) fn is_hit(&self) -> bool {
        self.place != NONE
    }

    /// What the ray hits, to the last bit.
    #[inline(always)]
    pub(super) fn into_hit(self, blocks: &Blocks, ray: &Ray) -> Option<Hit> {
        if !self.is_hit() {
            return None;
        }
        exact_hit(blocks, ray, self.place)
    }

    /// Takes a hit that is nearer than the nearest known.
    #[inline(always)]
    pub(super) fn found<Q: Query>(&mut self, place: u32, low: f32, high: f32) {
        *self = match Q::ANY {
            true => Self {
                place,
                ..Self::before(f32::NEG_INFINITY)
            },
            false => Self { low, high, place },
        };
    }

    /// Takes what the ray hits of the triangles of a block, given the block's index and how the ray passes them.
    #[inline(always)]
    pub(super) fn test_block<S: Simd, Q: Query>(
        &mut self,
        simd: S,
        blocks: &Blocks,
        ray: &Ray,
        index: usize,
        passing: &Passing<S, f32x8<S>>,
        errors: &ErrorLanes<f32x8<S>>,
    ) {
        if passing.missed.all_true() {
            return;
        }
        let distance = passing.distance(simd, errors);
        let t_min = f32x8::splat(simd, ray.t_min);
        let high = f32x8::splat(simd, self.high);
        let possible = distance.possible(t_min, high) & !passing.missed;
        let mut possible = possible.to_bitmask() as u32;
        if possible == 0 {
            return;
        }
        let sure = distance.surely_within(t_min, high).to_bitmask() as u32;
        let (lows, highs): ([f32; LANES], [f32; LANES]) =
            (distance.low.into(), distance.high.into());
        while possible != 0 {
            let lane = possible.trailing_zeros() as usize % LANES;
            possible &= possible - 1;
            let place = (index * LANES + lane) as u32;
            // What was found in another lane may be nearer.
            if sure >> lane & 1 != 0 && (Q::ANY || highs[lane] <= self.low) {
                self.found::<Q>(place, lows[lane], highs[lane]);
                if Q::ANY {
                    return;
                }
            } else {
                self.decide::<Q>(blocks, ray, place);
            }
        }
    }

    /// Takes a hit that may be there, or may be nearer than the nearest known, if it is.
    pub(super) fn decide<Q: Query>(&mut self, blocks: &Blocks, ray: &Ray, place: u32) {
        let number = |place: u32| {
            let (block, lane) = blocks.at(place);
            block.triangles[lane]
        };
        let known = self.is_hit();
        if known && number(self.place) == number(place) {
            return;
        }
        let Some(crossing) = exact(blocks, ray, place) else {
            return;
        };
        if known
            && self.low < self.high
            && let Some(last) = exact(blocks, ray, self.place)
        {
            (self.low, self.high) = (last.t, last.t);
        }
        let first_of_equals = || !known || number(place) < number(self.place);
        if crossing.t < self.high || crossing.t == self.high && first_of_equals() {
            self.found::<Q>(place, crossing.t, crossing.t);
        }
    }
}

/// The ray's hit of the triangle at a place, within the ray's range.
#[inline(always)]
fn exact(blocks: &Blocks, ray: &Ray, place: u32) -> Option<Crossing> {
    let (block, lane) = blocks.at(place);
    let crossing = ShearedRay::new(ray)?.intersect(&block.corners_of(lane))?;
    (crossing.t >= ray.t_min && crossing.t <= ray.t_max).then_some(crossing)
}

/// The same with all that is told of it.
pub(super) fn exact_hit(blocks: &Blocks, ray: &Ray, place: u32) -> Option<Hit> {
    let crossing = exact(blocks, ray, place)?;
    let (block, lane) = blocks.at(place);
    let normal = unit_normal(&block.corners_of(lane));
    Some(complete(crossing, block.triangles[lane], normal))
}
