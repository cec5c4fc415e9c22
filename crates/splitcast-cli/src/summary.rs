//! The table at the end of a render.

use crate::progress::clock;
use crate::report::{FrameReport, Report};
use crate::table::{
    self,
    Align::{Left, Right},
};

/// What a run took, in a few lines.
pub(crate) fn summary(report: &Report) -> String {
    let frames = &report.frames;
    let mut text = format!(
        "{}: {} of {}x{} pixels, {} a pixel, {} trees, {}\n",
        report.out,
        count(frames.len() + report.resumed_frames.len(), "frame"),
        report.width,
        report.height,
        count(report.samples_per_pixel as usize, "sample"),
        report.builder,
        count(report.threads, "thread"),
    );
    if !report.resumed_frames.is_empty() {
        text.push_str(&format!(
            "{} kept from an earlier run\n",
            count(report.resumed_frames.len(), "frame")
        ));
    }
    if frames.is_empty() {
        return text;
    }
    let mut rows = Vec::new();
    let mut row = |name: &str, value: &dyn Fn(&FrameReport) -> f64, unit: &str| {
        let mut values: Vec<f64> = frames.iter().map(value).collect();
        values.sort_by(f64::total_cmp);
        let cell = |value: f64| format!("{} {unit}", figure(value));
        rows.push(vec![
            name.to_owned(),
            cell(median(&values)),
            cell(values[0]),
            cell(values[values.len() - 1]),
        ]);
    };
    row("build", &|frame| frame.build_ms, "ms");
    row("trace", &|frame| frame.trace_ms, "ms");
    row("total", &|frame| frame.build_ms + frame.trace_ms, "ms");
    row("rays/s", &|frame| megarays(frame), "M");
    text.push_str(&table::layout(
        &[
            ("per frame", Left),
            ("median", Right),
            ("least", Right),
            ("most", Right),
        ],
        &rows,
    ));
    let wall = std::time::Duration::from_secs_f64(report.wall_ms / 1e3);
    text.push_str(&format!(
        "whole run {}, reading and encoding included\n",
        clock(wall)
    ));
    text
}

/// Million rays a second of tracing.
pub(crate) fn megarays(frame: &FrameReport) -> f64 {
    if frame.trace_ms > 0.0 {
        frame.rays as f64 / frame.trace_ms / 1e3
    } else {
        0.0
    }
}

/// Three digits, and not more after the point than that.
pub(crate) fn figure(value: f64) -> String {
    let digits = match value.abs() {
        v if v >= 100.0 => 0,
        v if v >= 10.0 => 1,
        _ => 2,
    };
    format!("{value:.digits$}")
}

/// A number with its noun: 1 frame, 2 frames.
pub(crate) fn count(number: usize, thing: &str) -> String {
    format!("{number} {thing}{}", if number == 1 { "" } else { "s" })
}

/// The middle of sorted values, or the mean of the two in the middle.
pub(crate) fn median(sorted: &[f64]) -> f64 {
    let middle = sorted.len() / 2;
    if sorted.len() % 2 == 1 {
        sorted[middle]
    } else {
        (sorted[middle - 1] + sorted[middle]) / 2.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn medians_of_odd_and_even_counts() {
        assert_eq!(median(&[7.0]), 7.0);
        assert_eq!(median(&[1.0, 2.0, 9.0]), 2.0);
        assert_eq!(median(&[1.0, 2.0, 4.0, 9.0]), 3.0);
    }

    #[test]
    fn figures_have_three_digits() {
        assert_eq!(figure(0.1234), "0.12");
        assert_eq!(figure(12.345), "12.3");
        assert_eq!(figure(812.34), "812");
    }
}
