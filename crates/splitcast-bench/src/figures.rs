//! The figures of a scene: who is on the front, and what the frames took one by one.

use std::collections::BTreeMap;

use splitcast_report::{Axis, Dash, Figure, Plot, Role, Series};

use crate::command::SystemInfo;
use crate::front::{Standing, front};
use crate::measure::{SceneMeasurement, SystemMeasurement, UpdateSample};
use crate::rays::RaySetKind;
use crate::results::{Row, Spread};

/// Largest ratio to a yardstick that is shown on a linear axis.
const LINEAR_UP_TO: f64 = 2.0;

/// Most lines in a plot: beyond that, colors repeat.
const MAX_LINES: usize = Role::SERIES.len();

/// Kinds of rays that fronts are shown for, as far as they were traced: coherent and
/// incoherent ones.
const FRONT_KINDS: [RaySetKind; 2] = [RaySetKind::Primary, RaySetKind::Diffuse];

/// Rays by whose time the trees' quality is told, if they were traced: those that a tree's
/// shape matters to most.
const QUALITY_KIND: RaySetKind = RaySetKind::Diffuse;

/// One scene with one number of threads, as the figures look at it.
pub(crate) struct SceneView<'r> {
    pub(crate) scene: &'r SceneMeasurement,
    pub(crate) rows: &'r [&'r Row],
    pub(crate) systems: &'r [SystemInfo],
    pub(crate) kinds: &'r [RaySetKind],
}

/// Figures of one scene, in the order of the page.
pub(crate) struct SceneFigures {
    /// Update time against trace rate.
    pub(crate) fronts: Vec<Figure>,
    /// Times over the sequence.
    pub(crate) times: Vec<Figure>,
    /// Quality over the sequence; empty if no system has a yardstick.
    pub(crate) quality: Vec<Figure>,
}

impl SceneFigures {
    /// The figures of a scene.
    pub(crate) fn new(view: &SceneView<'_>) -> Self {
        let kinds = view.front_kinds();
        let mut styles = Styles::default();
        let shown = view.lines_of_time(&kinds);
        let times = vec![
            total_times(view, &shown, &mut styles),
            update_times(view, &shown, &mut styles),
        ];
        Self {
            fronts: kinds.iter().map(|&kind| scatter(view, kind)).collect(),
            times,
            quality: quality(view, &mut styles),
        }
    }
}

impl<'r> SceneView<'r> {
    /// The kinds that fronts are shown for.
    fn front_kinds(&self) -> Vec<RaySetKind> {
        let is_traced = |kind: &RaySetKind| self.kinds.contains(kind);
        let kinds: Vec<_> = FRONT_KINDS.into_iter().filter(is_traced).collect();
        if kinds.is_empty() {
            self.kinds.iter().copied().take(1).collect()
        } else {
            kinds
        }
    }

    /// Where systems stand by a kind of rays, the sound ones or the others.
    fn standings(&self, kind: RaySetKind, sound: bool) -> Vec<Standing<'r>> {
        let rows = self.rows.iter().filter(|row| row.is_sound() == sound);
        let standing = |row: &&'r Row| {
            Some(Standing {
                system: &row.system,
                update_ms: row.update_ms.median,
                rate: *row.mrays.get(kind.name())?,
            })
        };
        rows.filter_map(standing).collect()
    }

    /// The systems whose times are shown: those on the fronts of `kinds`, then ours, each
    /// from the shortest frames to the longest.
    fn lines_of_time(&self, kinds: &[RaySetKind]) -> Vec<&'r SystemMeasurement> {
        let fronts = kinds
            .iter()
            .flat_map(|&kind| front(&self.standings(kind, true)));
        let fronts: Vec<&str> = fronts.map(|standing| standing.system).collect();
        let place = |row: &Row| {
            let name = &row.system[..];
            (fronts.contains(&name) || row.is_ours()).then_some(!fronts.contains(&name))
        };
        let right = self.rows.iter().filter(|row| row.is_sound());
        let known = right.filter_map(|row| Some((place(row)?, self.measured(&row.system)?)));
        let mut shown: Vec<_> = known
            .map(|(place, system)| {
                let totals = by_frame(system, total);
                let total = totals.values().sum::<f64>() / totals.len().max(1) as f64;
                (place, total, system)
            })
            .collect();
        shown.sort_by(|a, b| a.0.cmp(&b.0).then(a.1.total_cmp(&b.1)));
        shown.truncate(MAX_LINES);
        shown.into_iter().map(|shown| shown.2).collect()
    }

    /// Sound systems, each beside its yardstick.
    fn against_yardsticks(&self) -> Vec<(&'r SystemMeasurement, &'r SystemMeasurement)> {
        let right = |name: &str| {
            let row = self.rows.iter().find(|row| row.system == name)?;
            self.measured(name).filter(|_| row.is_sound())
        };
        let pair = |info: &SystemInfo| Some((right(&info.name)?, right(info.yardstick.as_ref()?)?));
        self.systems.iter().filter_map(pair).collect()
    }

    fn measured(&self, name: &str) -> Option<&'r SystemMeasurement> {
        self.scene.systems.iter().find(|system| system.name == name)
    }
}

