//! Wrong input: one line that names the place and the remedy, the right exit
//! code, no panic, and what was there before stays.

mod common;

use common::{Place, header, tetrahedron};

const USAGE: i32 = 2;
const FAILURE: i32 = 1;

/// Runs `render` with the arguments and checks how it fails.
fn check(place: &Place, args: &[&str], code: i32, expected: &[&str]) {
    let before = place.contents(".");
    let outcome = place.render(args);
    let errors: Vec<&str> = outcome
        .stderr
        .lines()
        .filter(|line| !line.starts_with("warning: "))
        .collect();
    assert_eq!(outcome.code, code, "{args:?}: {}", outcome.stderr);
    assert_eq!(errors.len(), 1, "{args:?}: one line: {}", outcome.stderr);
    assert!(errors[0].starts_with("error: "), "{args:?}: {}", errors[0]);
    for part in expected {
        assert!(
            errors[0].contains(part),
            "{args:?}: '{part}' in '{}'",
            errors[0]
        );
    }
    assert_eq!(outcome.stdout, "", "{args:?}");
    assert_eq!(
        place.contents("."),
        before,
        "{args:?}: nothing new, nothing gone"
    );
}

#[test]
fn wrong_meshes() {
    let place = Place::new();
    let good = tetrahedron(0.0);
    place.write("empty.ply", "");
    place.write("text.ply", "Dear diary, this is no mesh.\n");
    place.write("truncated.ply", &good[..good.len() - 20]);
    place.write("lies.ply", good.replace("vertex 4", "vertex 4000000000"));
    place.write("index.ply", good.replace("3 0 2 1", "3 0 99 1"));
    place.write("negative.ply", good.replace("3 0 2 1", "3 0 -1 1"));
    place.write("nan.ply", good.replacen("0 1 0", "0 nan 0", 1));
    place.write("points.ply", header(1, 0) + "0 0 0\n");
    place.write("letters.ply", good.replacen("0 1 0", "0 one 0", 1));
    place.write("mesh.xyz", &good);
    place.write(
        "broken.ply.gz",
        [0x1f, 0x8b, 8, 0, 0, 0, 0, 0, 0, 3, 1, 2, 3],
    );
    place.write("bad.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 9\n");
    for (file, code, expected) in [
        ("missing.ply", FAILURE, "no such file"),
        ("empty.ply", FAILURE, "empty"),
        ("text.ply", FAILURE, "text.ply"),
        ("truncated.ply", FAILURE, "cut short"),
        ("lies.ply", FAILURE, "4000000000"),
        ("index.ply", FAILURE, "99"),
        ("negative.ply", FAILURE, "-1"),
        ("nan.ply", FAILURE, "--non-finite skip"),
        ("points.ply", FAILURE, "triangles"),
        ("letters.ply", FAILURE, "one"),
        ("mesh.xyz", USAGE, ".ply"),
        ("broken.ply.gz", FAILURE, "gzip"),
        ("bad.obj", FAILURE, "9"),
        ("nothing_*.ply", FAILURE, "no mesh file"),
        ("nothing_%04d.ply", FAILURE, "no mesh file"),
        ("%s.ply", USAGE, "%04d"),
    ] {
        let name = if file.contains("nothing") {
            "nothing"
        } else {
            file
        };
        check(&place, &[file, "--out", "out.mp4"], code, &[name, expected]);
    }
    check(
        &place,
        &["horsse", "--out", "out.mp4"],
        FAILURE,
        &["horsse", "elephant"],
    );
}

#[test]
fn a_bad_frame_in_the_middle_is_found_before_rendering() {
    let place = Place::new();
    place.write_frames("in", 4);
    place.write(
        "in/frame_02.ply",
        tetrahedron(0.6).replacen("0.6 1 0", "nan 1 0", 1),
    );
    place.write("film.mp4", "an earlier film");
    check(
        &place,
        &["in", "--out", "film.mp4"],
        FAILURE,
        &["frame_02.ply", "frame 2", "vertex 2"],
    );
    place.write("in/frame_02.ply", "ply\n");
    check(
        &place,
        &["in", "--out", "film.mp4"],
        FAILURE,
        &["frame_02.ply"],
    );
}

