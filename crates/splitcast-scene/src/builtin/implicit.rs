//! Implicit bodies: smooth unions of pieces with elliptic cross-sections and
//! of ellipsoids (metaballs' descendants; Bloomenthal and Shoemake,
//! "Convolution Surfaces", 1991, and the polynomial smooth minimum of
//! Quilez, "Smooth minimum", 2013).
//!
//! Only `+ - * / sqrt` are used, which IEEE 754 rounds the same everywhere,
//! so a mesh made from a body has the same topology on every machine.

use glam::Vec3;

use super::skeleton::BoneId;

/// Bound on the slope of the distance estimates outside and near the surface;
/// they are exact to first order only at the surface itself.
pub(super) const SLOPE: f32 = 1.3;

/// Segments that a loft gets between two of its sections: enough that the
/// kinks between them stay below the cell size of the meshes.
const LOFT_SUBDIVISIONS: usize = 8;

/// A cross-section of a loft.
#[derive(Clone, Copy, Debug)]
pub(super) struct Section {
    pub(super) center: Vec3,
    /// Half height, across the axis and across `side`.
    pub(super) depth: f32,
    /// Half width, along the part's `side`.
    pub(super) width: f32,
}

/// A section from plain numbers: center, half height, half width.
pub(super) const fn section(center: [f32; 3], depth: f32, width: f32) -> Section {
    Section {
        center: Vec3::from_array(center),
        depth,
        width,
    }
}

/// What a part is made of, about a segment of its axis.
#[derive(Clone, Debug)]
struct Piece {
    start: Vec3,
    span: Vec3,
    inverse_span_squared: f32,
    axis: Vec3,
    side: Vec3,
    up: Vec3,
    /// Depth, width and cap radius at the start and the change to the end.
    radii: Vec3,
    radii_change: Vec3,
    /// Half thickness of a plate: an ellipse across `up`, rounded at the rim.
    plate: Option<f32>,
}

impl Piece {
    /// A tube of elliptic cross-section with rounded ends.
    fn tube(start: Section, end: Section, side: Vec3) -> Self {
        let span = end.center - start.center;
        let axis = span.normalize();
        let side = (side - axis * side.dot(axis)).normalize();
        let radii = |s: Section| Vec3::new(s.depth, s.width, s.depth.min(s.width));
        Self {
            start: start.center,
            span,
            inverse_span_squared: 1.0 / span.length_squared(),
            axis,
            side,
            up: side.cross(axis),
            radii: radii(start),
            radii_change: radii(end) - radii(start),
            plate: None,
        }
    }

    /// An ellipsoid; a plate too, but for its thickness.
    fn ellipsoid(center: Vec3, axis: Vec3, side: Vec3, [along, depth, width]: [f32; 3]) -> Self {
        let axis = axis.normalize();
        let side = (side - axis * side.dot(axis)).normalize();
        Self {
            start: center,
            span: Vec3::ZERO,
            inverse_span_squared: 0.0,
            axis,
            side,
            up: side.cross(axis),
            radii: Vec3::new(depth, width, along),
            radii_change: Vec3::ZERO,
            plate: None,
        }
    }

    fn mirrored(&self) -> Self {
        Self {
            start: mirror(self.start),
            span: mirror(self.span),
            axis: mirror(self.axis),
            side: mirror(self.side),
            up: mirror(self.up),
            ..self.clone()
        }
    }

    fn distance(&self, point: Vec3) -> f32 {
        let from_start = point - self.start;
        let along = (from_start.dot(self.span) * self.inverse_span_squared).clamp(0.0, 1.0);
        let radii = self.radii + self.radii_change * along;
        let offset = from_start - self.span * along;
        let local = Vec3::new(
            offset.dot(self.up),
            offset.dot(self.side),
            offset.dot(self.axis),
        );
        let Some(half_thickness) = self.plate else {
            return first_order(local, radii);
        };
        let rim = first_order(local * Vec3::new(0.0, 1.0, 1.0), radii);
        let outside = Vec3::new(rim.max(0.0), local.x, 0.0).length();
        outside - half_thickness
    }
}

/// Signed distance to an ellipsoid to first order: `k0 (k0 - 1) / k1`, with
/// `k0` its own norm and `k1` the length of the gradient of `k0^2 / 2`
/// (Quilez, "Ellipsoid SDF").
pub(super) fn first_order(local: Vec3, radii: Vec3) -> f32 {
    let inverse = radii.recip();
    let scaled = local * inverse;
    let gradient_squared = (scaled * inverse).length_squared();
    if gradient_squared < 1e-12 {
        return -radii.min_element();
    }
    let k0 = scaled.length();
    k0 * (k0 - 1.0) / gradient_squared.sqrt()
}

