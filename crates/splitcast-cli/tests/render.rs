//! Whole runs: complete outputs, the same bytes every time, resuming, figures.

mod common;

use common::Place;

const TARGETS: [&str; 4] = ["film.mp4", "film.apng", "frame_%02d.png", "frame_%02d.exr"];

#[test]
fn every_format_is_complete_and_the_same_on_any_number_of_threads() {
    let place = Place::new();
    place.write_frames("in", 3);
    for target in TARGETS {
        let mut results = Vec::new();
        for (run, threads) in ["1", "2", "2"].iter().enumerate() {
            let folder = format!("out{run}_{}", target.replace('%', ""));
            place.write(&format!("{folder}/keep"), "");
            let out = format!("{folder}/{target}");
            place
                .run(&[
                    "render",
                    "in",
                    "--out",
                    &out,
                    "--size",
                    "32x18",
                    "--spp",
                    "2",
                    "--threads",
                    threads,
                ])
                .success();
            results.push(place.contents(&folder));
        }
        let files = if target.contains('%') { 3 } else { 1 };
        assert_eq!(results[0].len(), files + 1, "{target}: nothing else stays");
        assert_eq!(results[0], results[1], "{target}");
        assert_eq!(results[1], results[2], "{target}");
    }
}

#[test]
fn pictures_have_the_size_and_something_in_them() {
    let place = Place::new();
    place.write_frames("in", 2);
    for view in ["beauty", "steps", "leaf-depth", "split-planes", "normals"] {
        place
            .render(&["in", "--out", "f_%d.png", "--view", view, "--ground", "off"])
            .success();
        for name in ["f_0.png", "f_1.png"] {
            let file = std::fs::File::open(place.path(name)).unwrap();
            let mut reader = png::Decoder::new(std::io::BufReader::new(file))
                .read_info()
                .unwrap();
            assert_eq!((reader.info().width, reader.info().height), (32, 18));
            let mut pixels = vec![0; 3 * 32 * 18];
            reader.next_frame(&mut pixels).unwrap();
            let shows = pixels.chunks(3).any(|pixel| pixel != &pixels[..3]);
            assert!(shows, "{view}: the mesh differs from the sky");
        }
    }
}

#[test]
fn a_resumed_run_gives_the_bytes_of_an_uninterrupted_one() {
    let place = Place::new();
    place.write_frames("in", 4);
    for target in TARGETS {
        for folder in ["whole", "parts"] {
            let _ = std::fs::remove_dir_all(place.path(folder));
            place.write(&format!("{folder}/keep"), "");
        }
        let (whole, parts) = (format!("whole/{target}"), format!("parts/{target}"));
        place.render(&["in", "--out", &whole]).success();
        // A frame that breaks off the run in the middle, after the check of the input.
        place.render(&["in", "--out", &parts]).success();
        if target.contains('%') {
            let extension = &target[target.len() - 3..];
            std::fs::remove_file(place.path(&format!("parts/frame_03.{extension}"))).unwrap();
            let path = place.path(&format!("parts/frame_01.{extension}"));
            let bytes = std::fs::read(&path).unwrap();
            std::fs::write(&path, &bytes[..bytes.len() - 9]).unwrap();
        }
        let outcome = place
            .render(&["in", "--out", &parts, "--resume", "--json", "r.json"])
            .success();
        assert_eq!(place.contents("whole"), place.contents("parts"), "{target}");
        let report = place.json("r.json");
        if target.contains('%') {
            assert_eq!(
                report["resumed_frames"],
                serde_json::json!([0, 2]),
                "{target}"
            );
            assert_eq!(report["frames"].as_array().unwrap().len(), 2);
            assert!(
                outcome
                    .stderr
                    .contains("1 frame of the earlier run not kept"),
                "{}",
                outcome.stderr
            );
        }
    }
}

/// Stops a run in the middle, as Ctrl-C or a power cut would.
#[test]
fn a_killed_run_leaves_whole_frames_and_goes_on() {
    let place = Place::new();
    place.write_frames("in", 24);
    for target in ["film.mp4", "frame_%02d.png"] {
        let folder = format!("out_{}", &target[..4]);
        let whole = format!("whole_{}", &target[..4]);
        for folder in [&folder, &whole] {
            place.write(&format!("{folder}/keep"), "");
        }
        let args = |folder: &str| {
            let out = format!("{folder}/{target}");
            let args = [
                "render",
                "in",
                "--out",
                &out,
                "--size",
                "160x90",
                "--spp",
                "16",
                "--threads",
                "2",
            ];
            args.map(str::to_owned)
        };
        let mut child = std::process::Command::new(assert_cmd::cargo::cargo_bin("splitcast"))
            .args(args(&folder))
            .current_dir(place.path("."))
            .stdout(std::process::Stdio::null())
            .stderr(std::process::Stdio::null())
            .spawn()
            .unwrap();
        let third = if target.contains('%') {
            place.path(&format!("{folder}/frame_02.png"))
        } else {
            place.path(&format!("{folder}/{target}.partial/frame_000002.png"))
        };
        while !third.exists() && child.try_wait().unwrap().is_none() {
            std::thread::sleep(std::time::Duration::from_millis(1));
        }
        child.kill().unwrap();
        child.wait().unwrap();
        assert!(!place.exists(&format!("{folder}/film.mp4")));

        let mut resumed: Vec<String> = args(&folder).into();
        resumed.extend(["--resume", "--json", "r.json"].map(str::to_owned));
        place
            .run(&resumed.iter().map(String::as_str).collect::<Vec<_>>())
            .success();
        let kept = place.json("r.json")["resumed_frames"]
            .as_array()
            .unwrap()
            .len();
        assert!(
            (3..24).contains(&kept),
            "{kept} frames of the killed run were kept"
        );
        place
            .run(&args(&whole).each_ref().map(String::as_str))
            .success();
        let is_left_over = |name: &str| name.ends_with(".tmp");
        let mut files = place.contents(&folder);
        files.retain(|(name, _)| !is_left_over(name));
        assert_eq!(files, place.contents(&whole), "{target}");
    }
}

