//! Noise of the model and virtual observations (Hussain & Grahn 2008,
//! Algorithm 1).
//!
//! The algorithm is printed as
//!
//! ```text
//! Q = Std[s − s·p(w)]²
//! R = Std[s − s·p(v)]²
//! z = s + p(v)·s
//! ```
//!
//! with s the vector of initial split positions. We read p(w) and p(v) as
//! draws from N(0, σ_w²) and N(0, σ_v²), a new one for each component, and Std
//! as the sample's standard deviation (divided by N − 1). Then Q and R
//! are about the variance of the positions themselves when both σ are small: with
//! σ = 0 they are equal to it, and the filter's gain settles near 0.618.

use rand::SeedableRng;
use rand::rngs::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

use super::KalmanModel;

/// Largest standard deviation that is accepted: ten times the position itself.
const MAX_SIGMA: f32 = 10.0;

/// Strength of the noise in Algorithm 1, relative to the positions.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NoiseParameters {
    /// σ_w: standard deviation of p(w), which enters the process noise. 0 to 10.
    pub process: f32,
    /// σ_v: standard deviation of p(v), which enters the measurement noise and
    /// the virtual observations. 0 to 10. Higher values make the
    /// observations worse; 0 makes them exact.
    pub measurement: f32,
    /// Where the random numbers start. Any value; the same one gives the same numbers.
    pub seed: u64,
}

impl Default for NoiseParameters {
    /// Strong process noise, so that the filter follows its observations (gain
    /// 0.96), and observations within about a thousandth of their position:
    /// what tracked best on the built-in scenes.
    fn default() -> Self {
        Self {
            process: 5.0,
            measurement: 0.001,
            seed: 0,
        }
    }
}

impl NoiseParameters {
    /// Checks both standard deviations against their bounds.
    ///
    /// # Errors
    /// [`NoiseError::OutOfRange`] names the first that is out of bounds.
    pub fn validate(&self) -> Result<(), NoiseError> {
        for (field, value) in [
            ("noise.process", self.process),
            ("noise.measurement", self.measurement),
        ] {
            if !(0.0..=MAX_SIGMA).contains(&value) {
                return Err(NoiseError::OutOfRange { field, value });
            }
        }
        Ok(())
    }

    /// The model of Algorithm 1 (A = 1, B = 0, H = 1), with Q and R from the
    /// spread of `initial`, the positions in the first frame. Both are 0 for fewer than two
    /// positions.
    ///
    /// # Errors
    /// [`NoiseError`] if a parameter is out of bounds or a variance is not
    /// finite in single precision.
    pub fn kalman_model(&self, initial: &[f32]) -> Result<KalmanModel, NoiseError> {
        self.validate()?;
        let variance = |noise, draws, sigma: f32| {
            let sigma = f64::from(sigma);
            let residuals: Vec<f64> = initial
                .iter()
                .zip(normal_draws(self.seed, draws, 0))
                .map(|(&s, draw)| f64::from(s) * (1.0 - sigma * f64::from(draw)))
                .collect();
            let value = sample_variance(&residuals);
            if (value as f32).is_finite() {
                Ok(value as f32)
            } else {
                Err(NoiseError::VarianceNotFinite { noise, value })
            }
        };
        Ok(KalmanModel::random_walk(
            variance("process", Draws::Process, self.process)?,
            variance("measurement", Draws::Measurement, self.measurement)?,
        ))
    }
}

/// Why noise parameters do not make a model.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum NoiseError {
    /// A standard deviation out of its bounds.
    #[error("{field} is {value}, expected a standard deviation from 0 to {MAX_SIGMA}")]
    OutOfRange {
        /// Path of the field, as in `noise.process`.
        field: &'static str,
        /// Its value.
        value: f32,
    },
    /// Positions that are not finite, or too far apart for single precision.
    #[error(
        "the {noise} noise has variance {value}, expected one that is finite in single \
         precision: positions must be finite and within ±1e18"
    )]
    VarianceNotFinite {
        /// `process` or `measurement`.
        noise: &'static str,
        /// The variance.
        value: f64,
    },
}

/// Observations z = s + p(v)·s made up from known positions, as in Algorithm 1.
#[derive(Clone, Debug)]
pub struct VirtualObservations {
    noise: NoiseParameters,
    values: Vec<f32>,
}

