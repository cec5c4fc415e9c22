//! Rays of every kind, most of them unkind.

use splitcast::{Aabb, Mesh, Ray, reference};

use super::meshes::Rng;

/// About `count` rays, divided over all kinds, and the invalid ones.
pub(crate) fn all_kinds(mesh: Mesh<'_>, count: usize) -> Vec<Ray> {
    let mut source = RaySource::new(mesh);
    let mut rays = invalid();
    if source.is_empty() {
        rays.extend((0..100).map(|_| source.through_space()));
        return rays;
    }
    let kinds = [
        RaySource::through_space,
        RaySource::starting_inside,
        RaySource::along_an_axis,
        RaySource::at_a_vertex,
        RaySource::exactly_at_a_vertex,
        RaySource::at_an_edge,
        RaySource::grazing,
        RaySource::starting_on_a_surface,
        RaySource::starting_afar,
        RaySource::of_odd_length,
    ];
    let plain: Vec<Ray> = (0..count)
        .map(|i| kinds[i % kinds.len()](&mut source))
        .collect();
    for (i, ray) in plain.into_iter().enumerate() {
        rays.push(if (i / kinds.len()).is_multiple_of(3) {
            source.limited(ray)
        } else {
            ray
        });
    }
    rays
}

/// Rays that hit nothing whatever the mesh.
pub(crate) fn invalid() -> Vec<Ray> {
    let good = Ray::new([0.1, 0.2, 0.3], [0.3, 0.2, 0.1]);
    let mut rays = vec![
        Ray {
            direction: [0.0, -0.0, 0.0],
            ..good
        },
        good.with_range(1.0, 0.5),
        good.with_range(f32::NAN, f32::INFINITY),
        good.with_range(0.0, f32::NAN),
        good.with_range(f32::INFINITY, f32::INFINITY),
        good.with_range(f32::NEG_INFINITY, f32::NEG_INFINITY),
    ];
    for bad in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
        for axis in 0..3 {
            let (mut origin, mut direction) = (good, good);
            origin.origin[axis] = bad;
            direction.direction[axis] = bad;
            rays.extend([origin, direction]);
        }
    }
    rays
}

/// Where rays over a mesh come from.
pub(super) struct RaySource<'m> {
    mesh: Mesh<'m>,
    traceable: Vec<u32>,
    bounds: Aabb,
    pub(super) rng: Rng,
}

impl<'m> RaySource<'m> {
    pub(super) fn new(mesh: Mesh<'m>) -> Self {
        let all = 0..mesh.triangles().len() as u32;
        let traceable: Vec<u32> = all.filter(|&t| mesh.is_traceable(t)).collect();
        let boxes = traceable.iter().map(|&t| mesh.triangle_bounds(t));
        Self {
            bounds: boxes.fold(Aabb::EMPTY, |a, b| a.union(&b)),
            mesh,
            traceable,
            rng: Rng(mesh.triangles().len() as u64),
        }
    }

    /// Whether there is nothing to hit.
    pub(super) fn is_empty(&self) -> bool {
        self.traceable.is_empty()
    }

    pub(super) fn size(&self) -> f32 {
        let longest = self.bounds.extent().into_iter().fold(0.0, f32::max);
        if longest > 0.0 { longest } else { 1.0 }
    }

    /// A point in the box, at up to `spread` times its half extent from the middle.
    pub(super) fn point(&mut self, spread: f32) -> [f32; 3] {
        if self.is_empty() {
            return self.rng.in_cube();
        }
        let pad = 0.01 * self.size();
        std::array::from_fn(|axis| {
            let (min, max) = (self.bounds.min[axis], self.bounds.max[axis]);
            0.5 * (min + max) + (0.5 * (max - min) + pad) * spread * self.rng.signed()
        })
    }

    fn corners(&mut self) -> [[f32; 3]; 3] {
        let triangle = self.traceable[self.rng.below(self.traceable.len())];
        self.mesh.corners(triangle)
    }

    pub(super) fn vertex(&mut self) -> [f32; 3] {
        self.corners()[self.rng.below(3)]
    }

    /// Along an axis, with zeros of either sign on the others.
    pub(super) fn axis_direction(&mut self) -> [f32; 3] {
        let mut direction = [0.0, 0.0, 1.0].map(|x| if self.rng.unit() < 0.5 { x } else { -x });
        direction.rotate_left(self.rng.below(3));
        direction
    }

    fn through_space(&mut self) -> Ray {
        let (origin, target) = (self.point(3.0), self.point(1.0));
        Ray::new(origin, towards(origin, target))
    }

    fn starting_inside(&mut self) -> Ray {
        let origin = self.point(1.0);
        Ray::new(origin, self.rng.direction())
    }

