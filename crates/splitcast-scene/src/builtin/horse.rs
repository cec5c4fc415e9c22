//! `horse`: a bay horse at the gallop, in place.
//!
//! Proportions are those of a riding horse of 1.60 m at the withers. The gait
//! is the transverse gallop with one suspension (Muybridge 1887; Hildebrand,
//! "The Mechanics of Horse Legs", 1987): trailing hind, leading hind, trailing
//! fore, leading fore, and all four off the ground with the legs gathered.

mod body;
mod gait;

use super::BuiltinScene;
use super::animal::Animal;

/// What the scene list says of it.
pub(super) const SCENE: BuiltinScene = BuiltinScene {
    name: "horse",
    description: "a galloping horse, skinned",
    triangles: 16_948,
    frames: 48,
    frames_per_second: 30.0,
    periodic: true,
    open: || Box::new(horse()),
};

/// Chosen for the triangle count.
const CELL: f32 = 0.0314;

fn horse() -> Animal {
    Animal::new(&SCENE, body::rig(), CELL, body::paint, gait::pose)
}
