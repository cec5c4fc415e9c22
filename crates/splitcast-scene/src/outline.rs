//! The outline of a motion: vertices that together span nearly its convex
//! hull, so that a camera can be fitted to what is really there without
//! going through all frames again.
//!
//! Of each frame these are the extreme vertices in fixed directions, those to
//! the points of a 5 x 5 x 5 grid on the surface of a cube. No direction is
//! farther than 18 degrees from one of them, so a ball of radius r sticks out
//! of its outline by at most r (1 - cos 18°), 5 % of r.

/// One of each pair of opposite directions of the grid.
const AXES: [[f32; 3]; 49] = axes();

/// The finite vertices that are extreme in any of the directions in any frame.
#[derive(Clone, Debug, Default)]
pub(crate) struct Outline {
    points: Vec<[f32; 3]>,
}

impl Outline {
    /// Takes note of one frame.
    pub(crate) fn add(&mut self, positions: &[[f32; 3]]) {
        let finite = |position: &&[f32; 3]| position.iter().all(|x| x.is_finite());
        let Some(&first) = positions.iter().find(finite) else {
            return;
        };
        let start = self.points.len();
        for axis in &AXES {
            let along =
                |point: &[f32; 3]| axis[0] * point[0] + axis[1] * point[1] + axis[2] * point[2];
            let value = along(&first);
            let (mut least, mut most) = ((value, first), (value, first));
            for point in positions {
                let value = along(point);
                if (value < least.0 || value > most.0) && finite(&point) {
                    if value < least.0 {
                        least = (value, *point);
                    } else {
                        most = (value, *point);
                    }
                }
            }
            self.points.extend([least.1, most.1]);
        }
        // What stands still in the corner of the motion comes with every frame.
        self.points[start..].sort_unstable_by(by_coordinates);
        self.points.dedup();
    }

    /// All points, each once, in an order of their coordinates.
    pub(crate) fn into_points(mut self) -> Vec<[f32; 3]> {
        self.points.sort_unstable_by(by_coordinates);
        self.points.dedup();
        self.points
    }
}

fn by_coordinates(a: &[f32; 3], b: &[f32; 3]) -> std::cmp::Ordering {
    let differing = (0..3).map(|i| a[i].total_cmp(&b[i]));
    differing.fold(std::cmp::Ordering::Equal, std::cmp::Ordering::then)
}

/// The grid points whose last coordinate other than zero is above zero. The
/// greatest is 1, so that sums of usual coordinates do not overflow.
const fn axes() -> [[f32; 3]; 49] {
    let mut axes = [[0.0; 3]; 49];
    let (mut count, mut cell) = (0, 63);
    while cell < 125 {
        let [x, y, z] = [cell % 5 - 2, cell / 5 % 5 - 2, cell / 25 - 2];
        let on_surface = x * x == 4 || y * y == 4 || z * z == 4;
        if on_surface {
            axes[count] = [0.5 * x as f32, 0.5 * y as f32, 0.5 * z as f32];
            count += 1;
        }
        cell += 1;
    }
    assert!(count == 49);
    axes
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn outline(frames: &[Vec<[f32; 3]>]) -> Vec<[f32; 3]> {
        let mut outline = Outline::default();
        for frame in frames {
            outline.add(frame);
        }
        outline.into_points()
    }

    /// How far `points` reach in a direction.
    fn reach(points: &[[f32; 3]], direction: [f32; 3]) -> f32 {
        let along = |point: &[f32; 3]| (0..3).map(|i| direction[i] * point[i]).sum();
        points.iter().map(along).fold(f32::NEG_INFINITY, f32::max)
    }

    #[test]
    fn only_finite_vertices_are_taken_and_each_once() {
        let (nan, infinite) = (f32::NAN, f32::INFINITY);
        let (a, b) = ([1.0, 2.0, 3.0], [-1.0, 0.0, f32::MAX]);
        let broken = vec![[nan, 9.0, 9.0], a, [0.0, infinite, -infinite], b, a];
        assert_eq!(outline(&[broken.clone(), vec![], broken]), [b, a]);
        assert_eq!(outline(&[vec![[nan; 3]]]), [[0.0; 3]; 0]);
    }

    #[test]
    fn a_ball_hardly_sticks_out_of_its_outline() {
        let on_ball = |i: u32| {
            // A spiral from pole to pole by the golden angle spreads points evenly.
            let z = 1.0 - (2 * i + 1) as f32 / 20_000.0;
            let (sin, cos) = (2.399_963_3 * i as f32).sin_cos();
            let r = (1.0 - z * z).sqrt();
            [r * cos, r * sin, z]
        };
        let ball: Vec<[f32; 3]> = (0..20_000).map(on_ball).collect();
        let outline = outline(std::slice::from_ref(&ball));
        assert!(outline.len() <= 98, "{} points", outline.len());
        for &direction in &ball {
            let reach = reach(&outline, direction);
            assert!(reach > 0.95, "{reach} along {direction:?}");
        }
    }

    proptest! {
        #[test]
        fn the_outline_is_made_of_vertices_and_reaches_as_far_as_all(
            frames in prop::collection::vec(
                prop::collection::vec(prop::array::uniform3(-10.0f32..10.0), 0..40), 0..6),
        ) {
            let outline = outline(&frames);
            let all = frames.concat();
            prop_assert!(outline.iter().all(|point| all.contains(point)));
            for axis in AXES {
                for direction in [axis, axis.map(|x| -x)] {
                    prop_assert_eq!(reach(&outline, direction), reach(&all, direction));
                }
            }
        }
    }
}
