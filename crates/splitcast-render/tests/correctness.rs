//! The core's correctness suite over the built-in scenes, and over real meshes
//! read as a user would read them. The latter are not part of this project: the
//! tests look for them where the environment variable `SPLITCAST_DATA` points,
//! and skip without it.

#[path = "../../splitcast/tests/suite/mod.rs"]
mod suite;

use std::path::PathBuf;

use splitcast::{BuildOptions, Builder};
use splitcast_scene::{FrameSource, MeshSequence, builtin};

/// Checks every frame of a source, in order, with the builders that carry
/// something over from frame to frame, and some frames with all others.
fn check_frames(source: &mut dyn FrameSource) {
    let tracks = |options: &BuildOptions| {
        matches!(
            options.builder,
            Builder::Tracked | Builder::Kalman | Builder::Wiener
        )
    };
    let (tracked, other): (Vec<_>, Vec<_>) = suite::default_sets().into_iter().partition(tracks);
    let (mut tracked, mut other) = (suite::Suite::new(&tracked), suite::Suite::new(&other));
    for index in 0..source.frame_count() {
        let frame = source.frame(index).expect("a readable frame");
        let name = format!("{}, frame {index}", source.name());
        tracked.check_next(&name, &frame.positions, &frame.triangles);
        if index % 16 == 7 || index == 0 {
            other.check_next(&name, &frame.positions, &frame.triangles);
        }
    }
}

fn check_real(folder: &str) {
    let Some(data) = std::env::var_os("SPLITCAST_DATA") else {
        println!("skipped {folder}: SPLITCAST_DATA is not set");
        return;
    };
    let path = PathBuf::from(data).join(folder);
    check_frames(&mut MeshSequence::open(path).expect("a sequence"));
}

#[test]
fn the_galloping_horse_equals_brute_force() {
    check_real("horse-gallop");
}

#[test]
fn the_cloth_over_a_ball_equals_brute_force() {
    check_real("cloth-ball");
}

fn check_built_in(name: &str) {
    let mut scene = builtin::open(name).expect("a built-in scene");
    check_frames(&mut *scene);
}

#[test]
fn the_built_in_horse_equals_brute_force() {
    check_built_in("horse");
}

#[test]
fn the_elephant_equals_brute_force() {
    check_built_in("elephant");
}

#[test]
fn the_cloth_on_its_ball_equals_brute_force() {
    check_built_in("cloth-ball");
}

#[test]
fn the_collision_equals_brute_force() {
    check_built_in("collision");
}
