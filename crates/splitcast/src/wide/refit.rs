//! Bringing blocks and boxes up to date where triangles have moved.

use fearless_simd::prelude::*;
use fearless_simd::{f32x4, f32x8};

use super::leaf::lanes;
use super::{Block, LANES, WideNode};
use crate::Mesh;
use crate::build::Reference;
use crate::simd::{Kernel, dispatch};

/// What the boxes below a node come to: sums of half areas.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Tally {
    /// Of inner nodes.
    pub(crate) inner: f32,
    /// Of leaves.
    pub(crate) leaves: f32,
    /// Of blocks.
    pub(crate) blocks: f32,
}

impl Tally {
    /// Adds another.
    #[inline(always)]
    pub(crate) fn add(&mut self, other: &Self) {
        self.inner += other.inner;
        self.leaves += other.leaves;
        self.blocks += other.blocks;
    }

    /// The areas of leaves over those of their blocks; 0 if these have none.
    pub(crate) fn spread(&self) -> f32 {
        if self.blocks > 0.0 {
            self.leaves / self.blocks
        } else {
            0.0
        }
    }
}

/// Blocks whose triangles' indices are read together: memory answers all of them at once.
const BATCH: usize = 16;

/// Computes blocks, the boxes around them, and half the areas of the boxes of each one's triangles, added
/// up, anew from where their triangles are; `wanted` says which, by their places. Boxes that
/// are empty stay so: such blocks are not in use.
pub(crate) fn refit_blocks(
    mesh: Mesh<'_>,
    blocks: &mut [Block],
    boxes: &mut [Reference],
    areas: &mut [f32],
    wanted: impl Fn(usize) -> bool,
) {
    dispatch(Blocks {
        mesh,
        blocks,
        boxes,
        areas,
        wanted,
    });
}

/// The arguments of [`refit_blocks`].
struct Blocks<'a, F> {
    mesh: Mesh<'a>,
    blocks: &'a mut [Block],
    boxes: &'a mut [Reference],
    areas: &'a mut [f32],
    wanted: F,
}

impl<F: Fn(usize) -> bool> Kernel for Blocks<'_, F> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self, simd: S) {
        let Self {
            mesh,
            blocks,
            boxes,
            areas,
            wanted,
        } = self;
        let mut corners = [[[0; 3]; LANES]; BATCH];
        for first in (0..blocks.len()).step_by(BATCH) {
            let places = first..blocks.len().min(first + BATCH);
            for place in places.clone() {
                if !boxes[place].is_empty() && wanted(place) {
                    let own = &mut corners[place - first];
                    for lane in 0..LANES {
                        own[lane] = mesh.triangles()[blocks[place].triangles[lane] as usize];
                    }
                }
            }
            for place in places {
                if !boxes[place].is_empty() && wanted(place) {
                    let own = &corners[place - first];
                    areas[place] =
                        refit_block(simd, mesh, own, &mut blocks[place], &mut boxes[place]);
                }
            }
        }
    }
}

/// Gives a block and the box around it new places, and finds half the areas of its triangles' boxes, added
/// up. `corners` are the indices of the triangles' vertices.
#[inline(always)]
fn refit_block<S: Simd>(
    simd: S,
    mesh: Mesh<'_>,
    corners: &[[u32; 3]; LANES],
    block: &mut Block,
    own: &mut Reference,
) -> f32 {
    let mut places = [[[0.0; 4]; 3]; LANES];
    let mut min = f32x4::splat(simd, f32::INFINITY);
    let mut max = f32x4::splat(simd, f32::NEG_INFINITY);
    for lane in 0..LANES {
        let [a, b, c] = corners[lane];
        let a = lanes(simd, &mesh.positions()[a as usize]);
        let b = lanes(simd, &mesh.positions()[b as usize]);
        let c = lanes(simd, &mesh.positions()[c as usize]);
        min = min.min(a).min(b.min(c));
        max = max.max(a).max(b.max(c));
        places[lane] = [a.into(), b.into(), c.into()];
    }
    *block = Block::of_corners(simd, &places, block.triangles);
    let ([a, b, c, _], [d, e, f, _]): ([f32; 4], [f32; 4]) = (min.into(), max.into());
    *own = Reference::new([a, b, c], [d, e, f], own.triangle);
    areas_of(simd, block)
}

/// Half the areas of the boxes of each block's triangles, added up.
pub(crate) fn triangle_areas(blocks: &[Block], areas: &mut [f32]) {
    struct Areas<'a>(&'a [Block], &'a mut [f32]);
    impl Kernel for Areas<'_> {
        type Output = ();

        #[inline(always)]
        fn run<S: Simd>(self, simd: S) {
            for (block, area) in self.0.iter().zip(self.1) {
                *area = areas_of(simd, block);
            }
        }
    }
    dispatch(Areas(blocks, areas));
}

