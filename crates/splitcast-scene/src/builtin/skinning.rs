//! Skinning: how a surface follows its bones. Weights start as the nearest
//! bone of the surface's own part and are diffused along the mesh, so that
//! they are smooth at joints and never leak across a gap; vertices move by
//! dual quaternions (Kavan et al., "Skinning with Dual Quaternions", 2007),
//! which keep the girth of bent and twisted limbs.

use std::sync::Arc;

use glam::Vec3;
use rayon::prelude::*;

use super::animal::Paint;
use super::implicit::Body;
use super::skeleton::{BoneId, Pose, Rigid, Skeleton};
use super::surface_nets::{Neighbors, Surface};

/// Bones that may move one vertex.
const INFLUENCES: usize = 6;

/// Rounds of diffusion; at softness 1 a joint spreads over about five edges
/// either way, the square root of the rounds.
const DIFFUSIONS: usize = 24;

/// Rounds for colours, which only have to lose the steps of the mesh.
const TINT_DIFFUSIONS: usize = 2;

/// A surface bound to a skeleton.
pub(super) struct Skin {
    /// Rest positions.
    pub(super) positions: Vec<Vec3>,
    pub(super) triangles: Arc<Vec<[u32; 3]>>,
    /// sRGB, one per vertex: the colours of the parts, run into each other
    /// and painted over.
    pub(super) colors: Arc<Vec<[u8; 3]>>,
    influences: Vec<[(BoneId, f32); INFLUENCES]>,
}

impl Skin {
    /// Binds `surface`, meshed from `body`.
    pub(super) fn bind(surface: Surface, body: &Body, skeleton: &Skeleton, paint: Paint) -> Self {
        let parts = || surface.parts.iter().map(|&part| &body.parts[part]);
        let softness: Vec<f32> = parts().map(|part| part.softness).collect();
        let bone_count = skeleton.bones().len();
        let mut weights = vec![0.0f32; surface.positions.len() * bone_count];
        for ((row, part), position) in weights
            .chunks_mut(bone_count)
            .zip(parts())
            .zip(&surface.positions)
        {
            row[usize::from(nearest_bone(skeleton, &part.bones, *position))] = 1.0;
        }
        let weights = diffuse(weights, &surface.neighbors, &softness, DIFFUSIONS);
        let tints = parts().flat_map(|part| part.color.map(f32::from)).collect();
        let even = vec![0.5; softness.len()];
        let tints = diffuse(tints, &surface.neighbors, &even, TINT_DIFFUSIONS);
        let influences = weights.chunks(bone_count).map(strongest).collect();
        let colors = tints
            .chunks(3)
            .zip(&surface.positions)
            .map(|(tint, position)| {
                paint(
                    *position,
                    [tint[0], tint[1], tint[2]].map(|v| v.round() as u8),
                )
            })
            .collect();
        Self {
            positions: surface.positions,
            triangles: Arc::new(surface.triangles),
            colors: Arc::new(colors),
            influences,
        }
    }

    /// The vertices in `pose`.
    pub(super) fn posed(&self, pose: &Pose<'_>) -> Vec<[f32; 3]> {
        let bones: Vec<DualQuaternion> = pose.motions.iter().map(DualQuaternion::from).collect();
        self.positions
            .iter()
            .zip(&self.influences)
            .map(|(position, influences)| blend(&bones, influences).apply(*position).to_array())
            .collect()
    }
}

/// The bone out of `bones` whose segment is nearest.
fn nearest_bone(skeleton: &Skeleton, bones: &[BoneId], position: Vec3) -> BoneId {
    let distance = |id: &BoneId| {
        let bone = skeleton.get(*id);
        let (head, span) = (bone.head.as_vec3(), (bone.tail - bone.head).as_vec3());
        let along = (position - head).dot(span) / span.length_squared();
        position.distance_squared(head + span * along.clamp(0.0, 1.0))
    };
    let nearest = bones
        .iter()
        .min_by(|a, b| distance(a).total_cmp(&distance(b)));
    *nearest.expect("every part names the bones that carry it")
}

/// Diffuses rows of values, one row a vertex: a vertex goes towards the mean
/// of its neighbors by its softness.
fn diffuse(
    mut values: Vec<f32>,
    neighbors: &Neighbors,
    softness: &[f32],
    rounds: usize,
) -> Vec<f32> {
    let columns = values.len() / softness.len();
    let mut next = values.clone();
    for _ in 0..rounds {
        next.par_chunks_mut(columns)
            .enumerate()
            .for_each(|(vertex, row)| {
                let around = neighbors.of(vertex);
                let share = softness[vertex] / around.len() as f32;
                let own = &values[vertex * columns..][..columns];
                for (sum, value) in row.iter_mut().zip(own) {
                    *sum = value * (1.0 - softness[vertex]);
                }
                for &other in around {
                    let theirs = &values[other as usize * columns..][..columns];
                    for (sum, value) in row.iter_mut().zip(theirs) {
                        *sum += value * share;
                    }
                }
            });
        std::mem::swap(&mut values, &mut next);
    }
    values
}

