//! `splitcast track`: its table, its JSON, and what it says about wrong input.

mod common;

use common::{Place, header, sheet, tetrahedron};
use serde_json::Value;

/// Fields that every frame has.
const FIELDS: [&str; 11] = [
    "frame",
    "update_ms",
    "rebuild_ms",
    "sah_cost",
    "sah_ratio",
    "kept",
    "moved",
    "searched",
    "rebuilt",
    "references",
    "bytes",
];

/// Runs the command with JSON, checks what holds for every run, and gives the
/// frames and what was printed.
fn track(place: &Place, args: &[&str]) -> (Vec<Value>, String) {
    let args = [&["track", "--json", "track.json"], args].concat();
    let outcome = place.run(&args).success();
    let report = place.json("track.json");
    assert_eq!(report["version"], env!("CARGO_PKG_VERSION"));
    assert!(report["machine"]["cpu"].is_string());
    let frames = report["frames"].as_array().expect("a list").clone();
    let with_reference = args.contains(&"--reference");
    for frame in &frames {
        for field in FIELDS {
            assert!(frame.get(field).is_some(), "{field}: {frame}");
        }
        assert!(frame["update_ms"].is_f64(), "{frame}");
        for field in ["sah_cost", "sah_ratio", "bytes"] {
            assert!(number(frame, field) > 0.0, "{field}: {frame}");
        }
        assert_eq!(frame["rebuild_ms"].is_f64(), with_reference, "{frame}");
        let shares = ["kept", "moved", "searched", "rebuilt"];
        let all: f64 = shares.iter().map(|share| number(frame, share)).sum();
        assert_eq!(all, number(frame, "references"), "{frame}");
    }
    (frames, outcome.stdout)
}

fn number(frame: &Value, field: &str) -> f64 {
    frame[field].as_f64().expect(field)
}

fn numbers(frames: &[Value], field: &str) -> Vec<f64> {
    frames.iter().map(|frame| number(frame, field)).collect()
}

/// The first words of a table's rows, its header left out, up to where it ends.
fn row_names(text: &str) -> Vec<&str> {
    let lines = text.lines().skip(1);
    let names = lines.map(|line| line.split_whitespace().next().unwrap_or_default());
    names.take_while(|name| !name.ends_with(':')).collect()
}

#[test]
fn a_built_in_scene_has_a_row_a_frame_and_medians() {
    let place = Place::new();
    let (frames, text) = track(&place, &["horse", "--frames", "2:6", "--threads", "1"]);
    assert_eq!(numbers(&frames, "frame"), [2.0, 3.0, 4.0, 5.0]);
    assert_eq!(row_names(&text), ["2", "3", "4", "5", "median", "worst"]);
    for word in ["update", "SAH ratio", "rebuilt", "references", "bytes"] {
        assert!(text.contains(word), "{word}: {text}");
    }
    assert!(!text.contains("time ratio"), "{text}");
    let report = place.json("track.json");
    assert_eq!(
        (&report["input"], &report["threads"]),
        (&"horse".into(), &1.into())
    );
    assert_eq!(report["triangles"], frames[0]["triangles"]);
    assert!(report["reference"].is_null());

    let (others, _) = track(&place, &["horse", "--frames", "2:6", "--threads", "2"]);
    for field in ["sah_cost", "references", "kept", "nodes"] {
        let same = "the same tree on any number of threads";
        assert_eq!(
            numbers(&frames, field),
            numbers(&others, field),
            "{field}: {same}"
        );
    }
}

#[test]
fn a_reference_is_rebuilt_from_the_same_frames() {
    let place = Place::new();
    place.write_sheets("in", 5);
    let (frames, text) = track(&place, &["in", "--reference"]);
    for word in ["rebuild", "time ratio", "estimate", "binned"] {
        assert!(text.contains(word), "{word}: {text}");
    }
    // There is nothing to track in the first frame, so both are built alike.
    assert!((0.9..1.1).contains(&number(&frames[0], "sah_ratio")));
    assert_eq!(frames[0]["rebuilt"], frames[0]["references"]);
    assert_eq!(place.json("track.json")["reference"], "binned");

    let (alone, _) = track(&place, &["in"]);
    for field in ["sah_cost", "references", "sah_ratio_estimate"] {
        let same = "the reference leaves the tracker alone";
        assert_eq!(
            numbers(&frames, field),
            numbers(&alone, field),
            "{field}: {same}"
        );
    }
    assert_eq!(
        numbers(&alone, "sah_ratio"),
        numbers(&alone, "sah_ratio_estimate")
    );
}

