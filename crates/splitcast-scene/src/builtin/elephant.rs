//! `elephant`: an elephant at the walk, in place.
//!
//! Proportions are those of a young bull of 3 m at the shoulder, with the
//! high double-domed head and arched back of the Asian elephant and ears of
//! the African one. The gait is the lateral sequence walk that elephants keep
//! at every speed (Hutchinson et al., "The locomotor kinematics of Asian and
//! African elephants", 2006): hind foot, fore foot of that side, then the
//! other side, each about a quarter of a stride after the last.

mod body;
mod gait;

use super::BuiltinScene;
use super::animal::Animal;

/// What the scene list says of it.
pub(super) const SCENE: BuiltinScene = BuiltinScene {
    name: "elephant",
    description: "a walking elephant with swinging trunk and flapping ears, skinned",
    triangles: 84_524,
    frames: 48,
    frames_per_second: 30.0,
    periodic: true,
    open: || Box::new(elephant()),
};

/// Chosen for the triangle count.
const CELL: f32 = 0.03274;

fn elephant() -> Animal {
    Animal::new(&SCENE, body::rig(), CELL, body::paint, gait::pose)
}
