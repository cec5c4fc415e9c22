//! Labels beside dots, each where it covers neither a dot nor another label.
//!
//! The label with the fewest free places is put down first, on the place that takes
//! the least away from the others. A label that is left without a place takes one from
//! another that can move away. What has no place even so is left out.

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
    let candidates = dots.iter().map(|dot| match dot.text.trim() {
        "" => Vec::new(),
        text => Candidate::all(dot.at, text::width(text, TICK)),
    });
    let mut candidates: Vec<Vec<Candidate>> = candidates.collect();
    for candidate in &mut candidates {
        candidate.retain_mut(|candidate| {
            candidate.crossed = crossed(lines, candidate.room);
            let room = candidate.room;
            is_within(room, area) && !squares.iter().any(|&square| overlap(square, room))
        });
    }
    let mut chosen = greedy(candidates.clone());
    for dot in 0..dots.len() {
        if chosen[dot].is_none() {
            make_way(dot, &candidates, &mut chosen);
        }
    }
    let labels = chosen.into_iter();
    labels.map(|chosen| Some(chosen?.label)).collect()
}

/// Chooses places one by one, from those that are still free.
fn greedy(mut free: Vec<Vec<Candidate>>) -> Vec<Option<Candidate>> {
    let mut chosen = vec![None; free.len()];
    while let Some((dot, place)) = next(&free) {
        chosen[dot] = Some(place);
        free[dot].clear();
        for candidates in &mut free {
            candidates.retain(|candidate| !overlap(candidate.room, place.room));
        }
    }
    chosen
}

/// Gives `dot` the first place that at most one other label stands on, if that one has
/// another place to go to.
fn make_way(dot: usize, candidates: &[Vec<Candidate>], chosen: &mut [Option<Candidate>]) {
    let on = |room: Area| -> Vec<usize> {
        let labels = chosen.iter().enumerate();
        let labels = labels.filter_map(|(other, label)| Some((other, (*label)?)));
        let on = labels.filter(|(_, label)| overlap(label.room, room));
        on.map(|(other, _)| other).collect()
    };
    let moves = candidates[dot].iter().find_map(|wanted| {
        let &[other] = &on(wanted.room)[..] else {
            return None;
        };
        let is_free = |to: &&Candidate| {
            !overlap(to.room, wanted.room) && on(to.room).iter().all(|&label| label == other)
        };
        Some((*wanted, other, *candidates[other].iter().find(is_free)?))
    });
    if let Some((wanted, other, to)) = moves {
        chosen[other] = Some(to);
        chosen[dot] = Some(wanted);
    }
}

/// A place that a label may take.
#[derive(Clone, Copy)]
struct Candidate {
    label: Label,
    /// What the text covers.
    room: Area,
    /// How much of the lines it covers.
    crossed: f64,
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
                crossed: 0.0,
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
    let taken = |candidate: &Candidate| {
        let others = free.iter().enumerate().filter(|&(other, _)| other != dot);
        let others = others.flat_map(|(_, places)| places);
        others
            .filter(|other| overlap(other.room, candidate.room))
            .count()
    };
    let cost = |candidate: &Candidate| (taken(candidate), candidate.rank);
    let best = places.iter().min_by(|a, b| {
        let crossed = a.crossed.total_cmp(&b.crossed);
        crossed.then_with(|| cost(a).cmp(&cost(b)))
    });
    Some((dot, *best?))
}

fn around((x, y): (f64, f64)) -> Area {
    Area {
        left: x - DOT,
        top: y - DOT,
        right: x + DOT,
        bottom: y + DOT,
    }
}

/// Length of the parts of lines that are within `room`.
fn crossed(lines: &[Vec<Option<(f64, f64)>>], room: Area) -> f64 {
    let pairs = lines.iter().flat_map(|line| line.windows(2));
    let parts = pairs.filter_map(|pair| marks::clip(pair[0]?, pair[1]?, room));
    parts.map(|(a, b)| (b.0 - a.0).hypot(b.1 - a.1)).sum()
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
    fn a_label_makes_way_for_one_that_has_no_other_place() {
        let all = |dots: &[Dot<'_>]| {
            let squares: Vec<Area> = dots.iter().map(|dot| around(dot.at)).collect();
            let places = |dot: &Dot<'_>| {
                let mut places = Candidate::all(dot.at, 30.0);
                places.retain(|place| !squares.iter().any(|&square| overlap(square, place.room)));
                places
            };
            dots.iter().map(places).collect::<Vec<_>>()
        };
        let mut candidates = all(&[dot(60.0, 50.0), dot(110.0, 50.0)]);
        // The second label can only stand where the first one does.
        candidates[1].retain(|place| place.label.anchor == Anchor::End);
        candidates[1].truncate(1);
        let mut chosen = vec![Some(candidates[0][0]), None];
        assert!(overlap(candidates[0][0].room, candidates[1][0].room));
        make_way(1, &candidates, &mut chosen);
        let rooms: Vec<Area> = chosen.iter().flatten().map(|place| place.room).collect();
        assert!(rooms.len() == 2 && !overlap(rooms[0], rooms[1]));
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
