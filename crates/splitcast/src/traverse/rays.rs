//! Slices of rays, on all threads.

use rayon::prelude::*;

use super::nearest::{AnyHits, ClosestHits};
use super::packet::{GROUP, PACKET, Packet};
use super::stream::{StreamQuery, Streams};
use crate::simd::Vectors;
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
    if rays.len() <= TASK {
        return trace_task::<Q>(tree, rays, answers);
    }
    (rays.par_chunks(TASK).zip(answers.par_chunks_mut(TASK)))
        .for_each(|(rays, answers)| trace_task::<Q>(tree, rays, answers));
}

/// Traces a slice on this thread: packets where rays are alike, streams of the others, and alone who fits
/// into neither, or all without vectors. Each of these is a kernel of its own, since compilers take long for
/// large functions.
fn trace_task<Q: SliceQuery>(tree: &KdTree<'_>, rays: &[Ray], answers: &mut [Q::Answer]) {
    let Some(vectors) = Vectors::chosen() else {
        for (ray, answer) in rays.iter().zip(answers) {
            *answer = Q::alone(tree, ray);
        }
        return;
    };
    let mut packet = Packet::new(vectors, tree);
    let mut streams: Option<Streams<'_, '_>> = None;
    let mut start = 0;
    while start < rays.len() {
        let packed = &rays[start..rays.len().min(start + PACKET)];
        let traced = packet.trace::<Q>(tree, packed);
        for (index, group) in packed.chunks(GROUP).enumerate() {
            let start = start + index * GROUP;
            let places = start..start + group.len();
            if traced >> index & 1 != 0 {
                Q::of_group(&packet, index, &mut answers[places]);
                continue;
            }
            for place in places {
                if rays.len() >= STREAMED {
                    let streams = streams.get_or_insert_with(|| Streams::new(vectors, tree, rays));
                    if streams.add(place) {
                        continue;
                    }
                }
                answers[place] = Q::alone(tree, &rays[place]);
            }
        }
        start += packed.len();
        if let Some(streams) = &mut streams {
            streams.trace::<Q>(start == rays.len(), answers);
        }
    }
}

/// What slices of rays are asked.
trait SliceQuery: StreamQuery<Answer: Send> {
    /// Puts down answers for a group of a packet.
    fn of_group(packet: &Packet<'_>, group: usize, answers: &mut [Self::Answer]);

    /// The answer for a ray that goes alone.
    fn alone(tree: &KdTree<'_>, ray: &Ray) -> Self::Answer;
}

impl SliceQuery for ClosestHits {
    fn of_group(packet: &Packet<'_>, group: usize, hits: &mut [Option<Hit>]) {
        packet.complete(group, hits);
    }

    fn alone(tree: &KdTree<'_>, ray: &Ray) -> Option<Hit> {
        tree.closest_hit(ray)
    }
}

impl SliceQuery for AnyHits {
    fn of_group(packet: &Packet<'_>, group: usize, occluded: &mut [bool]) {
        for (lane, occluded) in occluded.iter_mut().enumerate() {
            *occluded = packet.is_hit(group * GROUP + lane);
        }
    }

    fn alone(tree: &KdTree<'_>, ray: &Ray) -> bool {
        tree.occluded(ray)
    }
}
