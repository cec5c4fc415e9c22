//! Triangles on both sides of a plane: which they are, and what box is left
//! of each on either side.
//!
//! Boxes of whole triangles reach into cells that the triangles miss. Cutting
//! the boxes at every plane costs builders that sort boxes a third of their
//! time, and saves as large a share of a tree's references (Wald & Havran 2006 call
//! them perfect splits).

use fearless_simd::f32x8;
use fearless_simd::prelude::*;

use super::Reference;
use crate::Mesh;
use crate::aabb::{lower, upper};

/// Straddlers divided at once: one 256-bit register of single-precision values.
pub(super) const LANES: usize = 8;

/// Rounding of a point computed on an edge, relative to the largest coordinate
/// M of the triangle. In half units of 2⁻²³ of M: the difference of the ends, at
/// most 2M, is off by 2, its product with the weight by 2 more and by 4 for the
/// weight's own error, the sum by 1: 9. Six whole units leave room.
const EDGE_ROUNDING: f32 = 6.0 * f32::EPSILON;

/// A value for each straddler.
pub(super) type Lanes = [f32; LANES];

/// Corners of triangles, by corner and axis.
pub(super) type Corners<S> = [[f32x8<S>; 3]; 3];

/// How many members of a node a plane sent where.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct SortedCounts {
    pub(super) left: usize,
    pub(super) right: usize,
    pub(super) straddling: usize,
}

/// Sorts a node's members by a plane: those on its right to the front of
/// `own`, where the members are, those on its left to `behind`, and those on
/// both sides to `straddlers`, all in order. A member that lies in the plane
/// counts as left.
///
/// Without branches: a member is stored to all three, and only the end of the
/// one it belongs to moves on. Neither it nor the other two overtake the
/// reading, so nothing that counts is overwritten. All three slices have the
/// same length.
#[inline(always)]
pub(super) fn sort_by_side<T: Copy>(
    own: &mut [T],
    behind: &mut [T],
    straddlers: &mut [T],
    extent: impl Fn(&T) -> (f32, f32),
    position: f32,
) -> SortedCounts {
    let (mut ending_right, mut straddling) = (0, 0);
    for read in 0..own.len() {
        let (min, max) = extent(&own[read]);
        let ends_right = usize::from(max > position);
        let begins_left = usize::from(min < position);
        behind[read - ending_right] = own[read];
        straddlers[straddling] = own[read];
        own[ending_right - straddling] = own[read];
        ending_right += ends_right;
        straddling += ends_right & begins_left;
    }
    SortedCounts {
        left: own.len() - ending_right,
        right: ending_right - straddling,
        straddling,
    }
}

/// [`sort_by_side`] for members that go to both sides as they are if they
/// straddle the plane. Gives the numbers on the left and on the right.
#[inline(always)]
pub(super) fn sort_to_both_sides<T: Copy>(
    own: &mut [T],
    behind: &mut [T],
    extent: impl Fn(&T) -> (f32, f32),
    position: f32,
) -> (usize, usize) {
    let (mut left, mut right) = (0, 0);
    for read in 0..own.len() {
        let (min, max) = extent(&own[read]);
        let ends_right = max > position;
        behind[left] = own[read];
        own[right] = own[read];
        left += usize::from((min < position) | !ends_right);
        right += usize::from(ends_right);
    }
    (left, right)
}

/// Divides references that straddle a plane: calls `emit` for each, in order,
/// with what lies to the left and to the right of the plane.
///
/// Boxes only ever shrink, and are rounded outwards. One that comes out empty
/// (see [`Reference::is_empty`]) tells that the part of the triangle left by
/// earlier cuts does not reach that side.
#[inline(always)]
pub(super) fn divide<S: Simd>(
    simd: S,
    straddlers: &[Reference],
    mesh: Mesh<'_>,
    axis: usize,
    position: f32,
    mut emit: impl FnMut(Reference, Reference),
) {
    for chunk in straddlers.chunks(LANES) {
        // By corner, axis and lane; unused lanes hold a point, which does no harm.
        let mut corners = [[[0.0; LANES]; 3]; 3];
        for (lane, straddler) in chunk.iter().enumerate() {
            let [a, b, c] = mesh.corners(straddler.triangle);
            for coordinate in 0..3 {
                corners[0][coordinate][lane] = a[coordinate];
                corners[1][coordinate][lane] = b[coordinate];
                corners[2][coordinate][lane] = c[coordinate];
            }
        }
        let corners = load_corners(simd, &corners);
        let cut = Cut::new(&corners, axis, position);
        let zero = [[0.0; LANES]; 3];
        let (mut left_min, mut left_max) = (zero, zero);
        let (mut right_min, mut right_max) = (zero, zero);
        for k in 0..3 {
            let parts = cut.parts(&corners, k);
            left_min[k] = parts.left_min.into();
            left_max[k] = parts.left_max.into();
            right_min[k] = parts.right_min.into();
            right_max[k] = parts.right_max.into();
        }
        for (lane, straddler) in chunk.iter().enumerate() {
            let (mut left, mut right) = (*straddler, *straddler);
            for k in 0..3 {
                left.min[k] = upper(left.min[k], left_min[k][lane]);
                left.max[k] = lower(left.max[k], left_max[k][lane]);
                right.min[k] = upper(right.min[k], right_min[k][lane]);
                right.max[k] = lower(right.max[k], right_max[k][lane]);
            }
            left.max[axis] = position;
            right.min[axis] = position;
            emit(left, right);
        }
    }
}