impl VirtualObservations {
    /// A generator with the noise `noise.measurement`, from `noise.seed`.
    ///
    /// # Errors
    /// [`NoiseError::OutOfRange`] if a parameter is out of bounds.
    pub fn new(noise: NoiseParameters) -> Result<Self, NoiseError> {
        noise.validate()?;
        Ok(Self {
            noise,
            values: Vec::new(),
        })
    }

    /// One observation for each of the true `positions`. The draw for a component depends on
    /// the seed, the number of the frame and the component's index only, not on earlier
    /// calls; the draws of different frames are independent of each other.
    pub fn observe(&mut self, frame: u64, positions: &[f32]) -> &[f32] {
        let sigma = self.noise.measurement;
        let draws = normal_draws(self.noise.seed, Draws::Observation, frame);
        let observed = positions
            .iter()
            .zip(draws)
            .map(|(&s, draw)| s + sigma * draw * s);
        self.values.clear();
        self.values.extend(observed);
        &self.values
    }

    /// What [`VirtualObservations::observe`] returned last; nothing before its first call.
    pub fn last(&self) -> &[f32] {
        &self.values
    }
}

/// What random numbers are used for; each use has its own.
#[derive(Clone, Copy)]
enum Draws {
    Process = 0,
    Measurement = 1,
    Observation = 2,
}

/// Draws from N(0, 1) without end. Seed and use make the key of the generator and the
/// frame its stream, so that no two of them share numbers.
fn normal_draws(seed: u64, draws: Draws, frame: u64) -> impl Iterator<Item = f32> {
    let mut key = [0; 32];
    key[..8].copy_from_slice(&seed.to_le_bytes());
    key[8] = draws as u8;
    let mut generator = ChaCha8Rng::from_seed(key);
    generator.set_stream(frame);
    StandardNormal.sample_iter(generator)
}

