//! Light from afar: a sun with soft edges and a sky that pales towards the
//! horizon. Colours are chosen for looks, not measured.
//!
//! The sky depends on the height above the horizon only. Its light on an
//! unobstructed surface is therefore a function of one number, the slope of
//! the surface, and is tabulated: shading starts from the exact value and
//! traces rays for what obstacles change about it, so that open places are
//! free of noise.

use glam::{Vec2, Vec3};

use crate::lanes::{Lanes, Vector};
use crate::sampling::{PixelSamples, cosine_hemisphere, disk};

/// Light from the horizon, from straight above, and from the sun on a white
/// surface that faces it. A white surface on open ground gets about 1 in all.
const HORIZON: Vec3 = Vec3::new(0.62, 0.78, 0.95);
const ZENITH: Vec3 = Vec3::new(0.17, 0.28, 0.48);
const SUN: Vec3 = Vec3::new(1.15, 0.98, 0.78);

/// What lies below the horizon where there is no ground.
const NADIR: Vec3 = Vec3::new(0.34, 0.33, 0.33);

/// Tangent of the sun's angular radius, 1.6 degrees: six times the real one,
/// as behind thin haze, so that shadows are seen to soften with distance.
const SUN_RADIUS: f32 = 0.028;

/// Table entries for slopes from straight down to straight up.
const SLOPES: usize = 65;

/// Sample points behind each entry of the table, in both dimensions together.
const TABLE_SAMPLES: u32 = 1 << 12;

/// Sun and sky over, if there is a ground, ground.
#[derive(Clone, Debug)]
pub(crate) struct Sky {
    up: Vec3,
    horizon: Vec3,
    zenith: Vec3,
    nadir: Vec3,
    /// Reflected by open ground, if there is a ground.
    ground: Option<Vec3>,
    /// To the middle of the sun, of unit length, and across it.
    sun: [Vec3; 3],
    sun_light: Vec3,
    irradiance: [Vec3; SLOPES],
}

impl Sky {
    /// The sky for unit vectors `up` and `sun`. A ground of albedo
    /// `ground_albedo` lights surfaces from below.
    pub(crate) fn new(up: Vec3, sun: Vec3, ground_albedo: Option<Vec3>) -> Self {
        Self::with_colors([HORIZON, ZENITH, NADIR, SUN], up, sun, ground_albedo)
    }

    /// A sky of the given colours of horizon, zenith, nadir and sun.
    pub(crate) fn with_colors(
        [horizon, zenith, nadir, sun_light]: [Vec3; 4],
        up: Vec3,
        sun: Vec3,
        ground_albedo: Option<Vec3>,
    ) -> Self {
        let (across, along) = sun.any_orthonormal_pair();
        let mut sky = Self {
            up,
            horizon,
            zenith,
            nadir,
            ground: None,
            sun: [sun, across * SUN_RADIUS, along * SUN_RADIUS],
            sun_light,
            irradiance: [Vec3::ZERO; SLOPES],
        };
        // Open ground sees the sky's upper half only, so it can be lit before it lights anything.
        sky.ground = ground_albedo.map(|albedo| {
            let lit = sky.integrate(1.0) + sun_light * sun.dot(up).max(0.0);
            albedo * lit
        });
        sky.irradiance = std::array::from_fn(|entry| {
            sky.integrate(2.0 * entry as f32 / (SLOPES - 1) as f32 - 1.0)
        });
        sky
    }

    /// Up, of unit length.
    pub(crate) fn up(&self) -> Vec3 {
        self.up
    }

    /// Unit direction to the middle of the sun.
    pub(crate) fn sun(&self) -> Vec3 {
        self.sun[0]
    }

    /// The sun's light on a white surface that faces it.
    pub(crate) fn sun_light(&self) -> Vec3 {
        self.sun_light
    }

    /// Unit direction to a point of the sun's disk.
    pub(crate) fn sun_direction(&self, point: Vec2) -> Vec3 {
        let on_disk = disk(point);
        let [middle, across, along] = self.sun;
        (middle + across * on_disk.x + along * on_disk.y).normalize()
    }

    /// The light that comes along unit direction `direction` from where
    /// nothing but open ground and sky is.
    pub(crate) fn environment(&self, direction: Vec3) -> Vec3 {
        match self.ground {
            Some(ground) if direction.dot(self.up) < 0.0 => ground,
            _ => self.backdrop(direction),
        }
    }

    /// What the camera sees along unit direction `direction` behind
    /// everything else: as the environment, but ground far away has turned to haze.
    pub(crate) fn backdrop(&self, direction: Vec3) -> Vec3 {
        self.backdrop_lanes(direction.into()).into()
    }

