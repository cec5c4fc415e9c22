//! What the mesh looks like at a hit: place, normals, colour.

use fearless_simd::prelude::*;
use fearless_simd::{Simd, f32x8};
use glam::Vec3;
use splitcast::{Hit, KdTree};

use crate::lanes::{LANES, Lanes, Vector};
use crate::srgb;

/// Share of light that a mesh without colours reflects: fired clay.
pub(crate) const CLAY: Vec3 = Vec3::new(0.50, 0.24, 0.14);

/// The same where colours mean something else: plaster.
pub(crate) const PLASTER: Vec3 = Vec3::splat(0.6);

/// Rays that leave a surface start this far above it, relative to its largest
/// coordinate: 32 units in the last place, several times what barycentric
/// interpolation loses.
const OFFSET: f32 = 32.0 * f32::EPSILON;

/// A mesh with its attributes per vertex.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Surfaces<'s> {
    pub(crate) tree: &'s KdTree<'s>,
    /// Unit normals, or none for flat shading. Zero where there is none.
    pub(crate) normals: Option<&'s [[f32; 3]]>,
    pub(crate) colors: Option<&'s [[u8; 3]]>,
    /// Albedo where there are no colours.
    pub(crate) material: Vec3,
}

/// A point on the mesh or the ground.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Surface {
    /// Where it is.
    pub(crate) position: Vec3,
    /// Where rays that leave it start.
    pub(crate) start: Vec3,
    /// The triangle's unit normal, on the side of the viewer; the ground's own.
    pub(crate) facet: Vec3,
    /// The unit normal for shading, on the same side of the triangle.
    pub(crate) normal: Vec3,
    /// Share of light that it reflects.
    pub(crate) albedo: Vec3,
}

impl Surfaces<'_> {
    /// The point at `hit`, seen along `direction`.
    pub(crate) fn at(&self, hit: &Hit, direction: Vec3) -> Surface {
        let mesh = self.tree.mesh();
        let vertices = mesh.triangles()[hit.triangle as usize];
        let of_vertices = |values: &[[f32; 3]]| {
            vertices.map(|vertex| Vector::from(Vec3::from(values[vertex as usize])))
        };
        let facet = Facet {
            corners: of_vertices(mesh.positions()),
            normals: self.normals.map(of_vertices),
            weights: weights(hit.u, hit.v),
        };
        let spot = facet.seen_along(direction.into());
        let albedo = self.colors.map_or(self.material, |colors| {
            let colors = vertices.map(|vertex| srgb::decode(colors[vertex as usize]));
            facet
                .mix(colors.map(|color| Vec3::from(color).into()))
                .into()
        });
        Surface {
            position: spot.position.into(),
            start: spot.start.into(),
            facet: spot.facet.into(),
            normal: spot.normal.into(),
            albedo,
        }
    }

    /// The points where `hits` say: of up to eight triangles with two weights each.
    #[inline(always)]
    pub(crate) fn at_lanes<S: Simd>(
        &self,
        simd: S,
        hits: &HitLanes,
        direction: Vector<f32x8<S>>,
    ) -> (Spot<f32x8<S>>, Vector<f32x8<S>>) {
        let mesh = self.tree.mesh();
        let vertices = vertices_of(mesh.triangles(), &hits.triangles);
        let (u, v) = (
            f32x8::simd_from(simd, hits.u),
            f32x8::simd_from(simd, hits.v),
        );
        let mut facet = Facet {
            corners: of_vertices(simd, &vertices, mesh.positions()),
            normals: None,
            weights: weights(u, v),
        };
        // No closure: it would not be compiled with the kernel's instruction set.
        if let Some(normals) = self.normals {
            facet.normals = Some(of_vertices(simd, &vertices, normals));
        }
        let albedo = match self.colors {
            Some(colors) => {
                let mut rows = [[[0.0; LANES]; 3]; 3];
                for corner in 0..3 {
                    for lane in 0..LANES {
                        let color = srgb::decode(colors[vertices[corner][lane] as usize]);
                        for channel in 0..3 {
                            rows[corner][channel][lane] = color[channel];
                        }
                    }
                }
                facet.mix(load(simd, &rows))
            }
            None => Vector::splat(u, self.material),
        };
        (facet.seen_along(direction), albedo)
    }
}

/// Hits of eight rays.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct HitLanes {
    pub(crate) triangles: [u32; LANES],
    pub(crate) u: [f32; LANES],
    pub(crate) v: [f32; LANES],
}

