//! The ground: a plane under the motion that catches its shadow and turns to
//! haze in the distance, so that no horizon line cuts the picture.

use glam::Vec3;

use crate::lanes::{Lanes, Vector};
use crate::stage::Stage;
use crate::surface::Surface;

/// Share of light that the ground reflects: pale sand.
pub(crate) const ALBEDO: Vec3 = Vec3::new(0.51, 0.44, 0.345);

/// Distances from the motion's middle, in its radii, at which the haze begins
/// and at which nothing but haze is left.
const HAZE: (f32, f32) = (2.0, 24.0);

/// A horizontal plane under the motion.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Ground {
    /// Up, of unit length: the ground's normal.
    up: Vec3,
    /// Coordinate of the plane along up.
    height: f32,
    /// Below the middle of the motion, on the plane.
    centre: Vec3,
    /// Radius of the motion.
    radius: f32,
    /// Squared distance from the centre up to which there surely is no haze.
    clear: f32,
}

impl Ground {
    /// The plane at the lowest point of the stage.
    pub(crate) fn new(stage: &Stage) -> Self {
        let up = stage.up();
        let centre = stage.centre + up * (stage.floor - stage.centre.dot(up));
        Self {
            up: up.as_vec3(),
            height: stage.floor as f32,
            centre: centre.as_vec3(),
            radius: stage.radius as f32,
            // Less by more than rounding: where haze begins, `haze` looks closer.
            clear: 0.999 * (HAZE.0 * stage.radius as f32).powi(2),
        }
    }

    /// The distance at which a ray comes down on the ground.
    pub(crate) fn intersect(&self, origin: Vec3, direction: Vec3) -> Option<f32> {
        let distance = self.distance(self.above(origin), direction.into());
        Some(distance).filter(|t| t.is_finite())
    }

    /// How far `point` is above the ground.
    pub(crate) fn above(&self, point: Vec3) -> f32 {
        point.dot(self.up) - self.height
    }

    /// The distance at which rays that start `above` the ground come down on it, infinite if they do not.
    #[inline(always)]
    pub(crate) fn distance<L: Lanes>(&self, above: f32, direction: Vector<L>) -> L {
        let descent = -direction.dot_with(self.up);
        let (zero, above) = (descent.splat(0.0), descent.splat(above));
        let comes_down = zero.is_below(above) & zero.is_below(descent);
        (above / descent).or(comes_down, zero.splat(f32::INFINITY))
    }

    /// The height that a way along unit direction `sun` gains for each unit of length.
    pub(crate) fn slope(&self, sun: Vec3) -> f32 {
        sun.dot(self.up)
    }

    /// Where the sun in unit direction `sun` casts the shadows of points.
    #[inline(always)]
    pub(crate) fn shadow<L: Lanes>(&self, point: Vector<L>, sun: Vec3) -> Vector<L> {
        let height = point.dot_with(self.up) - self.height;
        point - Vector::splat(height, sun) * (height / self.slope(sun))
    }

    /// The ground at `point`.
    pub(crate) fn surface(&self, point: Vec3) -> Surface {
        Surface {
            position: point,
            start: point,
            facet: self.up,
            normal: self.up,
            albedo: ALBEDO,
        }
    }

    /// How much of the ground has turned to haze at `point`: 0 to 1, smooth.
    pub(crate) fn haze(&self, point: Vec3) -> f32 {
        if (point - self.centre).length_squared() < self.clear {
            return 0.0;
        }
        self.haze_lanes(point.into())
    }

    /// [`Ground::haze`] at many points.
    #[inline(always)]
    pub(crate) fn haze_lanes<L: Lanes>(&self, point: Vector<L>) -> L {
        let away = point - Vector::splat(point.x, self.centre);
        let distance = away.length() / self.radius;
        let share = ((distance - HAZE.0) / (HAZE.1 - HAZE.0)).within(0.0, 1.0);
        // Eased at the far end only: near ground loses contrast slowly, as in real haze.
        share * share * (share.splat(3.0) - share * 2.0)
    }
}

#[cfg(test)]
mod tests {
    use splitcast::Aabb;

    use super::*;

    fn ground() -> Ground {
        let bounds = Aabb {
            min: [-1.0, 2.0, -1.0],
            max: [1.0, 3.0, 1.0],
        };
        Ground::new(&Stage::new(&bounds, [0.0, 1.0, 0.0]))
    }

    #[test]
    fn rays_from_above_come_down_on_the_lowest_point() {
        let t = ground().intersect(Vec3::new(0.0, 5.0, 0.0), Vec3::new(0.6, -0.8, 0.0));
        assert!((t.unwrap() - 3.75).abs() < 1e-5);
    }

    #[test]
    fn rays_that_rise_or_start_below_miss() {
        let ground = ground();
        let above = Vec3::new(0.0, 5.0, 0.0);
        assert_eq!(ground.intersect(above, Vec3::Y), None);
        assert_eq!(ground.intersect(above, Vec3::X), None);
        assert_eq!(ground.intersect(Vec3::ZERO, Vec3::NEG_Y), None);
    }

    #[test]
    fn haze_grows_from_nothing_to_all() {
        let ground = ground();
        let haze: Vec<f32> = (0..200)
            .map(|x| ground.haze(Vec3::new(x as f32 * 0.25, 2.0, 0.0)))
            .collect();
        assert!(haze.is_sorted());
        assert_eq!((haze[0], haze[199]), (0.0, 1.0));
    }
}
