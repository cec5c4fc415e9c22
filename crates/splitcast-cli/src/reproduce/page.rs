//! The page `report.html`.

use splitcast_console::count;
use splitcast_console::table::grouped;
use splitcast_report::{Cell, Column, Figure, Image, Page, Provenance, Section, Table};

use super::figures::{SceneFigure, SceneFigures};
use super::measure::RAYS_A_SIDE;
use super::paper::{SAH_GOAL, row_for};
use super::rows::{BuilderRow, Row};
use super::settings::{Contender, Settings};
use crate::cells::{NONE, number, percent, ratio};
use crate::column::Extreme;

/// Everything about one scene that the page shows.
pub(crate) struct ScenePage {
    pub(crate) name: String,
    pub(crate) rows: [Row; 2],
    pub(crate) builders: Vec<BuilderRow>,
    pub(crate) notes: Vec<String>,
    pub(crate) thumbnails: Vec<Image>,
    pub(crate) figures: SceneFigures,
}

/// The whole page.
pub(crate) fn page(scenes: &[&ScenePage], settings: &Settings, provenance: &Provenance) -> String {
    let page = Page::new("Tracked kd-trees, reproduced")
        .lead(
            "Hussain and Grahn (2008) track the split planes of a kd-tree from frame to frame \
             with a Kalman filter, so that the search for the next tree’s planes starts close to \
             where they are. This page measures their normal, initial and running builds, written \
             anew, beside two builds of today. Everything on it was measured in one run, whose \
             settings stand at its end.",
        )
        .section(table_1(scenes))
        .section(builders(scenes, settings));
    let page = scenes
        .iter()
        .fold(page, |page, scene| page.section(scene_section(scene)));
    page.section(columns())
        .section(origin(settings, provenance))
        .to_html()
}

fn table_1(scenes: &[&ScenePage]) -> Section {
    Section::new("Table I")
        .paragraph(format!(
            "Running builds are to be at least as much faster than normal ones as in the paper, \
             with an expected cost within {:.0}% of the same frame’s normal tree. Goals met are \
             marked ✓, others ✗. As in the paper, running times are without the filter; the \
             column beside them adds it.",
            100.0 * (SAH_GOAL - 1.0)
        ))
        .table(times(scenes))
        .table(quality(scenes))
        .table(causes(scenes))
}

fn times(scenes: &[&ScenePage]) -> Table {
    let header = [
        "triangles",
        "frames",
        "normal",
        "initial",
        "running",
        "with filter",
        "reduced by",
        "goal",
    ];
    let mut table = table(header).caption(
        "Build times in ms of conventional and of tracked kd-trees: the paper’s (Intel Core 2, \
         2.16 GHz) and ours.",
    );
    for scene in scenes {
        if let Some(paper) = row_for(&scene.name) {
            let text = [
                format!("{}, paper", paper.scene),
                grouped(paper.triangles),
                paper.frames.to_string(),
                format!("{:.0}", paper.normal_ms),
                format!("{:.0}", paper.initial_ms),
                format!("{:.0}", paper.running_ms),
                NONE.to_owned(),
                percent(Some(paper.reduction)),
                NONE.to_owned(),
            ];
            table = table.row(text.map(Cell::muted));
        }
        for row in &scene.rows {
            table = table.row::<Cell>([
                name(row).into(),
                grouped(row.triangles).into(),
                row.frames.to_string().into(),
                number(row.normal_ms).into(),
                number(row.initial_ms).into(),
                number(row.running_ms).into(),
                number(row.running_with_filter_ms).into(),
                marked(percent(row.reduction), row.meets_reduction()),
                percent(row.reduction_goal).into(),
            ]);
        }
    }
    table
}

fn quality(scenes: &[&ScenePage]) -> Table {
    let header = [
        "SAH ÷ normal",
        "worst frame",
        "SAH ÷ sweep",
        "worst frame",
        "trace ÷ sweep",
        "worst frame",
    ];
    let table = table(header).caption(
        "What the trees of running builds are worth, against the normal and the exact tree of the \
         same frame.",
    );
    let rows = scenes.iter().flat_map(|scene| &scene.rows);
    rows.fold(table, |table, row| {
        let worst = &row.worst;
        table.row::<Cell>([
            name(row).into(),
            against_goal(row.sah_ratio_to_normal),
            against_goal(value(worst.sah_ratio_to_normal)),
            ratio(row.sah_ratio_to_sweep).into(),
            ratio(value(worst.sah_ratio_to_sweep)).into(),
            ratio(row.trace_ratio_to_sweep).into(),
            ratio(value(worst.trace_ratio_to_sweep)).into(),
        ])
    })
}

fn causes(scenes: &[&ScenePage]) -> Table {
    let header = [
        "evaluations, normal",
        "evaluations, running",
        "axes turned",
        "worst frame",
        "prediction error",
        "worst frame",
        "least reduction",
    ];
    let table = table(header).caption(
        "Where the time goes: evaluations of the cost for each split, and how good predictions \
         are.",
    );
    let rows = scenes.iter().flat_map(|scene| &scene.rows);
    rows.fold(table, |table, row| {
        let worst = &row.worst;
        table.row([
            name(row),
            number(row.evaluations_per_split_normal),
            number(row.evaluations_per_split_running),
            percent(row.orientation_mismatch_rate),
            percent(value(worst.orientation_mismatch_rate)),
            percent(row.prediction_rmse_relative),
            percent(value(worst.prediction_rmse_relative)),
            percent(value(worst.reduction)),
        ])
    })
}

