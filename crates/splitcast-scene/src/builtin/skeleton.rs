//! Skeletons and their poses: bones at rest, turned about their heads from
//! parent to child (forward kinematics).
//!
//! All animals face +x, so a turn about +z lifts what lies ahead of the
//! joint, and their right side is +z.

use glam::{DQuat, DVec3};

use super::curve::sin_cos;

/// Index of a bone.
pub(super) type BoneId = u8;

/// A bone at rest.
#[derive(Clone, Debug)]
pub(super) struct Bone {
    name: String,
    parent: Option<BoneId>,
    /// The joint about which it turns.
    pub(super) head: DVec3,
    /// Its other end: the head of the next bone of a chain, or a tip.
    pub(super) tail: DVec3,
}

/// A rigid motion: `rotation * point + translation`.
#[derive(Clone, Copy, Debug)]
pub(super) struct Rigid {
    pub(super) rotation: DQuat,
    pub(super) translation: DVec3,
}

impl Rigid {
    const IDENTITY: Self = Self {
        rotation: DQuat::IDENTITY,
        translation: DVec3::ZERO,
    };

    /// The turn that takes `from` to `to`.
    pub(super) fn carrying(from: DVec3, to: DVec3, rotation: DQuat) -> Self {
        Self {
            rotation,
            translation: to - rotation * from,
        }
    }

    /// Where `point` goes.
    pub(super) fn apply(&self, point: DVec3) -> DVec3 {
        self.rotation * point + self.translation
    }
}

/// Bones at rest, parents before children.
#[derive(Clone, Debug, Default)]
pub(super) struct Skeleton {
    bones: Vec<Bone>,
}

impl Skeleton {
    /// Adds one bone; `parent` has to be there already.
    pub(super) fn bone(&mut self, name: &str, parent: &str, head: [f64; 3], tail: [f64; 3]) {
        let parent = (!parent.is_empty()).then(|| self.id(parent));
        self.bones.push(Bone {
            name: name.to_owned(),
            parent,
            head: head.into(),
            tail: tail.into(),
        });
    }

    /// Adds `joints.len() - 1` bones named `name0`, `name1` and so on.
    pub(super) fn chain(&mut self, name: &str, parent: &str, joints: &[[f64; 3]]) {
        let mut parent = parent.to_owned();
        for (index, pair) in joints.windows(2).enumerate() {
            let bone = format!("{name}{index}");
            self.bone(&bone, &parent, pair[0], pair[1]);
            parent = bone;
        }
    }

    /// The bone called `name`.
    pub(super) fn id(&self, name: &str) -> BoneId {
        let found = self.bones.iter().position(|bone| bone.name == name);
        found.unwrap_or_else(|| panic!("the skeleton has no bone {name}")) as BoneId
    }

    /// Every bone whose name starts with one of `prefixes`.
    pub(super) fn ids(&self, prefixes: &[&str]) -> Vec<BoneId> {
        (0..)
            .zip(&self.bones)
            .filter(|(_, bone)| prefixes.iter().any(|prefix| bone.name.starts_with(prefix)))
            .map(|(id, _)| id)
            .collect()
    }

    pub(super) fn bones(&self) -> &[Bone] {
        &self.bones
    }

    pub(super) fn get(&self, id: BoneId) -> &Bone {
        &self.bones[usize::from(id)]
    }
}

/// The motion of every bone from rest; bones are set parents first.
#[derive(Clone, Debug)]
pub(super) struct Pose<'a> {
    skeleton: &'a Skeleton,
    pub(super) motions: Vec<Rigid>,
}

impl<'a> Pose<'a> {
    /// The rest pose.
    pub(super) fn new(skeleton: &'a Skeleton) -> Self {
        Self {
            skeleton,
            motions: vec![Rigid::IDENTITY; skeleton.bones.len()],
        }
    }

    pub(super) fn skeleton(&self) -> &'a Skeleton {
        self.skeleton
    }

    /// Turns a bone about its head, after its parent's motion, and shifts it.
    pub(super) fn turn(&mut self, name: &str, rotation: DQuat, shift: DVec3) {
        let id = self.skeleton.id(name);
        let bone = self.skeleton.get(id);
        let base = bone
            .parent
            .map_or(Rigid::IDENTITY, |parent| self.motions[usize::from(parent)]);
        self.motions[usize::from(id)] = Rigid::carrying(
            bone.head,
            base.apply(bone.head) + shift,
            base.rotation * rotation,
        );
    }

    /// Sets the motion of a bone outright.
    pub(super) fn set(&mut self, id: BoneId, motion: Rigid) {
        self.motions[usize::from(id)] = motion;
    }

    /// Where the parent of a bone has taken its head.
    pub(super) fn head(&self, id: BoneId) -> DVec3 {
        let bone = self.skeleton.get(id);
        bone.parent.map_or(bone.head, |parent| {
            self.motions[usize::from(parent)].apply(bone.head)
        })
    }
}

/// The turn by `degrees` about the unit vector `axis`.
pub(super) fn turn_about(axis: DVec3, degrees: f64) -> DQuat {
    let (sin, cos) = sin_cos(degrees / 720.0);
    let v = axis * sin;
    DQuat::from_xyzw(v.x, v.y, v.z, cos)
}

/// Lifts what lies ahead of the joint.
pub(super) fn pitch(degrees: f64) -> DQuat {
    turn_about(DVec3::Z, degrees)
}

/// Turns what lies ahead of the joint to the left.
pub(super) fn yaw(degrees: f64) -> DQuat {
    turn_about(DVec3::Y, degrees)
}

/// Rolls over to the right.
pub(super) fn roll(degrees: f64) -> DQuat {
    turn_about(DVec3::X, degrees)
}