/// Variance of a sample, in two passes; 0 for fewer than two values.
fn sample_variance(values: &[f64]) -> f64 {
    let count = values.len();
    if count < 2 {
        return 0.0;
    }
    let mean = values.iter().sum::<f64>() / count as f64;
    let squares: f64 = values.iter().map(|v| (v - mean) * (v - mean)).sum();
    squares / (count - 1) as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    fn observer(measurement: f32, seed: u64) -> VirtualObservations {
        let noise = NoiseParameters {
            process: 0.0,
            measurement,
            seed,
        };
        VirtualObservations::new(noise).expect("the parameters are valid")
    }

    #[test]
    fn observations_depend_on_seed_frame_and_index_only() {
        let positions = [1.0f32; 1000];
        let first = observer(0.5, 7).observe(3, &positions).to_vec();
        let mut other = observer(0.5, 7);
        other.observe(9, &positions[..10]);
        assert_eq!(other.observe(3, &positions), first);
        assert_eq!(other.observe(3, &positions[..400]), &first[..400]);
        let same = |a: &[f32], b: &[f32]| a.iter().zip(b).filter(|(a, b)| a == b).count();
        assert!(same(other.observe(4, &positions), &first) < 5);
        assert!(same(observer(0.5, 8).observe(3, &positions), &first) < 5);
    }

    /// A change of these numbers changes every recorded run.
    #[test]
    fn draws_are_stable() {
        let draws: Vec<f32> = normal_draws(1, Draws::Observation, 2).take(4).collect();
        assert_eq!(draws, [0.629665, 2.116984, -1.9633541, 0.52751493]);
    }

    #[test]
    fn draws_are_normal_and_frames_uncorrelated() {
        let n = 100_000;
        let frame = |k| -> Vec<f64> {
            let draws = normal_draws(5, Draws::Observation, k).take(n);
            draws.map(f64::from).collect()
        };
        let (a, b) = (frame(0), frame(1));
        let mean = |values: &mut dyn Iterator<Item = f64>| values.sum::<f64>() / n as f64;
        // Bounds of five standard errors: 1, √2, √15 and √96 over √n.
        assert!(mean(&mut a.iter().copied()).abs() < 0.016);
        assert!((sample_variance(&a) - 1.0).abs() < 0.023);
        assert!(mean(&mut a.iter().map(|d| d.powi(3))).abs() < 0.062);
        assert!((mean(&mut a.iter().map(|d| d.powi(4))) - 3.0).abs() < 0.16);
        assert!(mean(&mut a.iter().zip(&b).map(|(a, b)| a * b)).abs() < 0.016);
        let within = a.iter().filter(|d| d.abs() < 1.959964).count() as f64 / n as f64;
        assert!((within - 0.95).abs() < 0.0035);
    }

    #[test]
    fn observations_scale_with_position_and_sigma() {
        let positions: Vec<f32> = (0..50_000)
            .map(|i| if i % 2 == 0 { 1.0 } else { -4.0 })
            .collect();
        let observed = observer(0.1, 0).observe(0, &positions).to_vec();
        let errors = |s: f32| -> Vec<f64> {
            let pairs = positions.iter().zip(&observed);
            pairs
                .filter(|&(&p, _)| p == s)
                .map(|(p, z)| f64::from(z - p))
                .collect()
        };
        for (s, sigma) in [(1.0, 0.1), (-4.0, 0.4)] {
            let found = sample_variance(&errors(s)).sqrt();
            assert!((found - sigma).abs() < 0.02 * sigma, "{found} for {sigma}");
        }
        assert_eq!(observer(0.0, 0).observe(0, &positions), positions);
    }

    /// Var(s − s·p) = Var(s) + σ² E(s²) for p from N(0, σ²) that knows nothing of s.
    #[test]
    fn the_model_has_the_variances_of_algorithm_1() {
        let positions: Vec<f32> = (0..100_000)
            .map(|i| 2.0 + (i % 101) as f32 * 0.01)
            .collect();
        let exact: Vec<f64> = positions.iter().map(|&s| s.into()).collect();
        let spread = sample_variance(&exact);
        let square = exact.iter().map(|s| s * s).sum::<f64>() / exact.len() as f64;
        let noise = NoiseParameters {
            process: 0.0,
            measurement: 0.5,
            seed: 3,
        };
        let model = noise.kalman_model(&positions).unwrap();
        assert_eq!(model.process_noise, spread as f32);
        let expected = spread + 0.25 * square;
        let found = f64::from(model.measurement_noise);
        assert!(
            (found - expected).abs() < 0.03 * expected,
            "{found} for {expected}"
        );
        let (q, r) = (model.process_noise, model.measurement_noise);
        assert_eq!(model, KalmanModel::random_walk(q, r));
        assert_eq!(noise.kalman_model(&positions), Ok(model));

        // The two draws differ, though their strengths be the same.
        let even = NoiseParameters {
            process: 0.5,
            ..noise
        };
        let even = even.kalman_model(&positions).unwrap();
        assert_ne!(even.process_noise, even.measurement_noise);
        assert_eq!(even.measurement_noise, r);
    }

    #[test]
    fn few_or_equal_positions_have_no_variance() {
        let still = KalmanModel::random_walk(0.0, 0.0);
        let noise = NoiseParameters {
            process: 0.0,
            measurement: 0.0,
            seed: 0,
        };
        for positions in [&[][..], &[3.0], &[0.25; 9]] {
            assert_eq!(noise.kalman_model(positions), Ok(still));
        }
        let noise = NoiseParameters {
            measurement: 0.001,
            ..noise
        };
        assert_eq!(noise.kalman_model(&[3.0]), Ok(still));
        let model = noise.kalman_model(&[0.25; 9]).unwrap();
        assert!(model.process_noise == 0.0 && model.measurement_noise > 0.0);
        assert!(
            VirtualObservations::new(noise)
                .unwrap()
                .observe(0, &[])
                .is_empty()
        );
    }

    #[test]
    fn what_is_out_of_bounds_is_refused_by_name() {
        let default = NoiseParameters::default();
        assert_eq!(default.validate(), Ok(()));
        for value in [-0.5, 10.5, f32::NAN, f32::INFINITY] {
            let process = NoiseParameters {
                process: value,
                ..default
            };
            let message = process.kalman_model(&[]).unwrap_err().to_string();
            let expected = "expected a standard deviation from 0 to 10";
            assert_eq!(message, format!("noise.process is {value}, {expected}"));
            let measurement = NoiseParameters {
                measurement: value,
                ..default
            };
            let message = VirtualObservations::new(measurement)
                .unwrap_err()
                .to_string();
            assert_eq!(message, format!("noise.measurement is {value}, {expected}"));
        }
        for position in [f32::NAN, f32::INFINITY, 1e30] {
            let error = default.kalman_model(&[0.0, position]).unwrap_err();
            assert!(
                error
                    .to_string()
                    .starts_with("the process noise has variance ")
            );
        }
    }
}
