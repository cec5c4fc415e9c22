//! Tables on the terminal.

use splitcast_console::figure;
use splitcast_console::table::{
    self,
    Align::{Left, Right},
};

use crate::rays::RaySetKind;
use crate::results::{BySet, Figure, Ratio, Row};

/// What stands in a cell that has no value.
const NONE: &str = "-";

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
            let name = if row.agrees {
                row.system.clone()
            } else {
                format!("{} (wrong hits)", row.system)
            };
            let update = row.update_ms;
            let mut line = vec![name];
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
    let mut scenes: Vec<(&str, usize)> = Vec::new();
    for ratio in ratios {
        let scene = (&ratio.scene[..], ratio.threads);
        if !scenes.contains(&scene) {
            scenes.push(scene);
        }
    }
    let lines: Vec<Vec<String>> = (scenes.into_iter())
        .map(|(scene, threads)| {
            let find = |figure: Figure, rays: Option<&str>| {
                let found = ratios.iter().find(|ratio| {
                    (&ratio.scene[..], ratio.threads) == (scene, threads)
                        && (ratio.figure, ratio.rays) == (figure, rays)
                });
                found.map_or(NONE.to_owned(), |ratio| format!("{:.2}", ratio.ratio))
            };
            let mut line = vec![
                scene.to_owned(),
                threads.to_string(),
                find(Figure::Update, None),
            ];
            for wanted in [Figure::Trace, Figure::Frame] {
                line.extend(kinds.iter().map(|kind| find(wanted, Some(kind.name()))));
            }
            line
        })
        .collect();
    format!(
        "{}time of our best system over that of the best peer, each the best by that figure: below \
         1 is ahead\n",
        table::layout(&columns, &lines)
    )
}
