//! `splitcast reproduce`: what it writes, and what it says about wrong input.

mod common;

use common::{Place, header, sheet, tetrahedron};
use serde_json::Value;

/// Fields that every row of the table has.
const FIELDS: [&str; 15] = [
    "scene",
    "filter",
    "triangles",
    "frames",
    "normal_ms",
    "initial_ms",
    "running_ms",
    "reduction",
    "evaluations_per_split_normal",
    "evaluations_per_split_running",
    "orientation_mismatch_rate",
    "prediction_rmse_relative",
    "sah_ratio_to_sweep",
    "trace_ratio_to_sweep",
    "filter_overhead_ms",
];

/// Runs the command with one round.
fn reproduce(place: &Place, args: &[&str]) -> common::Outcome {
    place.run(&[&["reproduce", "--rounds", "1"], args].concat())
}

fn text(place: &Place, file: &str) -> String {
    std::fs::read_to_string(place.path(file)).unwrap()
}

#[test]
fn table_figures_and_page() {
    let place = Place::new();
    place.write_sheets("in", 5);
    let outcome = place
        .run(&[
            "reproduce",
            "in",
            "--rounds",
            "2",
            "--seed",
            "7",
            "--out",
            "results/run",
            "--json",
            "table.json",
        ])
        .success();
    for word in ["scene", "kalman", "wiener", "sheet", "running", "SAH"] {
        assert!(outcome.stdout.contains(word), "{word}: {}", outcome.stdout);
    }
    assert_eq!(
        text(&place, "table.json"),
        text(&place, "results/run/table1.json")
    );

    let table = place.json("table.json");
    assert_eq!(table["seed"], 7);
    assert_eq!(table["settings"]["rounds"], 2);
    assert!(table["machine"]["cpu"].is_string() && table["machine"]["commit"].is_string());
    assert_eq!(table["paper"].as_array().unwrap().len(), 4);
    let rows = table["scenes"].as_array().unwrap();
    let filters: Vec<&str> = rows
        .iter()
        .map(|row| row["filter"].as_str().unwrap())
        .collect();
    assert_eq!(filters, ["kalman", "wiener"]);
    for row in rows {
        assert_eq!(row["scene"], "sheet");
        assert_eq!(
            (&row["triangles"], &row["frames"]),
            (&512.into(), &5.into())
        );
        for field in &FIELDS[4..] {
            assert!(row[field].is_f64(), "{field}: {row}");
        }
        assert!(row["sah_ratio_to_normal"].as_f64().unwrap() > 0.5);
        assert!((0.0..=1.0).contains(&row["orientation_mismatch_rate"].as_f64().unwrap()));
        let worst = &row["worst"]["running_ms"];
        assert!(worst["value"].as_f64() >= row["running_ms"].as_f64());
        assert!(
            (1..5).contains(&worst["frame"].as_u64().unwrap()),
            "{worst}"
        );
    }

    let csv = text(&place, "results/run/table1.csv");
    let lines: Vec<&str> = csv.lines().collect();
    assert!(lines[0].starts_with(&FIELDS.join(",")), "{}", lines[0]);
    assert_eq!(lines.len(), 3);
    assert!(lines[1].starts_with("sheet,kalman,512,5,"), "{}", lines[1]);
    let columns = |line: &str| line.split(',').count();
    assert!(lines.iter().all(|line| columns(line) == columns(lines[0])));

    let files: Vec<String> = place
        .contents("results/run")
        .into_iter()
        .map(|(name, _)| name)
        .collect();
    for file in ["figure3-sheet-build-time.svg", "sheet-innovation.svg"] {
        assert!(files.iter().any(|name| name == file), "{file}: {files:?}");
    }
    for part in ["figure3-sheet-cost-", "figure3-sheet-position-", "node-"] {
        let found = files.iter().filter(|name| name.starts_with(part)).count();
        assert!(found >= 2, "{part}: {files:?}");
    }
    check_page(&text(&place, "results/run/report.html"));
}

