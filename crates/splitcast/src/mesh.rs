//! The borrowed triangle mesh that trees are built over.

use crate::build::MAX_COORDINATE;
use crate::{Aabb, MeshError};

/// Positions and triangles, borrowed from their owner. Cheap to copy.
///
/// Every index of every triangle is below the number of positions: checked
/// once by [`Mesh::new`], relied on everywhere else.
#[derive(Clone, Copy, Debug)]
pub struct Mesh<'m> {
    positions: &'m [[f32; 3]],
    triangles: &'m [[u32; 3]],
}

impl<'m> Mesh<'m> {
    /// Borrows a mesh after checking its indices.
    ///
    /// # Errors
    /// [`MeshError::IndexOutOfRange`] names the first triangle with an index
    /// that no position has; [`MeshError::TooManyTriangles`] if a triangle's
    /// number would not fit 32 bits.
    pub fn new(positions: &'m [[f32; 3]], triangles: &'m [[u32; 3]]) -> Result<Self, MeshError> {
        if triangles.len() > u32::MAX as usize {
            return Err(MeshError::TooManyTriangles {
                triangles: triangles.len(),
            });
        }
        // One branch-free pass for the common case; the culprit is looked for only if there is one.
        let highest = triangles
            .iter()
            .fold([0; 3], |[a, b, c]: [u32; 3], &[d, e, f]| {
                [a.max(d), b.max(e), c.max(f)]
            });
        let in_range = |index: u32| (index as usize) < positions.len();
        if !triangles.is_empty() && !highest.into_iter().all(in_range) {
            for (triangle, corners) in triangles.iter().enumerate() {
                if let Some(corner) = corners.iter().position(|&index| !in_range(index)) {
                    return Err(MeshError::IndexOutOfRange {
                        triangle,
                        index: corners[corner],
                        positions: positions.len(),
                    });
                }
            }
        }
        Ok(Self {
            positions,
            triangles,
        })
    }

    /// Vertex positions.
    pub fn positions(&self) -> &'m [[f32; 3]] {
        self.positions
    }

    /// Vertex indices, three a triangle.
    pub fn triangles(&self) -> &'m [[u32; 3]] {
        self.triangles
    }

    /// The three corners of triangle `index`.
    ///
    /// # Panics
    /// If there is no such triangle.
    #[inline]
    pub fn corners(&self, index: u32) -> [[f32; 3]; 3] {
        let [a, b, c] = self.triangles[index as usize];
        [
            self.positions[a as usize],
            self.positions[b as usize],
            self.positions[c as usize],
        ]
    }

    /// Whether all corners of triangle `index` are finite and near enough to
    /// be traced (no coordinate beyond ±1e12).
    ///
    /// # Panics
    /// If there is no such triangle.
    #[inline]
    pub fn is_traceable(&self, index: u32) -> bool {
        are_traceable(&self.corners(index))
    }

    /// The box around the three corners of triangle `index`.
    ///
    /// # Panics
    /// If there is no such triangle.
    #[inline]
    pub fn triangle_bounds(&self, index: u32) -> Aabb {
        Aabb::of_points(&self.corners(index))
    }
}

/// Whether corners may stand here. NaN fails; no short cut, so that it vectorises.
#[inline]
pub(crate) fn are_traceable(positions: &[[f32; 3]]) -> bool {
    let coordinates = positions.as_flattened().iter();
    coordinates.fold(true, |all, x| all & (x.abs() <= MAX_COORDINATE))
}
