//! A pinhole camera in perspective, and the view that frames a whole motion.

use glam::{DVec3, Vec3};
use splitcast::{Aabb, Ray};

use crate::RenderError;
use crate::lanes::{Lanes, Vector};
use crate::options::{check_coordinates, check_direction, check_range};
use crate::stage::Stage;

/// Vertical field of view when none is asked for, in degrees: about a 65 mm
/// lens on 35 mm film, long enough to keep proportions natural.
pub const DEFAULT_FOV_DEGREES: f32 = 24.0;

/// Share of the half picture that a framed motion leaves free at each border.
const MARGIN: f64 = 0.12;

/// Shadows of points up to this share of the motion's height are always framed:
/// those of feet and of what lies about join the motion to the ground.
const NEAR_GROUND: f64 = 0.25;

/// How much farther away than the motion needs the camera may stand so that
/// shadows of higher points are in the picture: enough for a long shadow beside
/// a standing animal, little beside one thrown for a moment by something that
/// flies.
const SHADOW_ALLOWANCE: f64 = 0.1;

/// Halvings of an interval from 0 to 1: to the precision of the coordinates.
const HALVINGS: usize = 32;

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
    /// A three-quarter view that shows a whole motion with a margin, in the
    /// middle of the picture together with its shadow under the default sun.
    /// A motion that is longest along one horizontal axis is seen rather from
    /// its side. `aspect` is the picture's width over its height.
    ///
    /// `points` are vertices, or what spans their convex hull, of all frames;
    /// those with a coordinate that is not finite are passed over, and without
    /// any, the picture is of the unit cube around the origin. The ground is at
    /// the lower side of the box around them.
    ///
    /// Shadows of points in the lowest quarter of the motion count as parts of
    /// it. To frame those of higher points, the camera moves away by a tenth of
    /// its distance at most; where this is not enough, all of them are framed
    /// only for an equal part of their way from the point to the ground.
    ///
    /// # Errors
    /// [`RenderError`] if `up` is no direction, or if the aspect or the field
    /// of view is out of range.
    pub fn framing(
        points: &[[f32; 3]],
        up: [f32; 3],
        aspect: f32,
        vertical_fov_degrees: f32,
    ) -> Result<Self, RenderError> {
        check_direction("up", up)?;
        check_aspect(aspect)?;
        let half_height = half_height(vertical_fov_degrees)? * (1.0 - MARGIN);
        let slopes = [half_height * f64::from(aspect), half_height];

        let finite = points.iter().filter(|p| p.iter().all(|x| x.is_finite()));
        let mut motion: Vec<[f32; 3]> = finite.copied().collect();
        let bounds = Aabb::of_points(&motion);
        let stage = Stage::new(&bounds, up);
        if bounds.min == bounds.max || bounds.is_empty() {
            motion = stage.corners.map(|c| c.as_vec3().into()).to_vec();
        }

        let view = ViewAxes::new(&stage);
        let (mut framed, shadows) = view.motion_and_shadows(&stage, &motion);
        let allowed = distance(&framed, slopes) * (1.0 + SHADOW_ALLOWANCE);
        add_shadows(&mut framed, &shadows, allowed, slopes);

        let nearest = framed.iter().map(|p| p.z).fold(f64::NEG_INFINITY, f64::max);
        // A flat picture of a flat motion could otherwise put the eye on it.
        let back = distance(&framed, slopes).max(nearest + 1e-3 * stage.radius);
        let right = middle(&framed, 0, slopes[0], back);
        let above = middle(&framed, 1, slopes[1], back);
        let look_at = stage.centre + view.right * right + view.above * above;
        Ok(Self {
            eye: (look_at + view.back * back).as_vec3().into(),
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
        let [depth, x, y] = self.seen(Vector::from(Vec3::from(point)), aspect);
        (depth > 0.0).then_some([x, y])
    }

    /// How deep behind the eye's plane points lie, and, if that is above 0, where they appear.
    #[inline(always)]
    pub(crate) fn seen<L: Lanes>(&self, point: Vector<L>, aspect: f32) -> [L; 3] {
        let towards = point - Vector::splat(point.x, self.eye);
        let depth = towards.dot_with(self.forward);
        let across = towards.dot_with(self.right) / (depth * self.right.length_squared());
        let above = towards.dot_with(self.up) / (depth * self.up.length_squared());
        let half = depth.splat(0.5);
        [depth, across * 0.5 / aspect + 0.5, half - above * 0.5]
    }

    /// What moves by no more than a share of its depth moves by no more than this in the picture, in heights of
    /// that.
    pub(crate) fn shift(&self, share: f32, aspect: f32) -> f32 {
        // The place is across / depth, and both may be off; the picture ends at half a height or width.
        share * (0.5 / self.up.length() + 0.5 * aspect.max(1.0))
    }

    /// The ray, of unit direction, through a point of the picture: (0, 0) is
    /// its top left corner, (1, 1) its bottom right one.
    pub fn ray(&self, [x, y]: [f32; 2], aspect: f32) -> Ray {
        let direction: Vec3 = self.towards(x, y, aspect).normalize().into();
        Ray::new(self.eye.into(), direction.into())
    }

    /// From the eye to points of the picture where that is at distance 1: linear in both coordinates.
    #[inline(always)]
    pub(crate) fn towards<L: Lanes>(&self, x: L, y: L, aspect: f32) -> Vector<L> {
        let across = (x * 2.0 - 1.0) * aspect;
        let above = (y * 2.0).rest();
        Vector::splat(x, self.forward)
            + Vector::splat(x, self.right) * across
            + Vector::splat(x, self.up) * above
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

/// The default camera's directions. Coordinates of a view are along right,
/// above and back, from the stage's centre.
struct ViewAxes {
    right: DVec3,
    above: DVec3,
    back: DVec3,
}

impl ViewAxes {
    fn new(stage: &Stage) -> Self {
        let back = stage.default_view();
        let right = stage.up().cross(back).normalize();
        let above = back.cross(right);
        Self { right, above, back }
    }

    /// In the view's coordinates the motion with its shadows near the ground,
    /// and all its other points, each with its shadow.
    fn motion_and_shadows(
        &self,
        stage: &Stage,
        motion: &[[f32; 3]],
    ) -> (Vec<DVec3>, Vec<[DVec3; 2]>) {
        let (sun, up) = (stage.default_sun(), stage.up());
        let per_height = sun / sun.dot(up);
        let height = |point: DVec3| point.dot(up) - stage.floor;
        let near = NEAR_GROUND * stage.corners.map(height).into_iter().fold(0.0, f64::max);
        let mut framed = Vec::with_capacity(2 * motion.len());
        let mut shadows = Vec::with_capacity(motion.len());
        for &point in motion {
            let point = Vec3::from(point).as_dvec3();
            let shadow = point - per_height * height(point);
            let [place, shadow_place] = [point, shadow].map(|p| self.coordinates(stage, p));
            framed.push(place);
            if height(point) <= near {
                framed.push(shadow_place);
            } else {
                shadows.push([place, shadow_place]);
            }
        }
        (framed, shadows)
    }

    fn coordinates(&self, stage: &Stage, point: DVec3) -> DVec3 {
        let point = point - stage.centre;
        DVec3::new(
            point.dot(self.right),
            point.dot(self.above),
            point.dot(self.back),
        )
    }
}

/// Adds to the `framed` points those on the ways to their `shadows` that are
/// the farthest, by the same part of the way for all, in view from `allowed`.
fn add_shadows(framed: &mut Vec<DVec3>, shadows: &[[DVec3; 2]], allowed: f64, slopes: [f64; 2]) {
    let part_way = |part: f64| shadows.iter().map(move |[from, to]| from.lerp(*to, part));
    // The distance that the points on their ways need is convex in the part, and allowed at 0.
    let part = largest_part(|part| {
        let points: Vec<DVec3> = part_way(part).collect();
        let all = |axis: usize| {
            let [a, b] = [framed.as_slice(), &points].map(|p| borders(p, axis, slopes[axis]));
            depth([a[0].max(b[0]), a[1].max(b[1])], slopes[axis])
        };
        all(0).max(all(1)) <= allowed
    });
    framed.extend(part_way(part));
}

/// How far in front of the stage's centre the eye has to be to see `points`
/// within the slopes to right and left, and to above and below.
fn distance(points: &[DVec3], slopes: [f64; 2]) -> f64 {
    let along = |axis: usize| depth(borders(points, axis, slopes[axis]), slopes[axis]);
    along(0).max(along(1))
}

/// Where across the view the eye has to be, `back` in front of the centre, for
/// the outermost points of both sides to appear equally far from the middle.
fn middle(points: &[DVec3], axis: usize, slope: f64, back: f64) -> f64 {
    // At the least slope within which the eye still sees all points it has no other place.
    let part = largest_part(|part| {
        let slope = slope * (1.0 - part);
        slope > 0.0 && depth(borders(points, axis, slope), slope) <= back
    });
    let [a, b] = borders(points, axis, slope * (1.0 - part));
    0.5 * (a - b)
}

/// A point is in view if it is no farther from the axis than `slope` times its
/// depth in front of the eye. On each of two opposite sides this bounds the
/// eye by one inequality that is linear in its place: with x the coordinate
/// along the axis and z the one along back, `slope * z + x` is at least the
/// first of these borders and `slope * z - x` the second.
fn borders(points: &[DVec3], axis: usize, slope: f64) -> [f64; 2] {
    points.iter().fold([f64::NEG_INFINITY; 2], |[a, b], point| {
        let (x, z) = (point[axis], slope * point.z);
        [a.max(z + x), b.max(z - x)]
    })
}

/// The least z that both of the borders allow.
fn depth([a, b]: [f64; 2], slope: f64) -> f64 {
    0.5 * (a + b) / slope
}

/// The largest part from 0 to 1 that is allowed, if 0 is and all from there to
/// some part are.
fn largest_part(is_allowed: impl Fn(f64) -> bool) -> f64 {
    if is_allowed(1.0) {
        return 1.0;
    }
    let (mut allowed, mut too_large) = (0.0, 1.0);
    for _ in 0..HALVINGS {
        let half = 0.5 * (allowed + too_large);
        if is_allowed(half) {
            allowed = half;
        } else {
            too_large = half;
        }
    }
    allowed
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
        let points = [[0.0; 3], [1.0; 3]];
        let frame = |up, aspect, fov| Perspective::framing(&points, up, aspect, fov);
        assert!(frame([0.0; 3], 1.0, 30.0).is_err());
        assert!(frame([0.0, 1.0, 0.0], 0.0, 30.0).is_err());
        assert!(frame([0.0, 1.0, 0.0], f32::NAN, 30.0).is_err());
        assert!(frame([0.0, 1.0, 0.0], 1.0, 0.0).is_err());
    }

    /// Where the framing's camera sees `points`.
    fn places(view: &Perspective, points: &[[f32; 3]], aspect: f32) -> Vec<[f32; 2]> {
        let camera = Camera::new(view).unwrap();
        let project = |&point| camera.project(point, aspect).expect("in front of the eye");
        points.iter().map(project).collect()
    }

    /// Least and greatest along one axis of the picture.
    fn span(places: &[[f32; 2]], axis: usize) -> [f32; 2] {
        let along = places.iter().map(|place| place[axis]);
        along.fold([f32::INFINITY, f32::NEG_INFINITY], |[a, b], x| {
            [a.min(x), b.max(x)]
        })
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(256))]

        #[test]
        fn a_framed_motion_is_in_the_picture_with_its_shadow_near_the_ground(
            middle in prop::array::uniform3(-100.0f32..100.0),
            offsets in prop::collection::vec(prop::array::uniform3(-50.0f32..50.0), 2..30),
            scale in prop::sample::select(vec![1e-4f32, 1.0, 1e4]),
            aspect in 0.3f32..4.0,
            fov in 5.0f32..120.0,
            up in prop::sample::select(vec![[0.0f32, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, -1.0, 0.5]]),
        ) {
            let place = |p: &[f32; 3]| std::array::from_fn(|i| (middle[i] + p[i]) * scale);
            let mut seen: Vec<[f32; 3]> = offsets.iter().map(place).collect();
            let view = Perspective::framing(&seen, up, aspect, fov).unwrap();

            let stage = Stage::new(&Aabb::of_points(&seen), up);
            let height = |p: DVec3| p.dot(stage.up()) - stage.floor;
            let total = stage.corners.map(height).into_iter().fold(0.0, f64::max);
            let sun = stage.default_sun();
            let low = seen.iter().map(|&p| Vec3::from(p).as_dvec3()).filter(|&p| height(p) < 0.2 * total);
            let shadows: Vec<[f32; 3]> = low
                .map(|p| (p - sun * (height(p) / sun.dot(stage.up()))).as_vec3().into())
                .collect();
            seen.extend(shadows);
            for place in places(&view, &seen, aspect) {
                for x in place {
                    prop_assert!((0.055..=0.945).contains(&x), "{place:?}");
                }
            }
        }
    }

    #[test]
    fn a_framed_motion_fills_the_picture_and_is_in_its_middle() {
        // All of it lies on the ground, so that it is its own shadow.
        let points = [
            [-1.0, 0.0, -1.3],
            [1.0, 0.0, 0.2],
            [0.3, 0.0, 0.8],
            [-0.8, 0.0, 0.1],
        ];
        for aspect in [0.3, 1.0, 16.0 / 9.0, 5.0] {
            let view = Perspective::framing(&points, [0.0, 1.0, 0.0], aspect, 24.0).unwrap();
            let places = places(&view, &points, aspect);
            let spans = [0, 1].map(|axis| span(&places, axis));
            for [least, greatest] in spans {
                assert!((least + greatest - 1.0).abs() < 1e-3, "{spans:?}");
            }
            let widest = spans.map(|[a, b]| b - a).into_iter().fold(0.0, f32::max);
            assert!((widest - 0.88).abs() < 1e-3, "{spans:?}");
        }
    }

    #[test]
    fn what_is_high_up_does_not_shrink_the_picture_by_its_shadow() {
        let up = [0.0, 1.0, 0.0];
        // Something in the air above the right end of a bar on the ground: its shadow falls beyond.
        let points = [[-1.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.9, 3.0, 0.0]];
        let view = Perspective::framing(&points, up, 0.5, 24.0).unwrap();
        let places = places(&view, &points, 0.5);
        let width = |[a, b]: [f32; 2]| b - a;
        let size = width(span(&places, 0)).max(width(span(&places, 1)));
        let least = 0.88 / (1.0 + SHADOW_ALLOWANCE as f32) - 0.05;
        assert!((least..0.88).contains(&size), "{size}");
    }

    #[test]
    fn the_empty_corners_of_the_box_do_not_matter() {
        let up = [0.0, 1.0, 0.0];
        let diagonal = [[-1.0, 0.0, -1.0], [1.0, 0.0, 1.0], [0.0, 0.5, 0.0]];
        let view = Perspective::framing(&diagonal, up, 1.0, 24.0).unwrap();
        let nearer = Vec3::from(view.eye).distance(Vec3::from(view.look_at));
        let with_corners = [[-1.0, 0.0, 1.0], [1.0, 0.0, -1.0]];
        let view = Perspective::framing(&[&diagonal[..], &with_corners].concat(), up, 1.0, 24.0);
        let view = view.unwrap();
        let farther = Vec3::from(view.eye).distance(Vec3::from(view.look_at));
        assert!(nearer < 0.8 * farther, "{nearer} and {farther}");
    }

    #[test]
    fn no_motion_at_all_can_still_be_framed() {
        let nothing: [&[[f32; 3]]; 3] = [&[], &[[5.0; 3], [5.0; 3]], &[[f32::NAN, 0.0, 0.0]]];
        for points in nothing {
            let view = Perspective::framing(points, [0.0, 1.0, 0.0], 1.5, 24.0).unwrap();
            let distance = Vec3::from(view.eye).distance(Vec3::from(view.look_at));
            assert!((2.0..8.0).contains(&distance), "{view:?}");
        }
    }
}
