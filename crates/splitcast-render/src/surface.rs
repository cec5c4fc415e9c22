//! What the mesh looks like at a hit: place, normals, colour.

use glam::Vec3;
use splitcast::{Hit, KdTree};

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
        let corners = mesh.corners(hit.triangle).map(Vec3::from);
        let weights = [1.0 - hit.u - hit.v, hit.u, hit.v];
        let mix = |values: [Vec3; 3]| {
            values[0] * weights[0] + values[1] * weights[1] + values[2] * weights[2]
        };
        let position = mix(corners);
        let across = facet_normal(corners);
        // Meshes need not be closed: whichever side is seen is the outside.
        let facet = if across.dot(direction) > 0.0 {
            -across
        } else {
            across
        };
        let mut surface = Surface {
            position,
            start: position,
            facet,
            normal: facet,
            albedo: self.colors.map_or(self.material, |colors| {
                mix(vertices.map(|vertex| srgb::decode(colors[vertex as usize]).into()))
            }),
        };
        if let Some(normals) = self.normals {
            // Normals at the corners, turned to the viewer's side one by one: their signs need not
            // agree with the winding.
            let normals = vertices.map(|vertex| {
                let normal = Vec3::from(normals[vertex as usize]);
                if normal.dot(facet) < 0.0 {
                    -normal
                } else {
                    normal
                }
            });
            surface.normal = mix(normals).try_normalize().unwrap_or(facet);
            surface.start = mix(lift(position, corners, normals));
        }
        let largest = corners
            .iter()
            .fold(Vec3::ZERO, |largest, corner| largest.max(corner.abs()))
            .max_element();
        surface.start += facet * (OFFSET * largest);
        surface
    }
}

/// `position` as seen from the planes through each corner across its normal,
/// where it lies below them (Hanika 2021, "Hacking the shadow terminator",
/// Ray Tracing Gems II): their mean is a point on the curved surface that the
/// triangle stands for, so that facets do not shade themselves.
fn lift(position: Vec3, corners: [Vec3; 3], normals: [Vec3; 3]) -> [Vec3; 3] {
    std::array::from_fn(|corner| {
        let above = (position - corners[corner]).dot(normals[corner]);
        position - normals[corner] * above.min(0.0)
    })
}

/// The unit normal on the side from which the corners appear
/// counter-clockwise; zero for a triangle without an area.
fn facet_normal([a, b, c]: [Vec3; 3]) -> Vec3 {
    // Scaled first: the product of two tiny edges would vanish.
    let (ab, ac) = (b - a, c - a);
    let scale = ab.abs().max(ac.abs()).max_element();
    if scale > 0.0 {
        (ab / scale).cross(ac / scale).normalize_or_zero()
    } else {
        Vec3::ZERO
    }
}
