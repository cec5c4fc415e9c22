//! References: the boxes of triangles that builders sort into nodes.

use fearless_simd::f32x4;
use fearless_simd::prelude::*;
use rayon::prelude::*;

use super::NonFinite;
use crate::aabb::{lower, upper};
use crate::mesh::are_traceable;
use crate::simd::{Kernel, dispatch};
use crate::{Aabb, BuildError, Mesh};

/// Triangles handled by one task when boxes are computed.
const CHUNK: usize = 4096;

/// One triangle's box and number: half a cache line, so that moving one is a
/// single 32-byte load and store.
#[derive(Clone, Copy, Debug, PartialEq)]
#[repr(C, align(32))]
pub(crate) struct Reference {
    pub(crate) min: [f32; 3],
    pub(crate) triangle: u32,
    pub(crate) max: [f32; 3],
    /// Keeps the second half the same shape as the first.
    _padding: u32,
}

impl Reference {
    /// Fills working memory.
    pub(crate) const ZERO: Self = Self {
        min: [0.0; 3],
        triangle: 0,
        max: [0.0; 3],
        _padding: 0,
    };

    /// Both corners as four lanes; the fourth means nothing.
    #[inline(always)]
    pub(crate) fn lanes(&self) -> ([f32; 4], [f32; 4]) {
        let [a, b, c] = self.min;
        let [d, e, f] = self.max;
        let bits = f32::from_bits;
        (
            [a, b, c, bits(self.triangle)],
            [d, e, f, bits(self._padding)],
        )
    }

    pub(crate) fn new(min: [f32; 3], max: [f32; 3], triangle: u32) -> Self {
        Self {
            min,
            triangle,
            max,
            _padding: 0,
        }
    }

    /// The box of a triangle, whose corners are numbers.
    #[inline(always)]
    pub(crate) fn of_triangle([a, b, c]: [[f32; 3]; 3], triangle: u32) -> Self {
        let mut bounds = Self {
            triangle,
            ..Self::ZERO
        };
        for axis in 0..3 {
            bounds.min[axis] = lower(lower(a[axis], b[axis]), c[axis]);
            bounds.max[axis] = upper(upper(a[axis], b[axis]), c[axis]);
        }
        bounds
    }

    pub(crate) fn bounds(&self) -> Aabb {
        Aabb {
            min: self.min,
            max: self.max,
        }
    }

    /// Whether nothing is left of the triangle.
    #[inline(always)]
    pub(crate) fn is_empty(&self) -> bool {
        (self.min[0] > self.max[0]) | (self.min[1] > self.max[1]) | (self.min[2] > self.max[2])
    }
}

/// The triangles that a tree is built over: all of a mesh, or those left when
/// unusable ones are skipped.
#[derive(Debug)]
pub(crate) struct Triangles<'m> {
    mesh: Mesh<'m>,
    /// The usable triangles, if not all are.
    usable: Option<Vec<u32>>,
}

impl<'m> Triangles<'m> {
    /// Finds the usable triangles of a mesh: those whose corners can be traced.
    pub(crate) fn of(mesh: Mesh<'m>, non_finite: NonFinite) -> Result<Self, BuildError> {
        // Nearly always all are, which is seen without a branch a vertex.
        if mesh.positions().par_chunks(CHUNK).all(are_traceable) {
            return Ok(Self { mesh, usable: None });
        }
        let usable: Vec<u32> = (0..mesh.triangles().len() as u32)
            .filter(|&triangle| mesh.is_traceable(triangle))
            .collect();
        if non_finite == NonFinite::Reject && usable.len() < mesh.triangles().len() {
            return Err(first_unusable(mesh));
        }
        Ok(Self {
            mesh,
            usable: Some(usable),
        })
    }

    /// These triangles of a mesh, all of them usable.
    pub(crate) fn these(mesh: Mesh<'m>, triangles: Vec<u32>) -> Self {
        Self {
            mesh,
            usable: Some(triangles),
        }
    }

