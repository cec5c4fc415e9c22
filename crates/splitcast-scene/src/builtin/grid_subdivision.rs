//! One step of bicubic B-spline subdivision of a grid of points.
//!
//! J. Lane, R. Riesenfeld: "A Theoretical Development for the Computer
//! Generation and Display of Piecewise Polynomial Surfaces", IEEE PAMI 2(1),
//! 1980; the rules that Catmull and Clark (1978) extended to any topology.
//! The limit surface has continuous curvature, so a cloth simulated on a
//! coarse grid shows smooth folds.

use glam::Vec3;

/// Doubles the resolution of a square grid of `count` rows of `count` points
/// (at least 2): the result has `2 * count - 1` rows. Corners stay in place
/// and the border is the B-spline curve of the coarse border.
pub(super) fn subdivide_grid(points: &[Vec3], count: usize) -> Vec<Vec3> {
    let fine = 2 * count - 1;
    let mut rows = Vec::with_capacity(count * fine);
    for row in points.chunks_exact(count) {
        rows.extend((0..fine).map(|i| subdivide(|j| row[j], count, i)));
    }
    (0..fine * fine)
        .map(|i| subdivide(|j| rows[j * fine + i % fine], count, i / fine))
        .collect()
}

/// Point `index` of the subdivision of a curve of `count` points.
fn subdivide(point: impl Fn(usize) -> Vec3, count: usize, index: usize) -> Vec3 {
    let j = index / 2;
    if index % 2 == 1 {
        (point(j) + point(j + 1)) * 0.5
    } else if j == 0 || j == count - 1 {
        point(j)
    } else {
        (point(j - 1) + point(j + 1)) * 0.125 + point(j) * 0.75
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn flat_grids_stay_as_they_are() {
        let place = |count: usize| -> Vec<Vec3> {
            let step = 1.0 / (count - 1) as f32;
            (0..count * count)
                .map(|i| Vec3::new((i / count) as f32 * step, 0.0, (i % count) as f32 * step))
                .collect()
        };
        let fine = subdivide_grid(&place(5), 5);
        for (point, expected) in fine.iter().zip(place(9)) {
            assert!(point.distance(expected) < 1.0e-6);
        }
        assert_eq!(fine.len(), 81);
    }

    #[test]
    fn a_spike_spreads_by_the_subdivision_mask() {
        let mut points = vec![Vec3::ZERO; 25];
        points[12] = Vec3::Y * 64.0;
        let fine = subdivide_grid(&points, 5);
        let heights: Vec<f32> = fine[2 * 9 + 2..2 * 9 + 7].iter().map(|p| p.y).collect();
        assert_eq!(heights, [1.0, 4.0, 6.0, 4.0, 1.0]);
        assert_eq!(fine[4 * 9 + 4].y, 36.0);
    }
}
