//! Scales: from values to places, and which ticks to name.

use super::Axis;
use super::number;

/// Greatest magnitude that is drawn; differences of such values stay finite.
const LIMIT: f64 = 1e300;

/// Smallest magnitude that is told from 0; quotients by such values stay finite.
const TINY: f64 = 1e-290;

/// Ratio of extent to magnitude under which data counts as constant: below it the
/// digits of `f64` no longer tell ticks apart.
const CONSTANT: f64 = 1e-12;

/// A range of values.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Scale {
    pub(super) lo: f64,
    pub(super) hi: f64,
    log: bool,
    whole: bool,
}

/// A named place on an axis.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Tick {
    pub(super) value: f64,
    pub(super) label: String,
}

/// Room that is left around the data.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Margin {
    /// None: the data ends where the axis ends.
    Tight,
    /// A twenty-fifth of the extent.
    Narrow,
    /// As much as it takes to end at a tick, with at most this many intervals.
    Ticks(usize),
}

impl Scale {
    /// The scale of `axis` for these values, `None` if none of them can be drawn.
    pub(super) fn new(
        axis: &Axis,
        values: impl IntoIterator<Item = f64>,
        margin: Margin,
    ) -> Option<Self> {
        let held = |value: f64| (Self::holds(axis, value)).then(|| snap(value));
        let (mut lo, mut hi) = extent(values.into_iter().filter_map(held))?;
        for value in axis.include.iter().copied().filter_map(held) {
            (lo, hi) = (lo.min(value), hi.max(value));
        }
        let scale = |(lo, hi)| Self {
            lo,
            hi,
            log: axis.log,
            whole: axis.whole,
        };
        let range = axis
            .range
            .and_then(|(from, to)| Some((held(from)?, held(to)?)));
        if let Some((from, to)) = range
            && from < to
            && !is_constant(from, to)
        {
            return Some(scale((from, to)));
        }
        let constant = is_constant(lo, hi);
        if constant {
            (lo, hi) = around(lo, axis);
        }
        let ends = if axis.log {
            log_margin(lo, hi, margin)
        } else {
            let included = |end: f64| !constant && axis.include.contains(&end);
            let (a, b) = linear_margin(lo, hi, margin, axis.whole);
            (
                if included(lo) { lo } else { a },
                if included(hi) { hi } else { b },
            )
        };
        // Margins must not lead to where values have no place.
        let least = if axis.log { TINY } else { -LIMIT };
        Some(scale((ends.0.max(least), ends.1.min(LIMIT))))
    }

    /// Whether the scale of `axis` can hold a value.
    pub(super) fn holds(axis: &Axis, value: f64) -> bool {
        value.is_finite() && value.abs() <= LIMIT && (!axis.log || value >= TINY)
    }

    /// From 0 at the lower end to 1 at the upper, beyond for values outside;
    /// `None` for values that the scale cannot hold.
    pub(super) fn place(&self, value: f64) -> Option<f64> {
        if !value.is_finite() || value.abs() > LIMIT || (self.log && value < TINY) {
            return None;
        }
        let place = if self.log {
            (value.ln() - self.lo.ln()) / (self.hi.ln() - self.lo.ln())
        } else {
            (value - self.lo) / (self.hi - self.lo)
        };
        // Far outside, only the direction matters.
        Some(place.clamp(-1e6, 1e6))
    }

    /// Where bars stand: 0, or the end that is nearest to it.
    pub(super) fn base(&self) -> f64 {
        if self.log {
            self.lo
        } else {
            0f64.clamp(self.lo, self.hi)
        }
    }

    /// The densest ticks, at most `most` where the scale is linear, whose labels
    /// `fit` says do not collide. At least two.
    pub(super) fn ticks(&self, most: usize, fit: impl Fn(&[Tick]) -> bool) -> Vec<Tick> {
        let mut sparsest = None;
        for ticks in self.candidates(most).into_iter().filter(|t| t.len() >= 2) {
            if fit(&ticks) {
                return ticks;
            }
            sparsest = Some(ticks);
        }
        sparsest.unwrap_or_else(|| named(vec![self.lo, self.hi]))
    }

    /// Sets of ticks from dense to sparse.
    fn candidates(&self, most: usize) -> Vec<Vec<Tick>> {
        let linear = |most| {
            let step = linear_step(self.lo, self.hi, most, self.whole);
            named_by_step(&multiples(self.lo, self.hi, step), step)
        };
        let decades = if self.log {
            self.hi.log10() - self.lo.log10()
        } else {
            0.0
        };
        if decades < 1.0 {
            return (1..=most).rev().map(linear).collect();
        }
        let mut candidates = Vec::new();
        if decades <= 3.0 {
            candidates.push(named(self.powers(&[1.0, 2.0, 5.0], 1)));
        }
        let strides = (1..).take_while(|&stride| f64::from(stride) <= decades.max(1.0));
        candidates.extend(strides.map(|stride| named(self.powers(&[1.0], stride))));
        candidates
    }

