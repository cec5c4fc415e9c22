//! Light at visible points: path tracing with the sun sampled at every point
//! and the sky's unobstructed light known in advance.
//!
//! At each point one ray goes to the sun and one into the hemisphere. The
//! latter only measures the difference to what would come from open sky and
//! ground (a control variate), which is nothing for most rays. Where it meets
//! mesh or ground in shadow, the light there is found in the same way, as
//! often as the quality allows.
//!
//! Many paths are followed at once, a step of all of them before the next
//! step: the rays of a step that start at neighbouring pixels take much the
//! same way through the tree, and are traced together.

mod reflection;
mod sunlit;

use glam::{Vec2, Vec3};
use splitcast::{Hit, KdTree, Ray};

use crate::ground::{self, Ground};
use crate::reach::reaching;
use crate::sampling::{PixelSamples, cosine_hemisphere};
use crate::sky::Sky;
use crate::surface::{Surface, Surfaces};
pub(crate) use reflection::Lit;

/// Dimensions of the sampler: the pixel filter, then two for every point of a path.
pub(crate) const FILTER: u32 = 0;
const PATH: u32 = 1;

/// Share of the sky that is seen from the average point behind which a path
/// ends: such a point has just been found to be close to another surface.
const OPEN_AT_END: f32 = 0.5;

/// Light from an obstacle that is not looked at closer, relative to the open
/// sky's light on the obstructed surface.
const OBSTACLE: f32 = 0.35;

/// The light of a scene without its mesh.
#[derive(Clone, Debug)]
pub(crate) struct Surroundings {
    pub(crate) sky: Sky,
    pub(crate) ground: Option<Ground>,
    pub(crate) detail: Detail,
}

/// How closely light is looked at.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Detail {
    /// A ray to the sun's middle at every visible point; all else counts as open.
    Sun,
    /// Paths with so many reflections between visible point and light.
    Bounces(u32),
}

/// Which of the picture's samples a path belongs to.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Sample<'p> {
    pub(crate) points: &'p PixelSamples,
    /// Its number among those of the pixel.
    pub(crate) number: u32,
}

impl Sample<'_> {
    /// The sample's point in `dimension`.
    pub(crate) fn point(&self, dimension: u32) -> Vec2 {
        self.points.point(self.number, dimension)
    }
}

/// Follows the rays of one tile.
#[derive(Debug)]
pub(crate) struct Tracer<'s> {
    surfaces: Surfaces<'s>,
    surroundings: &'s Surroundings,
    /// Rays traced so far, those that pass by the tree included.
    pub(crate) rays: u64,
}

/// What a ray meets first.
enum Met<'s> {
    Mesh(Surface),
    Ground(&'s Ground, Vec3),
    Nothing,
}

/// A point of a path that light is to be found at.
struct Place<'p> {
    surface: Surface,
    sample: Sample<'p>,
    /// The ray that has met it.
    ray: usize,
}

/// Light that arrives at a point, on a white surface.
#[derive(Clone, Copy, Debug)]
struct Arriving {
    sun: Vec3,
    around: Vec3,
    /// Share of the surroundings that is open.
    open: f32,
}

/// How the surroundings of a point differ from open sky and ground.
#[derive(Clone, Copy, Debug)]
struct Obstruction {
    /// What it adds to their light.
    difference: Vec3,
    /// Share of the surroundings that is open.
    open: f32,
}

impl Obstruction {
    const NONE: Self = Self {
        difference: Vec3::ZERO,
        open: 1.0,
    };

    /// Something that changes the light by `difference` and hides what is behind it.
    fn by(difference: Vec3) -> Self {
        Self {
            difference,
            open: 0.0,
        }
    }
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

