//! Scanned and simulated meshes as they are found in the world. They are not
//! part of the project: the tests look for them in the folder that the
//! environment variable `SPLITCAST_DATA` names, and skip without it.

use std::path::PathBuf;
use std::sync::Arc;

use splitcast_scene::{FrameSource, MeshSequence, Prefetch, SequenceInfo, SequenceWarning};

fn open(input: &str) -> Option<MeshSequence> {
    let Some(data) = std::env::var_os("SPLITCAST_DATA") else {
        println!("skipped: SPLITCAST_DATA is not set");
        return None;
    };
    let path = PathBuf::from(data).join(input);
    Some(MeshSequence::open(&path).unwrap_or_else(|error| panic!("{error}")))
}

fn measure(mut sequence: MeshSequence) -> SequenceInfo {
    SequenceInfo::measure(&mut sequence).unwrap_or_else(|error| panic!("{error}"))
}

#[test]
fn the_horse_gallops_with_one_topology() {
    for input in [
        "horse-gallop",
        "horse-gallop/*.ply",
        "horse-gallop/horse_%03d.ply",
    ] {
        let Some(sequence) = open(input) else { return };
        assert!(sequence.warnings().is_empty(), "{:?}", sequence.warnings());
        assert_eq!(sequence.files().len(), 48);
        assert_eq!(sequence.name(), "horse");
    }
    let Some(sequence) = open("horse-gallop") else {
        return;
    };
    let info = measure(sequence);
    assert_eq!(info.vertices(), (8431, 8431));
    assert_eq!(info.triangles(), (16843, 16843));
    assert!(info.topology_changes.is_empty());
    let motion = info.motion().expect("motion");
    assert!((motion.mean_step - 0.0219).abs() < 0.0001, "{motion:?}");
    assert!((motion.max_step - 0.231).abs() < 0.001, "{motion:?}");
}

#[test]
fn read_ahead_the_horse_shares_its_triangles() {
    let Some(sequence) = open("horse-gallop") else {
        return;
    };
    let mut first = None;
    for (expected, item) in Prefetch::new(Box::new(sequence), 0..48).enumerate() {
        let (index, frame) = item.unwrap_or_else(|error| panic!("{error}"));
        assert_eq!(index, expected);
        let first = first.get_or_insert_with(|| Arc::clone(&frame.triangles));
        assert!(Arc::ptr_eq(first, &frame.triangles));
    }
}

#[test]
fn the_cloth_is_big_endian() {
    let Some(sequence) = open("cloth-ball") else {
        return;
    };
    let info = measure(sequence);
    assert_eq!((info.frames.len(), info.vertices()), (2, (46598, 46598)));
    assert_eq!(info.triangles(), (92230, 92230));
    let motion = info.motion().expect("motion");
    assert!((motion.mean_step - 0.008).abs() < 0.001, "{motion:?}");
}

#[test]
fn the_flag_is_remeshed_in_every_frame() {
    let Some(sequence) = open("flag") else { return };
    let warnings = sequence.warnings();
    assert!(
        matches!(warnings, [SequenceWarning::MixedSizes { .. }]),
        "{warnings:?}"
    );
    let info = measure(sequence);
    assert_eq!(info.topology_changes, (1..16).collect::<Vec<_>>());
    assert!(info.motion().is_none());
}

#[test]
fn scans_are_read_as_text_plain_and_packed() {
    let Some(bunny) = open("bunny/bun_zipper.ply") else {
        return;
    };
    let bunny = measure(bunny);
    assert_eq!((bunny.vertices().0, bunny.triangles().0), (35947, 69451));
    let Some(dragon) = open("dragon") else { return };
    let dragon = measure(dragon);
    assert_eq!(
        (dragon.vertices().0, dragon.triangles().0),
        (100_250, 202_520)
    );
    assert_eq!(bunny.frames[0].non_finite + dragon.frames[0].non_finite, 0);
}
