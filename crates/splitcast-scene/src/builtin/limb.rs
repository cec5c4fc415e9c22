//! Legs of four segments that set their toes exactly where they should stand.
//!
//! Two segments of a mammal's leg often move as one. In the hind leg of a
//! runner the thigh and the metatarsus stay near parallel ("pantograph" or
//! matched motion; Fischer and Blickhan, "The tri-segmented limbs of therian
//! mammals", 2006). In a foreleg, and in every leg of an elephant, the lower
//! leg and the metapodium form a strut that folds back where they meet.
//! Either way the leg has two rigid groups once the fold is given, and they
//! follow in closed form from the law of cosines.

use glam::{DMat3, DQuat, DVec2, DVec3};

use super::curve::sin_cos;
use super::skeleton::{BoneId, Pose, Rigid, Skeleton, pitch};

/// Which segment forms a group with the third one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum LimbKind {
    /// The second; the fold turns the third segment backwards.
    Strut,
    /// The first; the fold turns the third segment forwards.
    Pantograph,
}

/// A leg: its bones from the body down.
#[derive(Clone, Copy, Debug)]
pub(super) struct Limb {
    pub(super) kind: LimbKind,
    pub(super) bones: [BoneId; 4],
}

/// What a leg is asked to do.
#[derive(Clone, Copy, Debug)]
pub(super) struct LimbGoal {
    /// Where the tip of the toe goes.
    pub(super) toe: DVec3,
    /// How far the toe segment is pitched from rest, toe down positive, degrees.
    pub(super) heel_lift: f64,
    /// Fold of the third segment from rest, degrees.
    pub(super) fold: f64,
}

impl Limb {
    /// The leg whose four bones are named with `suffix`.
    pub(super) fn new(skeleton: &Skeleton, kind: LimbKind, names: [&str; 4], suffix: &str) -> Self {
        Self {
            kind,
            bones: names.map(|name| skeleton.id(&format!("{name}{suffix}"))),
        }
    }

    /// Sets the bones of the leg, its parent being set already. Toes out of
    /// reach are approached as closely as the leg allows.
    pub(super) fn reach(&self, pose: &mut Pose<'_>, goal: LimbGoal) {
        let skeleton = pose.skeleton();
        let rest = self.bones.map(|id| skeleton.get(id));
        let root = pose.head(self.bones[0]);
        let digit_rotation = pitch(-goal.heel_lift);

        // The plane of the leg is tilted about the body's axis until the
        // fixed sideways offset of the joints ends over the ankle joint.
        let to_ankle = goal.toe - digit_rotation * (rest[3].tail - rest[3].head) - root;
        let sideways = rest[3].head.z - rest[0].head.z;
        let across = DVec2::new(to_ankle.y, to_ankle.z);
        let down = -(across.length_squared() - sideways * sideways)
            .max(0.0)
            .sqrt();
        let tilt = quotient(across, DVec2::new(down, sideways));

        let segments = [0, 1, 2].map(|i| (rest[i].tail - rest[i].head).truncate());
        let (first, second, fold) = self.groups(segments, goal.fold);
        let rest_total = segments[0] + segments[1] + segments[2];
        let bend = rest_total.perp_dot(match self.kind {
            LimbKind::Strut => segments[0],
            LimbKind::Pantograph => segments[0] + segments[2],
        });
        let target = DVec2::new(to_ankle.x, down);
        let (first_turn, second_turn) = two_bone(first, second, target, bend.signum());
        let turns = match self.kind {
            LimbKind::Strut => [first_turn, second_turn, second_turn.rotate(fold)],
            LimbKind::Pantograph => [first_turn, second_turn, first_turn.rotate(fold)],
        };

        let mut joint = root;
        for (index, turn) in turns.into_iter().enumerate() {
            let rotation = tilted_turn(tilt, turn);
            let motion = Rigid::carrying(rest[index].head, joint, rotation);
            joint = motion.apply(rest[index].tail);
            pose.set(self.bones[index], motion);
        }
        let digit = Rigid::carrying(rest[3].head, joint, digit_rotation);
        pose.set(self.bones[3], digit);
    }

    /// The two rigid groups at zero turn, and the fold between the segments
    /// of the one that has two.
    fn groups(&self, [a, b, c]: [DVec2; 3], fold: f64) -> (DVec2, DVec2, DVec2) {
        let sign = match self.kind {
            LimbKind::Strut => -1.0,
            LimbKind::Pantograph => 1.0,
        };
        let (sin, cos) = sin_cos(sign * fold / 360.0);
        let fold = DVec2::new(cos, sin);
        match self.kind {
            LimbKind::Strut => (a, b + fold.rotate(c), fold),
            LimbKind::Pantograph => (a + fold.rotate(c), b, fold),
        }
    }
}

