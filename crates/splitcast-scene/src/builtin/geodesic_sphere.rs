//! A sphere of nearly equal triangles: the icosahedron with every face cut
//! into a triangular grid and pushed out to the sphere (a geodesic
//! polyhedron of class I).

use std::collections::BTreeMap;

use glam::Vec3;

/// A mesh of `20 * frequency * frequency` triangles on the unit sphere:
/// positions and counter-clockwise triangles. `frequency` is at least one,
/// the number of parts that each edge of the icosahedron is cut into.
pub(super) fn geodesic_sphere(frequency: u32) -> (Vec<Vec3>, Vec<[u32; 3]>) {
    let (corners, faces) = icosahedron();
    let mut positions = Vec::new();
    let mut triangles = Vec::new();
    // Grid points are named by their non-zero weights at corners, so that the
    // faces on both sides of an edge name its points alike.
    let mut known = BTreeMap::new();
    for [a, b, c] in faces {
        let mut vertex = |i: u32, j: u32| {
            let mut name = [(a, frequency - i - j), (b, i), (c, j)];
            name.sort_unstable_by_key(|&(corner, weight)| (weight == 0, corner));
            let name = name.map(|(corner, weight)| (if weight == 0 { 0 } else { corner }, weight));
            *known.entry(name).or_insert_with(|| {
                let sum = name
                    .iter()
                    .map(|&(corner, weight)| corners[corner] * weight as f32);
                positions.push(sum.sum::<Vec3>().normalize());
                positions.len() as u32 - 1
            })
        };
        for i in 0..frequency {
            for j in 0..frequency - i {
                let [p, q, r] = [vertex(i, j), vertex(i + 1, j), vertex(i, j + 1)];
                triangles.push([p, q, r]);
                if i + j + 2 <= frequency {
                    triangles.push([q, vertex(i + 1, j + 1), r]);
                }
            }
        }
    }
    (positions, triangles)
}

/// Corners and counter-clockwise faces of the icosahedron: three golden
/// rectangles, and every triple of corners at edge length from each other.
fn icosahedron() -> ([Vec3; 12], Vec<[usize; 3]>) {
    let golden = (1.0 + 5.0f32.sqrt()) / 2.0;
    let mut corners = [Vec3::ZERO; 12];
    for axis in 0..3 {
        for (i, (short, long)) in [
            (1.0, golden),
            (1.0, -golden),
            (-1.0, golden),
            (-1.0, -golden),
        ]
        .into_iter()
        .enumerate()
        {
            let mut corner = [0.0; 3];
            corner[axis] = short;
            corner[(axis + 1) % 3] = long;
            corners[axis * 4 + i] = Vec3::from(corner);
        }
    }
    // Edges are 2 long, the next distance is 2 * golden.
    let linked = |a: usize, b: usize| corners[a].distance_squared(corners[b]) < 5.0;
    let mut faces = Vec::with_capacity(20);
    for a in 0..12 {
        for b in a + 1..12 {
            for c in b + 1..12 {
                if linked(a, b) && linked(b, c) && linked(a, c) {
                    let normal = (corners[b] - corners[a]).cross(corners[c] - corners[a]);
                    let outward = normal.dot(corners[a]) > 0.0;
                    faces.push(if outward { [a, b, c] } else { [a, c, b] });
                }
            }
        }
    }
    (corners, faces)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_is_closed_round_and_faces_outwards() {
        for frequency in [1, 2, 5] {
            let (positions, triangles) = geodesic_sphere(frequency);
            assert_eq!(triangles.len() as u32, 20 * frequency * frequency);
            assert_eq!(positions.len() as u32, 10 * frequency * frequency + 2);
            let mut edges: Vec<_> = (triangles.iter())
                .flat_map(|&[a, b, c]| [[a, b], [b, c], [c, a]])
                .collect();
            edges.sort_unstable();
            for &[a, b] in &edges {
                assert!(edges.binary_search(&[b, a]).is_ok(), "edge {a} {b} is open");
            }
            edges.dedup();
            assert_eq!(edges.len(), 3 * triangles.len());
            for triangle in triangles {
                let [a, b, c] = triangle.map(|index| positions[index as usize]);
                assert!((b - a).cross(c - a).dot(a) > 0.0);
            }
            assert!(positions.iter().all(|p| (p.length() - 1.0).abs() < 1.0e-6));
        }
    }
}