#[test]
fn frames_of_other_settings_are_not_mixed() {
    let place = Place::new();
    place.write_frames("in", 2);
    place.render(&["in", "--out", "f_%d.png"]).success();
    let outcome = place
        .render(&["in", "--out", "f_%d.png", "--resume"])
        .success();
    assert!(
        outcome.stdout.contains("2 frames kept"),
        "{}",
        outcome.stdout
    );
    let outcome = place
        .render(&["in", "--out", "f_%d.png", "--resume", "--flat"])
        .success();
    assert!(
        outcome
            .stderr
            .contains("shading was smooth and is now flat"),
        "{}",
        outcome.stderr
    );
    place.write_frames("in", 3);
    std::fs::remove_file(place.path("in/frame_02.ply")).unwrap();
    place.write("in/frame_01.ply", common::tetrahedron(0.29));
    let outcome = place
        .render(&["in", "--out", "f_%d.png", "--resume", "--flat"])
        .success();
    assert!(
        outcome.stderr.contains("input's content"),
        "{}",
        outcome.stderr
    );
    let outcome = place
        .render(&[
            "in",
            "--out",
            "f_%d.png",
            "--resume",
            "--flat",
            "--builder",
            "binned",
        ])
        .success();
    assert!(
        outcome
            .stderr
            .contains("builder was tracked and is now binned"),
        "{}",
        outcome.stderr
    );
}

#[test]
fn the_report_holds_every_frame() {
    let place = Place::new();
    place.write_frames("in", 4);
    let outcome = place
        .render(&[
            "in",
            "--out",
            "f_%02d.png",
            "--frames",
            "1:3",
            "--builder",
            "sweep",
            "--json",
            "r.json",
        ])
        .success();
    for word in [
        "build", "trace", "total", "tone map", "write", "mean", "median", "frames/s", "2 frames",
        "sweep",
    ] {
        assert!(outcome.stdout.contains(word), "{word}: {}", outcome.stdout);
    }
    assert!(
        outcome
            .stderr
            .contains("rendering 2/2: 0:00 left, frame 2, build"),
        "{}",
        outcome.stderr
    );
    assert!(place.exists("f_01.png") && place.exists("f_02.png") && !place.exists("f_00.png"));
    let report = place.json("r.json");
    let frames = report["frames"].as_array().unwrap();
    let numbers: Vec<_> = frames
        .iter()
        .map(|frame| frame["frame"].as_u64().unwrap())
        .collect();
    assert_eq!(numbers, [1, 2]);
    for frame in frames {
        assert_eq!(frame["triangles"], 4);
        for field in [
            "build_ms",
            "trace_ms",
            "tone_map_ms",
            "write_ms",
            "rays",
            "nodes",
            "references",
            "sah_cost",
            "bytes",
        ] {
            assert!(frame[field].as_f64().unwrap() > 0.0, "{field}: {frame}");
        }
    }
    assert!(report["frames_ms"].as_f64() < report["wall_ms"].as_f64());
    assert_eq!(report["width"], 32);
    assert_eq!(report["builder"], "sweep");
}

#[test]
fn one_frame_needs_no_pattern() {
    let place = Place::new();
    place.write_frames("in", 3);
    place
        .render(&["in", "--out", "still.png", "--frames", "2"])
        .success();
    place
        .render(&["in/frame_02.ply", "--out", "other.exr"])
        .success();
    assert!(place.exists("still.png") && place.exists("other.exr"));
}

/// A view of the tree shows what was carried over, so a resumed run has to follow the frames
/// that it does not render, and frames that were tracked from elsewhere are not its own.
#[test]
fn a_resumed_view_of_a_tracked_tree_is_that_of_an_uninterrupted_run() {
    let place = Place::new();
    place.write_sheets("in", 4);
    for builder in ["kalman", "tracked"] {
        let render = |folder: &str, flags: &[&str]| {
            place.write(&format!("{folder}/keep"), "");
            let out = format!("{folder}/frame_%d.png");
            let view = ["in", "--out", &out, "--view", "steps", "--builder", builder];
            place.render(&[&view, flags].concat()).success()
        };
        let (whole, parts) = (format!("whole_{builder}"), format!("parts_{builder}"));
        render(&whole, &[]);
        render(&parts, &[]);
        std::fs::remove_file(place.path(&format!("{parts}/frame_2.png"))).unwrap();
        let outcome = render(&parts, &["--resume", "--json", "r.json"]);
        assert!(
            outcome.stdout.contains("3 frames kept"),
            "{}",
            outcome.stdout
        );
        assert_eq!(place.json("r.json")["frames"].as_array().unwrap().len(), 1);
        assert_eq!(place.contents(&whole), place.contents(&parts), "{builder}");
        let outcome = render(&parts, &["--resume", "--frames", "2:"]);
        assert!(
            outcome.stderr.contains("first frame was 0 and is now 2"),
            "{}",
            outcome.stderr
        );
    }
}
