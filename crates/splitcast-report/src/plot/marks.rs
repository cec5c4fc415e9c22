//! The marks that stand for data: paths, markers and bars, within the plot's area.

use std::fmt::{self, Display, Formatter, Write};

use super::layout::Area;
use crate::palette::Role;

/// A place on the page, or a length, with two decimals.
pub(super) struct Num(pub(super) f64);

impl Display for Num {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        Hundredths(hundredths(self.0)).fmt(f)
    }
}

/// Lines through `points`, cut where they leave `area`; `None` is a gap. Empty if
/// nothing can be seen. Points that stand alone are left to [`lone_points`].
pub(super) fn polyline(points: &[Option<(f64, f64)>], area: Area) -> String {
    let mut path = String::new();
    let mut pen = None;
    for pair in points.windows(2) {
        let (Some(a), Some(b)) = (pair[0], pair[1]) else {
            continue;
        };
        let Some((a, b)) = clip(a, b, area) else {
            continue;
        };
        let round = |p: (f64, f64)| (hundredths(p.0), hundredths(p.1));
        let (a, b) = (round(a), round(b));
        if pen != Some(a) {
            let _ = write!(path, "M{},{}", Hundredths(a.0), Hundredths(a.1));
        }
        if a != b || pen != Some(a) {
            // Steps between rounded places: errors do not add up.
            let (dx, dy) = (b.0 - a.0, b.1 - a.1);
            let _ = write!(path, "l{},{}", Hundredths(dx), Hundredths(dy));
        }
        pen = Some(b);
    }
    path
}

/// The points of a line that have a gap on both sides.
pub(super) fn lone_points(points: &[Option<(f64, f64)>]) -> impl Iterator<Item = (f64, f64)> {
    let gap = |at: Option<usize>| at.and_then(|at| *points.get(at)?).is_none();
    let alone = move |&(at, _): &(usize, _)| gap(at.checked_sub(1)) && gap(Some(at + 1));
    let known = points
        .iter()
        .enumerate()
        .filter_map(|(at, point)| Some((at, (*point)?)));
    known.filter(alone).map(|(_, point)| point)
}

/// The corners of a line that keeps each value until the next point.
pub(super) fn steps(points: &[Option<(f64, f64)>]) -> Vec<Option<(f64, f64)>> {
    let mut corners = Vec::with_capacity(points.len() * 2);
    for (at, &point) in points.iter().enumerate() {
        let before = at.checked_sub(1).and_then(|at| points[at]);
        if let (Some(before), Some(point)) = (before, point) {
            corners.push(Some((point.0, before.1)));
        }
        corners.push(point);
    }
    corners
}

/// Whether the markers of a role are outlines: the last four repeat the shapes of the
/// first four.
pub(super) fn is_outline(role: Role) -> bool {
    matches!(role, Role::S5 | Role::S6 | Role::S7 | Role::S8)
}

