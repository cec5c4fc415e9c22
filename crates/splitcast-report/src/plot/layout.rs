//! Where everything stands: text above the area, labels around it, legend, colour key
//! and notes below it, where they never cover data.

use super::scale::{Margin, Scale, Tick};
use super::{Axis, Kind, Plot, number, text};

/// Type sizes.
pub(super) const TITLE: f64 = 14.5;
pub(super) const LABEL: f64 = 13.0;
pub(super) const TICK: f64 = 12.0;

/// How much wider bold type is.
const BOLD: f64 = 1.1;

/// Height of a line of type, as a multiple of its size.
const LEADING: f64 = 1.3;

/// Space between the plot's edge and what is in it.
const EDGE: f64 = 4.0;

/// Length of the sample of a series in the legend.
pub(super) const SAMPLE: f64 = 22.0;

/// Slope of names that have no room to stand level, in degrees.
pub(super) const SLOPE: f64 = 40.0;

/// Where things stand, in units of the plot, from its upper left corner.
pub(super) struct Layout {
    pub(super) width: f64,
    pub(super) height: f64,
    pub(super) area: Area,
    /// `None` if there is nothing to draw.
    pub(super) scales: Option<(Scale, Scale)>,
    pub(super) x_ticks: Vec<Tick>,
    pub(super) y_ticks: Vec<Tick>,
    /// Names of categories slope instead of breaking into lines.
    pub(super) sloped: bool,
    pub(super) lines: Vec<Line>,
    /// Each with the index of its series.
    pub(super) legend: Vec<(usize, Line)>,
    /// Place of the colour key's left and upper edge.
    pub(super) key: Option<Key>,
}

/// The area in which data is drawn.
#[derive(Clone, Copy)]
pub(super) struct Area {
    pub(super) left: f64,
    pub(super) top: f64,
    pub(super) right: f64,
    pub(super) bottom: f64,
}

/// A line of type.
pub(super) struct Line {
    pub(super) text: String,
    pub(super) x: f64,
    /// Of the baseline.
    pub(super) y: f64,
    pub(super) style: Style,
}

#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum Style {
    Title,
    Label,
    /// Centred on its place.
    XLabel,
    Note,
}

/// The bar of a colour key, with labels at both ends.
pub(super) struct Key {
    pub(super) left: f64,
    pub(super) right: f64,
    pub(super) top: f64,
}

impl Key {
    pub(super) const HEIGHT: f64 = 10.0;
}

impl Layout {
    pub(super) fn new(plot: &Plot) -> Self {
        let width = plot.width;
        let mut below = EDGE;
        let mut lines = Vec::new();
        for line in text::wrap(&plot.title, TITLE * BOLD, width - EDGE, 3) {
            lines.push(stack(line, 0.0, &mut below, TITLE, Style::Title));
        }
        let scales = scales(plot);
        if scales.is_some() {
            for line in text::wrap(&plot.y.text(), LABEL, width - EDGE, 2) {
                lines.push(stack(line, 0.0, &mut below, LABEL, Style::Label));
            }
        }
        let mut layout = Self {
            width,
            height: 0.0,
            area: Area {
                left: 1.0,
                top: below + 11.0,
                right: width - 1.0,
                bottom: below + 11.0 + plot.area_height,
            },
            scales,
            x_ticks: Vec::new(),
            y_ticks: Vec::new(),
            sloped: false,
            lines,
            legend: Vec::new(),
            key: None,
        };
        below = layout.area.bottom + EDGE;
        if let Some((x, y)) = scales {
            layout.place_ticks(plot, x, y);
            below += layout.x_tick_height(plot);
            layout.place_x_label(plot, &mut below);
        }
        layout.place_key(plot, &mut below);
        layout.place_legend(plot, &mut below);
        layout.place_notes(plot, &mut below);
        layout.height = below + EDGE;
        layout
    }

    fn place_ticks(&mut self, plot: &Plot, x: Scale, y: Scale) {
        let height = self.area.bottom - self.area.top;
        let places = |scale: Scale, ticks: &[Tick], length: f64| -> Vec<f64> {
            let place = |tick: &Tick| scale.place(tick.value).unwrap_or(0.0) * length;
            ticks.iter().map(place).collect()
        };
        self.y_ticks = y.ticks(most_y_ticks(plot), |ticks| {
            let places = places(y, ticks, height);
            places
                .windows(2)
                .all(|pair| pair[1] - pair[0] >= TICK * 1.6)
        });
        let widest = widest(&self.y_ticks);
        self.area.left = (widest + 8.0 + EDGE).min(self.width * 0.4);
        if !plot.categories.is_empty() {
            self.area.right = self.width - 10.0;
            self.place_categories(plot, x);
            return;
        }
        // The last label may reach beyond the area: how far is known once it is chosen.
        let mut ends = 10.0;
        for _ in 0..2 {
            self.area.right = self.width - EDGE - ends;
            let length = self.area.right - self.area.left;
            self.x_ticks = x.ticks(10, |ticks| {
                let places = places(x, ticks, length);
                let widths: Vec<_> = ticks.iter().map(|t| text::width(&t.label, TICK)).collect();
                (1..ticks.len())
                    .all(|i| places[i] - places[i - 1] >= (widths[i] + widths[i - 1]) / 2.0 + 9.0)
            });
            let last = self.x_ticks.last();
            ends = last
                .map_or(10.0, |tick| text::width(&tick.label, TICK) / 2.0)
                .max(10.0);
        }
    }

