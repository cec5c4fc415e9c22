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

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn contains(outer: &Aabb, inner: &Aabb) -> bool {
        *outer == outer.union(inner)
    }

    /// Coordinates of one magnitude: eighths, where corners often lie in planes, or anything.
    fn coordinate() -> impl Strategy<Value = f32> {
        prop_oneof![(-8..=8).prop_map(|x| x as f32 / 8.0), -1.0_f32..1.0]
    }

    fn point() -> impl Strategy<Value = [f32; 3]> {
        prop::array::uniform3(coordinate())
    }

    fn scale() -> impl Strategy<Value = f32> {
        prop_oneof![Just(1.0), Just(1e12), Just(1e-20), Just(1e-38)]
    }

    fn scaled(point: [f32; 3], scale: f32) -> [f32; 3] {
        point.map(|x| x * scale)
    }

    fn triangle() -> impl Strategy<Value = [[f32; 3]; 3]> {
        let degenerate = prop_oneof![
            point().prop_map(|a| [a, a, a]),
            (point(), point()).prop_map(|(a, b)| [a, b, a]),
            (point(), point()).prop_map(|(a, b)| [
                a,
                std::array::from_fn(|k| (a[k] + b[k]) / 2.0),
                b
            ]),
        ];
        prop_oneof![4 => prop::array::uniform3(point()), 1 => degenerate]
    }

    /// Boxes, some of them flat.
    fn cell() -> impl Strategy<Value = Aabb> {
        (point(), point()).prop_map(|(a, b)| Aabb::of_points(&[a, b]))
    }

    fn scaled_case() -> impl Strategy<Value = ([[f32; 3]; 3], Aabb)> {
        (triangle(), cell(), scale()).prop_map(|(corners, cell, scale)| {
            let cell = Aabb::of_points(&[scaled(cell.min, scale), scaled(cell.max, scale)]);
            (corners.map(|corner| scaled(corner, scale)), cell)
        })
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(2000))]

        #[test]
        fn lies_in_the_cell_and_in_the_full_box((corners, cell) in scaled_case()) {
            if let Some(clipped) = clipped_bounds(&corners, &cell) {
                prop_assert!(!clipped.is_empty());
                prop_assert!(contains(&cell, &clipped), "{clipped:?}");
                prop_assert!(contains(&Aabb::of_points(&corners), &clipped), "{clipped:?}");
            }
        }

        #[test]
        fn holds_every_point_of_the_triangle_in_the_cell(
            (corners, cell) in scaled_case(),
            weights in prop::collection::vec((0_u32..=64, 0_u32..=64), 32),
        ) {
            let clipped = clipped_bounds(&corners, &cell);
            for (u, v) in weights {
                let (u, v) = if u + v > 64 { (64 - u, 64 - v) } else { (u, v) };
                let [u, v] = [u, v].map(|w| f64::from(w) / 64.0);
                let [a, b, c] = corners.map(|corner| corner.map(f64::from));
                let point: [f64; 3] =
                    std::array::from_fn(|k| a[k] * (1.0 - u - v) + b[k] * u + c[k] * v);
                let inside = |bounds: &Aabb, slack: f64| {
                    (0..3).all(|k| {
                        point[k] >= f64::from(bounds.min[k]) - slack
                            && point[k] <= f64::from(bounds.max[k]) + slack
                    })
                };
                // The sampled point itself is rounded.
                let slack = corners.iter().flatten().fold(0.0, |s: f32, x| s.max(x.abs()));
                let slack = f64::from(slack) * 1e-15;
                if inside(&cell, -slack) {
                    prop_assert!(clipped.is_some_and(|clipped| inside(&clipped, slack)));
                }
            }
        }

        /// Corners and weights such that the point is exact in single precision.
        #[test]
        fn finds_an_exact_point_of_the_triangle_in_any_cell_around_it(
            corners in prop::array::uniform3(prop::array::uniform3(-0x1ffff..=0x1ffff)),
            (u, v) in (0..=64, 0..=64),
            other in prop::option::of(prop::array::uniform3(-0xff_ffff..=0xff_ffff)),
        ) {
            let (u, v) = if u + v > 64 { (64 - u, 64 - v) } else { (u, v) };
            let [a, b, c] = corners;
            let point: [f32; 3] =
                std::array::from_fn(|k| (a[k] * (64 - u - v) + b[k] * u + c[k] * v) as f32);
            let corners = corners.map(|corner| corner.map(|x| (64 * x) as f32));
            let other = other.map_or(point, |other| other.map(|x| x as f32));
            let clipped = clipped_bounds(&corners, &Aabb::of_points(&[point, other]));
            let expected = Aabb::of_points(&[point]);
            prop_assert!(clipped.is_some_and(|clipped| contains(&clipped, &expected)));
        }

        #[test]
        fn is_the_full_box_where_the_cell_holds_the_triangle((corners, cell) in scaled_case()) {
            let full = Aabb::of_points(&corners);
            prop_assert_eq!(clipped_bounds(&corners, &cell.union(&full)), Some(full));
        }

        #[test]
        fn grows_with_the_cell((corners, cell) in scaled_case(), other in cell()) {
            let larger = cell.union(&other);
            if let Some(clipped) = clipped_bounds(&corners, &cell) {
                let outer = clipped_bounds(&corners, &larger);
                // Both are rounded outwards, by no more than this.
                let size = corners.iter().flatten().fold(0.0, |s: f32, x| s.max(x.abs()));
                let slack = size * f32::EPSILON;
                let holds = outer.is_some_and(|outer| (0..3).all(|k| {
                    outer.min[k] <= clipped.min[k] + slack && outer.max[k] >= clipped.max[k] - slack
                }));
                prop_assert!(holds, "{clipped:?} in {outer:?}");
            }
        }
    }

    const UNIT: Aabb = Aabb {
        min: [0.0; 3],
        max: [1.0; 3],
    };

    #[test]
    fn a_triangle_past_a_corner_of_the_cell_is_apart() {
        // Its box overlaps the cell, but x + y >= 2.5 all over it.
        let corners = [[2.5, 0.0, 0.5], [0.0, 2.5, 0.5], [2.5, 2.5, 0.5]];
        assert!(clipped_bounds(&corners, &UNIT).is_none());
        let across = corners.map(|[x, y, z]| [x - 1.0, y - 1.0, z]);
        assert!(clipped_bounds(&across, &UNIT).is_some());
    }

    #[test]
    fn a_slanted_triangle_is_boxed_tightly() {
        // In the plane x + y = 0.5: inside the cell both go from 0 to 0.5.
        let corners = [[1.5, -1.0, 0.25], [-1.0, 1.5, 0.25], [0.25, 0.25, 8.0]];
        let clipped = clipped_bounds(&corners, &UNIT).unwrap();
        let expected = Aabb {
            min: [0.0, 0.0, 0.25],
            max: [0.5, 0.5, 1.0],
        };
        assert!(contains(&clipped, &expected));
        for axis in 0..3 {
            assert!(clipped.max[axis] <= expected.max[axis].next_up());
        }
        assert_eq!(clipped.min, expected.min);
    }

    #[test]
    fn a_triangle_in_a_border_of_the_cell_stays_flat() {
        let corners = [[-1.0, -1.0, 1.0], [3.0, -1.0, 1.0], [-1.0, 3.0, 1.0]];
        let clipped = clipped_bounds(&corners, &UNIT).unwrap();
        assert_eq!((clipped.min, clipped.max), ([0.0, 0.0, 1.0], [1.0; 3]));
        let beyond = corners.map(|[x, y, z]| [x, y, z.next_up()]);
        assert!(clipped_bounds(&beyond, &UNIT).is_none());
    }

    #[test]
    fn needles_through_the_cell_keep_their_whole_length() {
        // A needle far longer than the cell and thinner than rounding at its ends.
        let corners = [[-1e12, 0.5, 0.5], [1e12, 0.5, 0.5], [1e12, 0.500_1, 0.5]];
        let clipped = clipped_bounds(&corners, &UNIT).unwrap();
        assert_eq!((clipped.min[0], clipped.max[0]), (0.0, 1.0));
    }
}
