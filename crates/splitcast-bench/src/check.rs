//! Whether a system finds what is there: against brute force on a sample of
//! the rays, and in sum on all of them.

use std::fmt;

use rayon::prelude::*;
use serde::Serialize;
use splitcast::{KdTree, Mesh, reference};

use crate::rays::{RaySet, RaySetKind};
use crate::workers::TraceOutput;

/// Rays of each set that are tested against every triangle.
const SAMPLE: usize = 256;

/// How far counts and sums may be from what is expected, and distances of
/// single rays from brute force, relative to them.
pub const TOLERANCE: f64 = 1e-4;

/// What is expected of one set of rays.
pub(crate) struct Truth {
    /// Distance of the closest hit of each ray, infinite where there is none; for
    /// occlusion 0 where something is hit.
    t: Vec<f32>,
    /// Rays whose truth comes from brute force.
    sample: Vec<usize>,
    /// How far from its triangle a hit may be: the tolerance of the scene's diagonal.
    reach: f32,
}

impl Truth {
    /// Traces a set with our own tree, whose hits equal brute force in every bit,
    /// and asks brute force itself about a sample.
    pub(crate) fn new(set: &RaySet, tree: &KdTree<'_>) -> Self {
        let occlusion = set.kind.is_occlusion();
        let occluded = |yes| if yes { 0.0 } else { f32::INFINITY };
        let distance = |hit: Option<splitcast::Hit>| hit.map_or(f32::INFINITY, |hit| hit.t);
        let mut t: Vec<f32> = (set.rays.par_iter())
            .map(|ray| match occlusion {
                true => occluded(tree.occluded(ray)),
                false => distance(tree.closest_hit(ray)),
            })
            .collect();
        let step = set.rays.len().div_ceil(SAMPLE).max(1);
        // From the middle of each step: the first rays are all at the picture's border.
        let sample: Vec<usize> = (step / 2..set.rays.len()).step_by(step).collect();
        let by_force: Vec<f32> = (sample.par_iter())
            .map(|&index| match occlusion {
                true => occluded(reference::occluded(tree.mesh(), &set.rays[index])),
                false => distance(reference::closest_hit(tree.mesh(), &set.rays[index])),
            })
            .collect();
        for (&index, truth) in sample.iter().zip(by_force) {
            t[index] = truth;
        }
        let diagonal = tree
            .bounds()
            .extent()
            .iter()
            .map(|x| x * x)
            .sum::<f32>()
            .sqrt();
        Self {
            t,
            sample,
            reach: TOLERANCE as f32 * diagonal,
        }
    }
}

/// How a system did on one kind of rays, over all frames that were traced.
#[derive(Clone, Debug, Serialize)]
pub struct Agreement {
    /// The rays.
    #[serde(serialize_with = "as_text")]
    pub rays: RaySetKind,
    /// Rays that were compared with brute force one by one.
    pub sample: usize,
    /// Those of them with a wrong answer.
    pub sample_wrong: usize,
    /// Hits that were found.
    pub hits: usize,
    /// Hits that there are.
    pub hits_expected: usize,
    /// Sum of the distances of all hits; 0 for occlusion.
    pub distance: f64,
    /// What it should be.
    pub distance_expected: f64,
}

impl Agreement {
    /// Nothing compared yet.
    pub(crate) fn new(rays: RaySetKind) -> Self {
        Self {
            rays,
            sample: 0,
            sample_wrong: 0,
            hits: 0,
            hits_expected: 0,
            distance: 0.0,
            distance_expected: 0.0,
        }
    }

    /// Compares what a system found with what is there.
    pub(crate) fn add(
        &mut self,
        mesh: Mesh<'_>,
        set: &RaySet,
        truth: &Truth,
        output: &TraceOutput,
    ) {
        let found = |index: usize| match (set.kind.is_occlusion(), output.occluded[index]) {
            (true, true) => 0.0,
            (true, false) => f32::INFINITY,
            (false, _) => output.t[index],
        };
        for (index, &expected) in truth.t.iter().enumerate() {
            let found = found(index);
            // A distance that is not a number is no hit, and shows as one missing.
            if found < f32::INFINITY {
                self.hits += 1;
                self.distance += f64::from(found);
            }
            if expected < f32::INFINITY {
                self.hits_expected += 1;
                self.distance_expected += f64::from(expected);
            }
        }
        self.sample += truth.sample.len();
        let right = |&index: &usize| {
            let at_triangle = || {
                let point = set.rays[index].at(found(index));
                is_at_triangle(mesh, output.triangle[index], point, truth.reach)
            };
            is_near(found(index).into(), truth.t[index].into())
                && (set.kind.is_occlusion() || found(index) == f32::INFINITY || at_triangle())
        };
        self.sample_wrong += truth.sample.iter().filter(|&index| !right(index)).count();
    }

    /// Whether all is as it should be.
    pub fn agrees(&self) -> bool {
        self.sample_wrong == 0
            && is_near(self.hits as f64, self.hits_expected as f64)
            && is_near(self.distance, self.distance_expected)
    }
}

impl fmt::Display for Agreement {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "{}: {} of {} sampled rays are wrong, {} hits where there are {}",
            self.rays, self.sample_wrong, self.sample, self.hits, self.hits_expected
        )?;
        if self.rays.is_occlusion() {
            return Ok(());
        }
        let (found, expected) = (self.distance, self.distance_expected);
        write!(f, ", distances that sum to {found} instead of {expected}")
    }
}

/// Whether a point lies in a triangle's box, grown by `reach`: of two triangles
/// that share the edge that is hit, either is right.
fn is_at_triangle(mesh: Mesh<'_>, triangle: u32, point: [f32; 3], reach: f32) -> bool {
    (triangle as usize) < mesh.triangles().len() && {
        let bounds = mesh.triangle_bounds(triangle);
        (0..3).all(|k| (bounds.min[k] - reach..=bounds.max[k] + reach).contains(&point[k]))
    }
}

fn is_near(found: f64, expected: f64) -> bool {
    found == expected || (found - expected).abs() <= TOLERANCE * expected.abs()
}

fn as_text<S: serde::Serializer>(kind: &RaySetKind, serializer: S) -> Result<S::Ok, S::Error> {
    serializer.collect_str(kind)
}
