//! A Wiener predictor of finite impulse response (Wiener 1949).
//!
//! Hussain & Grahn followed their Kalman filter up with a Wiener filter as a
//! second predictor (ISVC 2008). We know their abstract only; what
//! stands here is the textbook's one-step linear predictor, put on displacements so that a
//! plane at rest needs nothing learned:
//!
//! ```text
//! prediction = s_(k−1) + Σ w_j d_(k−j),   d_k = s_k − s_(k−1),   j = 1 … M
//! ```
//!
//! All components share the weights w. They minimise the squared error of the
//! predicted displacement, which is to say that they solve the Wiener–Hopf equations
//!
//! ```text
//! (R + noise · r̄ I) w = p,   R_ij = Σ d_(k−i) d_(k−j),   p_j = Σ d_k d_(k−j)
//! ```
//!
//! where r̄ is the mean of R's diagonal and the sums run over all components that
//! know M + 1 displacements and over all frames so far, a frame's share
//! shrinking by the forgetting factor with every later one.
//!
//! Sums are formed in double precision in a fixed order, so weights depend
//! neither on vector width nor on threads.

use super::{Predictor, check_count, check_sources, reindexed};

/// Highest order that is accepted.
const MAX_ORDER: usize = 8;

/// Partial sums of a correlation, enough for the widest vectors.
const LANES: usize = 8;

/// Share of a lag's power below which what the earlier lags do not explain of it is taken
/// for rounding: positions are rounded to 2⁻²⁴, and moderate displacements so to about
/// 1e-5, the square of which this is.
const DEPENDENT: f64 = 1e-10;

/// Power below which there is no motion to learn from. The square of the smallest
/// single-precision displacement is about 1e-90; below it stands only what was forgotten.
const NO_POWER: f64 = 1e-200;

/// Parameters of a [`WienerPredictor`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct WienerParameters {
    /// M: number of past displacements that a prediction is made from, 1 to 8. 1
    /// scales the last displacement, 2 can follow an oscillation, more average noise away.
    /// A component is learned from once it has been seen in M + 2 frames.
    pub order: usize,
    /// Factor by which a frame's share in the correlations shrinks with every
    /// later frame, 0 to 1: about 1 / (1 − forgetting) frames count. 0 learns from the last
    /// frame only, 1 forgets nothing.
    pub forgetting: f32,
    /// Power of the noise relative to that of the displacements, 0 to 1. Higher values
    /// pull the weights toward 0, that is, predictions toward the last position.
    pub noise: f32,
}

impl Default for WienerParameters {
    fn default() -> Self {
        Self {
            order: 3,
            forgetting: 0.9,
            noise: 1e-6,
        }
    }
}

impl WienerParameters {
    /// Checks every field against its bounds.
    ///
    /// # Errors
    /// [`WienerError`] names the first field that is out of bounds.
    pub fn validate(&self) -> Result<(), WienerError> {
        if !(1..=MAX_ORDER).contains(&self.order) {
            return Err(WienerError::Order { value: self.order });
        }
        for (field, value) in [("forgetting", self.forgetting), ("noise", self.noise)] {
            if !(0.0..=1.0).contains(&value) {
                return Err(WienerError::OutOfRange { field, value });
            }
        }
        Ok(())
    }
}

/// Which of the [`WienerParameters`] is out of its bounds.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum WienerError {
    /// An order outside 1 to 8.
    #[error("order of the Wiener predictor is {value}, expected 1 to {MAX_ORDER}")]
    Order {
        /// Its value.
        value: usize,
    },
    /// A factor outside 0 to 1.
    #[error("{field} of the Wiener predictor is {value}, expected 0 to 1")]
    OutOfRange {
        /// Name of the field.
        field: &'static str,
        /// Its value.
        value: f32,
    },
}

/// A linear predictor of many scalars that learns its weights from their motion.
///
/// Components without history, and all of them until there is something to
/// learn from, are predicted at their last position.
#[derive(Clone, Debug)]
pub struct WienerPredictor {
    forgetting: f64,
    noise: f64,
    positions: Vec<f32>,
    /// Row 0 holds every component's newest displacement, row `order` the oldest that is
    /// kept; 0 where a component has none. Always finite.
    displacements: Vec<Vec<f32>>,
    /// Number of displacements that each component knows, at most the number of rows.
    known: Vec<u8>,
    predictions: Vec<f32>,
    correlations: Correlations,
    weights: Vec<f32>,
}

