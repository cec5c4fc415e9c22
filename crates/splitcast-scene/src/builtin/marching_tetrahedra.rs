//! Marching tetrahedra for several materials: closed surfaces of all pieces
//! of a body at once, which fit each other exactly.
//!
//! J. Bloomenthal, K. Ferguson: "Polygonization of Non-Manifold Implicit
//! Surfaces", SIGGRAPH 1995, on the body-centred cubic lattice that F.
//! Labelle and J. Shewchuk ("Isosurface Stuffing", SIGGRAPH 2007) recommend
//! for the shape of its tetrahedra. Every lattice point has a material; the
//! surface between two materials cuts the edges between their points, meets
//! a third material on faces and a fourth inside a tetrahedron. Cuts depend on
//! the edge or face alone, so neighbouring tetrahedra agree on them.
//!
//! The outer surface (towards material [`OUTSIDE`]) is the same as if the
//! inside were of one material: seams between materials only subdivide it.

use std::collections::HashMap;

use glam::{IVec3, UVec3, Vec3};

/// The material around the body.
pub(super) const OUTSIDE: u32 = 0;

/// Cuts stay this share of an edge away from its ends, so that no triangle
/// shrinks to a point.
const EDGE_MARGIN: f32 = 0.02;

/// Seams stay this share of a cut face away from its border.
const SEAM_MARGIN: f32 = 0.1;

/// Points of a body-centred cubic lattice: corners of cubes and their centres.
#[derive(Clone, Debug)]
pub(super) struct Lattice {
    origin: Vec3,
    /// Edge of a cube in metres.
    pub(super) spacing: f32,
    /// Cubes along each axis.
    cubes: UVec3,
}

/// Surfaces between materials: triangles over shared vertices.
#[derive(Clone, Debug, Default)]
pub(super) struct MaterialSurface {
    pub(super) positions: Vec<Vec3>,
    /// Counter-clockwise seen from the second of their [`Self::sides`].
    pub(super) triangles: Vec<[u32; 3]>,
    /// The two materials that each triangle parts.
    pub(super) sides: Vec<[u32; 2]>,
}

impl MaterialSurface {
    /// Materials around every vertex, sorted: two on a surface, three on a
    /// seam, more where seams meet.
    pub(super) fn vertex_materials(&self) -> Vec<Vec<u32>> {
        let mut materials = vec![Vec::new(); self.positions.len()];
        for (triangle, &sides) in self.triangles.iter().zip(&self.sides) {
            for &vertex in triangle {
                insert_sorted(&mut materials[vertex as usize], sides);
            }
        }
        materials
    }
}

impl Lattice {
    /// A lattice that covers the box from `least` to `greatest` with at least
    /// one cube to spare all round.
    pub(super) fn covering(least: Vec3, greatest: Vec3, spacing: f32) -> Self {
        let cubes = ((greatest - least) / spacing).ceil().as_uvec3() + 2;
        let origin = (least + greatest - cubes.as_vec3() * spacing) * 0.5;
        Self {
            origin,
            spacing,
            cubes,
        }
    }

    /// Number of lattice points: corners, then centres.
    pub(super) fn len(&self) -> usize {
        self.corner_count() + self.cubes.element_product() as usize
    }

    /// Position of lattice point `index`.
    pub(super) fn point(&self, index: usize) -> Vec3 {
        let (index, size, shift) = match index.checked_sub(self.corner_count()) {
            None => (index as u32, self.cubes + 1, 0.0),
            Some(centre) => (centre as u32, self.cubes, 0.5),
        };
        let cell = UVec3::new(
            index % size.x,
            index / size.x % size.y,
            index / (size.x * size.y),
        );
        self.origin + (cell.as_vec3() + shift) * self.spacing
    }