/// The turns, as unit complex numbers, that make `first + second` end at
/// `target`; `side` says on which side of the target the first one lies.
fn two_bone(first: DVec2, second: DVec2, target: DVec2, side: f64) -> (DVec2, DVec2) {
    let (a, b) = (first.length(), second.length());
    let distance = target
        .length()
        .clamp((a - b).abs() * 1.001, (a + b) * 0.999);
    let direction = target.normalize_or(DVec2::NEG_Y);
    let cos = ((a * a + distance * distance - b * b) / (2.0 * a * distance)).clamp(-1.0, 1.0);
    let sin = side * (1.0 - cos * cos).sqrt();
    let knee = direction.rotate(DVec2::new(cos, sin)) * a;
    (
        quotient(knee, first),
        quotient(direction * distance - knee, second),
    )
}

/// The unit complex number that turns the direction of `from` into `to`'s.
fn quotient(to: DVec2, from: DVec2) -> DVec2 {
    DVec2::new(from.dot(to), from.perp_dot(to)).normalize_or(DVec2::X)
}

/// A turn in the x-y plane, then a tilt of the y-z plane.
fn tilted_turn(tilt: DVec2, turn: DVec2) -> DQuat {
    let in_plane = DMat3::from_cols(
        DVec3::new(turn.x, turn.y, 0.0),
        DVec3::new(-turn.y, turn.x, 0.0),
        DVec3::Z,
    );
    let sideways = DMat3::from_cols(
        DVec3::X,
        DVec3::new(0.0, tilt.x, tilt.y),
        DVec3::new(0.0, -tilt.y, tilt.x),
    );
    DQuat::from_mat3(&(sideways * in_plane))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn leg() -> Skeleton {
        let mut skeleton = Skeleton::default();
        skeleton.bone("trunk", "", [0.0, 1.3, 0.0], [0.3, 1.3, 0.0]);
        skeleton.bone("a", "trunk", [0.0, 1.2, 0.14], [0.2, 0.9, 0.20]);
        skeleton.bone("b", "a", [0.2, 0.9, 0.20], [-0.1, 0.55, 0.16]);
        skeleton.bone("c", "b", [-0.1, 0.55, 0.16], [-0.08, 0.2, 0.16]);
        skeleton.bone("d", "c", [-0.08, 0.2, 0.16], [0.0, 0.0, 0.16]);
        skeleton
    }

    #[test]
    fn toe_reaches_its_goal_and_bones_stay_joined() {
        let skeleton = leg();
        for kind in [LimbKind::Strut, LimbKind::Pantograph] {
            let limb = Limb::new(&skeleton, kind, ["a", "b", "c", "d"], "");
            for (x, y, z, heel_lift, fold) in [
                (0.0, 0.0, 0.16, 0.0, 0.0),
                (0.3, 0.1, 0.10, 20.0, 10.0),
                (-0.3, 0.2, 0.22, 50.0, 40.0),
            ] {
                let mut pose = Pose::new(&skeleton);
                let toe = DVec3::new(x, y, z);
                limb.reach(
                    &mut pose,
                    LimbGoal {
                        toe,
                        heel_lift,
                        fold,
                    },
                );
                let moved = |id: BoneId, point| pose.motions[usize::from(id)].apply(point);
                assert!(
                    moved(4, skeleton.get(4).tail).distance(toe) < 1e-9,
                    "{kind:?} {toe}"
                );
                for id in 1..4 {
                    let joint = skeleton.get(id).tail;
                    assert!(moved(id, joint).distance(moved(id + 1, joint)) < 1e-9);
                }
            }
        }
    }

    #[test]
    fn rest_is_a_fixed_point() {
        let skeleton = leg();
        for kind in [LimbKind::Strut, LimbKind::Pantograph] {
            let limb = Limb::new(&skeleton, kind, ["a", "b", "c", "d"], "");
            let mut pose = Pose::new(&skeleton);
            let toe = skeleton.get(4).tail;
            limb.reach(
                &mut pose,
                LimbGoal {
                    toe,
                    heel_lift: 0.0,
                    fold: 0.0,
                },
            );
            for motion in &pose.motions {
                assert!(
                    motion.apply(DVec3::ONE).distance(DVec3::ONE) < 1e-6,
                    "{kind:?}"
                );
            }
        }
    }

    #[test]
    fn goals_out_of_reach_stay_finite() {
        let skeleton = leg();
        let limb = Limb::new(&skeleton, LimbKind::Pantograph, ["a", "b", "c", "d"], "");
        for toe in [DVec3::new(9.0, -9.0, 3.0), DVec3::new(0.0, 1.2, 0.14)] {
            let mut pose = Pose::new(&skeleton);
            limb.reach(
                &mut pose,
                LimbGoal {
                    toe,
                    heel_lift: 0.0,
                    fold: 170.0,
                },
            );
            assert!(
                pose.motions
                    .iter()
                    .all(|m| m.rotation.is_finite() && m.translation.is_finite())
            );
        }
    }
}
