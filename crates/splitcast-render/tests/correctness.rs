//! The core's correctness suite over the built-in scenes, and over real meshes
//! read as a user would read them. The latter are not part of this project: the
//! tests look for them where the environment variable `SPLITCAST_DATA` points,
//! and skip without it.

#[path = "../../splitcast/tests/suite/mod.rs"]
mod suite;

use std::path::PathBuf;

use splitcast_scene::{FrameSource, MeshSequence, builtin};

/// Checks some frames of any source with every builder.
fn check_frames(source: &mut dyn FrameSource, frames: impl IntoIterator<Item = usize>) {
    for index in frames {
        let frame = source.frame(index).expect("a readable frame");
        suite::check_mesh_with(
            &format!("{}, frame {index}", source.name()),
            &frame.positions,
            &frame.triangles,
            &suite::default_sets(),
        );
    }
}

fn check_real(folder: &str, frames: impl IntoIterator<Item = usize>) {
    let Some(data) = std::env::var_os("SPLITCAST_DATA") else {
        println!("skipped {folder}: SPLITCAST_DATA is not set");
        return;
    };
    let path = PathBuf::from(data).join(folder);
    check_frames(&mut MeshSequence::open(path).expect("a sequence"), frames);
}

#[test]
fn the_galloping_horse_equals_brute_force() {
    check_real("horse-gallop", (0..48).step_by(5));
}

#[test]
fn the_cloth_over_a_ball_equals_brute_force() {
    check_real("cloth-ball", 0..2);
}

fn check_built_in(name: &str, frames: impl IntoIterator<Item = usize>) {
    let mut scene = builtin::open(name).expect("a built-in scene");
    check_frames(&mut *scene, frames);
}

#[test]
fn the_built_in_horse_equals_brute_force() {
    check_built_in("horse", [0, 7, 19]);
}

#[test]
fn the_elephant_equals_brute_force() {
    check_built_in("elephant", [0, 31]);
}

#[test]
fn the_cloth_on_its_ball_equals_brute_force() {
    check_built_in("cloth-ball", [0, 24]);
}

#[test]
fn the_collision_equals_brute_force() {
    check_built_in("collision", [0, 9]);
}
