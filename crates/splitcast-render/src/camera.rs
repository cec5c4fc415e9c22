//! A pinhole camera in perspective, and the view that frames a whole motion.

use glam::{DVec3, Vec3};
use splitcast::{Aabb, Ray};

use crate::RenderError;
use crate::options::{check_coordinates, check_direction, check_range};
use crate::stage::Stage;

/// Vertical field of view when none is asked for, in degrees: about a 65 mm
/// lens on 35 mm film, long enough to keep proportions natural.
pub const DEFAULT_FOV_DEGREES: f32 = 24.0;

/// Share of the half picture that a framed motion leaves free at each border.
const MARGIN: f64 = 0.12;

/// Shadows need no margin: how far out they count, relative to the motion.
const SHADOW_REACH: f64 = 1.0 - MARGIN;

/// Where a camera stands and what it looks at.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Perspective {
    /// The camera's place.
    pub eye: [f32; 3],
    /// The point in the middle of the picture.
    pub look_at: [f32; 3],
    /// What is up in the picture, of any length but zero and not along the view.
    pub up: [f32; 3],
    /// Angle between the top and the bottom of the picture, above 0 and below 180.
    pub vertical_fov_degrees: f32,
}

impl Perspective {
    /// A three-quarter view that shows all of `bounds`, the box around a
    /// whole motion, and its shadow on the ground, with a margin. `aspect` is
    /// the picture's width over its height. A motion that is longest along
    /// one horizontal axis is seen rather from its side.
    ///
    /// # Errors
    /// [`RenderError`] if `up` is no direction, or if the aspect or the field
    /// of view is out of range.
    pub fn framing(
        bounds: &Aabb,
        up: [f32; 3],
        aspect: f32,
        vertical_fov_degrees: f32,
    ) -> Result<Self, RenderError> {
        check_direction("up", up)?;
        check_aspect(aspect)?;
        let half_height = half_height(vertical_fov_degrees)?;
        let stage = Stage::new(bounds, up);
        let back = stage.default_view();
        let right = stage.up().cross(back).normalize();
        let above = back.cross(right);

        // A point is inside the picture if, seen from the eye, it is no farther from the axis than
        // `slope` times its depth. Each border thus bounds the eye by one inequality that is linear
        // in its place, and the nearest eye that satisfies two opposite ones has a closed form.
        let points = motion_and_shadow(&stage);
        let fit = |axis: DVec3, slope: f64| {
            let bound = |sign: f64| {
                points
                    .iter()
                    .map(|point| sign * point.dot(axis) + slope * point.dot(back))
                    .fold(f64::NEG_INFINITY, f64::max)
            };
            let (a, b) = (bound(1.0), bound(-1.0));
            (0.5 * (a - b), 0.5 * (a + b) / slope)
        };
        let half_height = half_height * (1.0 - MARGIN);
        let (along_right, wide) = fit(right, half_height * f64::from(aspect));
        let (along_above, tall) = fit(above, half_height);
        let nearest = points
            .iter()
            .map(|point| point.dot(back))
            .fold(f64::NEG_INFINITY, f64::max);
        // A flat picture of a flat motion could otherwise put the eye on it.
        let along_back = wide.max(tall).max(nearest + 1e-3 * stage.radius);
        let eye = right * along_right + above * along_above + back * along_back;
        let look_at = eye - back * (along_back - stage.centre.dot(back));
        Ok(Self {
            eye: eye.as_vec3().into(),
            look_at: look_at.as_vec3().into(),
            up,
            vertical_fov_degrees,
        })
    }
}

/// A pinhole camera.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Camera {
    eye: Vec3,
    forward: Vec3,
    /// From the middle of the picture, at distance 1, half a picture height to the right.
    right: Vec3,
    /// The same upwards.
    up: Vec3,
}

impl Camera {
    /// A camera that sees `view`.
    ///
    /// # Errors
    /// [`RenderError`] names the first field that is out of bounds, or says
    /// that the view has no direction or lies along up.
    pub fn new(view: &Perspective) -> Result<Self, RenderError> {
        check_coordinates("eye", view.eye)?;
        check_coordinates("look-at", view.look_at)?;
        check_direction("up", view.up)?;
        let half_height = half_height(view.vertical_fov_degrees)?;
        let eye = Vec3::from(view.eye);
        let towards = Vec3::from(view.look_at).as_dvec3() - eye.as_dvec3();
        if towards == DVec3::ZERO {
            return Err(RenderError::EyeAtTarget { position: view.eye });
        }
        let forward = towards.normalize();
        let side = forward.cross(Vec3::from(view.up).as_dvec3().normalize());
        // Below this sine the single-precision coordinates do not determine the side any more.
        if side.length() < 1e-6 {
            return Err(RenderError::UpAlongView { up: view.up });
        }
        let right = side.normalize();
        let up = right.cross(forward);
        Ok(Self {
            eye,
            forward: forward.as_vec3(),
            right: (right * half_height).as_vec3(),
            up: (up * half_height).as_vec3(),
        })
    }

