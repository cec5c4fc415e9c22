//! Minimisation of a function of one variable by golden section search
//! combined with parabolic interpolation (Brent 1973, chapter 5; the method of
//! Hussain & Grahn 2007), for costs that are step functions.
//!
//! The search asks for one evaluation at a time ([`LineSearch::propose`]) and
//! is told the result ([`LineSearch::tell`]), so that the caller decides how
//! evaluations are made. A [`Sample`] carries the counts that its cost was
//! computed from: where counts at both ends of a stretch are equal, the cost in
//! between is a straight line, and no evaluation is spent there.

/// The share of the longer part of a bracket at which golden section evaluates:
/// (3 − √5) / 2.
pub(super) const GOLDEN: f32 = 0.381_966;

/// The cost of a plane.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Sample {
    pub(super) position: f32,
    pub(super) cost: f32,
    /// References on each side.
    pub(super) counts: [u32; 2],
}

impl Sample {
    /// Fills arrays.
    pub(super) const ZERO: Self = Self {
        position: 0.0,
        cost: 0.0,
        counts: [0, 0],
    };
}

/// When a search ends.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Stop {
    /// Evaluations closer than this to others are not worth making. Above 0.
    pub(super) tolerance: f32,
    /// Evaluations that may be made.
    pub(super) budget: u32,
}

/// A search in progress.
#[derive(Clone, Debug)]
pub(super) struct LineSearch {
    /// The bracket: no better plane is looked for outside of it.
    low: Sample,
    high: Sample,
    /// The best three inner points, best first; as many as there are so far.
    best: Option<Sample>,
    second: Option<Sample>,
    third: Option<Sample>,
    last_step: f32,
    step_before: f32,
    stop: Stop,
}

impl LineSearch {
    /// A search between two planes that are known already, and are not
    /// minima themselves: the ends of a node.
    #[inline(always)]
    pub(super) fn between(low: Sample, high: Sample, stop: Stop) -> Self {
        let length = high.position - low.position;
        Self {
            low,
            high,
            best: None,
            second: None,
            third: None,
            last_step: length,
            step_before: length,
            stop,
        }
    }

    /// A search around a plane that costs no more than two others on either
    /// side of it.
    #[inline(always)]
    pub(super) fn around(low: Sample, best: Sample, high: Sample, stop: Stop) -> Self {
        let (second, third) = if low.cost < high.cost {
            (low, high)
        } else {
            (high, low)
        };
        Self {
            best: Some(best),
            second: Some(second),
            third: Some(third),
            ..Self::between(low, high, stop)
        }
    }

    /// The best plane so far.
    #[inline(always)]
    pub(super) fn best(&self) -> Option<Sample> {
        self.best
    }

    /// Where to evaluate next; `None` at the end.
    #[inline(always)]
    pub(super) fn propose(&mut self) -> Option<f32> {
        if self.stop.budget == 0 {
            return None;
        }
        let (low, high) = (self.low.position, self.high.position);
        let tolerance = self.stop.tolerance;
        let Some(best) = self.best else {
            let position = low + GOLDEN * (high - low);
            let wide = high - low > 2.0 * tolerance;
            return (wide && position > low && position < high).then_some(position);
        };
        let x = best.position;
        let middle = low + 0.5 * (high - low);
        let wide = (x - middle).abs() + 0.5 * (high - low) > 2.0 * tolerance;
        let flat_below = self.low.counts == best.counts;
        let flat_above = self.high.counts == best.counts;
        if !wide || (flat_below && flat_above) {
            return None;
        }
        let step = if let Some(step) = self.parabolic_step() {
            self.step_before = self.last_step;
            step
        } else {
            let above = if flat_below || flat_above {
                flat_below
            } else {
                x < middle
            };
            let part = if above { high - x } else { low - x };
            self.step_before = part;
            GOLDEN * part
        };
        self.last_step = step;
        let step = if step.abs() >= tolerance {
            step
        } else {
            tolerance.copysign(step)
        };
        let position = x + step;
        (position > low && position < high && position != x).then_some(position)
    }

