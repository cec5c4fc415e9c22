//! References: the boxes of triangles that builders sort into nodes.

use rayon::prelude::*;

use super::{MAX_COORDINATE, NonFinite};
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
    pub(crate) fn new(bounds: Aabb, triangle: u32) -> Self {
        Self {
            min: bounds.min,
            triangle,
            max: bounds.max,
            _padding: 0,
        }
    }

    pub(crate) fn bounds(&self) -> Aabb {
        Aabb {
            min: self.min,
            max: self.max,
        }
    }
}

/// One reference per triangle, in the mesh's order, and the number of
/// triangles left out because a corner is out of range.
pub(crate) fn collect(
    mesh: Mesh<'_>,
    non_finite: NonFinite,
) -> Result<(Vec<Reference>, usize), BuildError> {
    let triangles = mesh.triangles();
    let mut references: Vec<Reference> = (0..triangles.len() as u32)
        .into_par_iter()
        .with_min_len(CHUNK)
        .map(|triangle| Reference::new(mesh.triangle_bounds(triangle), triangle))
        .collect();
    let usable = |reference: &Reference| {
        // `max` and `min` drop NaN, so a NaN corner has to be looked for in the mesh; every
        // other bad coordinate shows in the box.
        let within = |x: f32| x.abs() <= MAX_COORDINATE;
        mesh.corners(reference.triangle)
            .iter()
            .flatten()
            .all(|&x| within(x))
    };
    if references.par_iter().with_min_len(CHUNK).all(usable) {
        return Ok((references, 0));
    }
    match non_finite {
        NonFinite::Reject => Err(first_unusable(mesh)),
        NonFinite::Skip => {
            references.retain(usable);
            let skipped = triangles.len() - references.len();
            Ok((references, skipped))
        }
    }
}

/// The box around all references.
pub(crate) fn bounds_of(references: &[Reference]) -> Aabb {
    references
        .par_iter()
        .with_min_len(CHUNK)
        .map(Reference::bounds)
        .reduce(|| Aabb::EMPTY, |a, b| a.union(&b))
}

/// Names the first vertex that keeps a triangle from being used.
fn first_unusable(mesh: Mesh<'_>) -> BuildError {
    let culprit = mesh
        .triangles()
        .iter()
        .enumerate()
        .flat_map(|(triangle, corners)| corners.iter().map(move |&vertex| (triangle, vertex)))
        .map(|(triangle, vertex)| (triangle, vertex, mesh.positions()[vertex as usize]))
        .find(|(_, _, position)| position.iter().any(|x| !(x.abs() <= MAX_COORDINATE)));
    let (triangle, vertex, position) = culprit.expect("called only if a triangle is unusable");
    BuildError::NonFinite {
        triangle,
        vertex,
        position,
    }
}
