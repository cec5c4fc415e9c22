//! What has changed in a mesh since the last frame, found by hashes of short runs of
//! vertices and of triangles.
//!
//! A mesh is read once, in order, which costs about a tenth of an update in which everything moves;
//! there, a sample of the runs will do. Hashes take a fiftieth of the memory of the old
//! positions.

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

/// Runs of vertices that tell whether a mesh moves as a whole.
const SAMPLE: usize = 64;

/// Triangles that a thread looks at in one go.
const CHUNK: usize = 4096;

/// Hashes of a mesh.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct MeshHashes {
    vertices: Vec<u64>,
    triangles: Vec<u64>,
    /// Of some runs of vertices, evenly spaced. The others may be missing.
    sample: Vec<u64>,
}

impl MeshHashes {
    /// Of a mesh whose other runs nobody will ask for.
    pub(super) fn sample_of(mesh: Mesh<'_>) -> Self {
        let runs = mesh.positions().chunks(VERTICES);
        let stride = runs.len().div_ceil(SAMPLE).max(1);
        Self {
            sample: runs.step_by(stride).map(hash_vertices).collect(),
            ..Self::default()
        }
    }

    /// The share of a sample of the vertices that may have moved since `before`, from 0 to 1.
    pub(super) fn share_of_sample(&self, before: &Self) -> f64 {
        if self.sample.len() != before.sample.len() {
            return 1.0;
        }
        let both = self.sample.iter().zip(&before.sample);
        let moved = both.filter(|(now, before)| now != before).count();
        moved as f64 / self.sample.len().max(1) as f64
    }

    /// Whether they are of all runs.
    pub(super) fn are_complete(&self) -> bool {
        self.vertices.is_empty() == self.sample.is_empty()
    }

    pub(super) fn of(mesh: Mesh<'_>) -> Self {
        let vertices = mesh.positions().par_chunks(VERTICES).with_min_len(64);
        let triangles = mesh.triangles().par_chunks(TRIANGLES).with_min_len(16);
        Self {
            vertices: vertices.map(hash_vertices).collect(),
            triangles: triangles.map(hash_triangles).collect(),
            ..Self::sample_of(mesh)
        }
    }

    /// The hashes of a mesh that differs from the one of these in some triangles and
    /// their corners only.
    pub(super) fn with_changes(&self, mesh: Mesh<'_>, triangles: &[Range<usize>]) -> Self {
        let count = mesh.triangles().len();
        if !self.are_complete() {
            return Self::sample_of(mesh);
        }
        if self.vertices.len() != mesh.positions().len().div_ceil(VERTICES)
            || self.triangles.len() != count.div_ceil(TRIANGLES)
        {
            return Self::of(mesh);
        }
        let mut hashes = Self {
            vertices: self.vertices.clone(),
            triangles: self.triangles.clone(),
            ..Self::sample_of(mesh)
        };
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
        (self.vertices.capacity() + self.triangles.capacity() + self.sample.capacity())
            * size_of::<u64>()
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

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    /// A strip of triangles, each from a vertex to the two behind it.
    fn strip(vertices: usize) -> (Vec<[f32; 3]>, Vec<[u32; 3]>) {
        let positions = (0..vertices).map(|i| [i as f32, (i % 2) as f32, 0.0]);
        let triangles = (2..vertices as u32).map(|i| [i - 2, i - 1, i]);
        (positions.collect(), triangles.collect())
    }

    fn marks(now: &MeshHashes, before: &MeshHashes, mesh: Mesh<'_>) -> Vec<bool> {
        let mut marks = vec![false; mesh.triangles().len()];
        now.changes_since(before).mark(mesh, &mut marks);
        marks
    }

    #[test]
    fn nothing_changes_in_a_mesh_that_stays() {
        for vertices in [0, 1, 2, 31, 32, 33, 5000] {
            let (positions, triangles) = strip(vertices);
            let mesh = Mesh::new(&positions, &triangles).unwrap();
            let hashes = MeshHashes::of(mesh);
            assert!(hashes.changes_since(&hashes.clone()).is_empty());
            assert!(!marks(&hashes, &hashes, mesh).contains(&true));
        }
    }

    #[test]
    fn a_mesh_that_grows_or_shrinks_within_a_run_has_changed() {
        let (positions, triangles) = strip(40);
        let hashes = |vertices: usize, count: usize| {
            MeshHashes::of(Mesh::new(&positions[..vertices], &triangles[..count]).unwrap())
        };
        for (a, b) in [((40, 30), (40, 29)), ((40, 30), (39, 30))] {
            let (a, b) = (hashes(a.0, a.1), hashes(b.0, b.1));
            assert!(!a.changes_since(&b).is_empty());
            assert!(!b.changes_since(&a).is_empty());
        }
    }

    proptest! {
        /// All that changes is marked, and little else; hashes brought up to date are
        /// those of the mesh.
        #[test]
        fn what_changes_is_marked(
            moved in prop::collection::vec(0..9000_usize, 0..4),
            rewired in prop::collection::vec(0..8998_usize, 0..3),
            bit in 0..32_u32,
        ) {
            let (positions, triangles) = strip(9000);
            let before = MeshHashes::of(Mesh::new(&positions, &triangles).unwrap());
            let (mut later, mut rewired_triangles) = (positions.clone(), triangles.clone());
            for &vertex in &moved {
                later[vertex][1] = f32::from_bits(positions[vertex][1].to_bits() ^ 1 << bit);
            }
            for &triangle in &rewired {
                rewired_triangles[triangle][0] = (triangles[triangle][0] + 7) % 9000;
            }
            let mesh = Mesh::new(&later, &rewired_triangles).unwrap();
            let now = MeshHashes::of(mesh);
            let marks = marks(&now, &before, mesh);
            let changed = |triangle: usize| {
                rewired.contains(&triangle)
                    || rewired_triangles[triangle].iter().any(|&v| moved.contains(&(v as usize)))
            };
            let changed: Vec<usize> = (0..triangles.len()).filter(|&t| changed(t)).collect();
            for &triangle in &changed {
                prop_assert!(marks[triangle]);
            }
            let marked = marks.iter().filter(|mark| **mark).count();
            let most = moved.len() * (VERTICES + 2 + 1) + rewired.len() * (TRIANGLES + 1);
            prop_assert!(marked <= most, "{marked} of at most {most}");
            let ranges: Vec<Range<usize>> = changed.iter().map(|&t| t..t + 1).collect();
            prop_assert_eq!(before.with_changes(mesh, &ranges), now);
        }
    }
}
