//! Light at visible points: path tracing with the sun sampled at every point
//! and the sky's unobstructed light known in advance.
//!
//! At each point one ray goes to the sun and one into the hemisphere. The
//! latter only measures the difference to what would come from open sky and
//! ground (a control variate), which is nothing for most rays. Where it meets
//! mesh or ground in shadow, the light there is found in the same way, as
//! often as the quality allows.

use glam::{Vec2, Vec3};
use splitcast::{KdTree, Ray, TraversalCounts};

use crate::ground::{self, Ground};
use crate::sampling::{PixelSamples, cosine_hemisphere};
use crate::sky::Sky;
use crate::surface::{Surface, Surfaces};

/// Dimensions of the sampler: the pixel filter, then two for every point of a path.
pub(crate) const FILTER: u32 = 0;
const PATH: u32 = 1;

/// Share of the sky that is seen from the average point behind which a path
/// ends: such a point has just been found to be close to another surface.
const OPEN_AT_END: f32 = 0.5;

/// Light from an obstacle that is not looked at closer, relative to the open
/// sky's light on the obstructed surface.
const OBSTACLE: f32 = 0.35;

/// Share of light reflected straight back by a dielectric such as clay, index 1.5.
const REFLECTANCE: f32 = 0.04;

/// Roughness of the sheen, squared as is usual for the width of the lobe.
const ROUGHNESS: f32 = 0.65;
const ALPHA: f32 = ROUGHNESS * ROUGHNESS;

/// The light of a scene without its mesh.
#[derive(Clone, Debug)]
pub(crate) struct Surroundings {
    pub(crate) sky: Sky,
    pub(crate) ground: Option<Ground>,
    /// Number of reflections between visible point and light.
    pub(crate) bounces: u32,
}

/// Follows the rays of one tile.
#[derive(Debug)]
pub(crate) struct Tracer<'s> {
    surfaces: Surfaces<'s>,
    surroundings: &'s Surroundings,
    /// Rays traced through the tree so far.
    pub(crate) rays: u64,
}

/// What a ray meets first.
enum Met {
    Mesh(Surface),
    Ground(Vec3),
    Nothing,
}

/// Light that arrives at a point, on a white surface.
#[derive(Clone, Copy, Debug)]
struct Arriving {
    sun: Vec3,
    around: Vec3,
    /// Share of the surroundings that is open.
    open: f32,
}

impl<'s> Tracer<'s> {
    /// A tracer that has not followed any ray yet.
    pub(crate) fn new(surfaces: Surfaces<'s>, surroundings: &'s Surroundings) -> Self {
        Self {
            surfaces,
            surroundings,
            rays: 0,
        }
    }

    /// The light that comes back along a camera ray of unit direction.
    pub(crate) fn radiance(&mut self, ray: &Ray, points: &PixelSamples, sample: u32) -> Vec3 {
        let Surroundings {
            sky,
            ground,
            bounces,
        } = self.surroundings;
        let direction = Vec3::from(ray.direction);
        match self.meet(ray) {
            Met::Mesh(surface) => {
                let arriving = self.gather(
                    surface.start,
                    surface.facet,
                    surface.normal,
                    points,
                    sample,
                    *bounces,
                );
                reflect(sky, &surface, -direction, &arriving)
            }
            Met::Ground(point) => {
                let ground = ground.expect("the ground was met");
                let haze = ground.haze(point);
                let backdrop = sky.backdrop(direction);
                if haze >= 1.0 {
                    return backdrop;
                }
                let up = ground.up();
                let arriving = self.gather(point, up, up, points, sample, *bounces);
                (ground::ALBEDO * (arriving.sun + arriving.around)).lerp(backdrop, haze)
            }
            Met::Nothing => sky.backdrop(direction),
        }
    }

    /// The mesh where a ray of unit direction meets it, and the work that took.
    pub(crate) fn mesh_along(&mut self, ray: &Ray) -> (Option<Surface>, TraversalCounts) {
        self.rays += 1;
        let (hit, counts) = self.tree().closest_hit_counted(ray);
        let surface = hit.map(|hit| self.surfaces.at(&hit, ray.direction.into()));
        (surface, counts)
    }

    /// The tree that rays go through.
    pub(crate) fn tree(&self) -> &'s KdTree<'s> {
        self.surfaces.tree
    }

