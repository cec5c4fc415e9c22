//! The vector Kalman filter (Kalman 1960; Welch & Bishop 2006; Hussain &
//! Grahn 2008, eq. 6 to 10), over components that are independent of each other.
//!
//! With a diagonal covariance the matrices of the paper fall apart into one
//! scalar filter a component:
//!
//! ```text
//! x⁻ = A x + B u              prediction                    (9)
//! P⁻ = A P A + Q
//! y  = z − H x⁻               innovation
//! S  = H P⁻ H + R             its covariance
//! K  = P⁻ H / S               gain
//! x  = x⁻ + K y               correction                    (10)
//! P  = (1 − K H) P⁻
//! ```
//!
//! Every operation stays within its component and is rounded once, in the
//! order written, so results depend neither on vector width nor on threads.

use super::{Predictor, check_count, check_sources, reindexed};

/// The linear model that all components share (Hussain & Grahn 2008, eq. 6
/// to 8).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct KalmanModel {
    /// A: how the state of one frame follows from the last. Finite; 1 for a
    /// random walk.
    pub transition: f32,
    /// B: how the control input moves the state. Finite; 0 for none.
    pub control: f32,
    /// H: what is observed of the state. Finite, not 0; 1 if it is observed directly.
    pub observation: f32,
    /// Q: variance that a frame adds to the state. Finite, 0 or more, in the
    /// square of the state's unit.
    pub process_noise: f32,
    /// R: variance of the observations. Finite, 0 or more, in the square of
    /// the observations' unit. 0 makes every correction believe its observation.
    pub measurement_noise: f32,
}

impl KalmanModel {
    /// The model of Algorithm 1 of Hussain & Grahn 2008: the state stays where it is but
    /// for noise, nothing controls it, and it is observed directly.
    pub const fn random_walk(process_noise: f32, measurement_noise: f32) -> Self {
        Self {
            transition: 1.0,
            control: 0.0,
            observation: 1.0,
            process_noise,
            measurement_noise,
        }
    }

    /// Checks every field against its bounds.
    ///
    /// # Errors
    /// [`ModelError`] names the first field that is out of bounds.
    pub fn validate(&self) -> Result<(), ModelError> {
        let fields = [
            ("transition", self.transition),
            ("control", self.control),
            ("observation", self.observation),
            ("process_noise", self.process_noise),
            ("measurement_noise", self.measurement_noise),
        ];
        for (field, value) in fields {
            if !value.is_finite() {
                return Err(ModelError::NotFinite { field, value });
            }
        }
        if self.observation == 0.0 {
            return Err(ModelError::NothingObserved);
        }
        for (field, value) in &fields[3..] {
            if *value < 0.0 {
                return Err(ModelError::NegativeVariance {
                    field,
                    value: *value,
                });
            }
        }
        Ok(())
    }
}

/// Which part of a [`KalmanModel`] is out of its bounds.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum ModelError {
    /// A field at NaN or infinity.
    #[error("{field} of the Kalman model is {value}, expected a finite number")]
    NotFinite {
        /// Name of the field.
        field: &'static str,
        /// Its value.
        value: f32,
    },
    /// An observation factor of 0, from which no state can be told.
    #[error("observation of the Kalman model is 0, expected a finite number other than 0")]
    NothingObserved,
    /// A variance below 0.
    #[error("{field} of the Kalman model is {value}, expected a variance of 0 or more")]
    NegativeVariance {
        /// Name of the field.
        field: &'static str,
        /// Its value.
        value: f32,
    },
}

/// A Kalman filter for each of many scalars, all of one model.
///
/// All slices that it returns hold one value a component.
#[derive(Clone, Debug)]
pub struct KalmanFilter {
    model: KalmanModel,
    state: Vec<f32>,
    covariance: Vec<f32>,
    predictions: Vec<f32>,
    gain: Vec<f32>,
    innovations: Vec<f32>,
}

impl KalmanFilter {
    /// A filter of `components` components with state and covariance 0, as
    /// Algorithm 1 is printed. [`Predictor::load`] gives it initial states.
    ///
    /// # Errors
    /// [`ModelError`] if the model is out of bounds.
    pub fn new(model: KalmanModel, components: usize) -> Result<Self, ModelError> {
        model.validate()?;
        let zeros = || vec![0.0; components];
        Ok(Self {
            model,
            state: zeros(),
            covariance: zeros(),
            predictions: zeros(),
            gain: zeros(),
            innovations: zeros(),
        })
    }

