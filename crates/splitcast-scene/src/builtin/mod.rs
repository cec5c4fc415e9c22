//! Scenes made by the library's own code: no files, no downloads, the same
//! bits on every machine.
//!
//! The four scenes stand in for the animations of Hussain and Grahn (2008,
//! table 1) at the same triangle and frame counts. Lengths are metres, y is
//! up, and the ground is the plane y = 0.

mod animal;
mod cloth;
mod cloth_ball;
mod collision;
mod curve;
mod edge_collapse;
mod edge_flips;
mod elephant;
mod figurines;
mod foot_path;
mod fracture;
mod geodesic_sphere;
mod grid_subdivision;
mod horse;
mod implicit;
mod limb;
mod marching_tetrahedra;
mod paint;
mod particle_contacts;
mod random;
mod rigid_body;
mod sculpture;
mod sculpture_blocks;
mod skeleton;
mod skinning;
mod surface_nets;
mod value_noise;
mod xpbd;

use crate::{FrameSource, SceneError};

/// What is known of a built-in scene before it is opened.
#[derive(Clone, Copy, Debug)]
pub struct BuiltinScene {
    /// The name that [`open`] knows it by.
    pub name: &'static str,
    /// One line on what is to be seen.
    pub description: &'static str,
    /// Exact number of triangles, the same in every frame.
    pub triangles: usize,
    /// Exact number of frames.
    pub frames: usize,
    /// Frames per second at which it is meant to play.
    pub frames_per_second: f32,
    /// Whether the last frame leads back into the first.
    pub periodic: bool,
    /// Builds the scene: its rest mesh or the start of its simulation.
    pub open: fn() -> Box<dyn FrameSource>,
}

/// Every built-in scene, by rising triangle count.
static SCENES: &[BuiltinScene] = &[
    horse::SCENE,
    elephant::SCENE,
    cloth_ball::SCENE,
    collision::SCENE,
];

/// Every built-in scene, by rising triangle count.
pub fn list() -> &'static [BuiltinScene] {
    SCENES
}

/// The names of the built-in scenes, in the order of [`list`].
pub fn names() -> impl Iterator<Item = &'static str> {
    SCENES.iter().map(|scene| scene.name)
}

/// Opens the built-in scene `name`, or `None` where there is none of that name.
pub fn open(name: &str) -> Option<Box<dyn FrameSource>> {
    let scene = SCENES.iter().find(|scene| scene.name == name)?;
    Some((scene.open)())
}

/// The error every source gives for a frame past its end.
fn check_frame_index(name: &str, index: usize, count: usize) -> Result<(), SceneError> {
    if index < count {
        return Ok(());
    }
    Err(SceneError::FrameOutOfRange {
        name: name.to_owned(),
        index,
        count,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn scenes_are_found_by_their_names_and_by_no_other() {
        for scene in list() {
            assert_eq!(names().filter(|name| *name == scene.name).count(), 1);
        }
        for name in ["", "Horse", "horse ", "no such scene"] {
            assert!(open(name).is_none(), "{name:?}");
        }
    }

    #[test]
    fn scenes_are_listed_by_rising_size() {
        assert!(list().is_sorted_by_key(|scene| scene.triangles));
    }
}