/// Strokes by system, the same in all plots of a scene. The first eight are told apart by
/// color; dashes tell further ones from them.
#[derive(Default)]
struct Styles<'r>(Vec<&'r str>);

impl<'r> Styles<'r> {
    fn line(&mut self, name: &'r str, points: impl IntoIterator<Item = (f64, f64)>) -> Series {
        let known = self.0.iter().position(|known| *known == name);
        let place = known.unwrap_or_else(|| {
            self.0.push(name);
            self.0.len() - 1
        });
        let dash = match place / MAX_LINES {
            0 => Dash::Solid,
            1 => Dash::Dashed,
            _ => Dash::Dotted,
        };
        Series::line(name, points).role(Role::nth(place)).dash(dash)
    }
}

/// Update time against trace rate, one dot a system.
fn scatter(view: &SceneView<'_>, kind: RaySetKind) -> Figure {
    let sound = view.standings(kind, true);
    let unsound = view.standings(kind, false);
    let at = |standing: &Standing<'_>| (standing.update_ms, standing.rate);
    let dots = |name: &str, standings: &[Standing<'_>]| {
        Series::dots(name, standings.iter().map(at))
            .labels(standings.iter().map(|standing| standing.system))
    };
    let mut plot = Plot::new(format!("Update against tracing, {kind} rays"))
        .description("One dot for each system; what is above and to the left is better.")
        .size(520.0, 380.0)
        .x(Axis::new("time of an update")
            .unit("ms, less is better")
            .log())
        .y(Axis::new(format!("{kind} rays"))
            .unit("million a second, more is better")
            .log())
        .no_data("no system has traced such rays")
        .series(
            Series::step("front", front(&sound).iter().map(at))
                .role(Role::Muted)
                .dash(Dash::Dashed),
        );
    let mut families: Vec<&str> = Vec::new();
    for info in view.systems {
        if !families.contains(&info.family) {
            families.push(info.family);
        }
    }
    for (index, family) in families.into_iter().enumerate() {
        let is_of_family = |standing: &&Standing<'_>| {
            let info = view
                .systems
                .iter()
                .find(|info| info.name == standing.system);
            info.is_some_and(|info| info.family == family)
        };
        let members: Vec<_> = sound.iter().filter(is_of_family).copied().collect();
        if !members.is_empty() {
            plot = plot.series(dots(family, &members).role(Role::nth(index)));
        }
    }
    let mut caption = "Medians, both axes logarithmic. The front joins the systems that no other \
                       one beats in both."
        .to_owned();
    if !unsound.is_empty() {
        plot = plot.series(dots("gave up or wrong hits", &unsound).role(Role::Muted));
        caption.push_str(" Systems that gave up or have wrong hits cannot be on it.");
    }
    Figure::new(plot).caption(caption)
}

