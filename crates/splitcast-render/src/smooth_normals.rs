//! Vertex normals for meshes that have none: the mean of the normals around a
//! vertex, each weighted by its triangle's angle there (Thürmer & Wüthrich
//! 1998, "Computing vertex normals from polygonal facets"), which does not
//! depend on how a surface is cut into triangles.

use glam::Vec3;
use rayon::prelude::*;

/// Vertices whose sums one task turns into unit vectors.
const CHUNK: usize = 4096;

/// One unit normal a vertex, on the side from which triangles appear
/// counter-clockwise. Zero for vertices that no proper triangle uses.
pub(crate) fn smooth_normals(positions: &[[f32; 3]], triangles: &[[u32; 3]]) -> Vec<[f32; 3]> {
    let mut sums = vec![Vec3::ZERO; positions.len()];
    for triangle in triangles {
        let corners = triangle.map(|vertex| Vec3::from(positions[vertex as usize]));
        for (&vertex, contribution) in triangle.iter().zip(contributions(corners)) {
            sums[vertex as usize] += contribution;
        }
    }
    sums.into_par_iter()
        .with_min_len(CHUNK)
        .map(|sum| sum.normalize_or_zero().into())
        .collect()
}

/// The triangle's unit normal times its angle at each corner.
fn contributions(corners: [Vec3; 3]) -> [Vec3; 3] {
    let edges: [Vec3; 3] = std::array::from_fn(|corner| {
        (corners[(corner + 1) % 3] - corners[corner]).normalize_or_zero()
    });
    let normal = edges[0].cross(edges[1]).normalize_or_zero();
    std::array::from_fn(|corner| normal * angle(edges[corner].dot(-edges[(corner + 2) % 3])))
}

/// The angle with the given cosine, within 7e-5 (Abramowitz & Stegun 1964,
/// 4.4.45): a weight need not be closer, and is the same on every platform.
fn angle(cosine: f32) -> f32 {
    let x = cosine.abs().min(1.0);
    let polynomial = 1.570_728_8 + x * (-0.212_114_4 + x * (0.074_261_0 - x * 0.018_729_3));
    let acute = (1.0 - x).sqrt() * polynomial;
    if cosine < 0.0 {
        std::f32::consts::PI - acute
    } else {
        acute
    }
}