    /// Calls `visit` with the points of every tetrahedron, positively oriented:
    /// one for each edge of each face between two cubes.
    pub(super) fn for_each_tetrahedron(&self, mut visit: impl FnMut([u32; 4])) {
        let index =
            |cell: IVec3, size: IVec3| (cell.x + size.x * (cell.y + size.y * cell.z)) as u32;
        let cubes = self.cubes.as_ivec3();
        let corner = |cell: IVec3| index(cell, cubes + 1);
        let centre = |cell: IVec3| self.corner_count() as u32 + index(cell, cubes);
        for axis in 0..3 {
            let along = IVec3::AXES[axis];
            let (u, v) = (IVec3::AXES[(axis + 1) % 3], IVec3::AXES[(axis + 2) % 3]);
            // Corners of the face, counter-clockwise about `along`.
            let ring = [IVec3::ZERO, u, u + v, v];
            for z in 0..cubes.z - along.z {
                for y in 0..cubes.y - along.y {
                    for x in 0..cubes.x - along.x {
                        let cell = IVec3::new(x, y, z);
                        let near = centre(cell);
                        let far = centre(cell + along);
                        for i in 0..4 {
                            let from = corner(cell + along + ring[i]);
                            let to = corner(cell + along + ring[(i + 1) % 4]);
                            visit([near, from, to, far]);
                        }
                    }
                }
            }
        }
    }

    fn corner_count(&self) -> usize {
        (self.cubes + 1).element_product() as usize
    }
}

/// The surfaces between the `materials` of the lattice points.
///
/// `value(a, b, i)` tells how near lattice point `i` is to the border between
/// materials `a < b`: negative on the side of `a`, positive on that of `b`,
/// zero on the border.
pub(super) fn material_surface(
    lattice: &Lattice,
    materials: &[u32],
    value: impl Fn(u32, u32, u32) -> f32,
) -> MaterialSurface {
    let mut marcher = Marcher {
        lattice,
        materials,
        value,
        surface: MaterialSurface::default(),
        edge_cuts: HashMap::new(),
        face_cuts: HashMap::new(),
    };
    lattice.for_each_tetrahedron(|points| marcher.march(points));
    marcher.surface
}

/// State of one run. The maps are only ever looked up, never walked, so their
/// order has no part in the result.
struct Marcher<'a, F> {
    lattice: &'a Lattice,
    materials: &'a [u32],
    value: F,
    surface: MaterialSurface,
    edge_cuts: HashMap<[u32; 2], u32>,
    face_cuts: HashMap<[u32; 3], u32>,
}

