//! The stage: which way is up, how large the motion is, and where the sun
//! stands. Camera, ground and light all derive from it, so that a mesh in
//! millimetres and one in metres give the same picture.

use glam::{DVec3, Vec3, Vec3Swizzles};
use splitcast::Aabb;

/// Direction from the motion to the default camera when the motion is longest
/// along the first of the stage's axes: a three-quarter view from slightly above.
const THREE_QUARTER: DVec3 = DVec3::new(0.52, 0.22, 0.85);

/// Direction to the default sun, to the right, upwards and towards the default
/// camera: high and to the left behind the camera, so that the lit side shows
/// and the shadow falls to the right and away.
const DEFAULT_SUN: DVec3 = DVec3::new(-0.85, 0.85, 0.12);

/// A place for a motion.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Stage {
    /// Two horizontal directions with up between them: right-handed, and the
    /// world's own x, y, z if y is up.
    pub(crate) axes: [DVec3; 3],
    /// Middle of the motion's box.
    pub(crate) centre: DVec3,
    /// Half the diagonal of the motion's box, above zero.
    pub(crate) radius: f64,
    /// The corners of the motion's box.
    pub(crate) corners: [DVec3; 8],
    /// Lowest extent of the box along up.
    pub(crate) floor: f64,
}

impl Stage {
    /// The stage for a motion within `bounds`; a box that is empty or a
    /// single point is given sides of 1. `up` must not be zero.
    pub(crate) fn new(bounds: &Aabb, up: [f32; 3]) -> Self {
        let axes = axes_around(Vec3::from(up).as_dvec3().normalize());
        let usable =
            !bounds.is_empty() && bounds.min.iter().chain(&bounds.max).all(|x| x.is_finite());
        let (mut min, mut max) = (DVec3::ZERO, DVec3::ZERO);
        if usable {
            min = Vec3::from(bounds.min).as_dvec3();
            max = Vec3::from(bounds.max).as_dvec3();
        }
        if min == max {
            min -= 0.5;
            max += 0.5;
        }
        let corners = std::array::from_fn(|corner| {
            DVec3::new(
                if corner & 1 == 0 { min.x } else { max.x },
                if corner & 2 == 0 { min.y } else { max.y },
                if corner & 4 == 0 { min.z } else { max.z },
            )
        });
        let floor = corners
            .iter()
            .map(|corner| corner.dot(axes[1]))
            .fold(f64::INFINITY, f64::min);
        Self {
            axes,
            centre: 0.5 * (min + max),
            radius: 0.5 * (max - min).length(),
            corners,
            floor,
        }
    }

    /// Up, of unit length.
    pub(crate) fn up(&self) -> DVec3 {
        self.axes[1]
    }

    /// The world's direction for components along the stage's axes.
    fn direction(&self, along: DVec3) -> DVec3 {
        self.axes[0] * along.x + self.axes[1] * along.y + self.axes[2] * along.z
    }

    /// Unit direction to the default camera: a motion that is longest along
    /// one horizontal axis is seen rather from its side.
    pub(crate) fn default_view(&self) -> DVec3 {
        let [extent_0, extent_2] = [self.axes[0], self.axes[2]].map(|axis| {
            let along = self.corners.map(|corner| corner.dot(axis));
            along.iter().fold(f64::NEG_INFINITY, |a, &b| a.max(b))
                - along.iter().fold(f64::INFINITY, |a, &b| a.min(b))
        });
        let view = if extent_2 > extent_0 {
            THREE_QUARTER.zyx()
        } else {
            THREE_QUARTER
        };
        self.direction(view.normalize())
    }

    /// Unit direction to the default sun.
    pub(crate) fn default_sun(&self) -> DVec3 {
        let (up, view) = (self.up(), self.default_view());
        let right = up.cross(view).normalize();
        let towards = right.cross(up);
        (right * DEFAULT_SUN.x + up * DEFAULT_SUN.y + towards * DEFAULT_SUN.z).normalize()
    }
}

/// A right-handed frame with the unit vector `up` in the middle.
fn axes_around(up: DVec3) -> [DVec3; 3] {
    let reference = if up.x.abs() < 0.9 { DVec3::X } else { DVec3::Y };
    let side = (reference - up * reference.dot(up)).normalize();
    [side, up, side.cross(up)]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn y_up_keeps_the_axes_of_the_world() {
        assert_eq!(axes_around(DVec3::Y), [DVec3::X, DVec3::Y, DVec3::Z]);
    }

    #[test]
    fn any_up_gives_a_right_handed_frame() {
        for up in [
            DVec3::X,
            DVec3::Z,
            DVec3::NEG_Y,
            DVec3::new(1.0, 2.0, -3.0).normalize(),
        ] {
            let [a, b, c] = axes_around(up);
            assert!((a.cross(b) - c).length() < 1e-12);
            assert!((a.length() - 1.0).abs() < 1e-12 && a.dot(up).abs() < 1e-12);
        }
    }

    #[test]
    fn an_empty_motion_still_has_a_stage() {
        for bounds in [Aabb::EMPTY, Aabb::of_points(&[[3.0, 4.0, 5.0]])] {
            let stage = Stage::new(&bounds, [0.0, 0.0, 2.0]);
            assert!(stage.radius > 0.0 && stage.floor.is_finite());
        }
    }
}