/// A piece of a body that is one union of pieces and joins the rest smoothly.
#[derive(Clone, Debug)]
pub(super) struct Part {
    pieces: Vec<Piece>,
    /// Width of the fillet to the parts before it, metres.
    blend: f32,
    /// Bones that may carry the surface of this part.
    pub(super) bones: Vec<BoneId>,
    /// Weight diffusion of the surface: 0 keeps joints sharp, 1 spreads them
    /// over several hand widths.
    pub(super) softness: f32,
    /// sRGB.
    pub(super) color: [u8; 3],
}

impl Part {
    /// A tube through `sections`, a Catmull-Rom spline in centers and radii;
    /// `side` is the direction of the sections' widths.
    pub(super) fn loft(sections: &[Section], side: Vec3, blend: f32) -> Self {
        let fine = subdivide(sections);
        Self::of(
            fine.windows(2)
                .map(|pair| Piece::tube(pair[0], pair[1], side))
                .collect(),
            blend,
        )
    }

    /// An ellipsoid with half sizes along `axis`, across, and along `side`.
    pub(super) fn ellipsoid(
        center: [f32; 3],
        axis: [f32; 3],
        side: Vec3,
        half_sizes: [f32; 3],
        blend: f32,
    ) -> Self {
        let piece = Piece::ellipsoid(center.into(), axis.into(), side, half_sizes);
        Self::of(vec![piece], blend)
    }

    /// A sheet of even thickness with a round rim: an ellipse with half sizes
    /// along `axis` and along `side`.
    pub(super) fn plate(
        center: [f32; 3],
        axis: [f32; 3],
        side: Vec3,
        [along, width]: [f32; 2],
        half_thickness: f32,
        blend: f32,
    ) -> Self {
        let half_sizes = [along - half_thickness, 1.0, width - half_thickness];
        let ellipse = Piece::ellipsoid(center.into(), axis.into(), side, half_sizes);
        Self::of(
            vec![Piece {
                plate: Some(half_thickness),
                ..ellipse
            }],
            blend,
        )
    }

    fn of(pieces: Vec<Piece>, blend: f32) -> Self {
        Self {
            pieces,
            blend,
            bones: Vec::new(),
            softness: 1.0,
            color: [128; 3],
        }
    }

    /// The part as carried by `bones`.
    pub(super) fn on(self, bones: Vec<BoneId>, softness: f32, color: [u8; 3]) -> Self {
        Self {
            bones,
            softness,
            color,
            ..self
        }
    }

    /// The same shape on the other side of the plane z = 0; bones are left out.
    pub(super) fn mirrored(&self) -> Self {
        Self {
            pieces: self.pieces.iter().map(Piece::mirrored).collect(),
            bones: Vec::new(),
            ..self.clone()
        }
    }
}

/// A body: its parts joined in order, cut off flat at the ground.
#[derive(Clone, Debug, Default)]
pub(super) struct Body {
    pub(super) parts: Vec<Part>,
}

/// The pieces that matter in some ball, as (part, tube) in order.
pub(super) type Nearby = Vec<(u16, u16)>;

impl Body {
    /// Signed distance estimate, negative inside, from the pieces of `nearby`.
    pub(super) fn distance(&self, point: Vec3, nearby: &Nearby) -> f32 {
        let mut total = f32::INFINITY;
        for group in nearby.chunk_by(|a, b| a.0 == b.0) {
            let part = &self.parts[usize::from(group[0].0)];
            total = smooth_min(total, part_distance(part, point, group), part.blend);
        }
        total.max(-point.y)
    }

    /// Distance and gradient by four taps at the corners of a tetrahedron.
    pub(super) fn distance_and_gradient(&self, point: Vec3, nearby: &Nearby) -> (f32, Vec3) {
        const REACH: f32 = 2e-3;
        let mut distance = 0.0;
        let mut gradient = Vec3::ZERO;
        for corner in [
            Vec3::new(1.0, 1.0, 1.0),
            Vec3::new(1.0, -1.0, -1.0),
            Vec3::new(-1.0, 1.0, -1.0),
            Vec3::new(-1.0, -1.0, 1.0),
        ] {
            let tap = self.distance(point + corner * REACH, nearby);
            distance += 0.25 * tap;
            gradient += corner * (tap / (4.0 * REACH));
        }
        (distance, gradient)
    }