    /// How much lower the cost is at the lowest point of the parabola through
    /// the best three points; 0 if they do not make one that is open upwards.
    #[inline(always)]
    pub(super) fn promised_gain(&self) -> f32 {
        let (Some(x), Some((numerator, denominator))) = (self.best, self.parabola()) else {
            return 0.0;
        };
        let (Some(w), Some(v)) = (self.second, self.third) else {
            return 0.0;
        };
        // The factor of the square, by divided differences.
        let spread = (x.position - w.position) * (x.position - v.position);
        let square = denominator / (2.0 * spread * (v.position - w.position));
        let step = numerator / denominator;
        let gain = square * step * step;
        // Also false for what is not a number.
        if gain > 0.0 { gain } else { 0.0 }
    }

    /// The step to the lowest point of the parabola through the best three
    /// points, if it leads into the bracket and steps are getting shorter.
    #[inline(always)]
    fn parabolic_step(&self) -> Option<f32> {
        let tolerance = self.stop.tolerance;
        if self.step_before.abs() <= tolerance {
            return None;
        }
        let (numerator, denominator) = self.parabola()?;
        let step = numerator / denominator;
        let position = self.best?.position + step;
        // Also false for a step that is not a number.
        let sound = step.abs() < 0.5 * self.step_before.abs()
            && position - self.low.position >= 2.0 * tolerance
            && self.high.position - position >= 2.0 * tolerance;
        sound.then_some(step)
    }

    /// Numerator and denominator of the step to the turning point of the parabola.
    #[inline(always)]
    fn parabola(&self) -> Option<(f32, f32)> {
        let (x, w, v) = (self.best?, self.second?, self.third?);
        let r = (x.position - w.position) * (x.cost - v.cost);
        let q = (x.position - v.position) * (x.cost - w.cost);
        let numerator = (x.position - v.position) * q - (x.position - w.position) * r;
        Some((numerator, 2.0 * (r - q)))
    }

