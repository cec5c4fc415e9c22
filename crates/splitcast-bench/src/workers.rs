//! The threads that all systems share.

use rayon::prelude::*;

use crate::rays::{LANES, RaySet};
use crate::system::{HitChunk, RayChunk, Tracer};

/// Rays that a thread takes at a time: a tile of a picture.
const CHUNK_RAYS: usize = 4096;
const CHUNK_BLOCKS: usize = CHUNK_RAYS / LANES;

/// A pool of so many threads. A single one stays on one processor, where the system
/// allows it. Several are left to the operating system: libraries with threads of their own
/// would inherit the place of the thread that starts them, and share one processor.
///
/// # Errors
/// If the threads cannot be started.
pub fn pool(threads: usize) -> Result<rayon::ThreadPool, rayon::ThreadPoolBuildError> {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads);
    pool.start_handler(move |_| {
        if threads == 1
            // The first processor is the one that is most often interrupted.
            && let Some(last) = core_affinity::get_core_ids().and_then(|ids| ids.last().copied())
        {
            core_affinity::set_for_current(last);
        }
    })
    .build()
}

/// What tracing a set of rays gave.
#[derive(Debug, Default)]
pub(crate) struct TraceOutput {
    /// Distances; infinite where nothing was hit. Of use after closest hits.
    pub(crate) t: Vec<f32>,
    /// Triangles. Of use after closest hits.
    pub(crate) triangle: Vec<u32>,
    /// Of use after occlusion.
    pub(crate) occluded: Vec<bool>,
}

impl TraceOutput {
    /// Makes room for a set's results and overwrites what is there, so that
    /// nothing of another system's results can be taken for this one's.
    pub(crate) fn clear(&mut self, set: &RaySet) {
        let lanes = set.blocks.len() * LANES;
        self.t.clear();
        self.t.resize(lanes, f32::NAN);
        self.triangle.clear();
        self.triangle.resize(lanes, u32::MAX);
        self.occluded.clear();
        self.occluded.resize(lanes, false);
    }
}

/// Traces a whole set on the current pool. Room for the results has to be there.
pub(crate) fn trace(tracer: &dyn Tracer, mode: usize, set: &RaySet, output: &mut TraceOutput) {
    let chunks = |index: usize| {
        let first = index * CHUNK_RAYS;
        let last = set.rays.len().min(first + CHUNK_RAYS);
        let blocks = set.blocks.len().min((index + 1) * CHUNK_BLOCKS);
        RayChunk {
            rays: &set.rays[first..last],
            blocks: &set.blocks[index * CHUNK_BLOCKS..blocks],
        }
    };
    if set.kind.is_occlusion() {
        let work = |(index, occluded): (usize, &mut [bool])| {
            tracer.occluded(mode, chunks(index), occluded);
        };
        let places = &mut output.occluded;
        match rayon::current_num_threads() {
            1 => places.chunks_mut(CHUNK_RAYS).enumerate().for_each(work),
            _ => (places
                .par_chunks_mut(CHUNK_RAYS)
                .enumerate()
                .with_max_len(1))
            .for_each(work),
        }
    } else {
        let work = |(index, (t, triangle)): (usize, (&mut [f32], &mut [u32]))| {
            tracer.closest_hits(mode, chunks(index), HitChunk { t, triangle });
        };
        let (t, triangle) = (&mut output.t, &mut output.triangle);
        match rayon::current_num_threads() {
            1 => (t
                .chunks_mut(CHUNK_RAYS)
                .zip(triangle.chunks_mut(CHUNK_RAYS)))
            .enumerate()
            .for_each(work),
            _ => (t
                .par_chunks_mut(CHUNK_RAYS)
                .zip(triangle.par_chunks_mut(CHUNK_RAYS)))
            .enumerate()
            .with_max_len(1)
            .for_each(work),
        }
    }
}