    /// Every tube.
    pub(super) fn everything(&self) -> Nearby {
        (0..)
            .zip(&self.parts)
            .flat_map(|(id, part)| (0..part.pieces.len() as u16).map(move |piece| (id, piece)))
            .collect()
    }

    /// Those of `candidates` that can shape the surface within `radius` of
    /// `center`. A part further off than the nearest by more than the ball
    /// and its fillet allow has no say there, nor has a piece further off
    /// than the nearest of its part by more than the ball allows.
    pub(super) fn nearby(&self, candidates: &Nearby, center: Vec3, radius: f32) -> Nearby {
        let distances: Vec<f32> = candidates
            .iter()
            .map(|&(part, piece)| {
                self.parts[usize::from(part)].pieces[usize::from(piece)].distance(center)
            })
            .collect();
        let least = |distances: &[f32]| distances.iter().copied().fold(f32::INFINITY, f32::min);
        let slack = 2.0 * SLOPE * radius;
        let nearest = least(&distances);
        let mut nearby = Nearby::new();
        let mut rest = &distances[..];
        for group in candidates.chunk_by(|a, b| a.0 == b.0) {
            let (own, others) = rest.split_at(group.len());
            rest = others;
            let blend = self.parts[usize::from(group[0].0)].blend;
            let limit = slack + least(own).min(nearest + blend);
            let kept = group
                .iter()
                .zip(own)
                .filter(|(_, distance)| **distance <= limit);
            nearby.extend(kept.map(|(id, _)| *id));
        }
        nearby
    }

    /// The part whose own surface is nearest to `point`.
    pub(super) fn nearest_part(&self, point: Vec3, nearby: &Nearby) -> usize {
        let mut best = (f32::INFINITY, 0);
        for group in nearby.chunk_by(|a, b| a.0 == b.0) {
            let index = usize::from(group[0].0);
            let distance = part_distance(&self.parts[index], point, group);
            if distance < best.0 {
                best = (distance, index);
            }
        }
        best.1
    }

    /// A box around every tube, a little wide.
    pub(super) fn bounds(&self) -> (Vec3, Vec3) {
        let mut low = Vec3::INFINITY;
        let mut high = Vec3::NEG_INFINITY;
        for piece in self.parts.iter().flat_map(|part| &part.pieces) {
            for end in 0..2 {
                let center = piece.start + piece.span * end as f32;
                let reach = (piece.radii + piece.radii_change * end as f32).max_element();
                low = low.min(center - reach);
                high = high.max(center + reach);
            }
        }
        low.y = low.y.max(0.0);
        (low, high)
    }
}

fn part_distance(part: &Part, point: Vec3, group: &[(u16, u16)]) -> f32 {
    group.iter().fold(f32::INFINITY, |least, (_, piece)| {
        least.min(part.pieces[usize::from(*piece)].distance(point))
    })
}

/// The quadratic polynomial smooth minimum: equal to `min` where `a` and `b`
/// differ by more than `width`.
pub(super) fn smooth_min(a: f32, b: f32, width: f32) -> f32 {
    let overlap = (width - (a - b).abs()).max(0.0);
    let fillet = if overlap > 0.0 {
        overlap * overlap / (4.0 * width)
    } else {
        0.0
    };
    a.min(b) - fillet
}

fn mirror(v: Vec3) -> Vec3 {
    Vec3::new(v.x, v.y, -v.z)
}

/// Weights of four keys in a row at `t`, from 0 to 1, between the middle ones.
pub(super) fn catmull_rom(t: f32) -> [f32; 4] {
    [
        t * (t * (1.0 - 0.5 * t) - 0.5),
        t * t * (1.5 * t - 2.5) + 1.0,
        t * (t * (2.0 - 1.5 * t) + 0.5),
        t * t * (0.5 * t - 0.5),
    ]
}