    /// The light that arrives at a point that is seen after `left` fewer
    /// reflections than allowed.
    fn gather(
        &mut self,
        start: Vec3,
        facet: Vec3,
        normal: Vec3,
        points: &PixelSamples,
        sample: u32,
        left: u32,
    ) -> Arriving {
        let surroundings = self.surroundings;
        let sky = &surroundings.sky;
        let dimension = PATH + 2 * (surroundings.bounces - left);
        let to_sun = sky.sun_direction(points.point(sample, dimension));
        let sun = self.sun_light(start, normal, to_sun);

        let direction = above(
            cosine_hemisphere(points.point(sample, dimension + 1), normal),
            facet,
        );
        let ray = Ray::new(start.into(), direction.into());
        let open_light = sky.irradiance(normal);
        let (difference, open) = if left == 0 {
            self.rays += 1;
            if self.tree().occluded(&ray) {
                (open_light * OBSTACLE - sky.environment(direction), 0.0)
            } else {
                (Vec3::ZERO, 1.0)
            }
        } else {
            match self.meet(&ray) {
                Met::Nothing => (Vec3::ZERO, 1.0),
                Met::Ground(point) => {
                    let on_sun = points.point(sample, dimension + 2);
                    self.beside_open_ground(point, on_sun)
                }
                Met::Mesh(surface) => {
                    let there = if left > 1 {
                        let arriving = self.gather(
                            surface.start,
                            surface.facet,
                            surface.normal,
                            points,
                            sample,
                            left - 1,
                        );
                        arriving.sun + arriving.around
                    } else {
                        let to_sun = sky.sun_direction(points.point(sample, dimension + 2));
                        self.sun_light(surface.start, surface.normal, to_sun)
                            + sky.irradiance(surface.normal) * OPEN_AT_END
                    };
                    (surface.albedo * there - sky.environment(direction), 0.0)
                }
            }
        };
        Arriving {
            sun,
            around: open_light + difference,
            open,
        }
    }

    /// The sun's light on a surface, if nothing stands between. Visibility
    /// goes by the sampled point of the sun, but light by its middle: the same
    /// on average, and free of noise where the whole sun is seen.
    fn sun_light(&mut self, start: Vec3, normal: Vec3, to_sun: Vec3) -> Vec3 {
        let cosine = normal.dot(self.surroundings.sky.sun());
        if cosine <= 0.0 {
            return Vec3::ZERO;
        }
        self.rays += 1;
        if self.tree().occluded(&Ray::new(start.into(), to_sun.into())) {
            Vec3::ZERO
        } else {
            self.surroundings.sky.sun_light() * cosine
        }
    }

    /// What the mesh's shadow takes from the light of open ground at `point`,
    /// and how open that ground is.
    fn beside_open_ground(&mut self, point: Vec3, on_sun: Vec2) -> (Vec3, f32) {
        let sky = &self.surroundings.sky;
        let to_sun = sky.sun_direction(on_sun);
        self.rays += 1;
        if self.tree().occluded(&Ray::new(point.into(), to_sun.into())) {
            let taken = ground::ALBEDO * sky.sun_light() * sky.sun().dot(sky.up());
            (-taken, 0.0)
        } else {
            (Vec3::ZERO, 1.0)
        }
    }

    /// What a ray of unit direction meets first.
    fn meet(&mut self, ray: &Ray) -> Met {
        self.rays += 1;
        let (origin, direction) = (Vec3::from(ray.origin), Vec3::from(ray.direction));
        let on_ground = self
            .surroundings
            .ground
            .and_then(|ground| ground.intersect(origin, direction));
        let hit = self.tree().closest_hit(ray);
        match (hit, on_ground) {
            (Some(hit), Some(t)) if t < hit.t => Met::Ground(origin + direction * t),
            (Some(hit), _) => Met::Mesh(self.surfaces.at(&hit, direction)),
            (None, Some(t)) => Met::Ground(origin + direction * t),
            (None, None) => Met::Nothing,
        }
    }
}

/// The light that a surface sends towards unit direction `to_eye`: diffuse
/// under a thin dielectric coat.
fn reflect(sky: &Sky, surface: &Surface, to_eye: Vec3, arriving: &Arriving) -> Vec3 {
    let normal = surface.normal;
    let facing = normal.dot(to_eye).clamp(0.0, 1.0);
    // Schlick's approximation, bounded for rough surfaces (Lagarde 2011): grazing light is
    // reflected by slopes that are not grazed.
    let fresnel = REFLECTANCE
        + ((1.0 - ROUGHNESS).max(REFLECTANCE) - REFLECTANCE) * fifth_power(1.0 - facing);
    let diffuse = surface.albedo * (arriving.sun + arriving.around) * (1.0 - fresnel);
    let mirrored = 2.0 * normal.dot(to_eye) * normal - to_eye;
    let sheen = sky.irradiance(mirrored) * (fresnel * arriving.open);
    diffuse + sheen + arriving.sun * highlight(normal, to_eye, sky.sun())
}

