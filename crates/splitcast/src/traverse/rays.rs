//! Slices of rays, on all threads.

use fearless_simd::Simd;
use rayon::prelude::*;

use super::packet::{AnyHits, ClosestHits, GROUP, PACKET, Packet};
use super::{Any, Closest, Trace};
use crate::simd::{Kernel, dispatch};
use crate::{Hit, KdTree, Ray};

/// Rays of a task: some tens of microseconds.
const TASK: usize = 16 * PACKET;

impl KdTree<'_> {
    /// The nearest hit of each ray, as [`KdTree::closest_hit`] finds it, in `hits`; on the current rayon
    /// thread pool. Faster than ray by ray: neighbors in the slice that take much the same way, such
    /// as those of a square of pixels, are traced as one, best if 64 follow each other.
    ///
    /// # Panics
    /// If `hits` is not as long as `rays`.
    pub fn closest_hits(&self, rays: &[Ray], hits: &mut [Option<Hit>]) {
        assert_eq!(rays.len(), hits.len(), "one hit for each ray");
        let trace = |rays, hits| {
            dispatch(ClosestOfAll {
                tree: self,
                rays,
                hits,
            });
        };
        if rays.len() <= TASK {
            return trace(rays, hits);
        }
        (rays.par_chunks(TASK).zip(hits.par_chunks_mut(TASK)))
            .for_each(|(rays, hits)| trace(rays, hits));
    }

    /// Whether each ray hits anything, as [`KdTree::occluded`] tells, in `occluded`; otherwise like
    /// [`KdTree::closest_hits`].
    ///
    /// # Panics
    /// If `occluded` is not as long as `rays`.
    pub fn occluded_rays(&self, rays: &[Ray], occluded: &mut [bool]) {
        assert_eq!(rays.len(), occluded.len(), "one answer for each ray");
        let trace = |rays, occluded| {
            dispatch(AnyOfAll {
                tree: self,
                rays,
                occluded,
            });
        };
        if rays.len() <= TASK {
            return trace(rays, occluded);
        }
        (rays.par_chunks(TASK).zip(occluded.par_chunks_mut(TASK)))
            .for_each(|(rays, occluded)| trace(rays, occluded));
    }
}

/// The arguments of [`KdTree::closest_hits`].
struct ClosestOfAll<'q, 'm> {
    tree: &'q KdTree<'m>,
    rays: &'q [Ray],
    hits: &'q mut [Option<Hit>],
}

impl Kernel for ClosestOfAll<'_, '_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self, simd: S) {
        let Self { tree, rays, hits } = self;
        let mesh = tree.mesh();
        let mut packet = Packet::new(mesh);
        for (rays, hits) in rays.chunks(PACKET).zip(hits.chunks_mut(PACKET)) {
            let traced = packet.trace::<S, ClosestHits>(simd, tree, rays);
            let groups = rays.chunks(GROUP).zip(hits.chunks_mut(GROUP));
            for (index, (rays, hits)) in groups.enumerate() {
                if traced >> index & 1 != 0 {
                    packet.complete(simd, index, hits);
                    continue;
                }
                for (ray, hit) in rays.iter().zip(hits) {
                    let mut closest = Closest::new(ray);
                    let sink = &mut closest;
                    Trace { tree, ray, sink }.trace(simd);
                    *hit = closest.into_hit(mesh);
                }
            }
        }
    }
}

/// The arguments of [`KdTree::occluded_rays`].
struct AnyOfAll<'q, 'm> {
    tree: &'q KdTree<'m>,
    rays: &'q [Ray],
    occluded: &'q mut [bool],
}

impl Kernel for AnyOfAll<'_, '_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self, simd: S) {
        let Self {
            tree,
            rays,
            occluded,
        } = self;
        let mut packet = Packet::new(tree.mesh());
        for (rays, occluded) in rays.chunks(PACKET).zip(occluded.chunks_mut(PACKET)) {
            let traced = packet.trace::<S, AnyHits>(simd, tree, rays);
            for (index, (ray, occluded)) in rays.iter().zip(occluded).enumerate() {
                *occluded = if traced >> (index / GROUP) & 1 != 0 {
                    packet.is_hit(index)
                } else {
                    let mut any = Any::new(ray);
                    let sink = &mut any;
                    Trace { tree, ray, sink }.trace(simd);
                    any.found
                };
            }
        }
    }
}
