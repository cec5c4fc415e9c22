//! Smooth vertex normals: the area-weighted mean of the normals of the
//! triangles around a vertex (Gouraud 1971, weighted by the cross product).

use glam::Vec3;

/// One unit normal per position; vertices of no triangle, or whose triangles
/// cancel out, get +y.
pub(super) fn vertex_normals(positions: &[[f32; 3]], triangles: &[[u32; 3]]) -> Vec<[f32; 3]> {
    let mut sums = vec![Vec3::ZERO; positions.len()];
    for triangle in triangles {
        let [a, b, c] = triangle.map(|index| Vec3::from(positions[index as usize]));
        let doubled_area = (b - a).cross(c - a);
        for &index in triangle {
            sums[index as usize] += doubled_area;
        }
    }
    sums.into_iter()
        .map(|sum| sum.try_normalize().unwrap_or(Vec3::Y).to_array())
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn corner_of_a_cube_points_along_the_diagonal() {
        let positions = [[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
        let normals = vertex_normals(&positions, &[[0, 2, 1], [0, 3, 2], [0, 1, 3]]);
        for component in normals[0] {
            assert!((component + 1.0 / 3.0f32.sqrt()).abs() < 1e-6);
        }
    }

    #[test]
    fn loose_and_flat_vertices_get_an_upward_unit_normal() {
        let positions = [[0.0; 3], [1.0, 0.0, 0.0], [2.0, 0.0, 0.0], [5.0, 5.0, 5.0]];
        let normals = vertex_normals(&positions, &[[0, 1, 2]]);
        assert_eq!(normals, vec![[0.0, 1.0, 0.0]; 4]);
    }
}