    /// The light that comes back along each of the camera rays, of unit
    /// direction, which belong to `samples`.
    pub(crate) fn radiance(&mut self, rays: &[Ray], samples: &[Sample<'_>]) -> Vec<Vec3> {
        let Surroundings { sky, detail, .. } = self.surroundings;
        let bounces = match *detail {
            Detail::Sun => return self.sunlit(rays),
            Detail::Bounces(bounces) => bounces,
        };
        let mut light = vec![Vec3::ZERO; rays.len()];
        let mut places = Vec::with_capacity(rays.len());
        // Of each place: how much of it is lost in haze if it lies on the ground.
        let mut hazes = Vec::with_capacity(rays.len());
        self.meet(rays, |ray, met| {
            if !matches!(met, Met::Mesh(_)) {
                light[ray] = sky.backdrop(rays[ray].direction.into());
            }
            let (surface, haze) = match met {
                Met::Mesh(surface) => (surface, None),
                Met::Ground(ground, point) => (ground.surface(point), Some(ground.haze(point))),
                Met::Nothing => return,
            };
            if haze.is_none_or(|haze| haze < 1.0) {
                let sample = samples[ray];
                places.push(Place {
                    surface,
                    sample,
                    ray,
                });
                hazes.push(haze);
            }
        });
        let arriving = self.gather(&places, PATH, bounces);
        for ((place, haze), arriving) in places.iter().zip(hazes).zip(arriving) {
            let Place { surface, ray, .. } = place;
            let to_eye = -Vec3::from(rays[*ray].direction);
            light[*ray] = match haze {
                None => reflect(sky, surface, to_eye, &arriving),
                Some(haze) => {
                    (surface.albedo * (arriving.sun + arriving.around)).lerp(light[*ray], haze)
                }
            };
        }
        light
    }

    /// The mesh where rays of unit direction meet it.
    pub(crate) fn mesh_along(&mut self, rays: &[Ray]) -> Vec<Option<Surface>> {
        let hits = self.closest_hits(rays);
        let at = |(ray, hit): (&Ray, Option<_>)| {
            hit.map(|hit| self.surfaces.at(&hit, ray.direction.into()))
        };
        rays.iter().zip(hits).map(at).collect()
    }

    /// How many nodes and blocks of the tree each ray visits on its way to the mesh.
    pub(crate) fn steps_along(&mut self, rays: &[Ray]) -> Vec<u32> {
        self.rays += rays.len() as u64;
        let steps = |ray| {
            let (_, counts) = self.tree().closest_hit_counted(ray);
            counts.nodes + counts.blocks
        };
        rays.iter().map(steps).collect()
    }

    /// The tree that rays go through.
    pub(crate) fn tree(&self) -> &'s KdTree<'s> {
        self.surfaces.tree
    }

    /// The light that arrives at places behind which there may be `left`
    /// reflections, with sampling from `dimension` on.
    fn gather(&mut self, places: &[Place<'_>], dimension: u32, left: u32) -> Vec<Arriving> {
        let sky = &self.surroundings.sky;
        let sun = self.sun_light(places, |sample| sky.sun_direction(sample.point(dimension)));
        let around = |place: &Place<'_>| {
            let Surface { facet, normal, .. } = place.surface;
            let point = place.sample.point(dimension + 1);
            above(cosine_hemisphere(point, normal), facet)
        };
        let rays: Vec<Ray> = (places.iter())
            .map(|place| Ray::new(place.surface.start.into(), around(place).into()))
            .collect();
        let obstructions = if left == 0 {
            self.obstacles(places, &rays)
        } else {
            self.reflections(places, &rays, dimension + 2, left)
        };
        let together = |((place, sun), obstruction): ((&Place<'_>, Vec3), Obstruction)| Arriving {
            sun,
            around: sky.irradiance(place.surface.normal) + obstruction.difference,
            open: obstruction.open,
        };
        (places.iter().zip(sun).zip(obstructions))
            .map(together)
            .collect()
    }

    /// What obstacles on the rays from places change, without a closer look at them.
    fn obstacles(&mut self, places: &[Place<'_>], rays: &[Ray]) -> Vec<Obstruction> {
        let sky = &self.surroundings.sky;
        let hidden = self.occluded(rays);
        let obstruction = |((place, ray), hidden): ((&Place<'_>, &Ray), bool)| {
            if !hidden {
                return Obstruction::NONE;
            }
            let open_light = sky.irradiance(place.surface.normal);
            Obstruction::by(open_light * OBSTACLE - sky.environment(ray.direction.into()))
        };
        (places.iter().zip(rays).zip(hidden))
            .map(obstruction)
            .collect()
    }

    /// What changes by the light of what the rays from places meet, of which
    /// the sun is sampled in `dimension`.
    fn reflections(
        &mut self,
        places: &[Place<'_>],
        rays: &[Ray],
        dimension: u32,
        left: u32,
    ) -> Vec<Obstruction> {
        let sky = &self.surroundings.sky;
        let to_sun = |sample: &Sample<'_>| sky.sun_direction(sample.point(dimension));
        let mut obstructions = vec![Obstruction::NONE; rays.len()];
        let (mut on_mesh, mut on_ground) = (Vec::new(), Vec::new());
        self.meet(rays, |ray, met| {
            let (found, surface) = match met {
                Met::Nothing => return,
                Met::Ground(ground, point) => (&mut on_ground, ground.surface(point)),
                Met::Mesh(surface) => (&mut on_mesh, surface),
            };
            let sample = places[ray].sample;
            found.push(Place {
                surface,
                sample,
                ray,
            });
        });
        let in_shadow = self.is_hidden(on_ground.iter(), to_sun);
        for (place, in_shadow) in on_ground.iter().zip(in_shadow) {
            if in_shadow {
                let taken = ground::ALBEDO * sky.sun_light() * sky.sun().dot(sky.up());
                obstructions[place.ray] = Obstruction::by(-taken);
            }
        }
        let there: Vec<Vec3> = if left > 1 {
            let arriving = self.gather(&on_mesh, dimension, left - 1);
            arriving
                .iter()
                .map(|light| light.sun + light.around)
                .collect()
        } else {
            let sun = self.sun_light(&on_mesh, to_sun);
            (on_mesh.iter().zip(sun))
                .map(|(place, sun)| sun + sky.irradiance(place.surface.normal) * OPEN_AT_END)
                .collect()
        };
        for (place, there) in on_mesh.iter().zip(there) {
            let open = sky.environment(rays[place.ray].direction.into());
            obstructions[place.ray] = Obstruction::by(place.surface.albedo * there - open);
        }
        obstructions
    }

    /// The sun's light at places, if nothing stands between. Visibility
    /// goes by the point of the sun that lies along `to_sun`, but light by its middle: the same
    /// on average, and free of noise where the whole sun is seen.
    fn sun_light(
        &mut self,
        places: &[Place<'_>],
        to_sun: impl Fn(&Sample<'_>) -> Vec3,
    ) -> Vec<Vec3> {
        let sky = &self.surroundings.sky;
        let cosine = |place: &Place<'_>| place.surface.normal.dot(sky.sun());
        let faces_sun = |place: &&Place<'_>| cosine(place) > 0.0;
        let mut hidden = (self.is_hidden(places.iter().filter(faces_sun), to_sun)).into_iter();
        let light = |place| {
            if faces_sun(&place) && hidden.next() == Some(false) {
                sky.sun_light() * cosine(place)
            } else {
                Vec3::ZERO
            }
        };
        places.iter().map(light).collect()
    }

    /// Whether something stands between each place and the point of the sun
    /// along `to_sun`.
    fn is_hidden<'p>(
        &mut self,
        places: impl Iterator<Item = &'p Place<'p>>,
        to_sun: impl Fn(&Sample<'_>) -> Vec3,
    ) -> Vec<bool> {
        let ray =
            |place: &Place<'_>| Ray::new(place.surface.start.into(), to_sun(&place.sample).into());
        let rays: Vec<Ray> = places.map(ray).collect();
        self.occluded(&rays)
    }

    /// Whether each ray meets the mesh.
    fn occluded(&mut self, rays: &[Ray]) -> Vec<bool> {
        self.rays += rays.len() as u64;
        let mut occluded = vec![false; rays.len()];
        for range in reaching(rays, &self.tree().bounds()) {
            let (rays, occluded) = (&rays[range.clone()], &mut occluded[range]);
            self.tree().occluded_rays(rays, occluded);
        }
        occluded
    }

    /// Where each ray meets the mesh first.
    fn closest_hits(&mut self, rays: &[Ray]) -> Vec<Option<Hit>> {
        self.rays += rays.len() as u64;
        let mut hits = vec![None; rays.len()];
        for range in reaching(rays, &self.tree().bounds()) {
            let (rays, hits) = (&rays[range.clone()], &mut hits[range]);
            self.tree().closest_hits(rays, hits);
        }
        hits
    }

    /// Tells `met` the number of each ray of unit direction, in order, and what it meets first.
    fn meet(&mut self, rays: &[Ray], mut met: impl FnMut(usize, Met<'s>)) {
        let hits = self.closest_hits(rays);
        for (index, (ray, hit)) in rays.iter().zip(hits).enumerate() {
            let (origin, direction) = (Vec3::from(ray.origin), Vec3::from(ray.direction));
            let on_ground = self.surroundings.ground.as_ref().and_then(|ground| {
                let t = ground.intersect(origin, direction)?;
                Some((ground, t))
            });
            // One call, so that it is inlined and nothing goes through memory.
            met(
                index,
                match (hit, on_ground) {
                    (Some(hit), on_ground) if on_ground.is_none_or(|(_, t)| hit.t <= t) => {
                        Met::Mesh(self.surfaces.at(&hit, direction))
                    }
                    (_, Some((ground, t))) => Met::Ground(ground, origin + direction * t),
                    (_, None) => Met::Nothing,
                },
            );
        }
    }
}

/// The light that a surface sends towards unit direction `to_eye`.
fn reflect(sky: &Sky, surface: &Surface, to_eye: Vec3, arriving: &Arriving) -> Vec3 {
    let lit = Lit {
        normal: surface.normal.into(),
        albedo: surface.albedo.into(),
        to_eye: to_eye.into(),
        sun: arriving.sun.into(),
        around: arriving.around.into(),
        open: arriving.open,
    };
    lit.reflected(sky).into()
}

/// `direction`, mirrored to the upper side of `facet` if it points below: smooth normals lean
/// over the edge of their triangles.
fn above(direction: Vec3, facet: Vec3) -> Vec3 {
    direction - facet * (2.0 * direction.dot(facet).min(0.0))
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
    fn mean_light(
        inward: bool,
        colors: [Vec3; 4],
        detail: Detail,
        eye: Vec3,
        samples: u32,
    ) -> Vec3 {
        let (positions, triangles) = sphere(24, inward);
        let mesh = Mesh::new(&positions, &triangles).unwrap();
        let tree = KdTree::build(mesh, &BuildOptions::default()).unwrap();
        let surroundings = Surroundings {
            sky: Sky::with_colors(colors, Vec3::Y, Vec3::new(0.6, 0.8, 0.0), None),
            ground: None,
            detail,
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
        let samples: Vec<_> = (0..samples)
            .map(|number| Sample {
                points: &points,
                number,
            })
            .collect();
        let ray = |sample: &Sample<'_>| {
            let offset = sample.point(100) - Vec2::splat(0.5);
            let target = Vec3::new(0.0, offset.y, offset.x);
            let direction = (target - eye).normalize();
            Ray::new(eye.into(), direction.into())
        };
        let rays: Vec<_> = samples.iter().map(ray).collect();
        let light = tracer.radiance(&rays, &samples);
        light.iter().sum::<Vec3>() / samples.len() as f32
    }

    #[test]
    fn a_white_ball_cannot_be_told_from_a_white_sky() {
        let white = [Vec3::ONE, Vec3::ONE, Vec3::ONE, Vec3::ZERO];
        for bounces in 0..3 {
            let light = mean_light(
                false,
                white,
                Detail::Bounces(bounces),
                Vec3::new(5.0, 0.0, 0.0),
                256,
            );
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
            let light = mean_light(true, white, Detail::Bounces(bounces), Vec3::ZERO, 256);
            assert!(
                light.max_element() < 0.6 && light.min_element() > 0.0,
                "{light}"
            );
        }
    }

    #[test]
    fn the_sun_gives_no_more_than_it_has() {
        let sun_only = [Vec3::ZERO, Vec3::ZERO, Vec3::ZERO, Vec3::ONE];
        for detail in [Detail::Sun, Detail::Bounces(0)] {
            let light = mean_light(false, sun_only, detail, Vec3::new(5.0, 0.0, 0.0), 256);
            // The middle of the ball faces the sun at a cosine around 0.6; its sheen adds a little.
            assert!((0.4..0.8).contains(&light.x), "{light}");
        }
    }

    #[test]
    fn only_the_sun_is_hidden_where_only_the_sun_is_looked_at() {
        let sun_only = [Vec3::ZERO, Vec3::ZERO, Vec3::ZERO, Vec3::ONE];
        let light = mean_light(true, sun_only, Detail::Sun, Vec3::ZERO, 16);
        assert_eq!(light, Vec3::ZERO);
        let sky_only = [Vec3::ONE, Vec3::ONE, Vec3::ONE, Vec3::ZERO];
        let light = mean_light(true, sky_only, Detail::Sun, Vec3::ZERO, 16);
        assert!((light - Vec3::ONE).abs().max_element() < 2e-3, "{light}");
    }
}