/// A table of numbers by scene and build.
fn table<const N: usize>(header: [&str; N]) -> Table {
    let names = [Column::left("scene, build")].into_iter();
    Table::new(names.chain(header.map(Column::right)))
}

fn name(row: &Row) -> String {
    format!("{}, {}", row.scene, row.filter.name())
}

fn value(worst: Option<Extreme>) -> Option<f64> {
    worst.map(|worst| worst.value)
}

fn builders(scenes: &[&ScenePage], settings: &Settings) -> Section {
    let header = [
        "build (ms)",
        "÷ normal",
        "evaluations",
        "SAH cost",
        "÷ sweep",
        "trace (ms)",
        "references a triangle",
    ];
    let mut table = table(header)
        .caption("All builders on the same frames. Tracked builds count with their filter.");
    for row in scenes.iter().flat_map(|scene| &scene.builders) {
        let evaluations = row.evaluations.map(|count| grouped(count as usize));
        table = table.row([
            match row.builder {
                Contender::NormalSameAxes => {
                    format!("{}, normal, {}", row.scene, settings.orientation_running)
                }
                builder => format!("{}, {}", row.scene, builder.name()),
            },
            number(row.build_ms),
            ratio(row.build_ratio_to_normal),
            evaluations.unwrap_or_else(|| NONE.to_owned()),
            number(row.sah_cost),
            ratio(row.sah_ratio_to_sweep),
            number(row.trace_ms),
            number(row.references_per_triangle),
        ]);
    }
    Section::new("What it is worth today")
        .paragraph(format!(
            "Sweep finds the best of all planes exactly (Wald and Havran 2006); binned looks at a \
             few planes only and is the fast way to build a tree from nothing (Shevtsov et al. \
             2007). The normal build with another word behind it chooses axes as tracked builds do \
             where a prediction is of no use: what it saves is not owed to the filter. Tracing is timed on one thread with {} primary rays \
             and one diffuse ray from each of their hits.",
            grouped((RAYS_A_SIDE * RAYS_A_SIDE) as usize)
        ))
        .table(table)
}

fn scene_section(scene: &ScenePage) -> Section {
    let row = &scene.rows[0];
    let mut section = Section::new(scene.name.clone()).paragraph(format!(
        "{} triangles, {}.",
        grouped(row.triangles),
        count(row.frames, "frame")
    ));
    for note in &scene.notes {
        section = section.paragraph(note.clone());
    }
    let figures = |figures: &[SceneFigure]| {
        let figures = figures.iter();
        let figure = |f: &SceneFigure| Figure::new(f.plot.clone()).caption(f.caption.clone());
        figures.map(figure).collect::<Vec<_>>()
    };
    section = section
        .images(scene.thumbnails.clone())
        .figures(figures(&scene.figures.root));
    if !scene.figures.nodes.is_empty() {
        section = section.figures(figures(&scene.figures.nodes));
    }
    section.figures(figures(&scene.figures.tree))
}

fn columns() -> Section {
    Section::new("What the columns mean").definitions([
        (
            "normal",
            "Time of a build that knows nothing of earlier frames. Every plane is searched from \
             the extremes of its node by golden section and parabolic interpolation.",
        ),
        (
            "initial",
            "Time of the first frame’s tracked build, which loads the filter.",
        ),
        (
            "running",
            "Time of a tracked build of a later frame, without the filter.",
        ),
        (
            "with filter",
            "The same with prediction, virtual observations, carrying over and correction.",
        ),
        (
            "reduced by",
            "One minus the median running time over the median normal time of the same frames. The \
             least reduction is that of the frame whose own two times are closest.",
        ),
        (
            "SAH cost",
            "Expected cost of a ray by the surface area heuristic, in the units of the cost model. \
             Ratios are formed frame by frame.",
        ),
        (
            "evaluations",
            "How often the cost of a plane was computed: for each split of the tree, searches that \
             ended in a leaf included; in the table of all builders, for the whole tree.",
        ),
        (
            "axes turned",
            "Share of the tracked splits whose axis is another than in the frame before, so that \
             the search starts from the extremes.",
        ),
        (
            "prediction error",
            "Root mean squared difference of prediction and plane, as a share of the extent of \
             the node’s cell, over splits whose axis is as tracked and whose prediction divided \
             the node.",
        ),
        (
            "worst frame",
            "The same figure in the frame where it is worst; all others are medians over the \
             running frames.",
        ),
        (
            "trace",
            "Time to trace the same rays through each tree, one thread.",
        ),
    ])
}

fn origin(settings: &Settings, provenance: &Provenance) -> Section {
    Section::new("Run it again")
        .paragraph("The same program with the same settings builds the same trees; times depend on the machine.")
        .code(provenance.command.clone())
        .definitions(settings.definitions())
        .definitions(provenance.definitions())
        .paragraph(format!(
            "Every frame is built by all builders in turn, in {}, in an order that shifts with \
             every frame and round. Times are medians over the rounds; table1.json and \
             table1.csv hold the tables, measurements.json every frame’s figures.",
            count(settings.rounds, "round")
        ))
}

fn marked(text: String, met: Option<bool>) -> Cell {
    match met {
        Some(true) => Cell::good(text),
        Some(false) => Cell::short(text),
        None => text.into(),
    }
}

fn against_goal(sah_ratio: Option<f64>) -> Cell {
    marked(ratio(sah_ratio), sah_ratio.map(|ratio| ratio <= SAH_GOAL))
}
