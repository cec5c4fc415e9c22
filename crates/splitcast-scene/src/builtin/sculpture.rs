//! Solid bodies modelled as smooth unions of round cones, ellipsoids and
//! plates, given by their signed distance: negative inside, positive outside,
//! in metres. Where [`super::implicit`] carries flesh on bones, this serves
//! still figures with thin and sharp parts.
//!
//! Distances after I. Quilez, "Distance functions" (iquilezles.org). A union
//! of parts is close to the true distance at the surface, where alone it is
//! relied on.

use glam::Vec3;

use super::implicit::{catmull_rom, first_order, smooth_min};

/// One part of a sculpture.
#[derive(Clone, Copy, Debug)]
pub(super) struct Part {
    shape: Shape,
    /// Width of the blend into the parts before it, in metres.
    blend: f32,
    color: [u8; 3],
    /// A sphere around the shape: centre and radius.
    bound: (Vec3, f32),
}

#[derive(Clone, Copy, Debug)]
enum Shape {
    /// The hull of two spheres.
    RoundCone { ends: [Vec3; 2], radii: [f32; 2] },
    /// An ellipsoid with orthonormal axes.
    Ellipsoid {
        centre: Vec3,
        axes: [Vec3; 3],
        radii: Vec3,
    },
    /// A triangle grown by a radius.
    Plate { corners: [Vec3; 3], radius: f32 },
}

/// A body as a union of parts, in the order in which they are blended.
#[derive(Clone, Debug, Default)]
pub(super) struct Sculpture {
    parts: Vec<Part>,
}

impl Sculpture {
    /// Adds the hull of two spheres.
    pub(super) fn round_cone(&mut self, ends: [Vec3; 2], radii: [f32; 2], style: Style) {
        let [a, b] = ends;
        let reach = 0.5 * a.distance(b) + radii[0].max(radii[1]);
        self.add(
            Shape::RoundCone { ends, radii },
            ((a + b) * 0.5, reach),
            style,
        );
    }

    /// Adds a chain of round cones through a Catmull-Rom spline of `knots`,
    /// each a point and a radius; the end knots are reached.
    pub(super) fn limb(&mut self, knots: &[(Vec3, f32)], style: Style) {
        const STEPS: usize = 6;
        for span in 0..knots.len() - 1 {
            let at = |step: usize| spline(knots, span, step as f32 / STEPS as f32);
            for step in 0..STEPS {
                let ((a, radius_a), (b, radius_b)) = (at(step), at(step + 1));
                // Links overlap in full, so only the chain as a whole is blended.
                self.round_cone([a, b], [radius_a, radius_b], style);
            }
        }
    }

    /// Adds an ellipsoid of `radii` along `forward`, the direction across it
    /// nearest to `up`, and the third.
    pub(super) fn ellipsoid(
        &mut self,
        centre: Vec3,
        radii: Vec3,
        forward: Vec3,
        up: Vec3,
        style: Style,
    ) {
        let first = forward.normalize();
        let third = first.cross(up).normalize();
        let axes = [first, third.cross(first), third];
        let shape = Shape::Ellipsoid {
            centre,
            axes,
            radii,
        };
        self.add(shape, (centre, radii.max_element()), style);
    }

    /// Adds a triangle grown by `radius`.
    pub(super) fn plate(&mut self, corners: [Vec3; 3], radius: f32, style: Style) {
        let centre = (corners[0] + corners[1] + corners[2]) / 3.0;
        let reach = corners
            .map(|c| c.distance(centre))
            .into_iter()
            .fold(0.0, f32::max);
        self.add(
            Shape::Plate { corners, radius },
            (centre, reach + radius),
            style,
        );
    }

    fn add(&mut self, shape: Shape, bound: (Vec3, f32), style: Style) {
        self.parts.push(Part {
            shape,
            blend: style.blend,
            color: style.color,
            bound,
        });
    }

    /// Signed distance of `point` from the surface, in metres.
    pub(super) fn distance(&self, point: Vec3) -> f32 {
        let mut nearest = f32::MAX;
        for part in &self.parts {
            // Parts too far away to be blended in need no exact distance.
            let (centre, reach) = part.bound;
            let limit = nearest + part.blend + reach;
            if limit <= 0.0 || point.distance_squared(centre) >= limit * limit {
                continue;
            }
            nearest = smooth_min(nearest, part.shape.distance(point), part.blend);
        }
        nearest
    }

    /// The parts that have a say within `radius` of `centre`, where the
    /// distance of the whole is at most `greatest`.
    pub(super) fn near(&self, centre: Vec3, radius: f32, greatest: f32) -> Self {
        // A part may also bear on the outcome by way of another one, which it
        // lowers by up to a quarter of their blend.
        let blend = 1.25 * self.parts.iter().map(|p| p.blend).fold(0.0, f32::max);
        let matters = |part: &&Part| {
            let (middle, reach) = part.bound;
            middle.distance(centre) - reach - radius < greatest + blend
        };
        Self {
            parts: self.parts.iter().filter(matters).copied().collect(),
        }
    }

