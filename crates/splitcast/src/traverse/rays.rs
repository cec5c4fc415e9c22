//! Slices of rays, on all threads.

use std::marker::PhantomData;

use fearless_simd::Simd;
use rayon::prelude::*;

use super::Alone;
use super::nearest::{AnyHits, ClosestHits, Nearest};
use super::packet::{GROUP, PACKET, Packet};
use super::stream::{StreamQuery, Streams};
use crate::simd::{Kernel, dispatch};
use crate::{Hit, KdTree, Ray};

/// Rays of a task: some hundreds of microseconds, and enough for streams.
const TASK: usize = 64 * PACKET;

/// Rays of a slice that streams are worth their memory for.
const STREAMED: usize = 64;

impl KdTree<'_> {
    /// The nearest hit of each ray, as [`KdTree::closest_hit`] finds it, in `hits`; on the current rayon
    /// thread pool. Faster than ray by ray, best with some thousands of rays: neighbors in the slice that take much the
    /// same way, such as those of a square of pixels, are traced as one, and others together with
    /// whatever rays of the slice go into the same direction.
    ///
    /// # Panics
    /// If `hits` is not as long as `rays`.
    pub fn closest_hits(&self, rays: &[Ray], hits: &mut [Option<Hit>]) {
        assert_eq!(rays.len(), hits.len(), "one hit for each ray");
        trace::<ClosestHits>(self, rays, hits);
    }

    /// Whether each ray hits anything, as [`KdTree::occluded`] tells, in `occluded`; otherwise like
    /// [`KdTree::closest_hits`].
    ///
    /// # Panics
    /// If `occluded` is not as long as `rays`.
    pub fn occluded_rays(&self, rays: &[Ray], occluded: &mut [bool]) {
        assert_eq!(rays.len(), occluded.len(), "one answer for each ray");
        trace::<AnyHits>(self, rays, occluded);
    }
}

/// Traces a slice, on all threads if it is long.
fn trace<Q: SliceQuery>(tree: &KdTree<'_>, rays: &[Ray], answers: &mut [Q::Answer]) {
    let task = |rays, answers| {
        dispatch(Slice::<Q> {
            tree,
            rays,
            answers,
            query: PhantomData,
        });
    };
    if rays.len() <= TASK {
        return task(rays, answers);
    }
    (rays.par_chunks(TASK).zip(answers.par_chunks_mut(TASK)))
        .for_each(|(rays, answers)| task(rays, answers));
}

/// What slices of rays are asked.
trait SliceQuery: StreamQuery<Answer: Send> {
    /// Puts down answers for a group of a packet.
    fn of_group<S: Simd>(simd: S, packet: &Packet<'_>, group: usize, answers: &mut [Self::Answer]);

    /// The answer for a ray.
    fn of_ray(tree: &KdTree<'_>, ray: &Ray, nearest: Nearest) -> Self::Answer;
}

impl SliceQuery for ClosestHits {
    #[inline(always)]
    fn of_group<S: Simd>(simd: S, packet: &Packet<'_>, group: usize, hits: &mut [Option<Hit>]) {
        packet.complete(simd, group, hits);
    }

    #[inline(always)]
    fn of_ray(tree: &KdTree<'_>, ray: &Ray, nearest: Nearest) -> Option<Hit> {
        nearest.into_hit(&tree.wide().blocks, ray)
    }
}

impl SliceQuery for AnyHits {
    #[inline(always)]
    fn of_group<S: Simd>(_: S, packet: &Packet<'_>, group: usize, occluded: &mut [bool]) {
        for (lane, occluded) in occluded.iter_mut().enumerate() {
            *occluded = packet.is_hit(group * GROUP + lane);
        }
    }

    #[inline(always)]
    fn of_ray(_: &KdTree<'_>, _: &Ray, nearest: Nearest) -> bool {
        nearest.is_hit()
    }
}

/// The arguments of [`trace`].
struct Slice<'q, 'm, Q: SliceQuery> {
    tree: &'q KdTree<'m>,
    rays: &'q [Ray],
    answers: &'q mut [Q::Answer],
    query: PhantomData<Q>,
}

impl<Q: SliceQuery> Kernel for Slice<'_, '_, Q> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self, simd: S) {
        let Self {
            tree,
            rays,
            answers,
            ..
        } = self;
        let mut packet = Packet::new(tree);
        let mut streams: Option<Streams<'_, '_>> = None;
        let mut start = 0;
        loop {
            let packed = &rays[start..rays.len().min(start + PACKET)];
            let traced = packet.trace::<S, Q>(simd, tree, packed);
            for (index, group) in packed.chunks(GROUP).enumerate() {
                let start = start + index * GROUP;
                let places = start..start + group.len();
                if traced >> index & 1 != 0 {
                    Q::of_group(simd, &packet, index, &mut answers[places]);
                    continue;
                }
                for place in places {
                    let ray = &rays[place];
                    if rays.len() >= STREAMED {
                        let streams = streams.get_or_insert_with(|| Streams::new(tree, rays));
                        if streams.add(place) {
                            continue;
                        }
                    }
                    // Rare, and not worth a copy of the whole descent here.
                    let nearest = dispatch(Alone::<Q>::new(tree, ray)).0;
                    answers[place] = Q::of_ray(tree, ray, nearest);
                }
            }
            start += packed.len();
            let is_last = start == rays.len();
            if let Some(streams) = &mut streams {
                streams.trace::<Q>(is_last, answers);
            }
            if is_last {
                return;
            }
        }
    }
}