    /// Takes in an evaluation: the one that was proposed, or another inside
    /// the bracket.
    #[inline(always)]
    pub(super) fn tell(&mut self, sample: Sample) {
        self.stop.budget = self.stop.budget.saturating_sub(1);
        let Some(best) = self.best else {
            self.best = Some(sample);
            return;
        };
        let below = sample.position < best.position;
        if sample.cost <= best.cost {
            *(if below { &mut self.high } else { &mut self.low }) = best;
            self.third = self.second;
            self.second = Some(best);
            self.best = Some(sample);
            return;
        }
        *(if below { &mut self.low } else { &mut self.high }) = sample;
        if self.second.is_none_or(|second| sample.cost <= second.cost) {
            self.third = self.second;
            self.second = Some(sample);
        } else if self.third.is_none_or(|third| sample.cost <= third.cost) {
            self.third = Some(sample);
        }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    /// Searches between two ends; gives the best plane and the number of evaluations.
    fn minimise(
        f: impl Fn(f32) -> (f32, [u32; 2]),
        (low, high): (f32, f32),
        stop: Stop,
    ) -> (Option<Sample>, u32) {
        let sample = |position| {
            let (cost, counts) = f(position);
            Sample {
                position,
                cost,
                counts,
            }
        };
        let mut search = LineSearch::between(sample(low), sample(high), stop);
        let mut evaluations = 0;
        while let Some(position) = search.propose() {
            assert!(position > low && position < high);
            search.tell(sample(position));
            evaluations += 1;
        }
        (search.best(), evaluations)
    }

    /// A smooth function: no two samples have equal counts.
    fn smooth(f: impl Fn(f32) -> f32) -> impl Fn(f32) -> (f32, [u32; 2]) {
        move |x| (f(x), [x.to_bits(), 0])
    }

    const STOP: Stop = Stop {
        tolerance: 1e-4,
        budget: 60,
    };

    #[test]
    fn a_parabola_is_found_in_a_few_steps() {
        let (best, evaluations) = minimise(smooth(|x| (x - 0.7).powi(2)), (0.0, 2.0), STOP);
        assert!((best.unwrap().position - 0.7).abs() < 1e-3, "{best:?}");
        assert!(evaluations <= 12, "{evaluations}");
    }

    #[test]
    fn a_kink_takes_golden_section() {
        let (best, evaluations) = minimise(smooth(|x| (x - 0.3).abs()), (-1.0, 2.0), STOP);
        assert!((best.unwrap().position - 0.3).abs() < 5e-4, "{best:?}");
        // Golden section alone needs log(3 / 1e-4) / log(1.618) = 22 steps.
        assert!(evaluations <= 30, "{evaluations}");
    }

    #[test]
    fn a_plateau_ends_the_search_at_once() {
        let (best, evaluations) = minimise(|_| (1.0, [3, 3]), (0.0, 1.0), STOP);
        assert!(best.is_some());
        assert_eq!(evaluations, 1);
    }

    #[test]
    fn an_empty_bracket_has_no_minimum() {
        let (best, evaluations) = minimise(smooth(|x| x), (0.5, 0.5), STOP);
        assert_eq!((best, evaluations), (None, 0));
    }

    #[test]
    fn a_promise_is_kept_by_a_parabola() {
        let sample = |position: f32| Sample {
            position,
            cost: 2.0 * (position - 0.4).powi(2) + 3.0,
            counts: [0, 0],
        };
        let (low, best, high) = (sample(0.0), sample(0.5), sample(1.0));
        let search = LineSearch::around(low, best, high, STOP);
        assert!((search.promised_gain() - 0.02).abs() < 1e-5);
        let line = |position: f32| Sample {
            position,
            cost: position,
            counts: [0, 0],
        };
        let search = LineSearch::around(line(0.0), line(0.5), line(1.0), STOP);
        assert!(search.promised_gain().is_finite());
    }

    proptest! {
        /// Within bounds and budget on any step function, and never worse than what it has seen.
        #[test]
        fn steps_of_any_kind(
            steps in prop::collection::vec((0.0_f32..1.0, -3.0_f32..3.0), 0..40),
            tolerance in 1e-7_f32..0.3,
            budget in 0_u32..50,
        ) {
            let f = |x: f32| {
                let passed = steps.iter().filter(|(at, _)| *at < x);
                let cost = passed.clone().map(|(_, height)| height).sum::<f32>();
                (cost, [passed.count() as u32, 0])
            };
            let stop = Stop { tolerance, budget };
            let lowest = std::cell::Cell::new(f32::INFINITY);
            let watched = |x: f32| {
                let (cost, counts) = f(x);
                if x > 0.0 && x < 1.0 {
                    lowest.set(lowest.get().min(cost));
                }
                (cost, counts)
            };
            let (best, evaluations) = minimise(watched, (0.0, 1.0), stop);
            prop_assert!(evaluations <= budget);
            prop_assert_eq!(best.map_or(f32::INFINITY, |best| best.cost), lowest.get());
        }

        /// The only minimum of a function is found, wherever it is and however lopsided.
        #[test]
        fn a_single_minimum(at in 0.01_f32..0.99, left in 0.1_f32..10.0, right in 0.1_f32..10.0) {
            let f = smooth(|x: f32| if x < at { left * (at - x) } else { right * (x - at).powi(2) });
            let stop = Stop { tolerance: 1e-4, budget: 100 };
            let (best, _) = minimise(f, (0.0, 1.0), stop);
            let best = best.unwrap();
            prop_assert!((best.position - at).abs() < 0.01, "{best:?}");
            prop_assert!(best.cost < 1e-2, "{best:?}");
        }

        /// Anything may come back from an evaluation.
        #[test]
        fn not_a_number_ends_too(costs in prop::collection::vec(any::<f32>(), 60)) {
            let next = std::cell::Cell::new(0);
            let f = |_: f32| {
                next.set((next.get() + 1) % costs.len());
                (costs[next.get()], [next.get() as u32, 0])
            };
            let (_, evaluations) = minimise(f, (-1e30, 1e30), STOP);
            prop_assert!(evaluations <= STOP.budget);
        }
    }
}