/// The largest weights, largest first, scaled to a sum of one.
fn strongest(weights: &[f32]) -> [(BoneId, f32); INFLUENCES] {
    let mut ranked: Vec<(BoneId, f32)> = (0..).zip(weights.iter().copied()).collect();
    ranked.sort_by(|a, b| b.1.total_cmp(&a.1));
    let sum: f32 = ranked
        .iter()
        .take(INFLUENCES)
        .map(|(_, weight)| weight)
        .sum();
    std::array::from_fn(|rank| {
        let (bone, weight) = ranked.get(rank).copied().unwrap_or((ranked[0].0, 0.0));
        (bone, weight / sum)
    })
}

/// A rigid motion as a unit dual quaternion: real part (rotation) and dual
/// part (half the translation times the rotation), each as vector and scalar.
#[derive(Clone, Copy)]
struct DualQuaternion {
    real: [f32; 4],
    dual: [f32; 4],
}

impl From<&Rigid> for DualQuaternion {
    fn from(motion: &Rigid) -> Self {
        let real = motion.rotation;
        let t = motion.translation * 0.5;
        let dual = glam::DQuat::from_xyzw(t.x, t.y, t.z, 0.0) * real;
        Self {
            real: real.to_array().map(|value| value as f32),
            dual: dual.to_array().map(|value| value as f32),
        }
    }
}

impl DualQuaternion {
    /// Equation (4) of Kavan et al., for a dual quaternion of any length.
    fn apply(&self, point: Vec3) -> Vec3 {
        let (r, d) = (self.real, self.dual);
        let inverse = 1.0 / (r[0] * r[0] + r[1] * r[1] + r[2] * r[2] + r[3] * r[3]);
        let (r, rw) = (Vec3::new(r[0], r[1], r[2]), r[3]);
        let (d, dw) = (Vec3::new(d[0], d[1], d[2]), d[3]);
        let turned = r.cross(r.cross(point) + point * rw);
        let shift = d * rw - r * dw + r.cross(d);
        point + (turned + shift) * (2.0 * inverse)
    }
}

/// The weighted sum, each term on the side of the first one's rotation.
fn blend(bones: &[DualQuaternion], influences: &[(BoneId, f32); INFLUENCES]) -> DualQuaternion {
    let pivot = bones[usize::from(influences[0].0)].real;
    let mut sum = DualQuaternion {
        real: [0.0; 4],
        dual: [0.0; 4],
    };
    for &(bone, weight) in influences.iter().take_while(|(_, weight)| *weight > 0.0) {
        let bone = &bones[usize::from(bone)];
        let agreement: f32 = (0..4).map(|i| pivot[i] * bone.real[i]).sum();
        let weight = if agreement < 0.0 { -weight } else { weight };
        for i in 0..4 {
            sum.real[i] += weight * bone.real[i];
            sum.dual[i] += weight * bone.dual[i];
        }
    }
    sum
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::builtin::skeleton::turn_about;
    use glam::DVec3;

    #[test]
    fn one_bone_moves_a_vertex_rigidly() {
        let motion = Rigid {
            rotation: turn_about(DVec3::new(0.6, 0.0, 0.8), 130.0),
            translation: DVec3::new(1.0, -2.0, 0.5),
        };
        let bones = [DualQuaternion::from(&motion)];
        let mut influences = [(0, 0.0); INFLUENCES];
        influences[0].1 = 1.0;
        let point = Vec3::new(0.3, 0.7, -1.1);
        let moved = blend(&bones, &influences).apply(point);
        assert!(moved.distance(motion.apply(point.as_dvec3()).as_vec3()) < 1e-5);
    }

    #[test]
    fn opposite_signs_of_one_rotation_blend_to_that_rotation() {
        let motion = Rigid {
            rotation: turn_about(DVec3::Z, 90.0),
            translation: DVec3::X,
        };
        let flipped = Rigid {
            rotation: -motion.rotation,
            ..motion
        };
        let bones = [
            DualQuaternion::from(&motion),
            DualQuaternion::from(&flipped),
        ];
        let mut influences = [(0, 0.0); INFLUENCES];
        influences[0] = (0, 0.6);
        influences[1] = (1, 0.4);
        let moved = blend(&bones, &influences).apply(Vec3::X);
        assert!(moved.distance(Vec3::new(1.0, 1.0, 0.0)) < 1e-6);
    }

    #[test]
    fn strongest_weights_sum_to_one() {
        let weights = [0.0, 0.1, 0.2, 0.05, 0.3, 0.15, 0.1, 0.1];
        let kept = strongest(&weights);
        assert_eq!((kept[0].0, kept[1].0), (4, 2));
        assert!((kept.iter().map(|(_, weight)| weight).sum::<f32>() - 1.0).abs() < 1e-6);
    }
}