    /// Direction of steepest ascent of the distance: the outward unit normal
    /// at the surface. `step` is the spacing of the differences in metres.
    pub(super) fn normal(&self, point: Vec3, step: f32) -> Vec3 {
        // The four corners of a tetrahedron see every direction alike.
        const CORNERS: [Vec3; 4] = [
            Vec3::new(1.0, -1.0, -1.0),
            Vec3::new(-1.0, -1.0, 1.0),
            Vec3::new(-1.0, 1.0, -1.0),
            Vec3::new(1.0, 1.0, 1.0),
        ];
        let ascent: Vec3 = CORNERS
            .iter()
            .map(|&corner| corner * self.distance(point + corner * step))
            .sum();
        ascent.try_normalize().unwrap_or(Vec3::Y)
    }

    /// Colour of the surface at `point`: that of the parts around, mixed over
    /// a few millimetres where they meet.
    pub(super) fn color(&self, point: Vec3) -> [u8; 3] {
        const SOFTNESS: f32 = 0.004;
        /// Parts farther away than this have no share to speak of.
        const REACH: f32 = 0.04;
        let near = |part: &&Part| {
            let (centre, reach) = part.bound;
            point.distance_squared(centre) < (reach + REACH) * (reach + REACH)
        };
        let near: Vec<(f32, [u8; 3])> = (self.parts.iter().filter(near))
            .map(|part| (part.shape.distance(point), part.color))
            .collect();
        let least = near.iter().map(|part| part.0).fold(f32::MAX, f32::min);
        let mut sum = Vec3::ZERO;
        let mut total = f32::MIN_POSITIVE;
        for (distance, color) in near {
            let share = SOFTNESS / (SOFTNESS + distance - least);
            let weight = share * share * share * share;
            sum += Vec3::from(color.map(f32::from)) * weight;
            total += weight;
        }
        (sum / total)
            .to_array()
            .map(|channel| channel.round() as u8)
    }

    /// A box around the body: least and greatest corner.
    pub(super) fn bounds(&self) -> (Vec3, Vec3) {
        let mut least = Vec3::MAX;
        let mut greatest = Vec3::MIN;
        for part in &self.parts {
            let (centre, reach) = part.bound;
            // A smooth union bulges by at most a quarter of the blend.
            least = least.min(centre - reach - 0.25 * part.blend);
            greatest = greatest.max(centre + reach + 0.25 * part.blend);
        }
        (least, greatest)
    }
}

/// How a part joins the others and looks.
#[derive(Clone, Copy, Debug)]
pub(super) struct Style {
    /// Width of the blend into the parts added before, in metres, above zero.
    pub(super) blend: f32,
    pub(super) color: [u8; 3],
}

impl Shape {
    fn distance(&self, point: Vec3) -> f32 {
        match *self {
            Shape::RoundCone { ends, radii } => round_cone(point, ends, radii),
            Shape::Ellipsoid {
                centre,
                axes,
                radii,
            } => {
                let offset = point - centre;
                let local = Vec3::from(axes.map(|axis| offset.dot(axis)));
                // The estimate falls short at a distance from stretched ones;
                // none is nearer than the sphere around it.
                first_order(local, radii).max(local.length() - radii.max_element())
            }
            Shape::Plate { corners, radius } => triangle_distance(point, corners) - radius,
        }
    }
}

fn round_cone(point: Vec3, [a, b]: [Vec3; 2], [radius_a, radius_b]: [f32; 2]) -> f32 {
    let axis = b - a;
    let length_squared = axis.length_squared();
    let difference = radius_a - radius_b;
    let slant_squared = length_squared - difference * difference;
    if slant_squared <= 0.0 {
        // One ball holds the other.
        return (point.distance(a) - radius_a).min(point.distance(b) - radius_b);
    }
    let offset = point - a;
    let along = offset.dot(axis);
    let beyond = along - length_squared;
    let aside = (offset * length_squared - axis * along).length_squared();
    let beyond_squared = beyond * beyond * length_squared;
    let along_squared = along * along * length_squared;
    let k = difference.signum() * difference * difference * aside;
    if beyond.signum() * slant_squared * beyond_squared > k {
        (aside + beyond_squared).sqrt() / length_squared - radius_b
    } else if along.signum() * slant_squared * along_squared < k {
        (aside + along_squared).sqrt() / length_squared - radius_a
    } else {
        ((aside * slant_squared / length_squared).sqrt() + along * difference) / length_squared
            - radius_a
    }
}

