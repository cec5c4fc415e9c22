//! `scenes` and `info`.

mod common;

use common::Place;
use serde_json::Value;

#[test]
fn the_list_names_every_scene() {
    let place = Place::new();
    let text = place.run(&["scenes"]).success().stdout;
    let json: Value =
        serde_json::from_str(&place.run(&["scenes", "--json"]).success().stdout).unwrap();
    let scenes = json["scenes"].as_array().unwrap();
    assert!(!scenes.is_empty());
    for scene in scenes {
        assert!(text.contains(scene["name"].as_str().unwrap()));
        assert!(scene["triangles"].as_u64().unwrap() > 0 && scene["frames"].as_u64().unwrap() > 0);
    }
}

#[test]
fn an_exported_scene_reads_back() {
    let place = Place::new();
    place
        .run(&["scenes", "export", "horse", "horse-frames"])
        .success();
    let info = |input: &str| -> Value {
        serde_json::from_str(&place.run(&["info", input, "--json"]).success().stdout).unwrap()
    };
    let (built_in, exported) = (info("horse"), info("horse-frames"));
    for field in ["bounds", "frames", "constant_topology", "normals", "colors"] {
        assert_eq!(built_in[field], exported[field], "{field}");
    }
    assert_eq!(built_in["input"], "horse");
    let list: Value =
        serde_json::from_str(&place.run(&["scenes", "--json"]).success().stdout).unwrap();
    let horse = list["scenes"]
        .as_array()
        .unwrap()
        .iter()
        .find(|scene| scene["name"] == "horse");
    let frames = built_in["frames"].as_array().unwrap();
    assert_eq!(horse.unwrap()["frames"], frames.len());
    assert!(
        frames
            .iter()
            .all(|frame| frame["triangles"] == horse.unwrap()["triangles"])
    );
}

#[test]
fn info_tells_what_changes() {
    let place = Place::new();
    place.write_frames("in", 3);
    let text = place.run(&["info", "in"]).success().stdout;
    for part in [
        "frames",
        "vertices",
        "bounds",
        "motion",
        "topology   constant",
    ] {
        assert!(text.contains(part), "{part}: {text}");
    }
    place.write(
        "in/frame_01.ply",
        common::header(3, 1) + "0 0 0\n1 0 0\n0 nan 0\n3 0 1 2\n",
    );
    let outcome = place.run(&["info", "in"]).success();
    assert!(
        outcome.stdout.contains("changes 2 times, first at frame 1"),
        "{}",
        outcome.stdout
    );
    assert!(
        outcome.stdout.contains("--non-finite skip"),
        "{}",
        outcome.stdout
    );
    assert!(outcome.stderr.contains("warning: "), "{}", outcome.stderr);
    let outcome = place.run(&["info", "nowhere.ply"]);
    assert_eq!((outcome.code, outcome.stderr.lines().count()), (1, 1));
}