    /// One name for each category as long as there is room for a line of type each.
    fn place_categories(&mut self, plot: &Plot, x: Scale) {
        let slot = (self.area.right - self.area.left) / (x.hi - x.lo);
        let stride = (TICK * 1.2 / slot).ceil().max(1.0) as usize;
        let names = plot.categories.iter().enumerate().step_by(stride);
        let names = names.filter(|(at, _)| {
            x.place(*at as f64)
                .is_some_and(|p| (0.0..=1.0).contains(&p))
        });
        let room = slot * stride as f64 - 6.0;
        let word = |name: &str| {
            let words = name.split_whitespace().map(|word| text::width(word, TICK));
            words.fold(0.0, f64::max)
        };
        self.sloped = names.clone().any(|(_, name)| {
            word(name) > room || text::wrap(name, TICK, room, usize::MAX).len() > 3
        });
        let most = if self.sloped { 130.0 } else { f64::INFINITY };
        let tick = |(at, name): (usize, &String)| Tick {
            value: at as f64,
            label: text::cut(name, TICK, most),
        };
        self.x_ticks = names.map(tick).collect();
        if self.sloped {
            // Sloped names end at their tick, so the first ones reach out to the left.
            let reach = self.x_ticks.iter().map(|tick| {
                let at = (tick.value - x.lo) * slot;
                text::width(&tick.label, TICK) * SLOPE.to_radians().cos() + 8.0 - at
            });
            self.area.left = reach.fold(self.area.left, f64::max).min(self.width * 0.4);
        }
    }

    fn x_tick_height(&self, plot: &Plot) -> f64 {
        if self.sloped {
            let (sin, cos) = SLOPE.to_radians().sin_cos();
            return widest(&self.x_ticks) * sin + TICK * cos + 4.0;
        }
        let lines = self
            .x_ticks
            .iter()
            .map(|tick| self.tick_lines(plot, tick).len());
        lines.max().unwrap_or(1).max(1) as f64 * TICK * LEADING + 2.0
    }

    /// The lines of a label along the horizontal axis.
    pub(super) fn tick_lines(&self, plot: &Plot, tick: &Tick) -> Vec<String> {
        let Some((x, _)) = self.scales.filter(|_| !plot.categories.is_empty()) else {
            return vec![tick.label.clone()];
        };
        let slot = (self.area.right - self.area.left) / (x.hi - x.lo);
        text::wrap(&tick.label, TICK, slot - 6.0, 3)
    }

    fn place_x_label(&mut self, plot: &Plot, below: &mut f64) {
        let center = (self.area.left + self.area.right) / 2.0;
        let room = 2.0 * (center.min(self.width - center) - EDGE);
        for line in text::wrap(&plot.x.text(), LABEL, room, 2) {
            self.lines
                .push(stack(line, center, below, LABEL, Style::XLabel));
        }
    }

    fn place_key(&mut self, plot: &Plot, below: &mut f64) {
        let Some(family) = plot.family.as_ref().filter(|_| self.scales.is_some()) else {
            return;
        };
        let Some((lo, hi)) = family.extent() else {
            return;
        };
        *below += 8.0;
        let room = (self.width - 2.0 * EDGE) * 0.4;
        let low = format!(
            "{} {}",
            text::cut(&family.label, LABEL, room),
            number::short(lo)
        );
        let (low, high) = (low.trim().to_owned(), number::short(hi));
        if lo == hi {
            let left = (self.width - text::width(&low, LABEL)) / 2.0;
            self.lines
                .push(stack(low, left, below, LABEL, Style::Label));
            return;
        }
        let (before, after) = (
            text::width(&low, LABEL) + 8.0,
            text::width(&high, LABEL) + 8.0,
        );
        let bar = 110.0f64.min(self.width - before - after - 2.0 * EDGE);
        let left = (self.width - before - bar - after) / 2.0;
        let key = Key {
            left: left + before,
            right: left + before + bar,
            top: *below + 3.0,
        };
        let high_at = key.right + 8.0;
        let mut same_line = *below;
        self.lines
            .push(stack(low, left, &mut same_line, LABEL, Style::Label));
        self.lines
            .push(stack(high, high_at, below, LABEL, Style::Label));
        self.key = Some(key);
    }