    /// The camera's place.
    pub fn eye(&self) -> [f32; 3] {
        self.eye.into()
    }

    /// Where `point` appears in a picture of the given aspect: (0, 0) is the
    /// top left corner and (1, 1) the bottom right one. `None` if it lies
    /// behind the camera.
    pub fn project(&self, point: [f32; 3], aspect: f32) -> Option<[f32; 2]> {
        let towards = Vec3::from(point) - self.eye;
        let depth = towards.dot(self.forward);
        let along = |axis: Vec3| towards.dot(axis) / (depth * axis.length_squared());
        (depth > 0.0).then(|| {
            [
                0.5 + 0.5 * along(self.right) / aspect,
                0.5 - 0.5 * along(self.up),
            ]
        })
    }

    /// The ray, of unit direction, through a point of the picture: (0, 0) is
    /// its top left corner, (1, 1) its bottom right one.
    pub fn ray(&self, [x, y]: [f32; 2], aspect: f32) -> Ray {
        let direction =
            self.forward + self.right * ((2.0 * x - 1.0) * aspect) + self.up * (1.0 - 2.0 * y);
        Ray::new(self.eye.into(), direction.normalize().into())
    }
}

/// Half the picture's height at distance 1.
fn half_height(fov_degrees: f32) -> Result<f64, RenderError> {
    // The ends leave room for rounding: a wider picture would have an infinite height.
    check_range(
        "field of view",
        fov_degrees,
        0.01..=179.0,
        "0.01 to 179 degrees",
    )?;
    Ok((0.5 * f64::from(fov_degrees).to_radians()).tan())
}

fn check_aspect(aspect: f32) -> Result<(), RenderError> {
    check_range(
        "aspect",
        aspect,
        1e-5..=1e5,
        "width over height, 1e-5 to 1e5",
    )
}