fn total_times<'r>(
    view: &SceneView<'_>,
    shown: &[&'r SystemMeasurement],
    styles: &mut Styles<'r>,
) -> Figure {
    let sets: Vec<_> = view.kinds.iter().map(|kind| kind.name()).collect();
    let plot = times(Plot::new("Time of a whole frame"), "update and all rays");
    let plot = shown.iter().fold(plot, |plot, system| {
        plot.series(styles.line(&system.name, points(by_frame(system, total))))
    });
    Figure::new(plot).caption(format!(
        "Update and all sets of rays ({}), in the frames in which rays were traced. Shown are the \
         systems on a front above and after them ours, {MAX_LINES} at most: those with the shortest \
         frames.",
        sets.join(", ")
    ))
}

fn update_times<'r>(
    view: &SceneView<'_>,
    shown: &[&'r SystemMeasurement],
    styles: &mut Styles<'r>,
) -> Figure {
    let plot = times(Plot::new("Time of an update"), "update");
    let plot = shown.iter().fold(plot, |plot, system| {
        let updates = by_frame(system, |update| Some(update.update_ms));
        plot.series(styles.line(&system.name, points(updates)))
    });
    let frames = match view.scene.frames {
        1 => "of the only frame, built again",
        _ => "in all frames but the first",
    };
    Figure::new(plot).caption(format!("Updates alone, of the same systems, {frames}."))
}

fn times(plot: Plot, what: &str) -> Plot {
    plot.x(Axis::new("frame").whole())
        .y(Axis::new(what).unit("ms").log())
        .no_data("no frame was measured")
}

/// What trees are worth in each frame, measured by the systems' yardsticks.
fn quality<'r>(view: &SceneView<'r>, styles: &mut Styles<'r>) -> Vec<Figure> {
    let mut pairs = view.against_yardsticks();
    if pairs.is_empty() {
        return Vec::new();
    }
    let set = view.kinds.iter().position(|&kind| kind == QUALITY_KIND);
    let time = |update: &UpdateSample| Some(update.traces.get(set?)?.ms);
    let cost = |update: &UpdateSample| update.sah_cost;
    // Those that fall behind the most are what there is to see, in each library.
    let typical = |points: Vec<(f64, f64)>| {
        let spread = Spread::of(points.into_iter().map(|point| point.1));
        spread.map_or(0.0, |spread| spread.median)
    };
    let behind = |&(system, yardstick): &(&'r SystemMeasurement, &'r SystemMeasurement)| {
        let cost = typical(ratios(system, yardstick, cost));
        typical(ratios(system, yardstick, time)).max(cost)
    };
    let all = pairs.len();
    pairs.sort_by(|a, b| behind(b).total_cmp(&behind(a)));
    let mut before: BTreeMap<&str, usize> = BTreeMap::new();
    let places = pairs.iter().map(|(_, yardstick)| {
        let place = before.entry(&yardstick.name).or_default();
        *place += 1;
        *place
    });
    let mut ranked: Vec<_> = places.collect::<Vec<_>>().into_iter().zip(pairs).collect();
    ranked.sort_by_key(|(place, _)| *place);
    let mut pairs: Vec<_> = ranked.into_iter().map(|(_, pair)| pair).collect();
    pairs.truncate(MAX_LINES);
    let choice = if all > MAX_LINES {
        format!(
            " Shown are {MAX_LINES} of {all} systems, of each library those that fall behind the most."
        )
    } else {
        String::new()
    };
    let mut yardsticks: Vec<&str> = pairs.iter().map(|pair| &pair.1.name[..]).collect();
    yardsticks.sort_unstable();
    yardsticks.dedup();
    let mut plot = |title: &str, label: &str, figure: &dyn Fn(&UpdateSample) -> Option<f64>| {
        let lines = pairs.iter().map(|(system, yardstick)| {
            let points = ratios(system, yardstick, figure);
            (&system.name[..], points)
        });
        let lines: Vec<_> = lines.filter(|(_, points)| !points.is_empty()).collect();
        let largest = lines.iter().flat_map(|(_, points)| points);
        let largest = largest.map(|point| point.1).fold(1.0, f64::max);
        // One tree that rots, or one frame that was disturbed, must not hide all others.
        let axis = match largest > LINEAR_UP_TO {
            true => Axis::new(label).log(),
            false => Axis::new(label),
        };
        let plot = Plot::new(title)
            .x(Axis::new("frame").whole())
            .y(axis.include(1.0))
            .no_data("no system tells");
        (lines.into_iter()).fold(plot, |plot, (name, points)| {
            plot.series(styles.line(name, points))
        })
    };
    let mut figures = Vec::new();
    if set.is_some() {
        figures.push(
            Figure::new(plot(
                "What trees are worth: diffuse rays",
                "time over that of the yardstick",
                &time,
            ))
            .caption(format!(
                "Time to trace diffuse rays over that of the yardstick in the same frame, which \
                 is the system of the same library that builds its tree well from nothing ({}). \
                 A line that rises is a tree that rots.{choice}",
                yardsticks.join(", ")
            )),
        );
    }
    figures.push(
        Figure::new(plot(
            "What trees are worth: expected cost",
            "SAH cost over that of the yardstick",
            &cost,
        ))
        .caption(
            "The same for the expected cost by the surface area heuristic, of those libraries \
             whose trees can be read.",
        ),
    );
    figures
}

