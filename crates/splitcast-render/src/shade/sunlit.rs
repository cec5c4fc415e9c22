//! Light for previews: a ray to the middle of the sun from every visible point,
//! all else as if it were open. For any rays, one by one: what [`preview`](crate::preview) does not
//! do, such as many samples a pixel.
//!
//! Most of a picture is open ground and sky. Ground has one of two colors, and
//! nothing of it but its haze is kept until its rays to the sun are traced.

use glam::Vec3;
use splitcast::Ray;

use super::{Arriving, Met, Surroundings, Tracer, reflect};
use crate::surface::Surface;

impl Tracer<'_> {
    /// [`Tracer::radiance`], nothing but the sun hidden.
    pub(super) fn sunlit(&mut self, rays: &[Ray]) -> Vec<Vec3> {
        let Surroundings { sky, ground, .. } = self.surroundings;
        let to_sun = |surface: Vec3| Ray::new(surface.into(), sky.sun().into());
        let towards = |ray: usize| Vec3::from(rays[ray].direction);
        let cosine = |normal: Vec3| normal.dot(sky.sun());

        let mut light = vec![Vec3::ZERO; rays.len()];
        let (mut on_mesh, mut from_mesh) = (Vec::new(), Vec::new());
        // The share of haze of each place on the ground.
        let mut on_ground = Vec::with_capacity(rays.len());
        let mut from_ground = Vec::with_capacity(rays.len());
        self.meet(rays, |ray, met| match met {
            Met::Mesh(surface) => {
                if cosine(surface.normal) > 0.0 {
                    from_mesh.push(to_sun(surface.start));
                }
                on_mesh.push((ray, surface));
            }
            Met::Ground(ground, point) => {
                let haze = ground.haze(point);
                if haze > 0.0 {
                    light[ray] = sky.backdrop(towards(ray));
                }
                if haze < 1.0 {
                    from_ground.push(to_sun(point));
                    on_ground.push((ray, haze));
                }
            }
            Met::Nothing => light[ray] = sky.backdrop(towards(ray)),
        });

        if let Some(ground) = ground {
            let Surface { normal, albedo, .. } = ground.surface(Vec3::ZERO);
            let in_sun = sky.sun_light() * cosine(normal);
            let [shadow, open] =
                [Vec3::ZERO, in_sun].map(|sun| albedo * (sun + sky.irradiance(normal)));
            let hidden = self.occluded(&from_ground);
            for ((ray, haze), hidden) in on_ground.into_iter().zip(hidden) {
                let color = if hidden { shadow } else { open };
                light[ray] = color.lerp(light[ray], haze);
            }
        }

        let mut hidden = self.occluded(&from_mesh).into_iter();
        for (ray, surface) in on_mesh {
            let cosine = cosine(surface.normal);
            let in_sun = cosine > 0.0 && hidden.next() == Some(false);
            let arriving = Arriving {
                sun: if in_sun {
                    sky.sun_light() * cosine
                } else {
                    Vec3::ZERO
                },
                around: sky.irradiance(surface.normal),
                open: 1.0,
            };
            light[ray] = reflect(sky, &surface, -towards(ray), &arriving);
        }
        light
    }
}
