//! The surface areas of a cell's parts, for the cost of planes across it.

use fearless_simd::f32x8;
use fearless_simd::prelude::*;

use crate::{Aabb, CostModel};

/// What it takes to tell the sides' shares of a cell's area for any plane.
pub(crate) struct CellAreas<'a> {
    cell: &'a Aabb,
    /// The faces across each axis, as shares of the cell's area.
    faces: [f32; 3],
    /// The circumference along each axis, likewise, per length.
    slopes: [f32; 3],
}

impl<'a> CellAreas<'a> {
    #[inline(always)]
    pub(crate) fn new(cell: &'a Aabb) -> Self {
        let [x, y, z] = cell.extent();
        let inverse_area = cell.half_area().recip();
        Self {
            cell,
            faces: [
                y * z * inverse_area,
                z * x * inverse_area,
                x * y * inverse_area,
            ],
            slopes: [
                (y + z) * inverse_area,
                (z + x) * inverse_area,
                (x + y) * inverse_area,
            ],
        }
    }

    /// What splits at planes of an axis cost; infinity for a plane on the cell's
    /// border, which would leave a side as it is.
    #[inline(always)]
    pub(super) fn split_costs<S: Simd>(
        &self,
        axis: usize,
        cost: &CostModel,
        planes: f32x8<S>,
        left: f32x8<S>,
        right: f32x8<S>,
    ) -> f32x8<S> {
        let (min, max) = (self.cell.min[axis], self.cell.max[axis]);
        let (faces, slope) = (self.faces[axis], self.slopes[axis]);
        let left_share = (planes - min) * slope + faces;
        let right_share = (max - planes) * slope + faces;
        let costs = cost.split_lanes((left_share, left), (right_share, right));
        let divides = planes.simd_gt(min) & planes.simd_lt(max);
        divides.select(costs, f32x8::splat(planes.token(), f32::INFINITY))
    }

    /// What a split at one plane costs, with so many references on each side; infinity for a
    /// plane on the cell's border or outside.
    #[inline(always)]
    pub(crate) fn split_cost(
        &self,
        axis: usize,
        cost: &CostModel,
        position: f32,
        [left, right]: [u32; 2],
    ) -> f32 {
        let (min, max) = (self.cell.min[axis], self.cell.max[axis]);
        let (faces, slope) = (self.faces[axis], self.slopes[axis]);
        if !(position > min && position < max) {
            return f32::INFINITY;
        }
        let left_share = (position - min) * slope + faces;
        let right_share = (max - position) * slope + faces;
        cost.split((left_share, left), (right_share, right))
    }
}