/// The vertices of triangles, corner by corner.
#[inline(always)]
fn vertices_of(triangles: &[[u32; 3]], numbers: &[u32; LANES]) -> [[u32; LANES]; 3] {
    let mut vertices = [[0; LANES]; 3];
    for lane in 0..LANES {
        let corners = triangles[numbers[lane] as usize];
        for corner in 0..3 {
            vertices[corner][lane] = corners[corner];
        }
    }
    vertices
}

/// What `values` has of vertices, corner by corner.
#[inline(always)]
fn of_vertices<S: Simd>(
    simd: S,
    vertices: &[[u32; LANES]; 3],
    values: &[[f32; 3]],
) -> [Vector<f32x8<S>>; 3] {
    let mut rows = [[[0.0; LANES]; 3]; 3];
    for corner in 0..3 {
        for lane in 0..LANES {
            let value = values[vertices[corner][lane] as usize];
            for axis in 0..3 {
                rows[corner][axis][lane] = value[axis];
            }
        }
    }
    load(simd, &rows)
}

#[inline(always)]
fn load<S: Simd>(simd: S, rows: &[[[f32; LANES]; 3]; 3]) -> [Vector<f32x8<S>>; 3] {
    [
        Vector::load(simd, &rows[0]),
        Vector::load(simd, &rows[1]),
        Vector::load(simd, &rows[2]),
    ]
}

/// The weights of a triangle's corners.
#[inline(always)]
fn weights<L: Lanes>(u: L, v: L) -> [L; 3] {
    [u.rest() - v, u, v]
}

/// Triangles, and a point on each.
#[derive(Clone, Copy)]
struct Facet<L> {
    corners: [Vector<L>; 3],
    /// At the corners.
    normals: Option<[Vector<L>; 3]>,
    /// Of the corners.
    weights: [L; 3],
}

/// A [`Surface`], or one in each lane, but for what color it has.
#[derive(Clone, Copy)]
pub(crate) struct Spot<L> {
    position: Vector<L>,
    pub(crate) start: Vector<L>,
    facet: Vector<L>,
    pub(crate) normal: Vector<L>,
}

impl<L: Lanes> Facet<L> {
    /// The mean of what the corners have.
    #[inline(always)]
    fn mix(&self, values: [Vector<L>; 3]) -> Vector<L> {
        values[0] * self.weights[0] + values[1] * self.weights[1] + values[2] * self.weights[2]
    }

    #[inline(always)]
    fn seen_along(&self, direction: Vector<L>) -> Spot<L> {
        let position = self.mix(self.corners);
        let zero = direction.x.splat(0.0);
        let across = self.normal();
        // Meshes need not be closed: whichever side is seen is the outside.
        let facet = (-across).or(zero.is_below(across.dot(direction)), across);
        let mut spot = Spot {
            position,
            start: position,
            facet,
            normal: facet,
        };
        if let Some(mut normals) = self.normals {
            // Normals at the corners, turned to the viewer's side one by one: their signs need not
            // agree with the winding.
            for normal in &mut normals {
                *normal = (-*normal).or(normal.dot(facet).is_below(zero), *normal);
            }
            spot.normal = self.mix(normals).normalize_or(facet);
            spot.start = self.mix(self.lift(position, normals));
        }
        let [a, b, c] = self.corners;
        let largest = a.abs().max(b.abs()).max(c.abs()).largest();
        spot.start = spot.start + facet * (largest * OFFSET);
        spot
    }

    /// `position` as seen from the planes through each corner across its normal,
    /// where it lies below them (Hanika 2021, "Hacking the shadow terminator",
    /// Ray Tracing Gems II): their mean is a point on the curved surface that the
    /// triangle stands for, so that facets do not shade themselves.
    #[inline(always)]
    fn lift(&self, position: Vector<L>, normals: [Vector<L>; 3]) -> [Vector<L>; 3] {
        let mut lifted = [position; 3];
        for corner in 0..3 {
            let above = (position - self.corners[corner]).dot(normals[corner]);
            let below = above.min(above.splat(0.0));
            lifted[corner] = position - normals[corner] * below;
        }
        lifted
    }

    /// The unit normal on the side from which the corners appear
    /// counter-clockwise; zero for a triangle without an area.
    #[inline(always)]
    fn normal(&self) -> Vector<L> {
        let [a, b, c] = self.corners;
        let (ab, ac) = (b - a, c - a);
        // Scaled first: the product of two tiny edges would vanish.
        let scale = ab.abs().max(ac.abs()).largest();
        let none = Vector::splat(scale, Vec3::ZERO);
        let normal = (ab / scale).cross(ac / scale).normalize_or(none);
        normal.or(none.x.is_below(scale), none)
    }
}
