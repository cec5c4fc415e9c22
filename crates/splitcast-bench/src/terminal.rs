//! Tables on the terminal.

use splitcast_console::figure;
use splitcast_console::table::{
    self,
    Align::{Left, Right},
};

use crate::rays::RaySetKind;
use crate::results::{BySet, Ratio, Row};

/// What stands in a cell that has no value.
pub(crate) const NONE: &str = "-";

/// The rows of one scene with one number of threads.
pub(crate) fn systems(rows: &[Row], kinds: &[RaySetKind]) -> String {
    let frame_names: Vec<String> = kinds.iter().map(|kind| format!("+ {kind}")).collect();
    let mut columns = vec![
        ("system", Left),
        ("update", Right),
        ("p95", Right),
        ("worst", Right),
    ];
    columns.extend(kinds.iter().map(|kind| (kind.name(), Right)));
    columns.extend(frame_names.iter().map(|name| (&name[..], Right)));
    columns.push(("MB", Right));
    let cell = |figures: &BySet, kind: &RaySetKind| {
        figures
            .get(kind.name())
            .map_or(NONE.to_owned(), |&value| figure(value))
    };
    let lines: Vec<Vec<String>> = (rows.iter())
        .map(|row| {
            let update = row.update_ms;
            let mut line = vec![row.label()];
            line.extend([update.median, update.p95, update.worst].map(figure));
            line.extend(kinds.iter().map(|kind| cell(&row.mrays, kind)));
            line.extend(kinds.iter().map(|kind| cell(&row.frame_ms, kind)));
            line.push(figure(row.bytes as f64 / 1e6));
            line
        })
        .collect();
    table::layout(&columns, &lines)
}

/// What the figures of [`systems`] are.
pub(crate) const LEGEND: &str = "update: median, 95th percentile and worst frame in ms; by set of rays: \
                          million rays a second; + set: ms of update and that set in one frame";

/// Our best system over the best peer, a line for each scene and number of threads.
pub(crate) fn ratios(ratios: &[Ratio], kinds: &[RaySetKind]) -> String {
    let names: Vec<String> = (kinds.iter().map(|kind| kind.to_string()))
        .chain(kinds.iter().map(|kind| format!("+ {kind}")))
        .collect();
    let mut columns = vec![
        ("splitcast / best peer", Left),
        ("threads", Right),
        ("update", Right),
    ];
    columns.extend(names.iter().map(|name| (&name[..], Right)));
    let lines: Vec<Vec<String>> = (Ratio::lines(ratios, kinds).into_iter())
        .map(|line| {
            let place = line.iter().flatten().next();
            let place = place.map(|ratio| [ratio.scene.clone(), ratio.threads.to_string()]);
            let cell = |ratio: Option<&Ratio>| {
                ratio.map_or(NONE.to_owned(), |ratio| format!("{:.2}", ratio.ratio))
            };
            place
                .into_iter()
                .flatten()
                .chain(line.into_iter().map(cell))
                .collect()
        })
        .collect();
    format!(
        "{}time of our best system over that of the best peer, each the best by that figure: below \
         1 is ahead\n",
        table::layout(&columns, &lines)
    )
}