/// One of [`triangle_areas`].
#[inline(always)]
fn areas_of<S: Simd>(simd: S, block: &Block) -> f32 {
    let mut extents = [f32x8::splat(simd, 0.0); 3];
    for axis in 0..3 {
        let a = f32x8::simd_from(simd, block.corners[0][axis]);
        let b = f32x8::simd_from(simd, block.corners[1][axis]);
        let c = f32x8::simd_from(simd, block.corners[2][axis]);
        extents[axis] = a.max(b).max(c) - a.min(b).min(c);
    }
    let [x, y, z] = extents;
    let areas: [f32; LANES] = (x * y + (x + y) * z).into();
    let [a, b, c, d, e, f, g, h] = areas;
    ((a + b) + (c + d)) + ((e + f) + (g + h))
}

/// Brings the boxes of leaves with a block a lane up to date with those of the blocks. Gives what each leaf's
/// own are around, and what they come to.
pub(crate) fn refit_leaves(
    leaves: &mut [WideNode],
    boxes: &[Reference],
    contents: &mut [Reference],
    tallies: &mut [Tally],
    wanted: impl Fn(usize) -> bool,
) {
    dispatch(Leaves {
        leaves,
        boxes,
        contents,
        tallies,
        wanted,
    });
}

/// The arguments of [`refit_leaves`].
struct Leaves<'a, F> {
    leaves: &'a mut [WideNode],
    boxes: &'a [Reference],
    contents: &'a mut [Reference],
    tallies: &'a mut [Tally],
    wanted: F,
}

impl<F: Fn(usize) -> bool> Kernel for Leaves<'_, F> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self, simd: S) {
        let Self {
            leaves,
            boxes,
            contents,
            tallies,
            wanted,
        } = self;
        let all = leaves.iter_mut().zip(contents).zip(tallies);
        for (place, ((leaf, content), tally)) in all.enumerate() {
            if !wanted(place) {
                continue;
            }
            let blocks = areas(simd, leaf, content, |leaf, lane| {
                (!leaf.blocks(lane).is_empty()).then(|| &boxes[leaf.first[lane] as usize])
            });
            *tally = Tally {
                inner: 0.0,
                leaves: content.bounds().half_area(),
                blocks,
            };
        }
    }
}

/// Brings the boxes of inner nodes up to date with those of their children, which are leaves, or
/// come behind their parents. `nodes` are all.
pub(crate) fn refit_inner(
    nodes: &mut [WideNode],
    leaf_count: usize,
    contents: &mut [Reference],
    tallies: &mut [Tally],
) {
    dispatch(Inner {
        nodes,
        leaf_count,
        contents,
        tallies,
    });
}

/// The arguments of [`refit_inner`].
struct Inner<'a> {
    nodes: &'a mut [WideNode],
    leaf_count: usize,
    contents: &'a mut [Reference],
    tallies: &'a mut [Tally],
}

impl Kernel for Inner<'_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self, simd: S) {
        let Self {
            nodes,
            leaf_count,
            contents,
            tallies,
        } = self;
        for index in (leaf_count..nodes.len()).rev() {
            let mut sum = Tally::default();
            let (before, behind) = contents.split_at_mut(index);
            let (own, behind) = behind.split_at_mut(1);
            let node = &mut nodes[index];
            areas(simd, node, &mut own[0], |node, lane| {
                // An empty box stays empty: children with nothing in them are left out.
                let child = node.first[lane] as usize;
                (!node.bounds_of(lane).is_empty()).then(|| {
                    sum.add(&tallies[child]);
                    if child < leaf_count {
                        &before[child]
                    } else {
                        &behind[child - index - 1]
                    }
                })
            });
            sum.inner += own[0].bounds().half_area();
            tallies[index] = sum;
        }
    }
}

/// Gives the lanes of a node new boxes, finds the one around all, and adds up half their areas.
#[inline(always)]
fn areas<'b, S: Simd>(
    simd: S,
    node: &mut WideNode,
    content: &mut Reference,
    mut bounds: impl FnMut(&WideNode, usize) -> Option<&'b Reference>,
) -> f32 {
    let mut min = f32x4::splat(simd, f32::INFINITY);
    let mut max = f32x4::splat(simd, f32::NEG_INFINITY);
    let mut sum = 0.0;
    for lane in 0..LANES {
        let Some(own) = bounds(node, lane) else {
            continue;
        };
        let (low, high) = own.lanes();
        min = min.min(f32x4::simd_from(simd, low));
        max = max.max(f32x4::simd_from(simd, high));
        let own = own.bounds();
        node.set_bounds(lane, &own);
        sum += own.half_area();
    }
    let ([a, b, c, _], [d, e, f, _]): ([f32; 4], [f32; 4]) = (min.into(), max.into());
    *content = Reference::new([a, b, c], [d, e, f], content.triangle);
    sum
}
