//! The surface area heuristic (MacDonald & Booth 1990; Hussain & Grahn, eq. 2 to 5).
//!
//! The chance that a ray which enters a node also enters a part of it is the
//! ratio of their surface areas, so the expected cost of splitting a node is
//!
//! ```text
//! C = C_traversal + P_left · C_leaf(N_left) + P_right · C_leaf(N_right)
//! ```
//!
//! This file holds the only copy of that formula.

use std::ops::{Add, Mul};

use fearless_simd::f32x8;
use fearless_simd::prelude::*;

use crate::OptionsError;

/// What the steps of a ray through the tree cost, relative to each other.
///
/// The default is what [`Preset::Balanced`](crate::Preset::Balanced) uses.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CostModel {
    /// Cost of one inner node: read it, find the plane, choose a side.
    /// Above 0. Only ratios matter, so it is 1 in every preset.
    pub traversal: f32,
    /// Cost of testing one block of `leaf_width` triangles. Above 0. Higher
    /// values give deeper trees with smaller leaves, and slower builds.
    pub intersection: f32,
    /// Triangles that a leaf tests at once, a power of two from 1 to 64; a leaf of `n`
    /// costs as much as one with `n` rounded up to whole blocks. 1 gives the textbook cost.
    pub leaf_width: u32,
    /// Share of the cost forgiven to a split that cuts off empty space, from 0
    /// up to but not including 1 (0.2 in Wald & Havran 2006). Higher values
    /// cut more empty space away, at the price of depth.
    pub empty_bonus: f32,
}

impl Default for CostModel {
    fn default() -> Self {
        Self {
            traversal: 1.0,
            intersection: 0.1,
            leaf_width: 8,
            empty_bonus: 0.0,
        }
    }
}

impl CostModel {
    /// Checks every field against its bounds.
    ///
    /// # Errors
    /// [`OptionsError`] names the first field that is out of bounds.
    pub fn validate(&self) -> Result<(), OptionsError> {
        let positive = |field, value: f32| {
            if value.is_finite() && value > 0.0 {
                Ok(())
            } else {
                Err(OptionsError::NotPositive { field, value })
            }
        };
        positive("cost.traversal", self.traversal)?;
        positive("cost.intersection", self.intersection)?;
        if !self.leaf_width.is_power_of_two() || self.leaf_width > 64 {
            return Err(OptionsError::LeafWidth {
                value: self.leaf_width,
            });
        }
        if !(0.0..1.0).contains(&self.empty_bonus) {
            return Err(OptionsError::EmptyBonus {
                value: self.empty_bonus,
            });
        }
        Ok(())
    }

    /// Expected cost of a leaf of `count` triangles, given that a ray enters it.
    #[inline(always)]
    pub fn leaf(&self, count: u32) -> f32 {
        self.intersection * self.blocks(count) as f32
    }

    /// Expected cost of a split, given that a ray enters the node. `left` and
    /// `right` are each side's share of the node's surface area (0 to 1) and
    /// number of triangles.
    #[inline(always)]
    pub fn split(&self, left: (f32, u32), right: (f32, u32)) -> f32 {
        let cost = expected_cost(
            self.traversal,
            (left.0, self.leaf(left.1)),
            (right.0, self.leaf(right.1)),
        );
        let empty = left.1 == 0 || right.1 == 0;
        cost * if empty { 1.0 - self.empty_bonus } else { 1.0 }
    }

    /// [`CostModel::split`] for eight candidates at once, with the same results.
    /// Counts are whole numbers.
    #[inline(always)]
    pub(crate) fn split_lanes<S: Simd>(
        &self,
        left: (f32x8<S>, f32x8<S>),
        right: (f32x8<S>, f32x8<S>),
    ) -> f32x8<S> {
        let simd = left.0.token();
        let width = self.leaf_width as f32;
        // Exact: the width is a power of two.
        let inverse_width = width.recip();
        let leaf =
            |count: f32x8<S>| ((count + (width - 1.0)) * inverse_width).floor() * self.intersection;
        let cost = expected_cost(
            f32x8::splat(simd, self.traversal),
            (left.0, leaf(left.1)),
            (right.0, leaf(right.1)),
        );
        let empty = left.1.simd_eq(0.0) | right.1.simd_eq(0.0);
        empty.select(cost * (1.0 - self.empty_bonus), cost)
    }

    /// Number of blocks that a leaf of `count` triangles takes.
    fn blocks(&self, count: u32) -> u32 {
        count.div_ceil(self.leaf_width)
    }
}

/// The surface area heuristic, for one candidate or for lanes of them: cost of
/// the step, and each side's share of area and cost as a leaf.
#[inline(always)]
fn expected_cost<F: Add<Output = F> + Mul<Output = F>>(
    traversal: F,
    left: (F, F),
    right: (F, F),
) -> F {
    traversal + (left.0 * left.1 + right.0 * right.1)
}