    /// [`Sky::backdrop`] along many directions.
    #[inline(always)]
    pub(crate) fn backdrop_lanes<L: Lanes>(&self, direction: Vector<L>) -> Vector<L> {
        let height = direction.dot_with(self.up).within(-1.0, 1.0);
        let rest = height.abs().rest();
        let below = match self.ground {
            Some(_) => self.horizon,
            None => self.nadir,
        };
        let (zenith, below) = (
            Vector::splat(height, self.zenith),
            Vector::splat(height, below),
        );
        let horizon = Vector::splat(height, self.horizon);
        let towards = below.or(height.is_below(height.splat(0.0)), zenith);
        towards.lerp(horizon, rest * rest * rest)
    }

    /// Light of the whole environment on a white surface with unit normal
    /// `normal`, unobstructed; the sun not included.
    pub(crate) fn irradiance(&self, normal: Vec3) -> Vec3 {
        self.irradiance_lanes(normal.into()).into()
    }

    /// [`Sky::irradiance`] for many normals.
    #[inline(always)]
    pub(crate) fn irradiance_lanes<L: Lanes>(&self, normal: Vector<L>) -> Vector<L> {
        let slope = normal.dot_with(self.up).within(-1.0, 1.0);
        let place = (slope * 0.5 + 0.5) * (SLOPES - 1) as f32;
        let entry = place.trunc().min(place.splat((SLOPES - 2) as f32));
        let (low, high) = (&self.irradiance[..SLOPES - 1], &self.irradiance[1..]);
        (entry.entries(low)).lerp(entry.entries(high), place - entry)
    }

    /// The mean of the environment around a normal that rises by `slope`,
    /// weighted by the cosine.
    fn integrate(&self, slope: f32) -> Vec3 {
        let side = self.up.any_orthonormal_vector();
        let normal = self.up * slope + side * (1.0 - slope * slope).max(0.0).sqrt();
        let points = PixelSamples::new(0, 0, TABLE_SAMPLES, 0);
        let sum: Vec3 = (0..TABLE_SAMPLES)
            .map(|sample| {
                let direction = cosine_hemisphere(points.point(sample, 0), normal);
                self.environment(direction)
            })
            .sum();
        sum / TABLE_SAMPLES as f32
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sun() -> Vec3 {
        Vec3::new(0.0, 0.6, 0.8)
    }

    #[test]
    fn an_even_sky_lights_every_slope_the_same() {
        let white = [Vec3::ONE, Vec3::ONE, Vec3::ONE, Vec3::ZERO];
        let sky = Sky::with_colors(white, Vec3::Y, sun(), None);
        for normal in [Vec3::Y, Vec3::NEG_Y, Vec3::X, sun()] {
            assert!((sky.irradiance(normal) - Vec3::ONE).abs().max_element() < 1e-4);
        }
    }

    #[test]
    fn half_a_sky_gives_half_the_light_to_a_wall() {
        let colors = [Vec3::ONE, Vec3::ONE, Vec3::ZERO, Vec3::ZERO];
        // A black ground hides the lower half.
        let sky = Sky::with_colors(colors, Vec3::Y, sun(), Some(Vec3::ZERO));
        for (slope, share) in [(1.0, 1.0), (0.6, 0.8), (0.0, 0.5), (-0.6, 0.2), (-1.0, 0.0)] {
            let normal = Vec3::new((1.0f32 - slope * slope).sqrt(), slope, 0.0);
            let light = sky.irradiance(normal).x;
            assert!((light - share).abs() < 5e-3, "{slope}: {light} for {share}");
        }
    }

    #[test]
    fn the_sun_is_a_disk_around_its_middle() {
        let sky = Sky::new(Vec3::Y, sun(), None);
        for sample in 0..64 {
            let point = PixelSamples::new(3, 4, 64, 0).point(sample, 1);
            let off = sky.sun_direction(point).dot(sun()).min(1.0);
            assert!(off >= 1.0 / (1.0 + SUN_RADIUS * SUN_RADIUS).sqrt() - 1e-6);
        }
    }

    #[test]
    fn no_line_parts_sky_and_haze_at_the_horizon() {
        let sky = Sky::new(Vec3::Y, sun(), Some(Vec3::splat(0.5)));
        let at = |height: f32| sky.backdrop(Vec3::new(1.0, height, 0.0).normalize());
        assert!((at(1e-4) - at(-1e-4)).abs().max_element() < 1e-3);
    }
}