/// Loads corners. Spelled out: the closures of `array::map` are compiled without the kernel's
/// instruction set.
#[inline(always)]
pub(super) fn load_corners<S: Simd>(simd: S, [a, b, c]: &[[Lanes; 3]; 3]) -> Corners<S> {
    let load = |lanes: &Lanes| f32x8::simd_from(simd, *lanes);
    [
        [load(&a[0]), load(&a[1]), load(&a[2])],
        [load(&b[0]), load(&b[1]), load(&b[2])],
        [load(&c[0]), load(&c[1]), load(&c[2])],
    ]
}

/// How a plane cuts triangles. Whether a point counts is expressed by what is
/// added to it: 0, or an infinity that takes it out of the running.
pub(super) struct Cut<S: Simd> {
    /// For each corner: 0 if it lies to the left of the plane or in it.
    off_left: [f32x8<S>; 3],
    /// For each corner: 0 if it lies to the right of the plane or in it.
    off_right: [f32x8<S>; 3],
    /// For each edge, from a corner to the next: 0 if the plane crosses it.
    off_edge: [f32x8<S>; 3],
    /// For each edge: how far along it the plane crosses.
    weight: [f32x8<S>; 3],
}

/// The extent on one axis of what lies on each side, rounded outwards.
pub(super) struct Parts<S: Simd> {
    pub(super) left_min: f32x8<S>,
    pub(super) left_max: f32x8<S>,
    pub(super) right_min: f32x8<S>,
    pub(super) right_max: f32x8<S>,
}

impl<S: Simd> Cut<S> {
    /// Cuts triangles by a plane.
    #[inline(always)]
    pub(super) fn new(corners: &Corners<S>, axis: usize, position: f32) -> Self {
        let [a, b, c] = corners;
        let (a, b, c) = (a[axis] - position, b[axis] - position, c[axis] - position);
        let zero = f32x8::splat(a.token(), 0.0);
        let infinity = f32x8::splat(a.token(), f32::INFINITY);
        let below = [a.simd_lt(0.0), b.simd_lt(0.0), c.simd_lt(0.0)];
        let off_left = |corner: f32x8<S>| corner.simd_le(0.0).select(zero, infinity);
        let off_right = |corner: f32x8<S>| corner.simd_ge(0.0).select(zero, infinity);
        let crosses = [
            below[0] ^ below[1],
            below[1] ^ below[2],
            below[2] ^ below[0],
        ];
        // Edges that are not crossed might divide by zero; they weigh nothing.
        let weight = |edge: usize, from: f32x8<S>, to: f32x8<S>| {
            crosses[edge].select(from / (from - to), zero)
        };
        Self {
            off_left: [off_left(a), off_left(b), off_left(c)],
            off_right: [off_right(a), off_right(b), off_right(c)],
            off_edge: [
                crosses[0].select(zero, infinity),
                crosses[1].select(zero, infinity),
                crosses[2].select(zero, infinity),
            ],
            weight: [weight(0, a, b), weight(1, b, c), weight(2, c, a)],
        }
    }

    /// The parts' extents on one axis.
    #[inline(always)]
    pub(super) fn parts(&self, corners: &Corners<S>, axis: usize) -> Parts<S> {
        let (a, b, c) = (corners[0][axis], corners[1][axis], corners[2][axis]);
        let on_edge =
            |edge: usize, from: f32x8<S>, to: f32x8<S>| from + self.weight[edge] * (to - from);
        let edges = [on_edge(0, a, b), on_edge(1, b, c), on_edge(2, c, a)];
        let corners = [a, b, c];
        let min = |points: &[f32x8<S>; 3], off: &[f32x8<S>; 3]| {
            (points[0] + off[0])
                .min(points[1] + off[1])
                .min(points[2] + off[2])
        };
        let max = |points: &[f32x8<S>; 3], off: &[f32x8<S>; 3]| {
            (points[0] - off[0])
                .max(points[1] - off[1])
                .max(points[2] - off[2])
        };
        let (edge_min, edge_max) = (min(&edges, &self.off_edge), max(&edges, &self.off_edge));
        let rounding = a.abs().max(b.abs()).max(c.abs()) * EDGE_ROUNDING + f32::MIN_POSITIVE;
        Parts {
            left_min: min(&corners, &self.off_left).min(edge_min) - rounding,
            left_max: max(&corners, &self.off_left).max(edge_max) + rounding,
            right_min: min(&corners, &self.off_right).min(edge_min) - rounding,
            right_max: max(&corners, &self.off_right).max(edge_max) + rounding,
        }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::build::clip::clipped_bounds;
    use crate::simd::{Kernel, dispatch};

    struct Divide<'a, 'm>(&'a [Reference], Mesh<'m>, usize, f32);

    impl Kernel for Divide<'_, '_> {
        type Output = Vec<(Reference, Reference)>;

        #[inline(always)]
        fn run<S: Simd>(self, simd: S) -> Self::Output {
            let mut parts = Vec::new();
            let Self(straddlers, mesh, axis, position) = self;
            divide(simd, straddlers, mesh, axis, position, |left, right| {
                parts.push((left, right));
            });
            parts
        }
    }

    fn coordinate() -> impl Strategy<Value = f32> {
        prop_oneof![(-8..=8).prop_map(|x| x as f32 / 8.0), -1.0_f32..1.0]
    }

    fn corners() -> impl Strategy<Value = [[f32; 3]; 3]> {
        prop::array::uniform3(prop::array::uniform3(coordinate()))
    }

    fn holds(outer: &Reference, inner: &crate::Aabb) -> bool {
        (0..3).all(|k| outer.min[k] <= inner.min[k] && outer.max[k] >= inner.max[k])
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(500))]