    /// The values `m · 10^k` within the scale, for each of `mantissas` and every
    /// `stride`-th `k`.
    fn powers(&self, mantissas: &[f64], stride: i32) -> Vec<f64> {
        let (first, last) = (
            self.lo.log10().floor() as i32,
            self.hi.log10().ceil() as i32,
        );
        (first..=last)
            .filter(|k| k.rem_euclid(stride) == 0)
            .flat_map(|k| mantissas.iter().map(move |m| m * 10f64.powi(k)))
            .filter(|&value| self.contains(value))
            .collect()
    }

    fn contains(&self, value: f64) -> bool {
        let place = self.place(value);
        place.is_some_and(|place| (-1e-9..=1.0 + 1e-9).contains(&place))
    }
}

/// The least and the greatest of the finite values.
pub(super) fn extent(values: impl IntoIterator<Item = f64>) -> Option<(f64, f64)> {
    let finite = values.into_iter().filter(|value| value.is_finite());
    finite.fold(None, |ends, value| {
        let (lo, hi) = ends.unwrap_or((value, value));
        Some((lo.min(value), hi.max(value)))
    })
}

/// Makes 0 of what is too small to divide by.
fn snap(value: f64) -> f64 {
    if value.abs() < TINY { 0.0 } else { value }
}

fn is_constant(lo: f64, hi: f64) -> bool {
    hi - lo <= lo.abs().max(hi.abs()) * CONSTANT
}

/// A range around a constant.
fn around(value: f64, axis: &Axis) -> (f64, f64) {
    if axis.log {
        (value / 2.0, value * 2.0)
    } else if axis.whole {
        (
            value - 1.0f64.max(value.abs() * 0.01),
            value + 1.0f64.max(value.abs() * 0.01),
        )
    } else if value == 0.0 {
        (-1.0, 1.0)
    } else {
        (value - value.abs() * 0.1, value + value.abs() * 0.1)
    }
}

fn linear_margin(lo: f64, hi: f64, margin: Margin, whole: bool) -> (f64, f64) {
    match margin {
        Margin::Tight => (lo, hi),
        Margin::Narrow => {
            let room = (hi - lo) / 25.0;
            (lo - room, hi + room)
        }
        Margin::Ticks(most) => {
            let step = linear_step(lo, hi, most, whole);
            let down = (lo / step + 1e-9).floor() * step;
            let up = (hi / step - 1e-9).ceil() * step;
            (down.min(lo), up.max(hi))
        }
    }
}

fn log_margin(lo: f64, hi: f64, margin: Margin) -> (f64, f64) {
    match margin {
        Margin::Tight => (lo, hi),
        Margin::Narrow => {
            // In logarithms: the quotient can be beyond `f64`.
            let room = ((hi.ln() - lo.ln()) / 25.0).exp();
            (lo / room, hi * room)
        }
        Margin::Ticks(_) => {
            let decade = |value: f64| 10f64.powi(value.log10().floor() as i32);
            let (down, up) = (decade(lo), decade(hi));
            let down = [5.0, 2.0]
                .map(|m| m * down)
                .into_iter()
                .find(|&v| v <= lo)
                .unwrap_or(down);
            let ups = [1.0, 2.0, 5.0, 10.0].map(|m| m * up);
            let up = ups
                .into_iter()
                .find(|&v| v >= hi * (1.0 - 1e-9))
                .unwrap_or(hi);
            (down.min(lo), up.max(hi))
        }
    }
}

/// The smallest of 1, 2 and 5 times a power of ten that makes at most `most` intervals.
fn linear_step(lo: f64, hi: f64, most: usize, whole: bool) -> f64 {
    let least = (hi - lo) / most.max(1) as f64;
    let decade = 10f64.powi(least.log10().floor() as i32);
    let steps = [1.0, 2.0, 5.0].map(|m| m * decade).into_iter();
    let step = steps.into_iter().find(|step| *step >= least * (1.0 - 1e-9));
    let step = step.unwrap_or(10.0 * decade);
    if whole { step.max(1.0) } else { step }
}

fn multiples(lo: f64, hi: f64, step: f64) -> Vec<f64> {
    let (first, last) = ((lo / step - 1e-9).ceil(), (hi / step + 1e-9).floor());
    let count = (last - first).clamp(-1.0, 1000.0) as i32 + 1;
    let value = |i: i32| ((first + f64::from(i)) * step).clamp(lo, hi);
    (0..count).map(value).collect()
}

/// Labels with as many digits as the step has.
fn named_by_step(values: &[f64], step: f64) -> Vec<Tick> {
    let greatest = values.iter().fold(0.0f64, |most, v| most.max(v.abs()));
    let name = |&value: &f64| Tick {
        value,
        label: number::with_step(value, step, greatest),
    };
    values.iter().map(name).collect()
}

/// Labels on their own, for logarithmic axes.
fn named(values: Vec<f64>) -> Vec<Tick> {
    let name = |value| Tick {
        value,
        label: number::short(value),
    };
    values.into_iter().map(name).collect()
}