#[test]
fn topology_may_change() {
    let place = Place::new();
    for (frame, n) in [12, 17, 9].into_iter().enumerate() {
        let phase = 0.05 * frame as f32;
        place.write(&format!("in/sheet_{frame}.ply"), sheet(n, phase));
    }
    let (frames, _) = track(&place, &["in", "--reference"]);
    assert_eq!(numbers(&frames, "triangles"), [288.0, 578.0, 162.0]);
    assert_eq!(place.json("track.json")["triangles"], 578);
    for (frame, quad) in [
        "f 1 2 3\nf 1 3 4\n",
        "f 1 2 3\n",
        "f 2 3 4\nf 1 2 4\nf 1 2 3\n",
    ]
    .into_iter()
    .enumerate()
    {
        let corners = format!("v 0 0 {frame}\nv 1 0 0\nv 1 1 0\nv 0 1 1\n");
        place.write(&format!("obj/{frame}.obj"), corners + quad);
    }
    let (frames, _) = track(&place, &["obj"]);
    assert_eq!(numbers(&frames, "triangles"), [2.0, 1.0, 3.0]);
}

#[test]
fn a_frame_without_triangles_is_left_out_and_told() {
    let place = Place::new();
    place.write_sheets("in", 4);
    place.write("in/sheet_1.ply", header(3, 0) + "0 0 0\n1 0 0\n0 1 0\n");
    let (frames, _) = track(&place, &["in"]);
    assert_eq!(numbers(&frames, "frame"), [0.0, 2.0, 3.0]);
    let notes = place.json("track.json")["notes"].clone();
    assert!(notes[0].as_str().unwrap().contains("Frame 1"), "{notes}");
}

#[test]
fn a_single_frame_has_no_median() {
    let place = Place::new();
    place.write_sheets("in", 2);
    let (_, text) = track(&place, &["in", "--frames", "1", "--reference"]);
    assert_eq!(row_names(&text), ["1"]);
}

#[test]
fn a_mesh_that_no_ray_meets_has_no_ratio() {
    let place = Place::new();
    place.write("point.ply", header(3, 1) + "1 1 1\n1 1 1\n1 1 1\n3 0 1 2\n");
    place
        .run(&["track", "point.ply", "--reference", "--json", "track.json"])
        .success();
    let frame = place.json("track.json")["frames"][0].clone();
    assert!(frame["sah_ratio"].is_null(), "{frame}");
}

#[test]
fn wrong_requests_are_refused_before_any_work() {
    let place = Place::new();
    place.write_sheets("in", 2);
    place.write("folder/inside", "x");
    place.write_frames("nan", 2);
    place.write(
        "nan/frame_01.ply",
        tetrahedron(0.0).replacen("0 1 0", "0 nan 0", 1),
    );
    place.write("empty.ply", header(3, 0) + "0 0 0\n1 0 0\n0 1 0\n");
    let before = place.contents(".");
    let (usage, failure) = (2, 1);
    for (args, code, expected) in [
        (&[][..], usage, "<INPUT>"),
        (&["missing.ply"], failure, "missing.ply"),
        (&["horsse"], failure, "elephant"),
        (&["in", "--threads", "0"], usage, "1024"),
        (&["in", "--threads", "two"], usage, "--threads"),
        (&["in", "--frames", "0:3"], usage, "0:2"),
        (&["in", "--frames", "x"], usage, "--frames"),
        (&["in", "--json", "none/a.json"], failure, "create it"),
        (&["in", "--json", "folder"], failure, "folder"),
        (&["in", "--reference", "best"], usage, "best"),
        (&["nan"], failure, "frame 1 (nan/frame_01.ply): vertex 2"),
        (&["nan"], failure, "--non-finite skip"),
        (&["nan", "--non-finite", "maybe"], usage, "reject"),
        (&["empty.ply"], failure, "no frame has a triangle"),
    ] {
        let outcome = place.run(&[&["track"], args].concat());
        assert_eq!(outcome.code, code, "{args:?}: {}", outcome.stderr);
        let is_error = |line: &&str| !line.starts_with("warning: ");
        let errors: Vec<&str> = outcome.stderr.lines().filter(is_error).collect();
        let [error] = errors[..] else {
            panic!("{args:?}: one line: {}", outcome.stderr);
        };
        assert!(
            error.starts_with("error: ") && error.contains(expected),
            "{args:?}: {error}"
        );
        assert_eq!(outcome.stdout, "", "{args:?}");
        assert_eq!(
            place.contents("."),
            before,
            "{args:?}: nothing new, nothing gone"
        );
    }
    let (frames, _) = track(&place, &["nan", "--non-finite", "skip"]);
    assert_eq!(numbers(&frames, "skipped_triangles"), [0.0, 3.0]);
}
