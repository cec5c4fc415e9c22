//! Labels beside dots, each where it covers neither a dot nor another label.
//!
//! The label with the fewest free places is put down first, on the place that takes
//! the least away from the others. What has no free place is left out.

use super::layout::{Area, TICK};
use super::marks;
use super::text;

/// Half the side of the square around a dot that labels keep off.
const DOT: f64 = 5.0;

/// Space between a dot's square and its label.
const GAP: f64 = 2.0;

/// How far type reaches above and below its baseline.
const ASCENT: f64 = TICK * 0.78;
const DESCENT: f64 = TICK * 0.24;

/// A dot and the text that goes with it; no label if that is empty.
pub(super) struct Dot<'a> {
    pub(super) at: (f64, f64),
    pub(super) text: &'a str,
}

/// Where a label stands.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Label {
    pub(super) x: f64,
    /// Of the baseline.
    pub(super) y: f64,
    pub(super) anchor: Anchor,
}

/// Which part of a label its place is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Anchor {
    Start,
    Middle,
    End,
}

impl Anchor {
    /// Its name in SVG.
    pub(super) fn name(self) -> &'static str {
        match self {
            Self::Start => "start",
            Self::Middle => "middle",
            Self::End => "end",
        }
    }
}

/// Places the labels of dots within `area`, and away from `lines` where it can be had.
pub(super) fn place(
    dots: &[Dot<'_>],
    lines: &[Vec<Option<(f64, f64)>>],
    area: Area,
) -> Vec<Option<Label>> {
    let squares: Vec<Area> = dots.iter().map(|dot| around(dot.at)).collect();
    let mut free: Vec<Vec<Candidate>> = (dots.iter())
        .map(|dot| match dot.text.trim() {
            "" => Vec::new(),
            text => Candidate::all(dot.at, text::width(text, TICK)),
        })
        .collect();
    for candidate in &mut free {
        candidate.retain_mut(|candidate| {
            candidate.crossed = crossed(lines, candidate.room);
            let room = candidate.room;
            is_within(room, area) && !squares.iter().any(|&square| overlap(square, room))
        });
    }
    let mut labels = vec![None; dots.len()];
    while let Some((dot, chosen)) = next(&free) {
        labels[dot] = Some(chosen.label);
        free[dot].clear();
        for candidates in &mut free {
            candidates.retain(|candidate| !overlap(candidate.room, chosen.room));
        }
    }
    labels
}

/// A place that a label may take.
#[derive(Clone, Copy)]
struct Candidate {
    label: Label,
    /// What the text covers.
    room: Area,
    /// Whether a line runs through it.
    crossed: bool,
    /// Its place in the order of preference.
    rank: usize,
}

impl Candidate {
    /// The places around a dot, the best first.
    fn all(dot: (f64, f64), width: f64) -> Vec<Self> {
        // Level with the dot, above and below it, and above and below at its corner.
        let level = (ASCENT - DESCENT) / 2.0;
        let (above, below) = (-DOT - GAP - DESCENT, DOT + GAP + ASCENT);
        let (beside, corner) = (DOT + GAP, DOT * 0.5);
        let (up, down) = (-DOT - DESCENT, DOT + ASCENT);
        let places = [
            (beside, level, Anchor::Start),
            (-beside, level, Anchor::End),
            (0.0, above, Anchor::Middle),
            (0.0, below, Anchor::Middle),
            (corner, up, Anchor::Start),
            (corner, down, Anchor::Start),
            (-corner, up, Anchor::End),
            (-corner, down, Anchor::End),
        ];
        let candidate = |(rank, (dx, dy, anchor))| {
            let (x, y) = (dot.0 + dx, dot.1 + dy);
            let left = match anchor {
                Anchor::Start => x,
                Anchor::Middle => x - width / 2.0,
                Anchor::End => x - width,
            };
            Self {
                label: Label { x, y, anchor },
                room: Area {
                    left,
                    top: y - ASCENT,
                    right: left + width,
                    bottom: y + DESCENT,
                },
                crossed: false,
                rank,
            }
        };
        places.into_iter().enumerate().map(candidate).collect()
    }
}

/// The dot with the fewest free places, and the best of those; `None` once no dot has any.
fn next(free: &[Vec<Candidate>]) -> Option<(usize, Candidate)> {
    let open = free
        .iter()
        .enumerate()
        .filter(|(_, places)| !places.is_empty());
    let (dot, places) = open.min_by_key(|(_, places)| places.len())?;
    let taken = |candidate: &&Candidate| {
        let others = free.iter().enumerate().filter(|&(other, _)| other != dot);
        let others = others.flat_map(|(_, places)| places);
        let taken = others
            .filter(|other| overlap(other.room, candidate.room))
            .count();
        (candidate.crossed, taken, candidate.rank)
    };
    Some((dot, *places.iter().min_by_key(taken)?))
}

fn around((x, y): (f64, f64)) -> Area {
    Area {
        left: x - DOT,
        top: y - DOT,
        right: x + DOT,
        bottom: y + DOT,
    }
}

fn crossed(lines: &[Vec<Option<(f64, f64)>>], room: Area) -> bool {
    let mut pairs = lines.iter().flat_map(|line| line.windows(2));
    pairs.any(|pair| match (pair[0], pair[1]) {
        (Some(a), Some(b)) => marks::clip(a, b, room).is_some(),
        _ => false,
    })
}

fn is_within(room: Area, area: Area) -> bool {
    room.left >= area.left
        && room.right <= area.right
        && room.top >= area.top
        && room.bottom <= area.bottom
}

fn overlap(a: Area, b: Area) -> bool {
    a.left < b.right && b.left < a.right && a.top < b.bottom && b.top < a.bottom
}

#[cfg(test)]
mod tests {
    use super::*;

    const AREA: Area = Area {
        left: 0.0,
        top: 0.0,
        right: 200.0,
        bottom: 100.0,
    };

    fn dot(x: f64, y: f64) -> Dot<'static> {
        Dot {
            at: (x, y),
            text: "name",
        }
    }

    #[test]
    fn a_label_stands_to_the_right_of_its_dot_if_there_is_room() {
        let anchors = |dots: &[Dot<'_>], lines: &[Vec<Option<(f64, f64)>>]| -> Vec<_> {
            let labels = place(dots, lines, AREA).into_iter();
            labels
                .map(|label| label.map(|label| label.anchor))
                .collect()
        };
        assert_eq!(anchors(&[dot(100.0, 50.0)], &[]), [Some(Anchor::Start)]);
        assert_eq!(anchors(&[dot(195.0, 50.0)], &[]), [Some(Anchor::End)]);
        let two = [dot(100.0, 50.0), dot(120.0, 50.0)];
        assert_eq!(anchors(&two, &[]), [Some(Anchor::End), Some(Anchor::Start)]);
        let line = vec![Some((110.0, 0.0)), Some((110.0, 100.0))];
        assert_eq!(anchors(&[dot(100.0, 50.0)], &[line]), [Some(Anchor::End)]);
    }

    #[test]
    fn what_has_no_free_place_is_left_out() {
        let heap: Vec<_> = (0..20).map(|_| dot(100.0, 50.0)).collect();
        let count = place(&heap, &[], AREA).into_iter().flatten().count();
        assert!((1..=8).contains(&count), "{count}");
        let nameless = Dot {
            at: (100.0, 50.0),
            text: " ",
        };
        assert_eq!(place(&[nameless], &[], AREA), [None]);
    }
}