    pub(crate) fn mesh(&self) -> Mesh<'m> {
        self.mesh
    }

    pub(crate) fn len(&self) -> usize {
        match &self.usable {
            None => self.mesh.triangles().len(),
            Some(usable) => usable.len(),
        }
    }

    /// Number of triangles left out.
    pub(crate) fn skipped(&self) -> usize {
        self.mesh.triangles().len() - self.len()
    }

    /// The index in the mesh of the triangle at `place` among the usable ones.
    #[inline(always)]
    pub(crate) fn triangle(&self, place: usize) -> u32 {
        match &self.usable {
            None => place as u32,
            Some(usable) => usable[place],
        }
    }

    /// The reference to the triangle at `place` among the usable ones.
    #[inline(always)]
    pub(crate) fn reference(&self, place: usize) -> Reference {
        let triangle = self.triangle(place);
        Reference::of_triangle(self.mesh.corners(triangle), triangle)
    }

    /// References to all usable triangles, in the mesh's order.
    pub(crate) fn references(&self) -> Vec<Reference> {
        let mut references = Vec::new();
        self.references_into(&mut references);
        references
    }

    /// [`Triangles::references`] in memory that is there already.
    pub(crate) fn references_into(&self, references: &mut Vec<Reference>) {
        (0..self.len())
            .into_par_iter()
            .with_min_len(CHUNK)
            .map(|place| self.reference(place))
            .collect_into_vec(references);
    }
}

/// The box around all references.
pub(crate) fn bounds_of(references: &[Reference]) -> Aabb {
    struct Bounds<'a>(&'a [Reference]);
    impl Kernel for Bounds<'_> {
        type Output = Aabb;

        #[inline(always)]
        fn run<S: Simd>(self, simd: S) -> Aabb {
            bounds_of_lanes(simd, self.0)
        }
    }
    dispatch(Bounds(references))
}

/// [`bounds_of`] inside a kernel.
#[inline(always)]
pub(crate) fn bounds_of_lanes<S: Simd>(simd: S, references: &[Reference]) -> Aabb {
    // Two of each: a minimum takes longer than reading what it needs.
    let mut min = [f32x4::splat(simd, f32::INFINITY); 2];
    let mut max = [f32x4::splat(simd, f32::NEG_INFINITY); 2];
    let mut pairs = references.chunks_exact(2);
    for pair in &mut pairs {
        for half in 0..2 {
            let (low, high) = pair[half].lanes();
            min[half] = min[half].min(f32x4::simd_from(simd, low));
            max[half] = max[half].max(f32x4::simd_from(simd, high));
        }
    }
    for last in pairs.remainder() {
        let (low, high) = last.lanes();
        min[0] = min[0].min(f32x4::simd_from(simd, low));
        max[0] = max[0].max(f32x4::simd_from(simd, high));
    }
    let (min, max) = (min[0].min(min[1]), max[0].max(max[1]));
    let [a, b, c, _]: [f32; 4] = min.into();
    let [d, e, f, _]: [f32; 4] = max.into();
    // Adding 0 turns -0 into 0: which of the two a minimum gives depends on the instruction set.
    Aabb {
        min: [a + 0.0, b + 0.0, c + 0.0],
        max: [d + 0.0, e + 0.0, f + 0.0],
    }
}

/// The part of the cell that references take up.
#[inline(always)]
pub(super) fn content_bounds<S: Simd>(simd: S, references: &[Reference], cell: &Aabb) -> Aabb {
    let mut content = bounds_of_lanes(simd, references);
    for axis in 0..3 {
        content.min[axis] = content.min[axis].max(cell.min[axis]);
        content.max[axis] = content.max[axis].min(cell.max[axis]);
    }
    content
}

/// Names the first vertex that keeps a triangle from being used.
fn first_unusable(mesh: Mesh<'_>) -> BuildError {
    let culprit = mesh
        .triangles()
        .iter()
        .enumerate()
        .flat_map(|(triangle, corners)| corners.iter().map(move |&vertex| (triangle, vertex)))
        .map(|(triangle, vertex)| (triangle, vertex, mesh.positions()[vertex as usize]))
        .find(|(_, _, position)| !are_traceable(&[*position]));
    let (triangle, vertex, position) = culprit.expect("called only if a triangle is unusable");
    BuildError::NonFinite {
        triangle,
        vertex,
        position,
    }
}
