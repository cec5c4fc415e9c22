//! Plots in words, for those who cannot see them.

use super::{Plot, layout, number, scale};

/// Series that the description tells of one by one.
const MAX_DESCRIBED: usize = 8;

/// Why nothing is drawn.
pub(super) fn reason(plot: &Plot) -> String {
    let left_out = layout::left_out(plot).unwrap_or_default();
    format!("{} {left_out}", plot.no_data).trim().to_owned()
}

/// The title, or what stands for it.
pub(super) fn title(plot: &Plot) -> &str {
    if plot.title.is_empty() {
        "Plot"
    } else {
        &plot.title
    }
}

/// What the plot shows, in words.
pub(super) fn description(plot: &Plot) -> String {
    let mut sentences = vec![plot.description.clone()];
    let axes = [("Horizontal", &plot.x), ("Vertical", &plot.y)];
    for (name, axis) in axes.into_iter().filter(|(_, axis)| !axis.text().is_empty()) {
        let scale = if axis.log { ", logarithmic" } else { "" };
        sentences.push(format!("{name} axis: {}{scale}.", axis.text()));
    }
    if let Some(family) = &plot.family {
        let (count, label) = (family.curves.len(), &family.label);
        let range = family.extent();
        let range = range.map(|(lo, hi)| {
            format!(
                ", {label} from {} to {}",
                number::short(lo),
                number::short(hi)
            )
        });
        sentences.push(format!("{count} curves{}.", range.unwrap_or_default()));
    }
    for series in plot.series.iter().take(MAX_DESCRIBED) {
        let known = series
            .points
            .iter()
            .filter(|p| p.0.is_finite() && p.1.is_finite());
        let count = known.clone().count();
        let range = match scale::extent(known.map(|p| p.1)) {
            None => "no values".into(),
            Some((lo, hi)) if lo == hi => format!("{count} × {}", number::short(lo)),
            Some((lo, hi)) => {
                format!(
                    "{count} values from {} to {}",
                    number::short(lo),
                    number::short(hi)
                )
            }
        };
        let name = if series.name.is_empty() {
            "Series"
        } else {
            &series.name
        };
        sentences.push(format!("{name}: {range}."));
    }
    if let Some(more) = plot.series.len().checked_sub(MAX_DESCRIBED + 1) {
        sentences.push(format!("And {} more series.", more + 1));
    }
    if plot.series.is_empty() && plot.family.is_none() {
        sentences.push(format!("No data. {}", reason(plot)));
    }
    sentences.retain(|sentence| !sentence.trim().is_empty());
    sentences.join(" ").trim().to_owned()
}
