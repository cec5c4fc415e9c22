//! Whether a system finds what is there: ray by ray against our own tree, whose hits
//! equal brute force, and against brute force itself on a sample and in doubt.

use std::fmt;

use rayon::prelude::*;
use serde::Serialize;
use splitcast::{Hit, KdTree, Mesh, Ray, reference};

use crate::rays::{RaySet, RaySetKind};
use crate::workers::TraceOutput;

/// Rays of each set and frame that are tested against every triangle.
const SAMPLE: usize = 256;

/// Rays of each set and frame on which a system differs that are put to brute force
/// before the system is blamed.
const IN_DOUBT: usize = 16;

/// Share of the rays of a set on which a system may be wrong, and of counts and sums by
/// which it may be off: hits at the very edge of a triangle are a matter of rounding. Distances
/// are right within this share of themselves, or of the scene's diagonal where the ray is short.
pub const TOLERANCE: f64 = 1e-4;

/// The same for the sample, which is too small for so small a share.
const SAMPLE_TOLERANCE: f64 = 1e-3;

/// What is expected of one set of rays.
pub(crate) struct Truth<'m> {
    mesh: Mesh<'m>,
    /// What each ray has to find.
    answers: Vec<f32>,
    /// Rays whose answer comes from brute force.
    sample: Vec<usize>,
    /// How far distances may be off, and hits from their triangle: the tolerance of the
    /// scene's diagonal.
    reach: f32,
}

/// The answer to a ray as a number: the distance of the closest hit, infinite where
/// there is none; for occlusion 0 where something is hit.
fn answer(occlusion: bool, occluded: impl Fn() -> bool, closest: impl Fn() -> Option<Hit>) -> f32 {
    match occlusion {
        true if occluded() => 0.0,
        true => f32::INFINITY,
        false => closest().map_or(f32::INFINITY, |hit| hit.t),
    }
}

impl<'m> Truth<'m> {
    /// Traces a set with our own tree, and asks brute force about a sample.
    pub(crate) fn new(set: &RaySet, tree: &KdTree<'m>) -> Self {
        let occlusion = set.kind.is_occlusion();
        let mut answers: Vec<f32> = (set.rays.par_iter())
            .map(|ray| answer(occlusion, || tree.occluded(ray), || tree.closest_hit(ray)))
            .collect();
        let step = set.rays.len().div_ceil(SAMPLE).max(1);
        // From the middle of each step: the first rays are all at the picture's border.
        let sample: Vec<usize> = (step / 2..set.rays.len()).step_by(step).collect();
        let by_force: Vec<f32> = (sample.par_iter())
            .map(|&index| brute_force(tree.mesh(), occlusion, &set.rays[index]))
            .collect();
        for (&index, answer) in sample.iter().zip(by_force) {
            answers[index] = answer;
        }
        let diagonal = tree
            .bounds()
            .extent()
            .iter()
            .map(|x| x * x)
            .sum::<f32>()
            .sqrt();
        Self {
            mesh: tree.mesh(),
            answers,
            sample,
            reach: TOLERANCE as f32 * diagonal,
        }
    }

    fn is_near(&self, found: f32, expected: f32) -> bool {
        let reach = self.reach.max(TOLERANCE as f32 * expected.abs());
        // Two infinities differ by what is not a number.
        found == expected || (found - expected).abs() <= reach
    }

    /// Whether a point lies in a triangle's box, or nearly: of two triangles that
    /// share the edge that is hit, either is right.
    fn is_at_triangle(&self, triangle: u32, point: [f32; 3]) -> bool {
        (triangle as usize) < self.mesh.triangles().len() && {
            let bounds = self.mesh.triangle_bounds(triangle);
            let reach = self.reach;
            (0..3).all(|k| (bounds.min[k] - reach..=bounds.max[k] + reach).contains(&point[k]))
        }
    }
}

fn brute_force(mesh: Mesh<'_>, occlusion: bool, ray: &Ray) -> f32 {
    answer(
        occlusion,
        || reference::occluded(mesh, ray),
        || reference::closest_hit(mesh, ray),
    )
}

/// How a system did on one kind of rays, over all frames that were traced.
#[derive(Clone, Debug, Serialize)]
pub struct Agreement {
    /// The rays.
    #[serde(serialize_with = "as_text")]
    pub kind: RaySetKind,
    /// Number of rays that were compared.
    pub rays: usize,
    /// Those of them with a wrong answer: a hit missed, invented, or at another distance.
    pub wrong: usize,
    /// Rays that were compared with brute force.
    pub sample: usize,
    /// Those of them with a wrong answer, or with a triangle that the hit is not at.
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
    pub(crate) fn new(kind: RaySetKind) -> Self {
        Self {
            kind,
            rays: 0,
            wrong: 0,
            sample: 0,
            sample_wrong: 0,
            hits: 0,
            hits_expected: 0,
            distance: 0.0,
            distance_expected: 0.0,
        }
    }