impl WienerPredictor {
    /// A predictor of `components` components at position 0, with weights 0.
    /// [`Predictor::load`] gives it initial positions.
    ///
    /// # Errors
    /// [`WienerError`] if a parameter is out of bounds.
    pub fn new(parameters: WienerParameters, components: usize) -> Result<Self, WienerError> {
        parameters.validate()?;
        let order = parameters.order;
        Ok(Self {
            forgetting: parameters.forgetting.into(),
            noise: parameters.noise.into(),
            positions: vec![0.0; components],
            displacements: vec![vec![0.0; components]; order + 1],
            known: vec![0; components],
            predictions: vec![0.0; components],
            correlations: Correlations::default(),
            weights: vec![0.0; order],
        })
    }

    /// The weights w, that of the newest displacement first; as many as the order.
    pub fn weights(&self) -> &[f32] {
        &self.weights
    }

    /// Last position of each component.
    pub fn positions(&self) -> &[f32] {
        &self.positions
    }

    /// What the last [`Predictor::predict`] returned, re-indexed since by
    /// [`Predictor::carry_over`]; the initial positions where there was none.
    pub fn predictions(&self) -> &[f32] {
        &self.predictions
    }

    /// Enters the step to each observation as the newest displacement.
    fn advance(&mut self, observations: &[f32]) {
        self.displacements.rotate_right(1);
        let rows = self.displacements.len();
        for (i, &z) in observations.iter().enumerate() {
            let z = if z.is_finite() {
                z
            } else {
                self.predictions[i]
            };
            let step = z - self.positions[i];
            self.positions[i] = z;
            if step.is_finite() {
                self.displacements[0][i] = step;
                self.known[i] = (self.known[i] + 1).min(rows as u8);
            } else {
                // Too far for single precision: the component starts anew.
                for row in &mut self.displacements {
                    row[i] = 0.0;
                }
                self.known[i] = 0;
            }
        }
    }
}

impl Predictor for WienerPredictor {
    fn len(&self) -> usize {
        self.positions.len()
    }

    /// All displacements are forgotten; the weights stay.
    fn load(&mut self, initial: &[f32]) {
        self.positions = initial.to_vec();
        self.predictions = initial.to_vec();
        self.known = vec![0; initial.len()];
        for row in &mut self.displacements {
            *row = vec![0.0; initial.len()];
        }
    }

    /// Further calls before a correction return the same.
    fn predict(&mut self) -> &[f32] {
        self.predictions.fill(0.0);
        for (&weight, row) in self.weights.iter().zip(&self.displacements) {
            for (sum, displacement) in self.predictions.iter_mut().zip(row) {
                *sum += weight * displacement;
            }
        }
        for (prediction, &position) in self.predictions.iter_mut().zip(&self.positions) {
            let moved = position + *prediction;
            let finite = moved.abs() < f32::INFINITY;
            *prediction = if finite { moved } else { position };
        }
        &self.predictions
    }

    /// New components start without displacements; the weights stay.
    fn carry_over(&mut self, sources: &[u32], initial: &[f32]) {
        check_sources(sources, initial, self.positions.len());
        self.positions = reindexed(&self.positions, sources, |i| initial[i]);
        self.predictions = reindexed(&self.predictions, sources, |i| initial[i]);
        self.known = reindexed(&self.known, sources, |_| 0);
        for row in &mut self.displacements {
            *row = reindexed(row, sources, |_| 0.0);
        }
    }

    fn correct(&mut self, observations: &[f32]) {
        check_count("observations", observations.len(), self.positions.len());
        self.advance(observations);
        self.correlations
            .learn(&self.displacements, &self.known, self.forgetting);
        self.weights = self.correlations.weights(self.weights.len(), self.noise);
    }
}

/// R and p of the Wiener–Hopf equations; only the first `order` rows and
/// columns are used, and of R the lower triangle.
#[derive(Clone, Debug, Default)]
struct Correlations {
    auto: [[f64; MAX_ORDER]; MAX_ORDER],
    cross: [f64; MAX_ORDER],
}