    fn place_legend(&mut self, plot: &Plot, below: &mut f64) {
        if self.scales.is_none() {
            return;
        }
        let (start, end) = (self.area.left.min(60.0), self.width - EDGE);
        let mut x = start;
        for (index, series) in plot.series.iter().enumerate() {
            if series.name.trim().is_empty() {
                continue;
            }
            let name = text::cut(&series.name, LABEL, end - start - SAMPLE - 6.0);
            let width = SAMPLE + 6.0 + text::width(&name, LABEL);
            if self.legend.is_empty() {
                *below += 6.0 + LABEL * LEADING;
            } else if x + width > end {
                *below += LABEL * LEADING + 3.0;
                x = start;
            }
            let line = Line {
                text: name,
                x,
                y: *below - LABEL * (LEADING - 1.0),
                style: Style::Label,
            };
            self.legend.push((index, line));
            x += width + 16.0;
        }
    }

    fn place_notes(&mut self, plot: &Plot, below: &mut f64) {
        let Some(note) = left_out(plot).filter(|_| self.scales.is_some()) else {
            return;
        };
        *below += 4.0;
        for line in text::wrap(&note, TICK, self.width - 2.0 * EDGE, 2) {
            self.lines.push(stack(line, 0.0, below, TICK, Style::Note));
        }
    }
}

/// What logarithmic axes leave out, `None` if nothing.
pub(super) fn left_out(plot: &Plot) -> Option<String> {
    let refused = |axis: &Axis, value: f64| axis.log && value.is_finite() && value <= 0.0;
    let count = points(plot)
        .filter(|p| refused(&plot.x, p.0) || refused(&plot.y, p.1))
        .count();
    match count {
        0 => None,
        1 => Some("One point at or below 0 has no place on a logarithmic axis.".into()),
        n => Some(format!(
            "{n} points at or below 0 have no place on a logarithmic axis."
        )),
    }
}

/// The points of everything that is drawn.
fn points(plot: &Plot) -> impl Iterator<Item = (f64, f64)> {
    let family = plot.family.iter().flat_map(|family| &family.curves);
    let curves = family.map(|curve| &curve.1);
    let all = curves.chain(plot.series.iter().map(|series| &series.points));
    all.flatten().copied()
}

/// Scales that hold every point that can be drawn, `None` if there is none.
fn scales(plot: &Plot) -> Option<(Scale, Scale)> {
    let drawn = || {
        let held = |p: &(f64, f64)| Scale::holds(&plot.x, p.0) && Scale::holds(&plot.y, p.1);
        points(plot).filter(held)
    };
    let has = |kind| plot.series.iter().any(|series| series.kind == kind);
    let mut y = plot.y.clone();
    if has(Kind::Bars) {
        // Bars stand on 0. On a logarithmic axis nothing is natural to stand on, but the
        // lowest bar has to be seen.
        let lowest = drawn().map(|p| p.1).fold(f64::INFINITY, f64::min);
        y = y.include(if plot.y.log { lowest / 2.0 } else { 0.0 });
    }
    let y = Scale::new(&y, drawn().map(|p| p.1), Margin::Ticks(most_y_ticks(plot)))?;
    let x = if has(Kind::Bars) || !plot.categories.is_empty() {
        let bars = plot
            .series
            .iter()
            .filter(|series| series.kind == Kind::Bars);
        let longest = bars.map(|series| series.points.len()).max();
        let count = plot.categories.len().max(longest.unwrap_or(0)).max(1);
        let ends = (-0.5, count as f64 - 0.5);
        let axis = Axis::new("").whole().range(ends.0, ends.1);
        Scale::new(&axis, [0.0], Margin::Tight)?
    } else if has(Kind::Dots) {
        Scale::new(&plot.x, drawn().map(|p| p.0), Margin::Narrow)?
    } else {
        Scale::new(&plot.x, drawn().map(|p| p.0), Margin::Tight)?
    };
    Some((x, y))
}

/// Intervals of the vertical axis, by the room there is.
fn most_y_ticks(plot: &Plot) -> usize {
    (plot.area_height / 36.0).clamp(2.0, 8.0) as usize
}

fn widest(ticks: &[Tick]) -> f64 {
    let widths = ticks.iter().map(|tick| text::width(&tick.label, TICK));
    widths.fold(0.0, f64::max)
}

/// Puts a line of type below what is there.
fn stack(text: String, x: f64, below: &mut f64, size: f64, style: Style) -> Line {
    let y = *below + size;
    *below += size * LEADING;
    Line { text, x, y, style }
}
