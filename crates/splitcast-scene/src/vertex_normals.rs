//! Vertex normals for meshes that have none: the mean of the normals around a
//! vertex, each weighted by its triangle's angle there (Thürmer & Wüthrich
//! 1998, "Computing vertex normals from polygonal facets"), which does not
//! depend on how a surface is cut into triangles.

use glam::Vec3;
use rayon::prelude::*;

/// Triangles that one task looks at, and vertices whose sums one turns into unit vectors.
const CHUNK: usize = 2048;

/// One unit normal a vertex, on the side from which triangles appear
/// counter-clockwise. Zero for vertices that no proper triangle uses.
pub fn vertex_normals(positions: &[[f32; 3]], triangles: &[[u32; 3]]) -> Vec<[f32; 3]> {
    let of_triangle = |triangle: &[u32; 3]| {
        contributions(triangle.map(|vertex| Vec3::from(positions[vertex as usize])))
    };
    let contributions: Vec<[Vec3; 3]> = (triangles.par_iter().with_min_len(CHUNK))
        .map(of_triangle)
        .collect();
    // One after the other: sums depend on the order.
    let mut sums = vec![Vec3::ZERO; positions.len()];
    for (triangle, contributions) in triangles.iter().zip(contributions) {
        for (&vertex, contribution) in triangle.iter().zip(contributions) {
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_corner_of_a_cube_leans_to_no_side_however_the_faces_are_cut() {
        // Three faces at the origin; one of them is cut through the corner into two triangles.
        let positions = [
            [0.0; 3],
            [1.0, 0.0, 0.0],
            [0.0, 1.0, 0.0],
            [0.0, 0.0, 1.0],
            [1.0, 1.0, 0.0],
        ];
        let triangles = [[0, 4, 1], [0, 2, 4], [0, 3, 2], [0, 1, 3]];
        let normal = vertex_normals(&positions, &triangles)[0];
        for component in normal {
            assert!((component + 1.0 / 3.0f32.sqrt()).abs() < 1e-3, "{normal:?}");
        }
    }

    #[test]
    fn vertices_without_a_proper_triangle_have_no_normal() {
        let positions = [
            [0.0; 3],
            [1.0, 0.0, 0.0],
            [2.0, 0.0, 0.0],
            [f32::NAN, 0.0, 0.0],
            [f32::INFINITY, 0.0, 0.0],
            [0.0, 1.0, 0.0],
        ];
        let triangles = [[0, 1, 2], [0, 0, 0], [1, 2, 3], [1, 2, 4]];
        for normal in vertex_normals(&positions, &triangles) {
            assert_eq!(normal, [0.0; 3]);
        }
    }

    #[test]
    fn a_broken_triangle_does_not_spoil_its_neighbours() {
        let positions = [[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [f32::NAN; 3]];
        let normals = vertex_normals(&positions, &[[0, 1, 2], [0, 1, 3]]);
        assert_eq!(normals[0], [0.0, 0.0, 1.0]);
    }

    #[test]
    fn the_angle_is_within_its_bound() {
        for step in 0..=2000 {
            let cosine = step as f32 / 1000.0 - 1.0;
            let exact = f64::from(cosine).acos();
            assert!((f64::from(angle(cosine)) - exact).abs() < 8e-5, "{cosine}");
        }
    }
}