    /// [`Predictor::predict`] with the control input `u` of each component.
    ///
    /// # Panics
    /// If the number of inputs is not [`Predictor::len`].
    pub fn predict_with_control(&mut self, control: &[f32]) -> &[f32] {
        check_count("control inputs", control.len(), self.state.len());
        self.predict();
        let b = self.model.control;
        for (x, u) in self.state.iter_mut().zip(control) {
            *x += b * u;
        }
        self.predictions.copy_from_slice(&self.state);
        &self.predictions
    }

    /// The model that all components share.
    pub fn model(&self) -> &KalmanModel {
        &self.model
    }

    /// State x: corrected after [`Predictor::correct`], predicted after
    /// [`Predictor::predict`].
    pub fn state(&self) -> &[f32] {
        &self.state
    }

    /// Variance P of the state's error, 0 or more; as with the state, that of the last
    /// step taken. Infinite, and its component no more corrected, once it has left the
    /// range of single precision.
    pub fn covariance(&self) -> &[f32] {
        &self.covariance
    }

    /// What the last [`Predictor::predict`] returned, re-indexed since by
    /// [`Predictor::carry_over`]; the initial state where there was none.
    pub fn predictions(&self) -> &[f32] {
        &self.predictions
    }

    /// Gain K of the last [`Predictor::correct`], between 0 and 1/H up to
    /// rounding. 0 for a component known without doubt (S = 0), for a missing
    /// observation, and from [`Predictor::carry_over`] until the next correction.
    pub fn gain(&self) -> &[f32] {
        &self.gain
    }

    /// Innovations z − H x⁻ of the last [`Predictor::correct`]: how far the observations were
    /// from the predictions. 0 where the observation was missing, and
    /// from [`Predictor::carry_over`] until the next correction.
    pub fn innovations(&self) -> &[f32] {
        &self.innovations
    }

    /// Forgets gains and innovations, which belong to components that are no more.
    fn clear_correction(&mut self) {
        for values in [&mut self.gain, &mut self.innovations] {
            values.clear();
            values.resize(self.state.len(), 0.0);
        }
    }
}

impl Predictor for KalmanFilter {
    fn len(&self) -> usize {
        self.state.len()
    }

    /// The state becomes `initial`, the covariance 0.
    fn load(&mut self, initial: &[f32]) {
        self.state = initial.to_vec();
        self.predictions = initial.to_vec();
        self.covariance = vec![0.0; initial.len()];
        self.clear_correction();
    }

    /// Without control input. Further calls before a correction predict further frames
    /// ahead.
    fn predict(&mut self) -> &[f32] {
        let (a, q) = (self.model.transition, self.model.process_noise);
        for (x, p) in self.state.iter_mut().zip(&mut self.covariance) {
            *x *= a;
            *p = a * *p * a + q;
        }
        self.predictions.copy_from_slice(&self.state);
        &self.predictions
    }

    /// New components start with covariance 0.
    fn carry_over(&mut self, sources: &[u32], initial: &[f32]) {
        check_sources(sources, initial, self.state.len());
        self.state = reindexed(&self.state, sources, |i| initial[i]);
        self.predictions = reindexed(&self.predictions, sources, |i| initial[i]);
        self.covariance = reindexed(&self.covariance, sources, |_| 0.0);
        self.clear_correction();
    }

    fn correct(&mut self, observations: &[f32]) {
        let n = self.state.len();
        check_count("observations", observations.len(), n);
        let (h, r) = (self.model.observation, self.model.measurement_noise);
        // Slices of one length, so that the loop is free of bounds checks and vectorised.
        let (state, covariance) = (&mut self.state[..n], &mut self.covariance[..n]);
        let (gain, innovations) = (&mut self.gain[..n], &mut self.innovations[..n]);
        let observations = &observations[..n];
        for i in 0..n {
            let p = covariance[i];
            let y = observations[i] - h * state[i];
            let s = h * p * h + r;
            let observed = y.abs() < f32::INFINITY;
            let weighed = observed & (s > 0.0) & (s < f32::INFINITY);
            let k = if weighed { p * h / s } else { 0.0 };
            // 1 − K H = R / S, which cannot come out below 0 as the difference can.
            let kept = if weighed { r / s } else { 1.0 };
            let y = if observed { y } else { 0.0 };
            state[i] += k * y;
            covariance[i] = kept * p;
            gain[i] = k;
            innovations[i] = y;
        }
    }
}

#[cfg(test)]
mod tests;