#[test]
fn skipping_leaves_out_and_counts() {
    let place = Place::new();
    place.write("nan.ply", tetrahedron(0.0).replacen("0 1 0", "0 nan 0", 1));
    place
        .render(&[
            "nan.ply",
            "--out",
            "a.png",
            "--non-finite",
            "skip",
            "--json",
            "a.json",
        ])
        .success();
    assert_eq!(place.json("a.json")["frames"][0]["skipped_triangles"], 3);
}

#[test]
fn wrong_outputs() {
    let place = Place::new();
    place.write_frames("in", 3);
    place.write("file", "x");
    place.write("folder.mp4/inside", "x");
    for (out, code, expected) in [
        ("film", USAGE, ".mp4"),
        ("film.avi", USAGE, ".mp4"),
        ("one.png", USAGE, "one_%04d.png"),
        ("%s.png", USAGE, "%04d"),
        ("none/film.mp4", FAILURE, "create it"),
        ("none/frame_%d.png", FAILURE, "create it"),
        ("file/film.mp4", FAILURE, "file"),
        ("folder.mp4", FAILURE, "is a folder"),
    ] {
        check(&place, &["in", "--out", out], code, &[expected]);
    }
    check(
        &place,
        &["in", "--out", "a.mp4", "--json", "none/a.json"],
        FAILURE,
        &["none", "create it"],
    );
    check(&place, &["in"], USAGE, &["--out"]);
}

#[test]
fn wrong_flags() {
    let place = Place::new();
    place.write_frames("in", 3);
    for (flags, expected) in [
        (&["--size", "0x0"][..], "--size"),
        (&["--size", "12"], "960x540"),
        (&["--size", "33x18"], "32x18"),
        (&["--size", "65535x65534"], "65535x65534"),
        (&["--spp", "0"], "1 to"),
        (&["--spp", "-3"], "--spp"),
        (&["--frames", "3:4"], "0:3"),
        (&["--frames", "0:4"], "0:3"),
        (&["--frames", "7"], "0:3"),
        (&["--frames", "2:1"], "--frames"),
        (&["--frames", "x"], "--frames"),
        (&["--fps", "0"], "1 to 1000"),
        (&["--fps", "nan"], "1 to 1000"),
        (&["--fov", "0"], "degrees"),
        (&["--fov", "-20"], "degrees"),
        (&["--eye", "1,2"], "1.5,0,-2"),
        (&["--eye", "nan,0,0"], "eye"),
        (&["--eye", "1,1,1", "--look-at", "1,1,1"], "eye"),
        (&["--up", "0,0,0"], "up"),
        (&["--builder", "best"], "sweep"),
        (&["--quality", "superb"], "draft"),
        (&["--view", "xray"], "beauty"),
        (&["--ground", "maybe"], "on"),
        (&["--exposure", "99"], "exposure"),
        (&["--threads", "0"], "--threads"),
        (&["--threads", "99999"], "1024"),
        (&["--colour"], "--colour"),
    ] {
        // The small flags come first and may not be given twice.
        let mut args = vec!["render", "in", "--out", "film.mp4"];
        args.extend(flags);
        let outcome = place.run(&args);
        assert_eq!(outcome.code, USAGE, "{flags:?}: {}", outcome.stderr);
        let errors: Vec<&str> = outcome.stderr.lines().collect();
        assert_eq!(errors.len(), 1, "{flags:?}: {}", outcome.stderr);
        assert!(
            errors[0].starts_with("error: ") && errors[0].contains(expected),
            "{}",
            errors[0]
        );
        assert!(!place.exists("film.mp4") && !place.exists("film.mp4.partial"));
    }
    for args in [
        &[][..],
        &["fly"],
        &["scenes", "export", "unicorn", "out"],
        &["info"],
    ] {
        let outcome = place.run(args);
        assert_eq!(
            (outcome.code, outcome.stderr.lines().count()),
            (USAGE, 1),
            "{args:?}"
        );
    }
    for args in [&["--help"][..], &["--version"], &["render", "--help"]] {
        assert!(!place.run(args).success().stdout.is_empty());
    }
}

#[test]
fn a_closed_pipe_is_no_error() {
    use std::process::{Command, Stdio};
    let place = Place::new();
    let mut child = Command::new(assert_cmd::cargo::cargo_bin("splitcast"))
        .args(["scenes", "--json"])
        .current_dir(place.path("."))
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    drop(child.stdout.take());
    let output = child.wait_with_output().unwrap();
    assert!(output.status.success());
    assert_eq!(String::from_utf8_lossy(&output.stderr), "");
}
