//! The page `report.html`.

use splitcast_report::{Cell, Column, Figure, Image, Page, Provenance, Section, Table};

use super::figures::{SceneFigure, SceneFigures};
use super::measure::RAYS_A_SIDE;
use super::paper::{SAH_GOAL, row_for};
use super::rows::{BuilderRow, Row};
use super::settings::{Contender, Settings};
use super::terminal::{NONE, number, percent, ratio};
use crate::summary::count;
use crate::table::grouped;

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
    let header = [
        "triangles",
        "frames",
        "normal (ms)",
        "initial (ms)",
        "running (ms)",
        "with filter (ms)",
        "reduced by",
        "goal",
        "SAH ÷ normal",
        "worst frame",
    ];
    let columns = [Column::left("scene"), Column::left("build")];
    let columns = columns.into_iter().chain(header.map(Column::right));
    let mut table = Table::new(columns).caption(
        "Build times of conventional and of tracked kd-trees: the paper’s (Intel Core 2, 2.16 GHz) \
         and ours.",
    );
    for scene in scenes {
        if let Some(paper) = row_for(&scene.name) {
            let text = [
                paper.scene.to_owned(),
                "paper".to_owned(),
                grouped(paper.triangles),
                paper.frames.to_string(),
                format!("{:.0}", paper.normal_ms),
                format!("{:.0}", paper.initial_ms),
                format!("{:.0}", paper.running_ms),
                NONE.to_owned(),
                percent(Some(paper.reduction)),
                NONE.to_owned(),
                NONE.to_owned(),
                NONE.to_owned(),
            ];
            table = table.row(text.map(Cell::muted));
        }
        for row in &scene.rows {
            let worst = row.worst.sah_ratio_to_normal.map(|worst| worst.value);
            table = table.row::<Cell>([
                row.scene.clone().into(),
                row.filter.name().into(),
                grouped(row.triangles).into(),
                row.frames.to_string().into(),
                number(row.normal_ms).into(),
                number(row.initial_ms).into(),
                number(row.running_ms).into(),
                number(row.running_with_filter_ms).into(),
                marked(percent(row.reduction), row.meets_reduction()),
                percent(row.reduction_goal).into(),
                against_goal(row.sah_ratio_to_normal),
                against_goal(worst),
            ]);
        }
    }
    let details = scenes.iter().flat_map(|scene| &scene.rows);
    let details = details.fold(details_table(), |table, row| {
        let worst = &row.worst;
        let value = |value: Option<super::rows::Extreme>| value.map(|worst| worst.value);
        table.row([
            row.scene.clone(),
            row.filter.name().to_owned(),
            number(row.evaluations_per_split_normal),
            number(row.evaluations_per_split_running),
            percent(row.orientation_mismatch_rate),
            percent(value(worst.orientation_mismatch_rate)),
            percent(row.prediction_rmse_relative),
            percent(value(worst.prediction_rmse_relative)),
            number(row.filter_overhead_ms),
            percent(value(worst.reduction)),
        ])
    });
    Section::new("Table I")
        .paragraph(format!(
            "Running builds are to be at least as much faster than normal ones as in the paper, \
             with an expected cost within {} of the same frame’s normal tree. Goals met are marked \
             ✓, others ✗. As in the paper, running times are without the filter; the column beside \
             them adds it.",
            percent(Some(SAH_GOAL - 1.0))
        ))
        .table(table)
        .table(details)
}

fn details_table() -> Table {
    let header = [
        "evaluations, normal",
        "evaluations, running",
        "axis mismatches",
        "worst frame",
        "prediction error",
        "worst frame",
        "filter (ms)",
        "reduced by, worst frame",
    ];
    let columns = [Column::left("scene"), Column::left("build")];
    Table::new(columns.into_iter().chain(header.map(Column::right)))
        .caption("Where the time goes: evaluations of the cost for each split, and how good predictions are.")
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
    let columns = [Column::left("scene"), Column::left("builder")];
    let mut table = Table::new(columns.into_iter().chain(header.map(Column::right)))
        .caption("All builders on the same frames. Tracked builds count with their filter.");
    for row in scenes.iter().flat_map(|scene| &scene.builders) {
        let evaluations = row.evaluations.map(|count| grouped(count as usize));
        table = table.row([
            row.scene.clone(),
            match row.builder {
                Contender::NormalSameAxes => {
                    format!("normal, {}", settings.orientation_running)
                }
                builder => builder.name().to_owned(),
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
            "One minus the median running time over the median normal time of the same frames. Its \
             worst frame compares the two times of one frame.",
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
            "axis mismatches",
            "Share of the tracked splits whose axis is another than in the frame before, so that \
             the search starts from the extremes.",
        ),
        (
            "prediction error",
            "Root mean squared difference of prediction and plane, as a share of the extent of \
             what the node holds, over splits whose axis is as tracked.",
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
            "Every frame is built by all builders in turn, {} times over, in an order that shifts \
             with every frame and round. Times are medians over the rounds; table1.json and \
             table1.csv hold the tables, measurements.json every frame’s figures.",
            settings.rounds
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
