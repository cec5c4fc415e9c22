//! The core's correctness suite over real meshes, read as a user would read
//! them. They are not part of this project: the tests look for them where the
//! environment variable `SPLITCAST_DATA` points, and skip without it.

#[path = "../../splitcast/tests/suite/mod.rs"]
mod suite;

use std::path::PathBuf;

use splitcast_scene::{FrameSource, MeshSequence};

/// Checks some frames of a sequence with every builder.
fn check_frames(folder: &str, frames: impl IntoIterator<Item = usize>) {
    let Some(data) = std::env::var_os("SPLITCAST_DATA") else {
        println!("skipped {folder}: SPLITCAST_DATA is not set");
        return;
    };
    let mut sequence = MeshSequence::open(PathBuf::from(data).join(folder)).expect("a sequence");
    for index in frames {
        let frame = sequence.frame(index).expect("a readable frame");
        suite::check_mesh_with(
            &format!("{folder}, frame {index}"),
            &frame.positions,
            &frame.triangles,
            &suite::default_sets(),
        );
    }
}

#[test]
fn the_galloping_horse_equals_brute_force() {
    check_frames("horse-gallop", (0..48).step_by(5));
}

#[test]
fn the_cloth_over_a_ball_equals_brute_force() {
    check_frames("cloth-ball", 0..2);
}
