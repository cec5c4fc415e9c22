//! Updates on the terminal: a row each, then the middle and the worst of them.

use splitcast_console::count;
use splitcast_console::table::{self, Align::Right, grouped};

use super::TrackReport;
use super::frames::FrameFigures;
use crate::cells::{NONE, number, percent, ratio};
use crate::column::Column;

/// A figure of updates.
struct Figure {
    name: &'static str,
    value: fn(&FrameFigures) -> Option<f64>,
    show: fn(Option<f64>) -> String,
    /// Whether more of it is worse; otherwise no update is the worst by it.
    is_cost: bool,
}

impl Figure {
    const fn cost(
        name: &'static str,
        show: fn(Option<f64>) -> String,
        value: fn(&FrameFigures) -> Option<f64>,
    ) -> Self {
        Self {
            name,
            value,
            show,
            is_cost: true,
        }
    }

    const fn share(name: &'static str, value: fn(&FrameFigures) -> Option<f64>) -> Self {
        Self {
            name,
            value,
            show: percent,
            is_cost: false,
        }
    }

    fn over(&self, frames: &[FrameFigures]) -> Column {
        let values = frames.iter();
        Column::new(values.map(|frame| (frame.frame, (self.value)(frame))))
    }
}

const UPDATE: Figure = Figure::cost("update", number, |frame| Some(frame.update_ms));
const SAH_RATIO: Figure = Figure::cost("SAH ratio", ratio, |frame| frame.sah_ratio);

/// The columns behind the frame's number.
fn columns(with_reference: bool) -> Vec<Figure> {
    let mut all = vec![UPDATE];
    if with_reference {
        all.push(Figure::cost("rebuild", number, |frame| frame.rebuild_ms));
        all.push(Figure::cost("time ratio", ratio, FrameFigures::time_ratio));
    }
    all.push(Figure::cost("SAH cost", number, |frame| {
        Some(frame.sah_cost)
    }));
    all.push(SAH_RATIO);
    if with_reference {
        let estimate: fn(&FrameFigures) -> _ = |frame| Some(frame.sah_ratio_estimate);
        all.push(Figure::cost("estimate", ratio, estimate));
    }
    all.extend([
        Figure::share("kept", |frame| frame.share(frame.kept)),
        Figure::share("moved", |frame| frame.share(frame.moved)),
        Figure::cost("sorted", percent, |frame| frame.share(frame.searched)),
        Figure::cost("rebuilt", percent, |frame| frame.share(frame.rebuilt)),
        Figure::cost("references", whole, |frame| Some(frame.references as f64)),
        Figure::cost("bytes", whole, |frame| Some(frame.bytes as f64)),
    ]);
    all
}

/// The table and what it takes to read it.
pub(super) fn text(report: &TrackReport) -> String {
    let columns = columns(report.reference.is_some());
    let row = |name: String, cell: &dyn Fn(&Figure) -> String| {
        let cells = columns.iter().map(cell);
        std::iter::once(name).chain(cells).collect::<Vec<_>>()
    };
    let mut rows: Vec<Vec<String>> = report
        .frames
        .iter()
        .map(|frame| {
            row(frame.frame.to_string(), &|column| {
                (column.show)((column.value)(frame))
            })
        })
        .collect();
    // The first frame is built: there is nothing to track yet.
    let updates = &report.frames[1..];
    if !updates.is_empty() {
        rows.push(row("median".to_owned(), &|column| {
            (column.show)(column.over(updates).median)
        }));
        rows.push(row("worst".to_owned(), &|column| {
            let worst = column.over(updates).most.filter(|_| column.is_cost);
            (column.show)(worst.map(|worst| worst.value))
        }));
    }
    let mut header = vec![("frame", Right)];
    header.extend(columns.iter().map(|column| (column.name, Right)));
    table::layout(&header, &rows) + &legend(report, updates)
}

/// What was tracked, where it was worst, and what the columns are.
fn legend(report: &TrackReport, updates: &[FrameFigures]) -> String {
    let mut text = format!(
        "{}: {}, at most {} triangles, {}\n",
        report.input,
        count(report.frames.len(), "frame"),
        grouped(report.triangles),
        count(report.threads, "thread"),
    );
    let slowest = UPDATE.over(updates).most;
    let costliest = SAH_RATIO.over(updates).most;
    if let (Some(slowest), Some(costliest)) = (slowest, costliest) {
        text.push_str(&format!(
            "median and worst are of {} behind the first: slowest is frame {}, the worst SAH ratio \
             that of frame {}\n",
            count(updates.len(), "frame"),
            slowest.frame,
            costliest.frame
        ));
    }
    text.push_str("times in ms; kept and rebuilt are shares of the references; SAH ratio is ");
    text.push_str(&match report.reference {
        Some(name) => format!("to a {name} rebuild, estimate what the tracker takes it for\n"),
        None => "the tracker's estimate, which --reference measures\n".to_owned(),
    });
    text
}

/// A count in digits by threes; the mean of two may be rounded.
fn whole(value: Option<f64>) -> String {
    value.map_or(NONE.to_owned(), |value| grouped(value.round() as usize))
}
