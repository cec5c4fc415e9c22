//! Which rays may reach a box, many at a time.
//!
//! Most rays of a picture pass by the mesh, whole squares of pixels of them:
//! these are told from one look at the ranges of their origins and directions,
//! and never go to the tree.

use std::ops::Range;

use splitcast::{Aabb, Ray};

/// Rays that are looked at together: as many as the tree traces together.
const TOGETHER: usize = 64;

/// Boxes are this much larger than they are, relative to the largest coordinate,
/// and distances as much farther: many times what rounding adds up to.
const SLACK: f32 = 1e-5;

/// Ranges of `rays` outside of which none reaches `bounds`, in order. All but
/// the last end at multiples of 64 rays.
pub(crate) fn reaching(rays: &[Ray], bounds: &Aabb) -> Vec<Range<usize>> {
    let mut ranges: Vec<Range<usize>> = Vec::new();
    for (number, together) in rays.chunks(TOGETHER).enumerate() {
        if !may_reach(together, bounds) {
            continue;
        }
        let start = number * TOGETHER;
        let end = start + together.len();
        match ranges.last_mut() {
            Some(last) if last.end == start => last.end = end,
            _ => ranges.push(start..end),
        }
    }
    ranges
}

/// Whether any of `rays` may reach `bounds`. Never wrong about a ray that does.
fn may_reach(rays: &[Ray], bounds: &Aabb) -> bool {
    let (low, high) = ranges(rays);
    let [.., first, _] = low;
    let [.., last] = high;
    let largest = |a: f32, b: &f32| a.max(b.abs());
    let size = [&low[..3], &high[..3], &bounds.min, &bounds.max]
        .into_iter()
        .flatten()
        .fold(0.0, largest);
    let (mut near, mut far) = (first, last);
    for axis in 0..3 {
        // What the box is away from the origins, and what rays cover of that in a unit of distance;
        // mirrored where all of them go down.
        let mut away = [
            bounds.min[axis] - SLACK * size - high[axis],
            bounds.max[axis] + SLACK * size - low[axis],
        ];
        let mut speed = [low[3 + axis], high[3 + axis]];
        if speed[1] <= 0.0 {
            away = [-away[1], -away[0]];
            speed = [-speed[1], -speed[0]];
        }
        if speed[0] > 0.0 {
            let [slow, fast] = speed;
            near = near.max(away[0] / if away[0] > 0.0 { fast } else { slow });
            far = far.min(away[1] / if away[1] > 0.0 { slow } else { fast });
        } else if away[0] > 0.0 {
            near = near.max(away[0] / speed[1]);
        } else if away[1] < 0.0 {
            near = near.max(away[1] / speed[0]);
        }
    }
    // Comparisons with NaN leave the question open.
    let passes = near - SLACK * near.abs() > far + SLACK * far.abs();
    !passes
}

/// The least and the greatest of each number of rays: origin, direction, first
/// and last distance. Rays with NaN, which hit nothing, may be left out.
fn ranges(rays: &[Ray]) -> ([f32; 8], [f32; 8]) {
    let (mut low, mut high) = ([f32::INFINITY; 8], [f32::NEG_INFINITY; 8]);
    for ray in rays {
        let ([a, b, c], [d, e, f]) = (ray.origin, ray.direction);
        let numbers = [a, b, c, d, e, f, ray.t_min, ray.t_max];
        for (index, number) in numbers.into_iter().enumerate() {
            low[index] = if number < low[index] {
                number
            } else {
                low[index]
            };
            high[index] = if number > high[index] {
                number
            } else {
                high[index]
            };
        }
    }
    (low, high)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;
    use splitcast::{BuildOptions, KdTree, Mesh};

    use super::*;

    fn ray(origin: [f32; 3], direction: [f32; 3]) -> Ray {
        Ray::new(origin, direction)
    }

    #[test]
    fn rays_that_pass_by_or_go_away_are_left_out() {
        let bounds = Aabb {
            min: [-1.0; 3],
            max: [1.0; 3],
        };
        let beside = ray([0.0, 0.0, 5.0], [0.5, 0.0, -1.0]);
        let away = ray([0.0, 0.0, 5.0], [0.0, 0.1, 1.0]);
        let short = ray([0.0, 0.0, 5.0], [0.0, 0.0, -1.0]).with_range(0.0, 3.0);
        let at = ray([0.0, 0.0, 5.0], [0.1, 0.1, -1.0]);
        let within = ray([0.0; 3], [0.0, 1.0, 0.0]);
        for passes in [beside, away, short] {
            assert!(!may_reach(&[passes], &bounds), "{passes:?}");
        }
        for reaches in [at, within] {
            assert!(may_reach(&[reaches], &bounds), "{reaches:?}");
        }
        let rays = [[beside; 64], [at; 64], [within; 64], [away; 64], [at; 64]].concat();
        assert_eq!(reaching(&rays[..300], &bounds), [64..192, 256..300]);
    }

    fn vector(reach: f32) -> impl Strategy<Value = [f32; 3]> {
        let number = prop_oneof![4 => -reach..reach, 1 => Just(0.0), 1 => Just(1.0)];
        [number.clone(), number.clone(), number]
    }

    proptest! {
        #[test]
        fn no_ray_that_hits_is_left_out(
            corners in prop::array::uniform3(vector(1.0)),
            origin in vector(3.0),
            direction in vector(1.0),
            spread in prop_oneof![Just(0.0f32), 0.0f32..0.5],
            others in prop::collection::vec((vector(1.0), vector(1.0)), 0..6),
        ) {
            let mesh = Mesh::new(&corners, &[[0, 1, 2]]).unwrap();
            let tree = KdTree::build(mesh, &BuildOptions::default()).unwrap();
            let mix = |a: [f32; 3], b: [f32; 3], share: f32| {
                std::array::from_fn(|axis| a[axis] + share * b[axis])
            };
            let others = others
                .into_iter()
                .map(|(o, d)| ray(mix(origin, o, spread), mix(direction, d, spread)));
            // Towards a corner and the middle of an edge: boxes are met at their sides, too.
            let middle = mix([0.0; 3], mix(corners[0], corners[1], 1.0), 0.5);
            let aimed = [corners[0], middle].map(|aim| ray(origin, mix(aim, origin, -1.0)));
            let rays: Vec<Ray> = others.chain(aimed).chain([ray(origin, direction)]).collect();
            if rays.iter().any(|ray| tree.closest_hit(ray).is_some()) {
                prop_assert!(may_reach(&rays, &tree.bounds()));
            }
            for ray in rays {
                let hit = tree.closest_hit(&ray);
                prop_assert!(hit.is_none() || may_reach(&[ray], &tree.bounds()));
            }
        }
    }
}