        /// A sequence of planes, against clipping to the cell they leave.
        #[test]
        fn parts_hold_the_triangle_and_shrink(
            triangles in prop::collection::vec(corners(), 1..20),
            planes in prop::collection::vec((0_usize..3, coordinate(), any::<bool>()), 1..6),
            offset in prop_oneof![Just(0.0_f32), Just(1000.0)],
        ) {
            let positions: Vec<[f32; 3]> = triangles.iter().flatten().map(|p| p.map(|x| x + offset)).collect();
            let indices: Vec<[u32; 3]> = (0..triangles.len() as u32).map(|t| [3 * t, 3 * t + 1, 3 * t + 2]).collect();
            let mesh = Mesh::new(&positions, &indices).unwrap();
            let mut cell = crate::Aabb { min: [-2.0 + offset; 3], max: [2.0 + offset; 3] };
            let mut references: Vec<Reference> = (0..triangles.len() as u32)
                .map(|t| Reference::of_triangle(mesh.corners(t), t))
                .collect();
            for (axis, position, keep_left) in planes {
                let position = position + offset;
                if position <= cell.min[axis] || position >= cell.max[axis] {
                    continue;
                }
                let (left_cell, right_cell) = cell.split(axis, position);
                cell = if keep_left { left_cell } else { right_cell };
                let (mut behind, mut straddlers) = (references.clone(), references.clone());
                let mut own = references.clone();
                let sorted = sort_by_side(&mut own, &mut behind, &mut straddlers, |r| (r.min[axis], r.max[axis]), position);
                prop_assert_eq!(sorted.left + sorted.right + sorted.straddling, references.len());
                let parts = dispatch(Divide(&straddlers[..sorted.straddling], mesh, axis, position));
                let mut next = if keep_left { behind[..sorted.left].to_vec() } else { own[..sorted.right].to_vec() };
                for (whole, (left, right)) in straddlers.iter().zip(parts) {
                    for part in [left, right] {
                        prop_assert!(part.is_empty() || holds(whole, &part.bounds()));
                    }
                    let part = if keep_left { left } else { right };
                    if !part.is_empty() {
                        next.push(part);
                    }
                }
                references = next;
                for triangle in 0..triangles.len() as u32 {
                    // In double precision and a hair smaller than the cell, so that touching does not count.
                    let inner = crate::Aabb {
                        min: cell.min.map(|x| x + 1e-6 + offset * 1e-6),
                        max: cell.max.map(|x| x - 1e-6 - offset * 1e-6),
                    };
                    if inner.is_empty() {
                        continue;
                    }
                    if let Some(exact) = clipped_bounds(&mesh.corners(triangle), &inner) {
                        let found = references.iter().find(|r| r.triangle == triangle);
                        prop_assert!(found.is_some_and(|r| holds(r, &exact)), "{triangle} {exact:?} {found:?}");
                    }
                }
            }
        }

        #[test]
        fn sorting_keeps_the_order(extents in prop::collection::vec((coordinate(), coordinate()), 0..100), position in coordinate()) {
            let members: Vec<(f32, f32)> = extents.iter().map(|&(a, b)| (a.min(b), a.max(b))).collect();
            let (mut own, mut behind, mut straddlers) = (members.clone(), members.clone(), members.clone());
            let sorted = sort_by_side(&mut own, &mut behind, &mut straddlers, |&member| member, position);
            let of = |filter: &dyn Fn(f32, f32) -> bool| -> Vec<(f32, f32)> {
                members.iter().copied().filter(|&(a, b)| filter(a, b)).collect()
            };
            prop_assert_eq!(&behind[..sorted.left], of(&|_, max| max <= position));
            prop_assert_eq!(&own[..sorted.right], of(&|min, max| max > position && min >= position));
            prop_assert_eq!(&straddlers[..sorted.straddling], of(&|min, max| max > position && min < position));
        }
    }
}
