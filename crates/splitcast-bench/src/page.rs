//! The page `report.html`.

use splitcast_console::table::grouped;
use splitcast_console::{count, figure};
use splitcast_report::{Cell, Column, Page, Section, Table};

use crate::check::TOLERANCE;
use crate::command::{Report, Settings, troubles};
use crate::figures::{SceneFigures, SceneView};
use crate::measure::SceneMeasurement;
use crate::rays::RaySetKind;
use crate::results::{Figure, Ratio, Row};
use crate::terminal::NONE;

/// What stands for a set in the table of modes that was traced ray by ray.
const SINGLE: &str = "single rays";

/// The whole page.
pub(crate) fn page(report: &Report) -> String {
    let page = Page::new("Splitcast side by side with its peers")
        .lead(lead(report))
        .section(standing(report));
    let page = (report.scenes.iter()).fold(page, |page, scene| {
        page.section(scene_section(report, scene))
    });
    page.section(systems(report))
        .section(columns())
        .section(method())
        .section(origin(report))
        .to_html()
}

fn lead(report: &Report) -> String {
    let mut families: Vec<&str> = report.systems.iter().map(|system| system.family).collect();
    families.sort_unstable();
    families.dedup();
    let libraries = match families.len() {
        1 => "1 library".to_owned(),
        n => format!("{n} libraries"),
    };
    format!(
        "{} of {libraries} follow the same moving meshes and trace the same rays behind each update, in \
         turns and in one run, on {} with {}.",
        count(report.systems.len(), "system"),
        report.machine.cpu,
        match &report.settings.threads[..] {
            [threads] => count(*threads, "thread"),
            _ => format!("{} threads", threads(&report.settings)),
        },
    )
}

fn threads(settings: &Settings) -> String {
    let threads: Vec<String> = settings.threads.iter().map(usize::to_string).collect();
    threads.join(" and ")
}

/// A scene's heading, and its name in tables.
fn place(scene: &str, threads: usize) -> String {
    format!("{scene}, {}", count(threads, "thread"))
}