/// The marker of a role: a disc, square, triangle or diamond. `title` is its tooltip, an
/// element or empty.
pub(super) fn marker(role: Role, (x, y): (f64, f64), title: &str) -> String {
    let start = |dx: f64, dy: f64| format!("M{},{}", Num(x + dx), Num(y + dy));
    let path = match role {
        Role::S1 | Role::S5 | Role::Muted => {
            let (x, y) = (Num(x), Num(y));
            return match title {
                "" => format!(r#"<circle cx="{x}" cy="{y}" r="3.4"/>"#),
                _ => format!(r#"<circle cx="{x}" cy="{y}" r="3.4">{title}</circle>"#),
            };
        }
        Role::S2 | Role::S6 => format!("{}h6.2v6.2h-6.2z", start(-3.1, -3.1)),
        Role::S3 | Role::S7 => format!("{}l4.1,7.1h-8.2z", start(0.0, -4.5)),
        Role::S4 | Role::S8 => format!("{}l4.4,4.4l-4.4,4.4l-4.4,-4.4z", start(0.0, -4.4)),
    };
    match title {
        "" => format!(r#"<path d="{path}"/>"#),
        _ => format!(r#"<path d="{path}">{title}</path>"#),
    }
}

/// Whether a point is in the area, its edges included.
pub(super) fn is_inside((x, y): (f64, f64), area: Area) -> bool {
    // Ends of the data stand on the edge, up to rounding.
    let near = |value: f64, lo: f64, hi: f64| value >= lo - 1e-6 && value <= hi + 1e-6;
    near(x, area.left, area.right) && near(y, area.top, area.bottom)
}

/// The part of the segment from `a` to `b` that is in the area (Liang & Barsky 1984).
pub(super) fn clip(a: (f64, f64), b: (f64, f64), area: Area) -> Option<((f64, f64), (f64, f64))> {
    let (dx, dy) = (b.0 - a.0, b.1 - a.1);
    let sides = [
        (-dx, a.0 - area.left),
        (dx, area.right - a.0),
        (-dy, a.1 - area.top),
        (dy, area.bottom - a.1),
    ];
    let (mut enter, mut leave) = (0.0f64, 1.0f64);
    for (towards, room) in sides {
        if towards == 0.0 {
            // Parallel: outside this side, or of no concern to it.
            if room < -1e-6 {
                return None;
            }
        } else if towards < 0.0 {
            enter = enter.max(room / towards);
        } else {
            leave = leave.min(room / towards);
        }
    }
    let at = |t: f64| match t {
        0.0 => a,
        1.0 => b,
        t => (a.0 + dx * t, a.1 + dy * t),
    };
    (enter <= leave).then(|| (at(enter), at(leave)))
}

fn hundredths(value: f64) -> i64 {
    (value * 100.0).round() as i64
}

/// A hundredth of it, written as short as possible.
struct Hundredths(i64);

impl Display for Hundredths {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        let sign = if self.0 < 0 { "-" } else { "" };
        let (whole, part) = (self.0.unsigned_abs() / 100, self.0.unsigned_abs() % 100);
        match (part, part % 10) {
            (0, _) => write!(f, "{sign}{whole}"),
            (_, 0) => write!(f, "{sign}{whole}.{}", part / 10),
            _ => write!(f, "{sign}{whole}.{part:02}"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const AREA: Area = Area {
        left: 0.0,
        top: 0.0,
        right: 10.0,
        bottom: 10.0,
    };

    #[test]
    fn numbers_have_two_decimals_at_most() {
        for (value, text) in [
            (0.0, "0"),
            (1.5, "1.5"),
            (-0.049, "-0.05"),
            (2.999, "3"),
            (-0.001, "0"),
        ] {
            assert_eq!(Num(value).to_string(), text);
        }
    }

    #[test]
    fn lines_break_at_gaps_and_at_the_edge_of_the_area() {
        let points = [
            Some((0.0, 0.0)),
            Some((5.0, 5.0)),
            None,
            Some((5.0, 5.0)),
            Some((15.0, 5.0)),
        ];
        assert_eq!(polyline(&points, AREA), "M0,0l5,5l5,0");
        let outside = [Some((-5.0, 12.0)), Some((15.0, 12.0))];
        assert_eq!(polyline(&outside, AREA), "");
        let alone = [Some((1.0, 1.0)), None, Some((2.0, 2.0)), Some((3.0, 3.0))];
        assert_eq!(lone_points(&alone).collect::<Vec<_>>(), [(1.0, 1.0)]);
    }

    #[test]
    fn steps_keep_a_value_until_the_next_point() {
        let points = [Some((0.0, 1.0)), Some((2.0, 3.0)), None, Some((4.0, 5.0))];
        let expected = [
            Some((0.0, 1.0)),
            Some((2.0, 1.0)),
            Some((2.0, 3.0)),
            None,
            Some((4.0, 5.0)),
        ];
        assert_eq!(steps(&points), expected);
    }
}
