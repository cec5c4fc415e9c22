//! Slices of rays, on all threads.

use fearless_simd::Simd;
use rayon::prelude::*;

use super::Alone;
use super::nearest::{AnyHits, ClosestHits};
use super::packet::{GROUP, PACKET, Packet};
use super::stream::Streams;
use crate::simd::{Kernel, dispatch};
use crate::{Hit, KdTree, Ray};

/// Rays of a task: some hundreds of microseconds, and enough for streams.
const TASK: usize = 64 * PACKET;

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
        let mut packet = Packet::new(tree);
        let mut streams = None;
        for (start, packed) in (0..).step_by(PACKET).zip(rays.chunks(PACKET)) {
            let traced = packet.trace::<S, ClosestHits>(simd, tree, packed);
            for (index, group) in packed.chunks(GROUP).enumerate() {
                let start = start + index * GROUP;
                let places = start..start + group.len();
                if traced >> index & 1 != 0 {
                    packet.complete(simd, index, &mut hits[places]);
                    continue;
                }
                let streams = streams.get_or_insert_with(|| Streams::new(tree, rays));
                for place in places {
                    if !streams.add::<S, ClosestHits>(simd, place, hits) {
                        let ray = &rays[place];
                        let nearest = Alone::<ClosestHits>::new(tree, ray).run(simd).0;
                        hits[place] = nearest.into_hit(&tree.wide().blocks, ray);
                    }
                }
            }
        }
        if let Some(streams) = &mut streams {
            streams.finish::<S, ClosestHits>(simd, hits);
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
        let mut packet = Packet::new(tree);
        let mut streams = None;
        for (start, packed) in (0..).step_by(PACKET).zip(rays.chunks(PACKET)) {
            let traced = packet.trace::<S, AnyHits>(simd, tree, packed);
            for (index, group) in packed.chunks(GROUP).enumerate() {
                let start = index * GROUP + start;
                for place in start..start + group.len() {
                    if traced >> index & 1 != 0 {
                        occluded[place] = packet.is_hit(place % PACKET);
                        continue;
                    }
                    let streams = streams.get_or_insert_with(|| Streams::new(tree, rays));
                    if !streams.add::<S, AnyHits>(simd, place, occluded) {
                        let nearest = Alone::<AnyHits>::new(tree, &rays[place]).run(simd).0;
                        occluded[place] = nearest.is_hit();
                    }
                }
            }
        }
        if let Some(streams) = &mut streams {
            streams.finish::<S, AnyHits>(simd, occluded);
        }
    }
}