/// The GGX lobe for light from `to_light`, relative to a white diffuse
/// surface (Walter et al. 2007; visibility after Hammon 2017).
fn highlight(normal: Vec3, to_eye: Vec3, to_light: Vec3) -> f32 {
    let Some(half) = (to_eye + to_light).try_normalize() else {
        return 0.0;
    };
    let (n_h, n_l) = (normal.dot(half).max(0.0), normal.dot(to_light).max(0.0));
    let n_v = normal.dot(to_eye).max(1e-3);
    let spread = n_h * n_h * (ALPHA * ALPHA - 1.0) + 1.0;
    let lobe = ALPHA * ALPHA / (spread * spread);
    let visibility = 0.5 / ((1.0 - ALPHA) * 2.0 * n_l * n_v + ALPHA * (n_l + n_v)).max(1e-6);
    let fresnel =
        REFLECTANCE + (1.0 - REFLECTANCE) * fifth_power(1.0 - to_light.dot(half).max(0.0));
    lobe * visibility * fresnel
}

/// `direction`, mirrored to the upper side of `facet` if it points below: smooth normals lean
/// over the edge of their triangles.
fn above(direction: Vec3, facet: Vec3) -> Vec3 {
    direction - facet * (2.0 * direction.dot(facet).min(0.0))
}

fn fifth_power(x: f32) -> f32 {
    let square = x * x;
    square * square * x
}

#[cfg(test)]
mod tests {
    use splitcast::{BuildOptions, Mesh};

    use super::*;

    /// A sphere of radius 1 around the origin, `2 n` by `n` quads, closed at
    /// the poles; seen from inside if `inward`.
    fn sphere(n: u32, inward: bool) -> (Vec<[f32; 3]>, Vec<[u32; 3]>) {
        use std::f32::consts::PI;
        let (columns, rows) = (2 * n, n + 1);
        let positions = (0..columns * rows)
            .map(|index| {
                let turn = 2.0 * PI * (index % columns) as f32 / columns as f32;
                let fall = PI * (index / columns) as f32 / n as f32;
                let ring = fall.sin();
                [ring * turn.cos(), fall.cos(), ring * turn.sin()]
            })
            .collect();
        let triangles = (0..columns * n)
            .flat_map(|quad| {
                let (x, y) = (quad % columns, quad / columns);
                let at = |x: u32, y: u32| y * columns + x % columns;
                let [a, b, c, d] = [at(x, y), at(x + 1, y), at(x, y + 1), at(x + 1, y + 1)];
                [[a, b, c], [b, d, c]]
            })
            .map(|[a, b, c]| if inward { [a, c, b] } else { [a, b, c] })
            .collect();
        (positions, triangles)
    }

    /// The mean light over rays through `places`, from `eye` towards them.
    fn mean_light(inward: bool, colors: [Vec3; 4], bounces: u32, eye: Vec3, samples: u32) -> Vec3 {
        let (positions, triangles) = sphere(24, inward);
        let mesh = Mesh::new(&positions, &triangles).unwrap();
        let tree = KdTree::build(mesh, &BuildOptions::default()).unwrap();
        let surroundings = Surroundings {
            sky: Sky::with_colors(colors, Vec3::Y, Vec3::new(0.6, 0.8, 0.0), None),
            ground: None,
            bounces,
        };
        // The vertices of a sphere around the origin are its normals.
        let surfaces = Surfaces {
            tree: &tree,
            normals: Some(&positions),
            colors: None,
            material: Vec3::ONE,
        };
        let mut tracer = Tracer::new(surfaces, &surroundings);
        let points = PixelSamples::new(0, 0, samples, 0);
        let sum: Vec3 = (0..samples)
            .map(|sample| {
                let offset = points.point(sample, 100) - Vec2::splat(0.5);
                let target = Vec3::new(0.0, offset.y, offset.x);
                let direction = (target - eye).normalize();
                let ray = Ray::new(eye.into(), direction.into());
                tracer.radiance(&ray, &points, sample)
            })
            .sum();
        sum / samples as f32
    }

    #[test]
    fn a_white_ball_cannot_be_told_from_a_white_sky() {
        let white = [Vec3::ONE, Vec3::ONE, Vec3::ONE, Vec3::ZERO];
        for bounces in 0..3 {
            let light = mean_light(false, white, bounces, Vec3::new(5.0, 0.0, 0.0), 256);
            assert!(
                (light - Vec3::ONE).abs().max_element() < 2e-3,
                "{bounces}: {light}"
            );
        }
    }

    #[test]
    fn the_inside_of_a_closed_ball_is_darker_than_the_sky() {
        let white = [Vec3::ONE, Vec3::ONE, Vec3::ONE, Vec3::ZERO];
        for bounces in 0..3 {
            let light = mean_light(true, white, bounces, Vec3::ZERO, 256);
            assert!(
                light.max_element() < 0.6 && light.min_element() > 0.0,
                "{light}"
            );
        }
    }

    #[test]
    fn the_sun_gives_no_more_than_it_has() {
        let sun_only = [Vec3::ZERO, Vec3::ZERO, Vec3::ZERO, Vec3::ONE];
        let light = mean_light(false, sun_only, 0, Vec3::new(5.0, 0.0, 0.0), 256);
        // The middle of the ball faces the sun at a cosine around 0.6; its sheen adds a little.
        assert!((0.4..0.8).contains(&light.x), "{light}");
    }
}