    /// Parallel to an axis or to a coordinate plane, through coordinates that planes and
    /// vertices have.
    fn along_an_axis(&mut self) -> Ray {
        let mut origin = self.vertex();
        let (other, space) = (self.vertex(), self.point(2.0));
        for axis in 0..3 {
            match self.rng.below(3) {
                0 => origin[axis] = other[axis],
                1 => origin[axis] = space[axis],
                _ => (),
            }
        }
        let mut direction = self.axis_direction();
        if self.rng.unit() < 0.3 {
            direction[self.rng.below(3)] = self.rng.signed();
        }
        Ray::new(origin, direction).with_range(f32::NEG_INFINITY, f32::INFINITY)
    }

    fn at_a_vertex(&mut self) -> Ray {
        let (origin, target) = (self.point(2.0), self.vertex());
        Ray::new(origin, towards(origin, target))
    }

    /// From a point that lies at a small multiple of a simple direction from a vertex.
    fn exactly_at_a_vertex(&mut self) -> Ray {
        let vertex = self.vertex();
        let direction = [0; 3].map(|_| self.rng.below(5) as f32 - 2.0);
        let step = self.size() * 0.5;
        let origin = std::array::from_fn(|axis| vertex[axis] - step * direction[axis]);
        Ray::new(origin, direction)
    }

    fn at_an_edge(&mut self) -> Ray {
        let origin = self.point(2.0);
        let [a, b, _] = self.corners();
        Ray::new(origin, towards(origin, between(a, b, 0.5)))
    }

    /// Along a triangle's plane: along an edge, or across the triangle from beside it.
    fn grazing(&mut self) -> Ray {
        let [a, b, c] = self.corners();
        let share = self.rng.unit();
        let target = between(b, c, share);
        let origin = between(a, target, -1.0 - self.rng.unit());
        let mut ray = Ray::new(origin, towards(origin, target));
        if self.rng.unit() < 0.3 {
            ray.origin = a;
        }
        ray
    }

    fn starting_on_a_surface(&mut self) -> Ray {
        let [a, b, c] = self.corners();
        let origin = match self.rng.below(3) {
            0 => a,
            1 => between(a, b, 0.5),
            _ => between(between(a, b, 0.5), c, 1.0 / 3.0),
        };
        let direction = if self.rng.unit() < 0.5 {
            self.rng.direction()
        } else {
            towards(origin, self.vertex())
        };
        Ray::new(origin, direction)
    }

    fn starting_afar(&mut self) -> Ray {
        let away = self.size() * 10f32.powi(1 + self.rng.below(5) as i32);
        let (target, direction) = (self.vertex(), self.rng.direction());
        let origin = std::array::from_fn(|axis| target[axis] - away * direction[axis]);
        Ray::new(origin, towards(origin, target))
    }

    /// Of any length that there is, so that distances may be as small as numbers get.
    fn of_odd_length(&mut self) -> Ray {
        let ray = self.at_a_vertex();
        let largest = ray
            .direction
            .iter()
            .fold(0.0f32, |size, x| size.max(x.abs()));
        let length = 10f64.powi(self.rng.below(76) as i32 - 37);
        let scaled = |x: f32| (f64::from(x) / f64::from(largest) * length) as f32;
        Ray::new(ray.origin, ray.direction.map(scaled))
    }

    /// The same ray with a range that may end exactly at one of its hits, or begin behind it.
    pub(super) fn limited(&mut self, ray: Ray) -> Ray {
        let mut hits = Vec::new();
        let line = ray.with_range(f32::NEG_INFINITY, f32::INFINITY);
        reference::all_hits(self.mesh, &line, &mut hits);
        if hits.is_empty() {
            return ray.with_range(-self.rng.unit(), self.rng.unit());
        }
        let t = hits[self.rng.below(hits.len())].t;
        match self.rng.below(7) {
            0 => ray.with_range(t, t),
            1 => ray.with_range(f32::NEG_INFINITY, t),
            2 => ray.with_range(t, f32::INFINITY),
            3 => ray.with_range(f32::NEG_INFINITY, t.next_down()),
            4 => ray.with_range(t.next_up(), f32::INFINITY),
            5 => ray.with_range(-1.0, self.rng.unit()),
            _ => line,
        }
    }
}

pub(super) fn between(a: [f32; 3], b: [f32; 3], share: f32) -> [f32; 3] {
    std::array::from_fn(|axis| a[axis] + share * (b[axis] - a[axis]))
}

pub(super) fn towards(origin: [f32; 3], target: [f32; 3]) -> [f32; 3] {
    std::array::from_fn(|axis| target[axis] - origin[axis])
}