/// Catmull-Rom subdivision, with the end sections doubled.
fn subdivide(sections: &[Section]) -> Vec<Section> {
    let last = sections.len() - 1;
    let mut fine = Vec::with_capacity(last * LOFT_SUBDIVISIONS + 1);
    for index in 0..last {
        let [before, from, to, after] = [
            sections[index.saturating_sub(1)],
            sections[index],
            sections[index + 1],
            sections[(index + 2).min(last)],
        ];
        for step in 0..LOFT_SUBDIVISIONS {
            let t = step as f32 / LOFT_SUBDIVISIONS as f32;
            let weights = catmull_rom(t);
            let mix = |value: fn(&Section) -> f32| {
                weights[0] * value(&before)
                    + weights[1] * value(&from)
                    + weights[2] * value(&to)
                    + weights[3] * value(&after)
            };
            fine.push(Section {
                center: Vec3::new(
                    mix(|s| s.center.x),
                    mix(|s| s.center.y),
                    mix(|s| s.center.z),
                ),
                depth: mix(|s| s.depth),
                width: mix(|s| s.width),
            });
        }
    }
    fine.push(sections[last]);
    fine
}

#[cfg(test)]
mod tests {
    use super::*;

    /// One of each: a bent loft, a flat ellipsoid and a plate.
    fn sample() -> Body {
        let loft = Part::loft(
            &[
                section([0.0, 0.3, 0.0], 0.10, 0.08),
                section([0.3, 0.5, 0.0], 0.16, 0.10),
                section([0.6, 0.5, 0.1], 0.06, 0.06),
            ],
            Vec3::Z,
            0.05,
        );
        let flat = Part::ellipsoid(
            [0.3, 0.6, 0.1],
            [1.0, 1.0, 0.0],
            Vec3::Z,
            [0.2, 0.1, 0.08],
            0.06,
        );
        let plate = Part::plate(
            [0.1, 0.7, 0.0],
            [0.0, 1.0, 0.2],
            Vec3::X,
            [0.2, 0.3],
            0.03,
            0.04,
        );
        Body {
            parts: vec![loft, flat.mirrored(), flat, plate],
        }
    }

    /// Points from inside the sample to some way off.
    fn points() -> impl Iterator<Item = Vec3> {
        (0..20 * 20 * 20).map(|index| {
            let at = Vec3::new(
                (index % 20) as f32,
                (index / 20 % 20) as f32,
                (index / 400) as f32,
            );
            Vec3::new(-0.4, 0.05, -0.6) + at * 0.0613
        })
    }

    #[test]
    fn slope_stays_below_its_bound_outside() {
        let body = sample();
        let everything = body.everything();
        for point in points() {
            let (distance, gradient) = body.distance_and_gradient(point, &everything);
            if distance > 0.0 {
                assert!(gradient.length() < SLOPE, "{gradient} at {point}");
            }
        }
    }

    #[test]
    fn pieces_left_out_do_not_move_the_surface() {
        let body = sample();
        let everything = body.everything();
        let mut left_out = 0;
        for point in points() {
            let exact = body.distance(point, &everything);
            if exact.abs() > 0.05 {
                continue;
            }
            // Sorted out for a ball that the point is at the rim of.
            let center = point + Vec3::new(0.03, -0.02, 0.03);
            let nearby = body.nearby(&everything, center, 0.05);
            left_out += everything.len() - nearby.len();
            assert!(
                (body.distance(point, &nearby) - exact).abs() < 1e-6,
                "{point}"
            );
        }
        assert!(left_out > 0);
    }

    #[test]
    fn ellipsoids_and_plates_have_the_sizes_asked_for() {
        let shape = |part: Part| Body { parts: vec![part] };
        let ellipsoid = shape(Part::ellipsoid(
            [0.0, 1.0, 0.0],
            [0.0, 1.0, 0.0],
            Vec3::Z,
            [0.5, 0.3, 0.2],
            0.1,
        ));
        let plate = shape(Part::plate(
            [0.0, 1.0, 0.0],
            [0.0, 1.0, 0.0],
            Vec3::Z,
            [0.5, 0.2],
            0.05,
            0.1,
        ));
        let tips = |depth| [Vec3::Y * 0.5, Vec3::X * depth, Vec3::Z * 0.2];
        for (body, depth) in [(ellipsoid, 0.3), (plate, 0.05)] {
            let everything = body.everything();
            for tip in tips(depth) {
                for point in [Vec3::Y + tip, Vec3::Y - tip] {
                    assert!(body.distance(point, &everything).abs() < 1e-6, "{point}");
                }
            }
            assert!(body.distance(Vec3::Y, &everything) < 0.0);
        }
    }

    #[test]
    fn smooth_minimum_is_the_minimum_beyond_its_width() {
        assert_eq!(smooth_min(0.3, 0.1, 0.2), 0.1);
        assert_eq!(smooth_min(f32::INFINITY, 0.1, 0.2), 0.1);
        assert_eq!(smooth_min(0.25, 0.25, 0.5), 0.125);
    }
}