fn standing(report: &Report) -> Section {
    let section = Section::new("How Splitcast stands");
    if report.ratios.is_empty() {
        return section.paragraph(
            "It takes one of our systems and one of the others, both with right hits, to compare \
             anything.",
        );
    }
    let lines = Ratio::lines(&report.ratios, &report.kinds);
    // The places of updates and tracing, and those of whole frames.
    let (times, frames): (Vec<_>, Vec<_>) = (Ratio::figures(&report.kinds).enumerate())
        .partition(|(_, (figure, _))| *figure != Figure::Frame);
    let table = |places: &[(usize, (Figure, Option<&'static str>))], caption: &str| {
        let names = places
            .iter()
            .map(|(_, figure)| Column::right(name(*figure)));
        let table = Table::new([Column::left("scene")].into_iter().chain(names)).caption(caption);
        lines.iter().fold(table, |table, line| {
            let name = line.iter().flatten().next();
            let name = name.map_or(String::new(), |ratio| place(&ratio.scene, ratio.threads));
            let cells = places.iter().map(|&(index, _)| ratio_cell(line[index]));
            table.row::<Cell>([name.into()].into_iter().chain(cells))
        })
    };
    section
        .paragraph(
            "Time of our best system over that of the best other one, each the best by that very \
             figure. Below 1 Splitcast is ahead (✓), above it is behind (✗). Which systems these are \
             stands in the section of each scene.",
        )
        .table(table(&times, "An update, and tracing each set of rays."))
        .table(table(&frames, "A frame: the update and one set of rays."))
        .paragraph(left_out(report))
}

fn ratio_cell(ratio: Option<&Ratio>) -> Cell {
    match ratio {
        Some(ratio) if ratio.ratio < 1.0 => Cell::good(format!("{:.2}", ratio.ratio)),
        Some(ratio) => Cell::short(format!("{:.2}", ratio.ratio)),
        None => NONE.into(),
    }
}

/// What a column of ratios compares.
fn name((figure, rays): (Figure, Option<&'static str>)) -> String {
    match (figure, rays) {
        (Figure::Frame, Some(rays)) => with_update(rays),
        (_, Some(rays)) => rays.to_owned(),
        (_, None) => "update".to_owned(),
    }
}

/// The name of an update and a set of rays; it does not break behind the sign.
fn with_update(rays: &str) -> String {
    format!("+\u{a0}{rays}")
}

/// Who is not compared, and where.
fn left_out(report: &Report) -> String {
    let unsound = report.scenes.iter().flat_map(|scene| {
        let systems = scene.systems.iter().filter(|system| !system.is_sound());
        systems.map(|system| format!("{} on {}", system.name, place(&scene.scene, scene.threads)))
    });
    let unsound: Vec<String> = unsound.collect();
    if unsound.is_empty() {
        "All systems followed all frames with right hits, so none is left out.".to_owned()
    } else {
        format!(
            "Systems that gave up, or miss hits or invent them, are measured, but not compared: {}.",
            unsound.join("; ")
        )
    }
}

fn scene_section(report: &Report, scene: &SceneMeasurement) -> Section {
    let is_here = |name: &str, threads| (name, threads) == (&scene.scene[..], scene.threads);
    let rows = report
        .rows
        .iter()
        .filter(|row| is_here(&row.scene, row.threads));
    let rows: Vec<&Row> = rows.collect();
    let ratios = report
        .ratios
        .iter()
        .filter(|ratio| is_here(&ratio.scene, ratio.threads));
    let ratios: Vec<&Ratio> = ratios.collect();
    let most = |figure: fn(&Row) -> usize| rows.iter().map(|row| figure(row)).max().unwrap_or(0);
    let section = Section::new(place(&scene.scene, scene.threads)).paragraph(format!(
        "{} triangles, {}. {} measured; behind {} of them rays were traced.",
        grouped(scene.triangles),
        count(scene.frames, "frame"),
        count(most(|row| row.samples), "update"),
        most(|row| row.traced),
    ));
    let figures = SceneFigures::new(&SceneView {
        scene,
        rows: &rows,
        systems: &report.systems,
        kinds: &report.kinds,
    });
    let section = section
        .table(times(&rows, &report.kinds))
        .table(frames(&rows, &report.kinds));
    let mut section = figures.fronts.into_iter().fold(section, Section::figure);
    if !ratios.is_empty() {
        section = section.table(best(&ratios));
    }
    section = section.figures(figures.times);
    if !figures.quality.is_empty() {
        section = section.figures(figures.quality);
    }
    match modes(&rows, &report.kinds) {
        Some(table) => section.table(table),
        None => section.paragraph("All rays were traced one by one."),
    }
}

/// What a column shows of a row.
type FigureOf<'a> = dyn Fn(&Row) -> Option<f64> + 'a;

/// A column of figures by system.
struct FigureColumn<'a> {
    name: String,
    value: Box<FigureOf<'a>>,
    /// Whether more is better; `None` if systems cannot be compared by it.
    more_is_better: Option<bool>,
}

impl<'a> FigureColumn<'a> {
    fn new(
        name: impl Into<String>,
        more_is_better: Option<bool>,
        value: impl Fn(&Row) -> Option<f64> + 'a,
    ) -> Self {
        Self {
            name: name.into(),
            value: Box::new(value),
            more_is_better,
        }
    }

    /// The best figure of sound systems.
    fn best(&self, rows: &[&Row]) -> Option<f64> {
        let more_is_better = self.more_is_better?;
        let values = rows.iter().filter(|row| row.is_sound());
        values
            .filter_map(|row| (self.value)(row))
            .reduce(match more_is_better {
                true => f64::max,
                false => f64::min,
            })
    }

    fn cell(&self, row: &Row, best: Option<f64>) -> Cell {
        match (self.value)(row) {
            None => NONE.into(),
            Some(value) if !row.is_sound() => Cell::muted(figure(value)),
            // Whatever reads the same as the best is as good as it.
            Some(value) if best.map(figure) == Some(figure(value)) => Cell::strong(figure(value)),
            Some(value) => figure(value).into(),
        }
    }
}

/// A table with a row a system.
fn by_system(rows: &[&Row], columns: &[FigureColumn<'_>]) -> Table {
    let header = columns
        .iter()
        .map(|column| Column::right(column.name.clone()));
    let table = Table::new([Column::left("system")].into_iter().chain(header));
    let best: Vec<_> = columns.iter().map(|column| column.best(rows)).collect();
    rows.iter().fold(table, |table, row| {
        let cells = columns
            .iter()
            .zip(&best)
            .map(|(column, &best)| column.cell(row, best));
        table.row::<Cell>([system_cell(row)].into_iter().chain(cells))
    })
}

fn system_cell(row: &Row) -> Cell {
    match row.is_sound() {
        true => row.label().into(),
        false => Cell::muted(row.label()),
    }
}

fn times(rows: &[&Row], kinds: &[RaySetKind]) -> Table {
    let mut columns = vec![
        FigureColumn::new("update", Some(false), |row| Some(row.update_ms.median)),
        FigureColumn::new("p95", Some(false), |row| Some(row.update_ms.p95)),
        FigureColumn::new("worst", Some(false), |row| Some(row.update_ms.worst)),
    ];
    columns.extend(kinds.iter().map(|kind| {
        FigureColumn::new(kind.name(), Some(true), |row: &Row| {
            row.mrays.get(kind.name()).copied()
        })
    }));
    by_system(rows, &columns).caption(
        "Time of an update in ms: median, 95th percentile and worst frame. Rate of each set of rays \
         in million a second. The best of each column stands out.",
    )
}

fn frames(rows: &[&Row], kinds: &[RaySetKind]) -> Table {
    let mut columns: Vec<_> = (kinds.iter())
        .map(|kind| {
            FigureColumn::new(with_update(kind.name()), Some(false), |row: &Row| {
                row.frame_ms.get(kind.name()).copied()
            })
        })
        .collect();
    columns.push(FigureColumn::new("memory", Some(false), |row| {
        Some(row.bytes as f64 / 1e6)
    }));
    columns.push(FigureColumn::new("SAH cost", None, |row| row.sah_cost));
    by_system(rows, &columns)
        .caption("Time of an update and one set of rays in the same frame in ms; memory in MB.")
}

/// Who is behind the ratios.
fn best(ratios: &[&Ratio]) -> Table {
    let table = Table::new([
        Column::left("best by"),
        Column::left("of ours"),
        Column::left("of the others"),
        Column::right("ours ÷ other"),
    ])
    .caption("The systems that are compared at the top of this page.");
    ratios.iter().fold(table, |table, ratio| {
        let by = match ratio.figure {
            Figure::Frame => format!("update {}", name((ratio.figure, ratio.rays))),
            _ => name((ratio.figure, ratio.rays)),
        };
        table.row::<Cell>([
            by.into(),
            ratio.ours.clone().into(),
            ratio.peer.clone().into(),
            ratio_cell(Some(ratio)),
        ])
    })
}

/// How rays were traced, `None` if all were traced one by one.
fn modes(rows: &[&Row], kinds: &[RaySetKind]) -> Option<Table> {
    let rows: Vec<_> = (rows.iter())
        .filter(|row| row.modes.values().any(|&mode| mode != SINGLE))
        .collect();
    if rows.is_empty() {
        return None;
    }
    let header = kinds.iter().map(|kind| Column::left(kind.name()));
    let table = Table::new([Column::left("system")].into_iter().chain(header)).caption(
        "How each set of rays was traced, which is the fastest way that the system has. All \
         others trace ray by ray.",
    );
    let table = rows.into_iter().fold(table, |table, row| {
        let modes = kinds.iter().map(|kind| match row.modes.get(kind.name()) {
            None => NONE.into(),
            Some(&SINGLE) => Cell::muted(SINGLE),
            Some(&mode) => mode.into(),
        });
        table.row::<Cell>([row.system.clone().into()].into_iter().chain(modes))
    });
    Some(table)
}

fn systems(report: &Report) -> Section {
    let table = Table::new([Column::left("system"), Column::left("what it is")]);
    let table = (report.systems.iter()).fold(table, |table, system| {
        table.row([system.name.clone(), system.about.clone()])
    });
    let mut section = Section::new("Systems").table(table);
    for missing in &report.missing {
        section = section.paragraph(format!("Missing: {missing}."));
    }
    let troubles: Vec<(String, String)> = (report.scenes.iter())
        .flat_map(|scene| {
            let place = place(&scene.scene, scene.threads);
            troubles(scene)
                .into_iter()
                .map(move |line| (place.clone(), line))
        })
        .collect();
    if troubles.is_empty() {
        section.paragraph("No system gave up, and the hits of all of them are right.")
    } else {
        section
            .paragraph("Systems that gave up or whose hits are wrong:")
            .definitions(troubles)
    }
}

fn columns() -> Section {
    Section::new("What the columns mean").definitions([
        (
            "update",
            "Everything from a frame’s new positions to the first ray traced at full speed, and \
             giving memory back afterwards: trees, leaf blocks, wide nodes, copies of vertices. The \
             first frame of a sequence does not count.",
        ),
        ("p95", "The time that 95 of 100 updates do not exceed."),
        (
            "primary",
            "One ray a pixel from a camera that frames the whole motion: closest hit.",
        ),
        (
            "shadow",
            "From each point that is seen to a random point of a square light: is anything hit?",
        ),
        (
            "ao",
            "From the same points into the half space above, a tenth of the scene’s diagonal \
             long: is anything hit?",
        ),
        (
            "diffuse",
            "From the same points into the half space above, without an end: closest hit.",
        ),
        ("random", "Between random points of the frame’s box: closest hit."),
        (
            "+ rays",
            "Update and those rays in the same frame; medians of sums, not sums of medians.",
        ),
        (
            "memory",
            "The most that was held behind one of the first two updates, the mesh itself not \
             counted.",
        ),
        (
            "SAH cost",
            "Expected cost of a ray by the surface area heuristic, in units of each library’s own, \
             where its tree can be read.",
        ),
        (
            "yardstick",
            "The system of the same library that builds its tree well from nothing in every frame.",
        ),
    ])
}

fn method() -> Section {
    Section::new("How it was measured")
        .paragraph(
            "All systems get the same frames and the same rays. In each frame they take turns, in \
             an order that rotates, so that drift of the machine hits all alike; on its turn a system updates and then traces all sets of rays. A single thread \
             stays on one processor, several are left to the operating system, and Embree, \
             which has threads of its own, gets as many.",
        )
        .paragraph(
            "Before the clock starts, two frames warm everything up; where a system has several \
             ways to trace, the fastest of three trials is chosen for each set of rays and kept.",
        )
        .paragraph(format!(
            "Hits are checked in every frame in which rays are traced: a sample of each set ray by \
             ray with brute force, and the number of all hits and the sum of their distances to \
             within {TOLERANCE:e}. Figures are medians over the frames unless they say otherwise."
        ))
}

fn origin(report: &Report) -> Section {
    let settings = &report.settings;
    let (width, height) = settings.size;
    let sets: Vec<&str> = report.kinds.iter().map(|kind| kind.name()).collect();
    let every = settings.every.map_or_else(
        || "about ten frames of each scene".to_owned(),
        |every| match every {
            1 => "every frame".to_owned(),
            _ => format!("one frame in {every}"),
        },
    );
    Section::new("Run it again")
        .paragraph(
            "results.json holds the figures of all tables, frames.json every update and every set \
             of rays that was traced.",
        )
        .code(report.machine.command.clone())
        .definitions([
            ("Picture", format!("{width} × {height} pixels")),
            ("Threads", threads(settings)),
            ("Rays", sets.join(", ")),
            ("Traced in", every),
            (
                "Rounds",
                settings
                    .rounds
                    .map_or("as many as give ten updates".to_owned(), |n| n.to_string()),
            ),
        ])
        .definitions(report.machine.definitions())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::check::Agreement;
    use crate::command::SystemInfo;
    use crate::measure::{SystemMeasurement, TraceSample, UpdateSample};
    use roxmltree::{Document, ParsingOptions};
    use splitcast_report::Provenance;

    const KINDS: [RaySetKind; 2] = [RaySetKind::Primary, RaySetKind::Diffuse];

    /// A system whose updates take longer from frame to frame.
    fn system(name: &str, update_ms: f64, trace_ms: f64) -> SystemMeasurement {
        let update = |frame: usize| UpdateSample {
            frame,
            update_ms: update_ms * (1.0 + 0.01 * frame as f64),
            traces: KINDS
                .map(|_| TraceSample {
                    rays: 1000,
                    ms: trace_ms,
                })
                .to_vec(),
            sah_cost: Some(trace_ms),
        };
        SystemMeasurement {
            name: name.to_owned(),
            modes: vec!["single rays", "packets"],
            bytes: 1_000_000,
            updates: (1..4).map(update).collect(),
            agreement: KINDS.map(Agreement::new).to_vec(),
            failure: None,
        }
    }

    /// A report of one scene.
    fn report(scene: &str, systems: Vec<SystemMeasurement>) -> Report {
        let infos = systems.iter().map(|system| SystemInfo {
            name: system.name.clone(),
            family: if system.name.starts_with("splitcast-") {
                "splitcast"
            } else {
                "peer"
            },
            about: "<about>".to_owned(),
            yardstick: Some("splitcast-binned".to_owned()),
        });
        let infos = infos.collect();
        let scene = SceneMeasurement {
            scene: scene.to_owned(),
            threads: 2,
            triangles: 12_345,
            frames: 4,
            systems,
        };
        let rows = Row::of_scene(&scene, &KINDS);
        Report {
            machine: Provenance::collect("splitcast-bench", "1.2.3"),
            settings: Settings {
                size: (64, 48),
                threads: vec![2],
                every: None,
                rounds: Some(1),
            },
            kinds: KINDS.to_vec(),
            systems: infos,
            missing: vec!["embree: <not> found".to_owned()],
            ratios: Ratio::of_rows(&rows, &KINDS),
            rows,
            scenes: vec![scene],
        }
    }

    fn parse(html: &str) -> Document<'_> {
        let options = ParsingOptions {
            allow_dtd: true,
            ..ParsingOptions::default()
        };
        Document::parse_with_options(html, options)
            .unwrap_or_else(|error| panic!("{error}\n{html}"))
    }

    /// The text of all elements of a name.
    fn texts(document: &Document<'_>, name: &str) -> Vec<String> {
        let nodes = document
            .descendants()
            .filter(|node| node.tag_name().name() == name);
        nodes
            .filter_map(|node| Some(node.text()?.to_owned()))
            .collect()
    }

    #[test]
    fn names_from_outside_come_out_as_text() {
        let scene = "scene/<script>alert('1')</script>&amp;\"x\".ply";
        let systems = vec![
            system("splitcast-binned", 2.0, 1.0),
            system("peer-<b>&", 1.0, 2.0),
        ];
        let html = page(&report(scene, systems));
        assert!(!html.contains("<script") && !html.contains("<b>"));
        let headings = texts(&parse(&html), "h2");
        assert!(
            headings.contains(&format!("{scene}, 2 threads")),
            "{headings:?}"
        );
    }

    #[test]
    fn wrong_hits_are_told_and_not_compared() {
        let mut cheat = system("peer-cheat", 0.1, 0.1);
        cheat.agreement[0].hits = 1;
        let systems = vec![
            system("splitcast-binned", 2.0, 1.0),
            system("peer-honest", 4.0, 1.0),
            cheat,
        ];
        let html = page(&report("scene", systems));
        let cells = texts(&parse(&html), "td");
        assert!(cells.contains(&"0.50".to_owned()), "{cells:?}");
        for told in [
            "not compared: peer-cheat on scene, 2 threads.",
            "peer-cheat (wrong hits)",
            "peer-cheat disagrees on primary",
        ] {
            assert!(html.contains(told), "{told}");
        }
    }

    #[test]
    fn a_run_without_results_has_a_page() {
        let mut failed = system("splitcast-binned", 1.0, 1.0);
        failed.updates.clear();
        failed.failure = Some("no memory".to_owned());
        for systems in [Vec::new(), vec![failed]] {
            parse(&page(&report("scene", systems)));
        }
    }
}
