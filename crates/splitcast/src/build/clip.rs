//! Boxes of triangles clipped to cells: what Wald & Havran (2006) call perfect
//! splits.
//!
//! A triangle's own box, cut at the borders of a cell, can claim space that the
//! triangle never enters. The box of the polygon that is left inside the cell
//! does not. The polygon comes from Sutherland & Hodgman (1974): cut by one
//! half-space after the other.
//!
//! The result may be too large by a rounding error, but never too small, so
//! that no tree built with it loses a triangle. Points are computed in double
//! precision; every computed point is off by at most [`SLACK`] times the
//! largest coordinate; planes are moved outwards by as much before the cut, so
//! that no point is cut off by another's error, and the box grows by as much
//! before it is rounded outwards to single precision.

use crate::Aabb;

/// Bound on the relative error of a clipped point. One cut adds
/// `a + (b - a) * t`: 4 roundings in `t`, 2 in the product of at most twice the
/// largest coordinate S, 1 in the sum, together 13 · 2⁻⁵³ S. Six cuts stay
/// below 2⁻⁴⁶ S.
const SLACK: f64 = 1.0 / (1_u64 << 46) as f64;

/// Most corners after six cuts, even of a polygon that rounding has made
/// slightly concave: a cut of n corners leaves no more than one and a half
/// times as many (3, 4, 6, 9, 13, 19, 28).
const MAX_CORNERS: usize = 28;

/// The box of the part of a triangle that lies in `cell`, itself inside `cell`;
/// `None` if they are apart. `corners` are finite and `cell` is not empty.
pub(crate) fn clipped_bounds(corners: &[[f32; 3]; 3], cell: &Aabb) -> Option<Aabb> {
    let full = Aabb::of_points(corners);
    let overlap = Aabb {
        min: std::array::from_fn(|axis| full.min[axis].max(cell.min[axis])),
        max: std::array::from_fn(|axis| full.max[axis].min(cell.max[axis])),
    };
    if overlap.is_empty() {
        return None;
    }
    let largest = corners
        .iter()
        .flatten()
        .fold(0.0, |s: f32, x| s.max(x.abs()));
    let slack = f64::from(largest) * SLACK;

    let mut polygon = Polygon::of_triangle(corners);
    for axis in 0..3 {
        if full.min[axis] < cell.min[axis] {
            polygon = polygon.cut(axis, 1.0, f64::from(cell.min[axis]) - slack);
        }
        if full.max[axis] > cell.max[axis] {
            polygon = polygon.cut(axis, -1.0, f64::from(cell.max[axis]) + slack);
        }
    }
    if polygon.count == 0 {
        return None;
    }

    let mut clipped = overlap;
    for axis in 0..3 {
        let coordinates = polygon.corners().iter().map(|corner| corner[axis]);
        let (low, high) = coordinates.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), x| {
            (low.min(x), high.max(x))
        });
        let within = |x: f32| x.max(overlap.min[axis]).min(overlap.max[axis]);
        clipped.min[axis] = within(round_down(low - slack));
        clipped.max[axis] = within(-round_down(-(high + slack)));
    }
    Some(clipped)
}

/// A convex polygon in space.
struct Polygon {
    corners: [[f64; 3]; MAX_CORNERS],
    count: usize,
}

impl Polygon {
    const EMPTY: Self = Self {
        corners: [[0.0; 3]; MAX_CORNERS],
        count: 0,
    };

    fn of_triangle(corners: &[[f32; 3]; 3]) -> Self {
        let mut polygon = Self::EMPTY;
        for corner in corners {
            polygon.push(corner.map(f64::from));
        }
        polygon
    }

    fn corners(&self) -> &[[f64; 3]] {
        &self.corners[..self.count]
    }

    fn push(&mut self, corner: [f64; 3]) {
        self.corners[self.count] = corner;
        self.count += 1;
    }

    /// The part with `sign * (x[axis] - plane) >= 0`.
    fn cut(&self, axis: usize, sign: f64, plane: f64) -> Self {
        let distance = |corner: &[f64; 3]| sign * (corner[axis] - plane);
        let mut part = Self::EMPTY;
        let Some(mut a) = self.corners().last() else {
            return part;
        };
        let mut distance_a = distance(a);
        for b in self.corners() {
            let distance_b = distance(b);
            if (distance_a >= 0.0) != (distance_b >= 0.0) {
                let t = distance_a / (distance_a - distance_b);
                let mut crossing = std::array::from_fn(|k| a[k] + (b[k] - a[k]) * t);
                crossing[axis] = plane;
                part.push(crossing);
            }
            if distance_b >= 0.0 {
                part.push(*b);
            }
            (a, distance_a) = (b, distance_b);
        }
        part
    }
}

/// The largest single-precision number that is not above `x`.
fn round_down(x: f64) -> f32 {
    let nearest = x as f32;
    if f64::from(nearest) > x {
        nearest.next_down()
    } else {
        nearest
    }
}