/// Unsigned distance from a triangle.
fn triangle_distance(point: Vec3, [a, b, c]: [Vec3; 3]) -> f32 {
    let normal = (b - a).cross(c - a);
    let inside = |from: Vec3, to: Vec3| (to - from).cross(normal).dot(point - from) <= 0.0;
    if inside(a, b) && inside(b, c) && inside(c, a) {
        return (normal.dot(point - a) / normal.length()).abs();
    }
    let to_edge = |from: Vec3, to: Vec3| {
        let edge = to - from;
        let t = ((point - from).dot(edge) / edge.length_squared()).clamp(0.0, 1.0);
        (from + edge * t).distance(point)
    };
    to_edge(a, b).min(to_edge(b, c)).min(to_edge(c, a))
}

/// Catmull-Rom spline (1974) through points and radii at `t` in span `span`.
pub(super) fn spline(knots: &[(Vec3, f32)], span: usize, t: f32) -> (Vec3, f32) {
    let p1 = knots[span];
    let p2 = knots[span + 1];
    let p0 = if span == 0 { p1 } else { knots[span - 1] };
    let p3 = *knots.get(span + 2).unwrap_or(&p2);
    let mut point = Vec3::ZERO;
    let mut radius = 0.0;
    for (weight, knot) in catmull_rom(t).into_iter().zip([p0, p1, p2, p3]) {
        point += knot.0 * weight;
        radius += knot.1 * weight;
    }
    (point, radius)
}

#[cfg(test)]
mod tests {
    use super::*;

    const STYLE: Style = Style {
        blend: 0.01,
        color: [10, 20, 30],
    };

    #[test]
    fn a_round_cone_is_two_balls_and_the_tangent_cone() {
        let mut cone = Sculpture::default();
        cone.round_cone([Vec3::ZERO, Vec3::X * 5.0], [4.0, 1.0], STYLE);
        assert!((cone.distance(Vec3::X * -6.0) - 2.0).abs() < 1.0e-5);
        assert!((cone.distance(Vec3::X * 8.0) - 2.0).abs() < 1.0e-5);
        // With sine 3/5 the cone touches the large ball at 4 * (3/5, 4/5) and
        // the small one at (5, 0) + (3/5, 4/5); outwards is (3/5, 4/5).
        let outward = Vec3::new(0.6, 0.8, 0.0);
        let touch = (outward * 4.0 + Vec3::X * 5.0 + outward) * 0.5;
        assert!((cone.distance(touch + outward * 0.7) - 0.7).abs() < 1.0e-5);
        assert!((cone.distance(touch - outward * 0.1) + 0.1).abs() < 1.0e-5);
        assert!(cone.normal(touch, 1.0e-2).distance(outward) < 1.0e-3);
    }

    #[test]
    fn a_ball_within_a_ball_leaves_the_larger() {
        let mut cone = Sculpture::default();
        cone.round_cone([Vec3::ZERO, Vec3::X * 0.5], [2.0, 0.5], STYLE);
        assert!((cone.distance(Vec3::Y * 3.0) - 1.0).abs() < 1.0e-6);
    }

    #[test]
    fn a_plate_is_as_thick_as_asked_and_rounded() {
        let mut plate = Sculpture::default();
        plate.plate([Vec3::ZERO, Vec3::X, Vec3::Z], 0.1, STYLE);
        assert!((plate.distance(Vec3::new(0.2, 0.3, 0.2)) - 0.2).abs() < 1.0e-6);
        assert!((plate.distance(Vec3::new(-0.3, 0.0, 0.5)) - 0.2).abs() < 1.0e-6);
        assert!((plate.distance(Vec3::new(-0.3, 0.4, 0.0)) - 0.4).abs() < 1.0e-6);
        assert!(plate.distance(Vec3::new(0.2, 0.05, 0.2)) < 0.0);
    }

    #[test]
    fn blended_parts_are_inside_the_bounds() {
        let mut body = Sculpture::default();
        body.ellipsoid(
            Vec3::ZERO,
            Vec3::new(0.3, 0.1, 0.2),
            Vec3::Y,
            Vec3::X,
            STYLE,
        );
        body.round_cone(
            [Vec3::X * 0.3, Vec3::X * 0.5],
            [0.1, 0.05],
            Style {
                blend: 0.2,
                ..STYLE
            },
        );
        let (least, greatest) = body.bounds();
        for i in 0..1000 {
            let share = |k: i32| (i / k % 10) as f32 / 9.0;
            let point = Vec3::new(share(1), share(10), share(100)) * 2.0 - 1.0;
            let inside = point.cmpge(least).all() && point.cmple(greatest).all();
            assert!(inside || body.distance(point) > 0.0, "{point}");
        }
        assert_eq!(body.color(Vec3::Y * 0.3), STYLE.color);
    }
}