/// The corners of the motion's box, and the shadows on the ground of the
/// middles of its edges. Meshes reach the faces of their boxes, but hardly
/// ever the corners, and the shadows of these lie far out.
fn motion_and_shadow(stage: &Stage) -> Vec<DVec3> {
    let (sun, up) = (stage.default_sun(), stage.up());
    let shadow = |point: DVec3| {
        let on_ground = point - sun * ((point.dot(up) - stage.floor) / sun.dot(up));
        stage.centre + (on_ground - stage.centre) * SHADOW_REACH
    };
    let edges = (0..8).flat_map(|from| [1, 2, 4].map(|bit| (from, from | bit)));
    let middles = edges
        .filter(|(from, to)| from != to)
        .map(|(from, to)| 0.5 * (stage.corners[from] + stage.corners[to]));
    stage
        .corners
        .into_iter()
        .chain(middles.map(shadow))
        .collect()
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn view() -> Perspective {
        Perspective {
            eye: [0.0, 0.0, 5.0],
            look_at: [0.0; 3],
            up: [0.0, 2.0, 0.0],
            vertical_fov_degrees: 90.0,
        }
    }

    fn close(a: [f32; 2], b: [f32; 2]) -> bool {
        (a[0] - b[0]).abs() < 1e-4 && (a[1] - b[1]).abs() < 1e-4
    }

    #[test]
    fn known_points_appear_where_they_should() {
        let camera = Camera::new(&view()).unwrap();
        let cases = [
            ([0.0, 0.0, 0.0], [0.5, 0.5]),
            // At 90 degrees the picture is as high as twice its distance.
            ([0.0, 5.0, 0.0], [0.5, 0.0]),
            ([-10.0, 0.0, 0.0], [0.0, 0.5]),
            ([10.0, -5.0, 0.0], [1.0, 1.0]),
        ];
        for (point, place) in cases {
            let projected = camera.project(point, 2.0).unwrap();
            assert!(close(projected, place), "{point:?} at {projected:?}");
        }
        assert_eq!(camera.project([0.0, 0.0, 6.0], 2.0), None);
    }

    #[test]
    fn rays_pass_through_the_points_that_are_seen() {
        let camera = Camera::new(&view()).unwrap();
        for place in [[0.5, 0.5], [0.0, 0.0], [0.9, 0.2]] {
            let point = camera.ray(place, 1.5).at(7.0);
            assert!(close(camera.project(point, 1.5).unwrap(), place));
        }
    }

    #[test]
    fn impossible_views_are_refused() {
        use RenderError as E;
        type Case = (fn(&mut Perspective), fn(&RenderError) -> bool);
        let cases: [Case; 9] = [
            (
                |v| v.eye = v.look_at,
                |e| matches!(e, E::EyeAtTarget { .. }),
            ),
            (
                |v| v.up = [0.0; 3],
                |e| matches!(e, E::ZeroDirection { field: "up" }),
            ),
            (
                |v| v.up = [0.0, 0.0, -3.0],
                |e| matches!(e, E::UpAlongView { .. }),
            ),
            (
                |v| v.eye[1] = f32::NAN,
                |e| matches!(e, E::Coordinates { field: "eye", .. }),
            ),
            (
                |v| v.look_at[0] = 1e30,
                |e| matches!(e, E::Coordinates { .. }),
            ),
            (
                |v| v.vertical_fov_degrees = 0.0,
                |e| matches!(e, E::OutOfRange { .. }),
            ),
            (
                |v| v.vertical_fov_degrees = 180.0,
                |e| matches!(e, E::OutOfRange { .. }),
            ),
            (
                |v| v.vertical_fov_degrees = -20.0,
                |e| matches!(e, E::OutOfRange { .. }),
            ),
            (
                |v| v.vertical_fov_degrees = f32::NAN,
                |e| matches!(e, E::OutOfRange { .. }),
            ),
        ];
        for (index, (change, expected)) in cases.into_iter().enumerate() {
            let mut view = view();
            change(&mut view);
            let error = Camera::new(&view).unwrap_err();
            assert!(expected(&error), "case {index}: {error}");
        }
    }

    #[test]
    fn framing_refuses_what_is_no_picture() {
        let bounds = Aabb::of_points(&[[0.0; 3], [1.0; 3]]);
        let frame = |up, aspect, fov| Perspective::framing(&bounds, up, aspect, fov);
        assert!(frame([0.0; 3], 1.0, 30.0).is_err());
        assert!(frame([0.0, 1.0, 0.0], 0.0, 30.0).is_err());
        assert!(frame([0.0, 1.0, 0.0], f32::NAN, 30.0).is_err());
        assert!(frame([0.0, 1.0, 0.0], 1.0, 0.0).is_err());
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(256))]

        #[test]
        fn a_framed_motion_is_wholly_in_the_picture(
            a in prop::array::uniform3(-100.0f32..100.0),
            size in prop::array::uniform3(0.0f32..50.0),
            scale in prop::sample::select(vec![1e-4f32, 1.0, 1e4]),
            aspect in 0.3f32..4.0,
            fov in 5.0f32..120.0,
            up in prop::sample::select(vec![[0.0f32, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, -1.0, 0.5]]),
        ) {
            let bounds = Aabb {
                min: a.map(|x| x * scale),
                max: std::array::from_fn(|axis| (a[axis] + size[axis]) * scale),
            };
            let view = Perspective::framing(&bounds, up, aspect, fov).unwrap();
            let camera = Camera::new(&view).unwrap();
            for corner in Stage::new(&bounds, up).corners {
                let place = camera.project(corner.as_vec3().into(), aspect);
                prop_assert!(place.is_some(), "{corner} is behind the camera");
                for x in place.unwrap() {
                    prop_assert!((0.04..=0.96).contains(&x), "{corner} at {place:?}");
                }
            }
        }
    }

    #[test]
    fn a_framed_motion_fills_the_picture() {
        let bounds = Aabb::of_points(&[[-1.0, 0.0, -0.3], [1.0, 1.2, 0.3]]);
        for aspect in [0.5, 1.0, 16.0 / 9.0] {
            let view = Perspective::framing(&bounds, [0.0, 1.0, 0.0], aspect, 24.0).unwrap();
            let camera = Camera::new(&view).unwrap();
            let places = Stage::new(&bounds, view.up)
                .corners
                .map(|corner| camera.project(corner.as_vec3().into(), aspect).unwrap());
            let span = |axis: usize| {
                let along = places.map(|place| place[axis]);
                along.iter().fold(0.0f32, |a, &b| a.max(b))
                    - along.iter().fold(1.0f32, |a, &b| a.min(b))
            };
            assert!(span(0).max(span(1)) > 0.5, "{places:?}");
        }
    }

    #[test]
    fn no_motion_at_all_can_still_be_framed() {
        for bounds in [Aabb::EMPTY, Aabb::of_points(&[[5.0; 3]])] {
            let view = Perspective::framing(&bounds, [0.0, 1.0, 0.0], 1.5, 24.0).unwrap();
            assert!(Camera::new(&view).is_ok());
        }
    }
}
