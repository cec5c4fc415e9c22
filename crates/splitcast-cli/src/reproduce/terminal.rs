//! Table I on the terminal.

use splitcast_console::figure;
use splitcast_console::table::{
    self,
    Align::{Left, Right},
};

use super::paper::{SAH_GOAL, row_for};
use super::rows::Row;
use crate::cells::{NONE, number, percent, ratio};

/// The paper's rows and ours, below each other.
pub(crate) fn table_1(rows: &[Row]) -> String {
    let columns = [
        ("scene", Left),
        ("build", Left),
        ("triangles", Right),
        ("frames", Right),
        ("normal", Right),
        ("initial", Right),
        ("running", Right),
        ("+ filter", Right),
        ("reduced", Right),
        ("goal", Right),
        ("SAH/normal", Right),
        ("worst", Right),
    ];
    let mut lines = Vec::new();
    let mut last = None;
    for row in rows {
        let paper = row_for(&row.scene).filter(|_| last != Some(&row.scene));
        last = Some(&row.scene);
        if let Some(paper) = paper {
            lines.push(vec![
                row.scene.clone(),
                "paper".to_owned(),
                table::grouped(paper.triangles),
                paper.frames.to_string(),
                figure(paper.normal_ms),
                figure(paper.initial_ms),
                figure(paper.running_ms),
                NONE.to_owned(),
                percent(Some(paper.reduction)),
                NONE.to_owned(),
                NONE.to_owned(),
                NONE.to_owned(),
            ]);
        }
        let goal = match (row.reduction_goal, row.meets_reduction()) {
            (Some(goal), Some(met)) => format!(
                "{} {}",
                percent(Some(goal)),
                if met { "met" } else { "short" }
            ),
            (goal, _) => percent(goal),
        };
        lines.push(vec![
            row.scene.clone(),
            row.filter.name().to_owned(),
            table::grouped(row.triangles),
            row.frames.to_string(),
            number(row.normal_ms),
            number(row.initial_ms),
            number(row.running_ms),
            number(row.running_with_filter_ms),
            percent(row.reduction),
            goal,
            ratio(row.sah_ratio_to_normal),
            ratio(row.worst.sah_ratio_to_normal.map(|worst| worst.value)),
        ]);
    }
    let mut text = table::layout(&columns, &lines);
    text.push_str(&format!(
        "times are medians in ms; running is without the filter, as in the paper; SAH/normal is to be at \
         most {SAH_GOAL}\n"
    ));
    text
}