impl<F: Fn(u32, u32, u32) -> f32> Marcher<'_, F> {
    fn march(&mut self, points: [u32; 4]) {
        let material = |i: usize| self.materials[points[i] as usize];
        let of = [material(0), material(1), material(2), material(3)];
        if of == [of[0]; 4] {
            return;
        }
        // Bring the tetrahedron to one of four forms, keeping its orientation.
        let same = |i: usize, j: usize| of[i] == of[j];
        let alone = (0..4).find(|&i| {
            let [j, k, l] = others(i);
            same(j, k) && same(k, l)
        });
        let pair = [[0, 1], [0, 2], [0, 3], [1, 2], [1, 3], [2, 3]]
            .into_iter()
            .find(|&[i, j]| same(i, j));
        if let Some(i) = alone {
            let [j, k, l] = others(i);
            self.one_against_three(oriented([i, j, k, l]).map(|i| points[i]));
        } else if let Some([i, j]) = pair {
            let [k, l] = rest(i, j);
            let turned = oriented([k, l, i, j]);
            // The swap of `oriented` was within the pair.
            let arranged = [turned[2], turned[3], turned[0], turned[1]].map(|i| points[i]);
            if same(k, l) {
                self.two_against_two(arranged);
            } else {
                self.pair_and_two(arranged);
            }
        } else {
            self.four(points);
        }
    }

    fn one_against_three(&mut self, [a, b, c, d]: [u32; 4]) {
        let polygon = [self.edge(a, b), self.edge(a, c), self.edge(a, d)];
        self.emit(&polygon, a, b);
    }

    fn two_against_two(&mut self, [a, b, c, d]: [u32; 4]) {
        let polygon = [
            self.edge(a, c),
            self.edge(a, d),
            self.edge(b, d),
            self.edge(b, c),
        ];
        self.emit(&polygon, a, c);
    }

    /// `a` and `b` are alike, `c` and `d` are two more materials.
    fn pair_and_two(&mut self, [a, b, c, d]: [u32; 4]) {
        let (near_a, near_b) = (self.face([a, c, d]), self.face([b, c, d]));
        let polygon = [self.edge(a, c), near_a, near_b, self.edge(b, c)];
        self.emit(&polygon, a, c);
        let polygon = [near_a, self.edge(a, d), self.edge(b, d), near_b];
        self.emit(&polygon, a, d);
        let polygon = [self.edge(c, d), near_a, near_b];
        self.emit(&polygon, c, d);
    }

    fn four(&mut self, points: [u32; 4]) {
        let faces: [u32; 4] = std::array::from_fn(|i| self.face(others(i).map(|j| points[j])));
        // On the outside's triangle where there is one, so that it stays flat:
        // the face opposite the outside point does not count.
        let outside = points
            .iter()
            .position(|&p| self.materials[p as usize] == OUTSIDE);
        let used = (0..4).filter(|&i| Some(i) != outside);
        let count = if outside.is_some() { 3.0 } else { 4.0 };
        let sum: Vec3 = used
            .map(|i| self.surface.positions[faces[i] as usize])
            .sum();
        let middle = self.vertex(sum / count);
        for [i, j] in [[0, 1], [0, 2], [0, 3], [1, 2], [1, 3], [2, 3]] {
            let [k, l] = rest(i, j);
            let [_, _, k, l] = oriented([i, j, k, l]);
            // The face through k is the one opposite l.
            let polygon = [self.edge(points[i], points[j]), faces[l], middle, faces[k]];
            self.emit(&polygon, points[i], points[j]);
        }
    }

    /// Adds a polygon of three or four vertices, counter-clockwise seen from
    /// the material of lattice point `to`.
    fn emit(&mut self, polygon: &[u32], from: u32, to: u32) {
        let sides = [from, to].map(|point| self.materials[point as usize]);
        for i in 2..polygon.len() {
            self.surface
                .triangles
                .push([polygon[0], polygon[i - 1], polygon[i]]);
            self.surface.sides.push(sides);
        }
    }

    /// The cut of the edge between lattice points `a` and `b`.
    fn edge(&mut self, a: u32, b: u32) -> u32 {
        let key = [a.min(b), a.max(b)];
        if let Some(&vertex) = self.edge_cuts.get(&key) {
            return vertex;
        }
        let [first, second] = key.map(|point| self.materials[point as usize]);
        let [at_a, at_b] = key.map(|point| self.border(first, second, point));
        let t = zero_of(at_a, at_b).clamp(EDGE_MARGIN, 1.0 - EDGE_MARGIN);
        let [from, to] = key.map(|point| self.lattice.point(point as usize));
        let vertex = self.vertex(from.lerp(to, t));
        self.edge_cuts.insert(key, vertex);
        vertex
    }

    /// The point of a face where three materials meet.
    fn face(&mut self, points: [u32; 3]) -> u32 {
        let mut key = points;
        key.sort_unstable();
        if let Some(&vertex) = self.face_cuts.get(&key) {
            return vertex;
        }
        let outside = key
            .into_iter()
            .find(|&point| self.materials[point as usize] == OUTSIDE);
        let position = if let Some(outside) = outside {
            self.seam(outside, key)
        } else {
            let [a, b, c] = key;
            let cuts = [self.edge(a, b), self.edge(b, c), self.edge(a, c)];
            cuts.map(|cut| self.surface.positions[cut as usize])
                .iter()
                .sum::<Vec3>()
                / 3.0
        };
        let vertex = self.vertex(position);
        self.face_cuts.insert(key, vertex);
        vertex
    }

    /// Where the border of the two inner materials of a face crosses the
    /// straight cut of the outer surface.
    fn seam(&mut self, outside: u32, face: [u32; 3]) -> Vec3 {
        let mut inner = face.into_iter().filter(|&point| point != outside);
        let ends: [u32; 2] = std::array::from_fn(|_| inner.next().expect("two points are left"));
        let cuts = ends.map(|end| self.edge(outside, end));
        let [from, to] = cuts.map(|cut| self.surface.positions[cut as usize]);
        // The border value at a cut, linear along its lattice edge.
        let [first, second] = ends.map(|end| self.materials[end as usize]);
        let start = self.lattice.point(outside as usize);
        let at_start = self.border(first, second, outside);
        let values: [f32; 2] = std::array::from_fn(|i| {
            let end = self.lattice.point(ends[i] as usize);
            let t = [from, to][i].distance(start) / end.distance(start);
            at_start + (self.border(first, second, ends[i]) - at_start) * t
        });
        let t = zero_of(values[0], values[1]).clamp(SEAM_MARGIN, 1.0 - SEAM_MARGIN);
        from.lerp(to, t)
    }

    /// Value at `point` of the border between two materials, negative on the
    /// side of `first`.
    fn border(&self, first: u32, second: u32, point: u32) -> f32 {
        if first < second {
            (self.value)(first, second, point)
        } else {
            -(self.value)(second, first, point)
        }
    }

    fn vertex(&mut self, position: Vec3) -> u32 {
        self.surface.positions.push(position);
        self.surface.positions.len() as u32 - 1
    }
}

