//! What has changed in a mesh since the last frame, found by hashes of short runs of
//! vertices and of triangles.
//!
//! A mesh is read once, in order, which costs about a percent of a build; keeping the
//! old positions would cost more memory than the tree.

use std::hash::{BuildHasher, Hasher};
use std::ops::Range;

use foldhash::quality::FixedState;
use rayon::prelude::*;

use crate::Mesh;

/// Vertices with one hash: what moves is told apart from its neighbors in the array by runs
/// of this length.
const VERTICES: usize = 32;

/// Triangles with one hash. Their indices hardly ever change.
const TRIANGLES: usize = 256;

/// Triangles that a thread looks at in one go.
const CHUNK: usize = 4096;

/// Hashes of a mesh.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct MeshHashes {
    vertices: Vec<u64>,
    triangles: Vec<u64>,
}

impl MeshHashes {
    pub(super) fn of(mesh: Mesh<'_>) -> Self {
        let vertices = mesh.positions().par_chunks(VERTICES).with_min_len(64);
        let triangles = mesh.triangles().par_chunks(TRIANGLES).with_min_len(16);
        Self {
            vertices: vertices.map(hash_vertices).collect(),
            triangles: triangles.map(hash_triangles).collect(),
        }
    }

    /// The hashes of a mesh that differs from the one of these in some triangles and
    /// their corners only.
    pub(super) fn with_changes(&self, mesh: Mesh<'_>, triangles: &[Range<usize>]) -> Self {
        let count = mesh.triangles().len();
        if self.vertices.len() != mesh.positions().len().div_ceil(VERTICES)
            || self.triangles.len() != count.div_ceil(TRIANGLES)
        {
            return Self::of(mesh);
        }
        let mut hashes = self.clone();
        let mut old_vertices = vec![false; self.vertices.len()];
        let mut old_triangles = vec![false; self.triangles.len()];
        for triangle in triangles
            .iter()
            .flat_map(|range| range.start..range.end.min(count))
        {
            old_triangles[triangle / TRIANGLES] = true;
            for vertex in mesh.triangles()[triangle] {
                old_vertices[vertex as usize / VERTICES] = true;
            }
        }
        let vertices = mesh.positions().chunks(VERTICES).zip(&mut hashes.vertices);
        for ((run, hash), _) in vertices.zip(&old_vertices).filter(|(_, old)| **old) {
            *hash = hash_vertices(run);
        }
        let triangles = mesh
            .triangles()
            .chunks(TRIANGLES)
            .zip(&mut hashes.triangles);
        for ((run, hash), _) in triangles.zip(&old_triangles).filter(|(_, old)| **old) {
            *hash = hash_triangles(run);
        }
        hashes
    }

    /// What may differ in the mesh of these hashes from the one of `before`.
    pub(super) fn changes_since(&self, before: &Self) -> Changes {
        let differ = |now: &[u64], before: &[u64]| {
            let mut before = before.iter();
            now.iter().map(|hash| before.next() != Some(hash)).collect()
        };
        Changes {
            vertices: differ(&self.vertices, &before.vertices),
            triangles: differ(&self.triangles, &before.triangles),
        }
    }

    pub(super) fn bytes(&self) -> usize {
        (self.vertices.capacity() + self.triangles.capacity()) * size_of::<u64>()
    }
}

/// Runs of a mesh that may have changed.
pub(super) struct Changes {
    vertices: Vec<bool>,
    triangles: Vec<bool>,
}

impl Changes {
    /// The share of the vertices that may have moved, from 0 to 1.
    pub(super) fn share_of_vertices(&self) -> f64 {
        let moved = self.vertices.iter().filter(|moved| **moved).count();
        moved as f64 / self.vertices.len().max(1) as f64
    }

    /// Whether nothing has.
    pub(super) fn is_empty(&self) -> bool {
        !self.vertices.contains(&true) && !self.triangles.contains(&true)
    }

    /// Marks the triangles that may have moved.
    pub(super) fn mark(&self, mesh: Mesh<'_>, marks: &mut [bool]) {
        let chunks = marks
            .par_chunks_mut(CHUNK)
            .zip(mesh.triangles().par_chunks(CHUNK));
        chunks.enumerate().for_each(|(chunk, (marks, triangles))| {
            for (place, (mark, corners)) in marks.iter_mut().zip(triangles).enumerate() {
                let moved = |vertex: u32| self.vertices[vertex as usize / VERTICES];
                let [a, b, c] = *corners;
                *mark |= self.triangles[(chunk * CHUNK + place) / TRIANGLES]
                    | moved(a)
                    | moved(b)
                    | moved(c);
            }
        });
    }
}

fn hash_vertices(run: &[[f32; 3]]) -> u64 {
    hash(run.as_flattened().iter().map(|x| x.to_bits()))
}

fn hash_triangles(run: &[[u32; 3]]) -> u64 {
    hash(run.as_flattened().iter().copied())
}

/// Runs of different lengths differ by their last word.
fn hash(mut words: impl ExactSizeIterator<Item = u32>) -> u64 {
    let mut hasher = FixedState::default().build_hasher();
    let count = words.len();
    while let Some(word) = words.next() {
        let next = words.next().unwrap_or_default();
        hasher.write_u64(u64::from(word) << 32 | u64::from(next));
    }
    hasher.write_usize(count);
    hasher.finish()
}