impl Correlations {
    /// Forgets a little and adds the newest frame, over components that know all `rows`: row
    /// 0 is what was to be predicted, the others what it was to be predicted from.
    fn learn(&mut self, rows: &[Vec<f32>], known: &[u8], forgetting: f64) {
        let complete = rows.len() as u8;
        let (target, lags) = rows.split_first().expect("there is at least one row");
        for (i, lag) in lags.iter().enumerate() {
            // 0 for components that do not know all rows, so that they add nothing.
            let counted: Vec<f32> = lag
                .iter()
                .zip(known)
                .map(|(&d, &k)| if k == complete { d } else { 0.0 })
                .collect();
            for (j, other) in lags[..=i].iter().enumerate() {
                let sum = &mut self.auto[i][j];
                *sum = forgetting * *sum + dot(&counted, other);
            }
            let sum = &mut self.cross[i];
            *sum = forgetting * *sum + dot(&counted, target);
        }
    }

    /// Solves for the weights; all 0 where nothing moves.
    fn weights(&self, order: usize, noise: f64) -> Vec<f32> {
        let power: f64 = (0..order).map(|i| self.auto[i][i]).sum();
        let still = vec![0.0; order];
        if power < NO_POWER {
            return still;
        }
        let mut matrix = self.auto;
        for i in 0..order {
            matrix[i][i] += noise * power / order as f64;
        }
        let solution = solve_semidefinite(&matrix, &self.cross, order);
        let weights: Vec<f32> = solution[..order].iter().map(|&w| w as f32).collect();
        if weights.iter().all(|w| w.is_finite()) {
            weights
        } else {
            still
        }
    }
}

/// Dot product in double precision, summed in [`LANES`] partial sums.
fn dot(a: &[f32], b: &[f32]) -> f64 {
    let mut sums = [0.0; LANES];
    let (a, b) = (a.chunks_exact(LANES), b.chunks_exact(LANES));
    let (a_rest, b_rest) = (a.remainder(), b.remainder());
    for (a, b) in a.zip(b) {
        for lane in 0..LANES {
            sums[lane] += f64::from(a[lane]) * f64::from(b[lane]);
        }
    }
    for (lane, (&a, &b)) in a_rest.iter().zip(b_rest).enumerate() {
        sums[lane] += f64::from(a) * f64::from(b);
    }
    sums.iter().sum()
}

/// Solves A x = b by A = L D Lᵀ, for a symmetric positive semidefinite A of
/// which the lower triangle of the first `n` rows is given. An unknown whose
/// pivot vanishes is determined by the ones before it; it is set to 0, which leaves
/// the system without it.
fn solve_semidefinite(
    a: &[[f64; MAX_ORDER]; MAX_ORDER],
    b: &[f64; MAX_ORDER],
    n: usize,
) -> [f64; MAX_ORDER] {
    let mut l = [[0.0; MAX_ORDER]; MAX_ORDER];
    let mut pivots = [0.0; MAX_ORDER];
    let mut x = [0.0; MAX_ORDER];
    for j in 0..n {
        let explained = |i: usize| (0..j).map(|k| l[i][k] * l[j][k] * pivots[k]).sum::<f64>();
        let pivot = a[j][j] - explained(j);
        if pivot <= DEPENDENT * a[j][j] {
            continue;
        }
        let mut column = [0.0; MAX_ORDER];
        for i in j + 1..n {
            column[i] = (a[i][j] - explained(i)) / pivot;
        }
        pivots[j] = pivot;
        for i in j + 1..n {
            l[i][j] = column[i];
        }
    }
    // L y = b, with y in place of x.
    for j in 0..n {
        x[j] = b[j] - (0..j).map(|k| l[j][k] * x[k]).sum::<f64>();
    }
    // Lᵀ x = D⁻¹ y, from the last row up.
    for j in (0..n).rev() {
        x[j] = if pivots[j] > 0.0 {
            x[j] / pivots[j] - (j + 1..n).map(|i| l[i][j] * x[i]).sum::<f64>()
        } else {
            0.0
        };
    }
    x
}

#[cfg(test)]
mod tests;