/// Where a line through `a` at 0 and `b` at 1 is zero; the middle if they do
/// not differ in sign.
fn zero_of(a: f32, b: f32) -> f32 {
    if (a < 0.0) == (b < 0.0) {
        0.5
    } else {
        a / (a - b)
    }
}

/// The three corners of a tetrahedron besides `i`.
fn others(i: usize) -> [usize; 3] {
    [[1, 2, 3], [0, 2, 3], [0, 1, 3], [0, 1, 2]][i]
}

/// The two corners besides `i < j`.
fn rest(i: usize, j: usize) -> [usize; 2] {
    let [a, b, c] = others(i);
    if a == j {
        [b, c]
    } else if b == j {
        [a, c]
    } else {
        [a, b]
    }
}

/// An even permutation: `corners` with its last two swapped if need be.
fn oriented(corners: [usize; 4]) -> [usize; 4] {
    let [a, b, c, d] = corners;
    let inversions = (0..4)
        .flat_map(|i| (i + 1..4).map(move |j| (i, j)))
        .filter(|&(i, j)| corners[i] > corners[j])
        .count();
    if inversions % 2 == 0 {
        corners
    } else {
        [a, b, d, c]
    }
}

/// Adds both materials to a sorted list without repeats.
pub(super) fn insert_sorted(list: &mut Vec<u32>, materials: [u32; 2]) {
    for material in materials {
        if let Err(place) = list.binary_search(&material) {
            list.insert(place, material);
        }
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;

    /// Volume of every material; checks that each surface is closed: every
    /// edge as often one way as the other, and that once.
    pub(in super::super) fn closed_volumes(surface: &MaterialSurface) -> Vec<f32> {
        let count = surface
            .sides
            .iter()
            .flatten()
            .max()
            .map_or(0, |&m| m as usize + 1);
        let mut volumes = vec![0.0; count];
        let mut edges = Vec::new();
        for (&[a, b, c], sides) in surface.triangles.iter().zip(&surface.sides) {
            let [p, q, r] = [a, b, c].map(|v| surface.positions[v as usize]);
            let volume = p.dot(q.cross(r)) / 6.0;
            volumes[sides[0] as usize] += volume;
            volumes[sides[1] as usize] -= volume;
            for [from, to] in [[a, b], [b, c], [c, a]] {
                edges.push((sides[0], from, to));
                edges.push((sides[1], to, from));
            }
        }
        edges.sort_unstable();
        for pair in edges.windows(2) {
            assert_ne!(pair[0], pair[1], "an edge is used twice");
        }
        for &(material, from, to) in &edges {
            assert!(
                edges.binary_search(&(material, to, from)).is_ok(),
                "open edge"
            );
        }
        volumes
    }

    /// A ball of radius 1 cut into `count` sectors about the y axis.
    pub(in super::super) fn sliced_ball(count: u32, spacing: f32) -> MaterialSurface {
        let lattice = Lattice::covering(Vec3::splat(-1.0), Vec3::ONE, spacing);
        let normal = |sector: u32| {
            let (sin, cos) = (std::f32::consts::TAU * sector as f32 / count as f32).sin_cos();
            Vec3::new(cos, 0.3, sin)
        };
        let materials: Vec<u32> = (0..lattice.len())
            .map(|i| {
                let point = lattice.point(i);
                if point.length() >= 1.0 {
                    return OUTSIDE;
                }
                let better =
                    |a: &u32, b: &u32| normal(*a).dot(point).total_cmp(&normal(*b).dot(point));
                1 + (0..count).max_by(better).expect("not empty")
            })
            .collect();
        material_surface(&lattice, &materials, |a, b, i| {
            let point = lattice.point(i as usize);
            if a == OUTSIDE {
                1.0 - point.length()
            } else {
                (normal(b - 1) - normal(a - 1)).dot(point)
            }
        })
    }

    #[test]
    fn tetrahedra_fill_the_lattice_and_face_the_right_way() {
        let lattice = Lattice::covering(Vec3::ZERO, Vec3::new(0.3, 0.5, 0.7), 0.1);
        let mut volume = 0.0;
        let mut count = 0;
        lattice.for_each_tetrahedron(|points| {
            let [a, b, c, d] = points.map(|i| lattice.point(i as usize));
            let part = (b - a).dot((c - a).cross(d - a)) / 6.0;
            assert!((part - 0.1f32.powi(3) / 12.0).abs() < 1.0e-8);
            volume += part;
            count += 1;
        });
        // Four for each of the faces between 5 x 7 x 9 cubes.
        assert_eq!(count, 4 * (4 * 7 * 9 + 5 * 6 * 9 + 5 * 7 * 8));
        assert!((volume - count as f32 * 0.001 / 12.0).abs() < 1.0e-4);
    }

    #[test]
    fn pieces_of_a_ball_are_closed_and_fill_it() {
        let ball = 4.0 / 3.0 * std::f32::consts::PI;
        for count in [1, 2, 3, 5] {
            let volumes = closed_volumes(&sliced_ball(count, 0.13));
            assert_eq!(volumes.len() as u32, count + 1);
            assert!((volumes[0] + ball).abs() < 0.05 * ball, "{volumes:?}");
            for part in &volumes[1..] {
                assert!(
                    (part - ball / count as f32).abs() < 0.06 * ball,
                    "{volumes:?}"
                );
            }
        }
    }

    #[test]
    fn any_materials_give_closed_pieces() {
        // Random materials meet in every way that there is, four to a
        // tetrahedron included.
        let lattice = Lattice::covering(Vec3::ZERO, Vec3::splat(0.8), 0.1);
        for seed in 0..4 {
            let mut random = super::super::random::Random::new(seed);
            let materials: Vec<u32> = (0..lattice.len())
                .map(|i| {
                    let inside = (lattice.point(i) - 0.4).abs().max_element() < 0.4;
                    if inside {
                        random.bits() as u32 % 6
                    } else {
                        OUTSIDE
                    }
                })
                .collect();
            let surface = material_surface(&lattice, &materials, |a, b, i| {
                if materials[i as usize] == a {
                    -0.1 - (b as f32)
                } else {
                    0.3 + a as f32
                }
            });
            let volumes = closed_volumes(&surface);
            assert!(
                volumes[1..].iter().all(|&volume| volume > 0.0),
                "{volumes:?}"
            );
            assert!(volumes.iter().sum::<f32>().abs() < 1.0e-4);
        }
    }
}