/// A system's figure over its yardstick's, frame by frame.
fn ratios(
    system: &SystemMeasurement,
    yardstick: &SystemMeasurement,
    figure: impl Fn(&UpdateSample) -> Option<f64>,
) -> Vec<(f64, f64)> {
    let reference = by_frame(yardstick, &figure);
    let figures = by_frame(system, &figure).into_iter();
    let ratio = |(frame, value)| Some((frame as f64, value / reference.get(&frame)?));
    figures.filter_map(ratio).collect()
}

/// Time of an update and all rays behind it, if any were traced.
fn total(update: &UpdateSample) -> Option<f64> {
    let rays: f64 = update.traces.iter().map(|trace| trace.ms).sum();
    (!update.traces.is_empty()).then_some(update.update_ms + rays)
}

/// A figure frame by frame: the median of its rounds.
fn by_frame(
    system: &SystemMeasurement,
    figure: impl Fn(&UpdateSample) -> Option<f64>,
) -> BTreeMap<usize, f64> {
    let mut rounds: BTreeMap<usize, Vec<f64>> = BTreeMap::new();
    for update in &system.updates {
        if let Some(value) = figure(update) {
            rounds.entry(update.frame).or_default().push(value);
        }
    }
    let median =
        |(frame, values): (usize, Vec<f64>)| Some((frame, Spread::of(values.into_iter())?.median));
    rounds.into_iter().filter_map(median).collect()
}

fn points(by_frame: BTreeMap<usize, f64>) -> impl Iterator<Item = (f64, f64)> {
    by_frame
        .into_iter()
        .map(|(frame, value)| (frame as f64, value))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::measure::TraceSample;

    #[test]
    fn frames_have_the_median_of_their_rounds() {
        let update = |frame, update_ms, ms: Option<f64>| UpdateSample {
            frame,
            update_ms,
            traces: ms
                .map(|ms| TraceSample { rays: 1, ms })
                .into_iter()
                .collect(),
            sah_cost: None,
        };
        let system = SystemMeasurement {
            name: String::new(),
            modes: Vec::new(),
            bytes: 0,
            updates: vec![
                update(1, 1.0, Some(2.0)),
                update(2, 5.0, None),
                update(1, 9.0, Some(9.0)),
                update(1, 3.0, Some(4.0)),
            ],
            agreement: Vec::new(),
            failure: None,
        };
        let updates = by_frame(&system, |update| Some(update.update_ms));
        assert_eq!(Vec::from_iter(updates), [(1, 3.0), (2, 5.0)]);
        assert_eq!(Vec::from_iter(by_frame(&system, total)), [(1, 7.0)]);
        assert_eq!(ratios(&system, &system, total), [(1.0, 1.0)]);
    }
}