    /// Compares what a system found with what is there.
    pub(crate) fn add(&mut self, set: &RaySet, truth: &Truth<'_>, output: &TraceOutput) {
        let occlusion = set.kind.is_occlusion();
        let found = |index: usize| match (occlusion, output.occluded[index]) {
            (true, true) => 0.0,
            (true, false) => f32::INFINITY,
            (false, _) => output.t[index],
        };
        let mut doubts = 0;
        for (index, &expected) in truth.answers.iter().enumerate() {
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
            if !truth.is_near(found, expected) {
                doubts += 1;
                let by_force = || brute_force(truth.mesh, occlusion, &set.rays[index]);
                let is_right = doubts <= IN_DOUBT && truth.is_near(found, by_force());
                self.wrong += usize::from(!is_right);
            }
        }
        self.rays += truth.answers.len();
        let right = |&index: &usize| {
            let at_triangle = || {
                let point = set.rays[index].at(found(index));
                truth.is_at_triangle(output.triangle[index], point)
            };
            truth.is_near(found(index), truth.answers[index])
                && (occlusion || found(index) == f32::INFINITY || at_triangle())
        };
        self.sample += truth.sample.len();
        self.sample_wrong += truth.sample.iter().filter(|&index| !right(index)).count();
    }

    /// Whether all is as it should be.
    pub fn agrees(&self) -> bool {
        let few = |wrong: usize, of: usize, share: f64| wrong as f64 <= share * of as f64;
        let near = |found: f64, expected: f64| (found - expected).abs() <= TOLERANCE * expected;
        few(self.wrong, self.rays, TOLERANCE)
            && few(self.sample_wrong, self.sample, SAMPLE_TOLERANCE)
            && near(self.hits as f64, self.hits_expected as f64)
            && near(self.distance, self.distance_expected)
    }
}

impl fmt::Display for Agreement {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "{}: {} of {} rays are wrong, {} of {} that brute force was asked about, {} hits where there are {}",
            self.kind,
            self.wrong,
            self.rays,
            self.sample_wrong,
            self.sample,
            self.hits,
            self.hits_expected
        )?;
        if self.kind.is_occlusion() {
            return Ok(());
        }
        let (found, expected) = (self.distance, self.distance_expected);
        write!(f, ", distances that sum to {found} instead of {expected}")
    }
}

fn as_text<S: serde::Serializer>(kind: &RaySetKind, serializer: S) -> Result<S::Ok, S::Error> {
    serializer.collect_str(kind)
}

#[cfg(test)]
mod tests {
    use splitcast::BuildOptions;

    use super::*;

    /// A strip of squares along x, far away from the origin if asked for; rays come down on it.
    fn strip(offset: f32) -> (Vec<[f32; 3]>, Vec<[u32; 3]>, RaySet) {
        let x = |i: u32| i as f32 * 0.01;
        let positions = (0..202)
            .map(|i| [x(i / 2) + offset, offset, (i % 2) as f32 + offset])
            .collect();
        let triangles = (0..200).map(|i| [i, i + 1, i + 2]).collect();
        let rays = (0..2000)
            .map(|i| {
                let origin = [x(i) / 15.0 + offset + 0.003, 1.0 + offset, 0.37 + offset];
                Ray::new(origin, [0.0, -1.0, 0.0])
            })
            .collect();
        (positions, triangles, RaySet::new(RaySetKind::Primary, rays))
    }

    /// What our tree finds, changed by `change`, as a judgement.
    fn judge(offset: f32, change: impl Fn(&mut TraceOutput)) -> Agreement {
        let (positions, triangles, set) = strip(offset);
        let mesh = Mesh::new(&positions, &triangles).expect("indices are in range");
        let tree = KdTree::build(mesh, &BuildOptions::default()).expect("all are finite");
        let mut output = TraceOutput::default();
        output.clear(&set);
        for (index, ray) in set.rays.iter().enumerate() {
            let hit = tree.closest_hit(ray);
            output.t[index] = hit.map_or(f32::INFINITY, |hit| hit.t);
            output.triangle[index] = hit.map_or(u32::MAX, |hit| hit.triangle);
        }
        change(&mut output);
        let mut agreement = Agreement::new(RaySetKind::Primary);
        agreement.add(&set, &Truth::new(&set, &tree), &output);
        agreement
    }

    #[test]
    fn right_hits_agree_also_with_rounding_and_far_away() {
        for offset in [0.0, 1000.0] {
            let right = judge(offset, |_| ());
            assert!(right.agrees() && right.hits > 1000, "{right}");
            let rounded = judge(offset, |output| {
                output.t.iter_mut().for_each(|t| *t += 3e-5);
            });
            assert!(rounded.agrees(), "{rounded}");
        }
    }

    #[test]
    fn distances_count() {
        let farther = judge(0.0, |output| output.t.iter_mut().for_each(|t| *t *= 1.01));
        assert!(!farther.agrees() && farther.hits == farther.hits_expected);
        assert_eq!(farther.wrong, farther.hits);
    }

    #[test]
    fn errors_that_cancel_each_other_count() {
        // Every hundredth ray swaps its answer with one that misses: as many hits, the same sum.
        let swapped = judge(0.0, |output| {
            let misses = (0..2000).filter(|&i| output.t[i] == f32::INFINITY);
            let misses: Vec<usize> = misses.collect();
            let hits = (0..2000)
                .filter(|&i| output.t[i] < f32::INFINITY)
                .step_by(100);
            let pairs: Vec<_> = hits.zip(misses).collect();
            assert!(pairs.len() >= 5);
            pairs.into_iter().for_each(|(a, b)| output.t.swap(a, b));
        });
        assert_eq!(swapped.hits, swapped.hits_expected);
        assert!(!swapped.agrees(), "{swapped}");
    }

    #[test]
    fn triangles_count_in_the_sample() {
        let elsewhere = judge(0.0, |output| output.triangle.fill(0));
        assert_eq!(elsewhere.wrong, 0);
        assert!(!elsewhere.agrees(), "{elsewhere}");
    }
}