/// Whether a page has what it is for, and fetches nothing.
fn check_page(page: &str) {
    let figures = page.matches("<svg").count();
    assert!(figures >= 12, "{figures} figures");
    assert!(page.matches("data:image/png;base64,").count() >= 5);
    for word in [
        "Table I",
        "reproduce in --rounds 2 --seed 7",
        "Seed",
        "Processor",
        "Commit",
    ] {
        assert!(page.contains(word), "{word}");
    }
    for part in page.split(['"', '\'', '(']).skip(1) {
        let names_a_namespace = part.starts_with("http://www.w3.org/");
        let fetches =
            part.starts_with("http:") || part.starts_with("https:") || part.starts_with("//");
        assert!(
            names_a_namespace || !fetches,
            "{}",
            &part[..part.len().min(60)]
        );
    }
    assert!(!page.contains("<script") && !page.contains("<link") && !page.contains("@import"));
}

#[test]
fn trees_and_predictions_do_not_depend_on_the_run() {
    let place = Place::new();
    place.write_sheets("in", 3);
    for (out, threads) in [("a", "1"), ("b", "2")] {
        reproduce(&place, &["in", "--out", out, "--threads", threads]).success();
    }
    let figures = |out: &str| {
        let rows = place.json(&format!("{out}/table1.json"))["scenes"].clone();
        let fields = [
            "prediction_rmse_relative",
            "sah_ratio_to_sweep",
            "sah_ratio_to_normal",
        ];
        let rows = rows.as_array().unwrap().iter();
        rows.map(|row| fields.map(|field| row[field].clone()))
            .collect::<Vec<_>>()
    };
    assert_eq!(figures("a"), figures("b"));
    let svg = |out: &str| {
        text(
            &place,
            &format!("{out}/sheet-prediction-error-by-depth.svg"),
        )
    };
    assert_eq!(svg("a"), svg("b"));
}

#[test]
fn one_frame_has_no_running_build() {
    let place = Place::new();
    place.write_sheets("in", 3);
    let outcome = reproduce(&place, &["in", "--frames", "1"]).success();
    assert!(outcome.stdout.contains(" - "), "{}", outcome.stdout);
    let table = place.json("reproduction/table1.json");
    let row = &table["scenes"][0];
    assert_eq!(row["frames"], 1);
    for field in ["normal_ms", "initial_ms", "evaluations_per_split_normal"] {
        assert!(row[field].as_f64().unwrap() > 0.0, "{field}");
    }
    for field in [
        "running_ms",
        "reduction",
        "sah_ratio_to_normal",
        "prediction_rmse_relative",
    ] {
        assert!(row[field].is_null(), "{field}");
    }
    let page = text(&place, "reproduction/report.html");
    for words in ["Only frame 1 is measured", "one frame only"] {
        assert!(page.contains(words), "{words}");
    }
}

#[test]
fn an_empty_frame_is_left_out_and_named() {
    let place = Place::new();
    place.write_sheets("in", 4);
    place.write("in/sheet_2.ply", header(3, 0) + "0 0 0\n1 0 0\n0 1 0\n");
    let outcome = reproduce(&place, &["in"]).success();
    let warned =
        |line: &str| line.starts_with("warning: Frame 2 (") && line.contains("sheet_2.ply");
    assert!(outcome.stderr.lines().any(warned), "{}", outcome.stderr);
    let measured = place.json("reproduction/measurements.json");
    let frames = measured["scenes"][0]["frames"].as_array().unwrap();
    let numbers: Vec<_> = frames
        .iter()
        .map(|frame| frame["frame"].as_u64().unwrap())
        .collect();
    assert_eq!(numbers, [0, 1, 3]);
    let is_running = |frame: &Value| {
        let builds = frame["builds"].as_array().unwrap().iter();
        builds.filter(|build| build["running"] == true).count()
    };
    assert_eq!([0, 1, 2].map(|frame| is_running(&frames[frame])), [0, 2, 2]);
}

#[test]
fn topology_may_change() {
    let place = Place::new();
    for (frame, n) in [12, 17, 9].into_iter().enumerate() {
        place.write(
            &format!("in/sheet_{frame}.ply"),
            sheet(n, 0.05 * frame as f32),
        );
    }
    reproduce(&place, &["in"]).success();
    let row = place.json("reproduction/table1.json")["scenes"][0].clone();
    assert!(row["running_ms"].is_f64() && row["triangles"] == 2 * 17 * 17);
    let page = text(&place, "reproduction/report.html");
    assert!(page.contains("The triangles change 2 times, first at frame 1"));
}

