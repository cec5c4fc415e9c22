//! The table at the end of a render.

use splitcast_console::table::{
    self,
    Align::{Left, Right},
};
use splitcast_console::{clock, count, figure, median};

use crate::report::{FrameReport, Report};

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
            cell(values.iter().sum::<f64>() / values.len() as f64),
            cell(median(&values)),
            cell(values[0]),
            cell(values[values.len() - 1]),
        ]);
    };
    row("build", &|frame| frame.build_ms, "ms");
    row("trace", &|frame| frame.trace_ms, "ms");
    row("total", &|frame| frame.build_ms + frame.trace_ms, "ms");
    row("rays/s", &|frame| megarays(frame), "M");
    row("tone map", &|frame| frame.tone_map_ms, "ms");
    row("write", &|frame| frame.write_ms, "ms");
    text.push_str(&table::layout(
        &[
            ("per frame", Left),
            ("mean", Right),
            ("median", Right),
            ("least", Right),
            ("most", Right),
        ],
        &rows,
    ));
    let per_second = |milliseconds: f64| figure(1e3 * frames.len() as f64 / milliseconds);
    let busy: f64 = (frames.iter())
        .map(|frame| frame.build_ms + frame.trace_ms)
        .sum();
    text.push_str(&format!(
        "{} frames/s built and traced, {} frames/s until all were written\n",
        per_second(busy),
        per_second(report.frames_ms)
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