#[test]
fn trees_without_a_split_have_no_figures_of_splits() {
    let place = Place::new();
    place.write_frames("in", 3);
    reproduce(&place, &["in"]).success();
    let row = place.json("reproduction/table1.json")["scenes"][0].clone();
    assert!(row["normal_ms"].is_f64());
    for field in ["orientation_mismatch_rate", "prediction_rmse_relative"] {
        assert!(row[field].is_null(), "{field}: {row}");
    }
    assert!(text(&place, "reproduction/report.html").contains("no frame has an inner node there"));
}

#[test]
fn nodes_are_chosen_by_their_way_from_the_root() {
    let place = Place::new();
    place.write_sheets("in", 3);
    let far = "l".repeat(40);
    let outcome = reproduce(&place, &["in", "--node", "L", "--node", &far]).success();
    assert!(
        outcome
            .stderr
            .contains("warning: sheet: no frame splits the node LLLL")
    );
    let files = place.contents("reproduction");
    let of_node = |node: &str| {
        let names = files.iter().map(|(name, _)| name);
        names
            .filter(|name| name.starts_with(&format!("node-{node}-")))
            .count()
    };
    assert_eq!((of_node("L"), of_node(&far.to_uppercase())), (2, 1));
}

#[test]
fn two_scenes_of_one_name_are_told_apart() {
    let place = Place::new();
    place.write_sheets("a", 2);
    place.write_sheets("b", 2);
    reproduce(&place, &["a", "b"]).success();
    assert!(place.exists("reproduction/sheet-outcomes.svg"));
    assert!(place.exists("reproduction/sheet-2-outcomes.svg"));
    let table = place.json("reproduction/table1.json");
    let names = table["scenes"].as_array().unwrap().iter();
    let names: Vec<&str> = names.map(|row| row["scene"].as_str().unwrap()).collect();
    assert_eq!(names, ["sheet", "sheet", "sheet-2", "sheet-2"]);
}

#[test]
fn wrong_requests_are_refused_before_any_work() {
    let place = Place::new();
    place.write_sheets("in", 2);
    place.write("file", "x");
    place.write("nan/sheet_0.ply", sheet(4, 0.0));
    place.write(
        "nan/sheet_1.ply",
        tetrahedron(0.0).replacen("0 1 0", "0 nan 0", 1),
    );
    place.write("empty.ply", header(3, 0) + "0 0 0\n1 0 0\n0 1 0\n");
    let before = place.contents(".");
    let (usage, failure) = (2, 1);
    for (args, code, expected) in [
        (&["in", "--noise-process", "-1"][..], usage, "0 to 10"),
        (&["in", "--noise-measurement", "11"], usage, "0 to 10"),
        (
            &["in", "--noise-measurement", "nan"],
            usage,
            "--noise-measurement",
        ),
        (&["in", "--seed", "-1"], usage, "--seed"),
        (&["in", "--threads", "0"], usage, "1024"),
        (&["in", "--rounds", "0"], usage, "1000"),
        (&["in", "--frames", "0:3"], usage, "0:2"),
        (&["in", "--node", "up"], usage, "LRL"),
        (&["in", "--orientation-running", "best"], usage, "probes"),
        (&["in", "--out", "file"], failure, "file"),
        (&["in", "--out", "file/out"], failure, "file"),
        (&["in", "--json", "none/a.json"], failure, "create it"),
        (&["in", "missing.ply"], failure, "missing.ply"),
        (&["horsse"], failure, "elephant"),
        (&["nan"], failure, "--non-finite skip"),
        (&["empty.ply"], failure, "no frame has a triangle"),
    ] {
        let outcome = place.run(&[&["reproduce"], args].concat());
        assert_eq!(outcome.code, code, "{args:?}: {}", outcome.stderr);
        let last = outcome.stderr.lines().last().unwrap();
        assert!(
            last.starts_with("error: ") && last.contains(expected),
            "{args:?}: {last}"
        );
        assert_eq!(outcome.stdout, "", "{args:?}");
        assert_eq!(
            place.contents("."),
            before,
            "{args:?}: nothing new, nothing gone"
        );
    }
    let outcome = reproduce(&place, &["nan", "--non-finite", "skip"]).success();
    let measured = place.json("reproduction/measurements.json");
    let skipped = &measured["scenes"][0]["frames"][1]["skipped_triangles"];
    assert_eq!(skipped, 3, "{}", outcome.stderr);
}
