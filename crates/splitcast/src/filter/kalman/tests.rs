//! The Kalman filter against numbers worked out by hand, against `adskalman`, and against
//! its known fixed points.

use adskalman::{
    CovarianceUpdateMethod, KalmanFilterNoControl, ObservationModel, StateAndCovariance,
    TransitionModelLinearNoControl,
};
use nalgebra::{Matrix1, Vector1};
use proptest::prelude::*;

use super::*;
use crate::filter::NEW_COMPONENT;

fn filter(model: KalmanModel, initial: &[f32]) -> KalmanFilter {
    let mut filter = KalmanFilter::new(model, 0).expect("the model is valid");
    filter.load(initial);
    filter
}

fn assert_near(value: f32, expected: f64, tolerance: f64, what: &str) {
    let difference = (f64::from(value) - expected).abs();
    assert!(
        difference <= tolerance,
        "{what} is {value}, expected {expected}"
    );
}

#[test]
fn two_steps_by_hand() {
    let mut filter = KalmanFilter::new(KalmanModel::random_walk(1.0, 2.0), 1).unwrap();
    assert_eq!(
        (filter.state(), filter.covariance()),
        (&[0.0][..], &[0.0][..])
    );

    // P⁻ = 0 + 1, S = 1 + 2, K = 1/3, x = 0 + 3/3, P = 2/3 · 1.
    assert_eq!(filter.predict(), [0.0]);
    assert_eq!(filter.covariance(), [1.0]);
    filter.correct(&[3.0]);
    assert_eq!(filter.innovations(), [3.0]);
    assert_near(filter.gain()[0], 1.0 / 3.0, 1e-7, "first gain");
    assert_near(filter.state()[0], 1.0, 1e-7, "first state");
    assert_near(filter.covariance()[0], 2.0 / 3.0, 1e-7, "first covariance");

    // P⁻ = 5/3, S = 11/3, K = 5/11, x = 1 + 3 · 5/11, P = 6/11 · 5/3.
    assert_near(filter.predict()[0], 1.0, 1e-7, "second prediction");
    filter.correct(&[4.0]);
    assert_near(filter.gain()[0], 5.0 / 11.0, 1e-6, "second gain");
    assert_near(filter.state()[0], 26.0 / 11.0, 1e-6, "second state");
    assert_near(
        filter.covariance()[0],
        10.0 / 11.0,
        1e-6,
        "second covariance",
    );
    assert_near(filter.predictions()[0], 1.0, 1e-7, "kept prediction");
}

/// All five scalars of the model at once, in numbers that are exact in binary.
#[test]
fn full_model_by_hand() {
    let model = KalmanModel {
        transition: 2.0,
        control: 3.0,
        observation: 0.5,
        process_noise: 4.0,
        measurement_noise: 1.0,
    };
    let mut filter = filter(model, &[1.0]);
    // x⁻ = 2 · 1 + 3 · 1, P⁻ = 0 + 4.
    assert_eq!(filter.predict_with_control(&[1.0]), [5.0]);
    assert_eq!(filter.covariance(), [4.0]);
    // y = 4.5 − 0.5 · 5, S = 0.25 · 4 + 1, K = 4 · 0.5 / 2, x = 5 + 2, P = (1 − 0.5) · 4.
    filter.correct(&[4.5]);
    assert_eq!(filter.innovations(), [2.0]);
    assert_eq!(filter.gain(), [1.0]);
    assert_eq!(filter.state(), [7.0]);
    assert_eq!(filter.covariance(), [2.0]);
    // P⁻ = 2 · 2 · 2 + 4.
    assert_eq!(filter.predict(), [14.0]);
    assert_eq!(filter.covariance(), [12.0]);
}

#[test]
fn a_component_known_without_doubt_is_not_corrected() {
    let mut filter = filter(KalmanModel::random_walk(0.0, 0.0), &[1.0]);
    filter.predict();
    filter.correct(&[2.0]);
    assert_eq!(filter.gain(), [0.0]);
    assert_eq!(filter.innovations(), [1.0]);
    assert_eq!(filter.state(), [1.0]);
    assert_eq!(filter.covariance(), [0.0]);
}

#[test]
fn exact_observations_are_believed() {
    let mut filter = filter(KalmanModel::random_walk(0.5, 0.0), &[1.0]);
    filter.predict();
    filter.correct(&[2.0]);
    assert_eq!(filter.state(), [2.0]);
    assert_eq!(filter.covariance(), [0.0]);
}

#[test]
fn a_missing_observation_leaves_the_prediction() {
    let model = KalmanModel::random_walk(1.0, 2.0);
    let mut filter = filter(model, &[1.0, 1.0, 1.0]);
    filter.predict();
    filter.correct(&[f32::NAN, f32::INFINITY, 2.0]);
    assert_eq!(filter.state()[..2], [1.0, 1.0]);
    assert_eq!(filter.covariance()[..2], [1.0, 1.0]);
    assert_eq!(filter.gain()[..2], [0.0, 0.0]);
    assert_eq!(filter.innovations(), [0.0, 0.0, 1.0]);
    assert!(filter.state()[2] > 1.0);
    filter.predict();
    filter.correct(&[2.0, 2.0, 2.0]);
    assert_eq!(filter.gain()[0], 0.5);
}

#[test]
fn carried_over_components_keep_everything_and_new_ones_start_exact() {
    let mut filter = filter(KalmanModel::random_walk(1.0, 2.0), &[1.0, 2.0, 3.0]);
    filter.predict();
    filter.correct(&[1.5, 2.5, 3.5]);
    filter.predict();
    let (state, covariance) = (filter.state().to_vec(), filter.covariance().to_vec());
    filter.carry_over(&[2, NEW_COMPONENT, 0, 2], &[9.0; 4]);
    assert_eq!(filter.len(), 4);
    assert_eq!(filter.state(), [state[2], 9.0, state[0], state[2]]);
    assert_eq!(filter.predictions(), filter.state());
    let p = covariance[0];
    assert_eq!(filter.covariance(), [p, 0.0, p, p]);
    assert_eq!(filter.gain(), [0.0; 4]);
    assert_eq!(filter.innovations(), [0.0; 4]);
    filter.correct(&[9.0; 4]);
    assert_eq!(filter.state()[1], 9.0);
    filter.carry_over(&[], &[]);
    assert!(filter.is_empty());
    assert!(filter.predict().is_empty());
    filter.correct(&[]);
}

#[test]
#[should_panic(expected = "source 3 of component 1 is not below 3")]
fn a_source_out_of_range_panics() {
    filter(KalmanModel::random_walk(1.0, 1.0), &[0.0; 3]).carry_over(&[2, 3], &[0.0; 2]);
}

#[test]
#[should_panic(expected = "number of sources (left) and of initial positions (right) differ")]
fn sources_without_initial_positions_panic() {
    filter(KalmanModel::random_walk(1.0, 1.0), &[0.0; 3]).carry_over(&[2, 1], &[0.0; 3]);
}

#[test]
#[should_panic(expected = "number of observations (left) and of components (right) differ")]
fn a_wrong_number_of_observations_panics() {
    filter(KalmanModel::random_walk(1.0, 1.0), &[0.0; 3]).correct(&[0.0; 2]);
}

#[test]
#[should_panic(expected = "number of control inputs (left) and of components (right) differ")]
fn a_wrong_number_of_control_inputs_panics() {
    filter(KalmanModel::random_walk(1.0, 1.0), &[0.0; 3]).predict_with_control(&[0.0; 4]);
}

#[test]
fn models_out_of_bounds_are_refused_by_name() {
    let valid = KalmanModel::random_walk(1.0, 1.0);
    let with = |change: fn(&mut KalmanModel)| {
        let mut model = valid;
        change(&mut model);
        KalmanFilter::new(model, 1).unwrap_err().to_string()
    };
    assert!(with(|m| m.transition = f32::NAN).starts_with("transition of the Kalman model is NaN"));
    assert!(with(|m| m.control = f32::INFINITY).starts_with("control "));
    assert!(with(|m| m.observation = f32::NAN).starts_with("observation "));
    assert!(with(|m| m.observation = 0.0).ends_with("other than 0"));
    assert!(with(|m| m.process_noise = -1.0).starts_with("process_noise "));
    assert!(with(|m| m.measurement_noise = -1.0).ends_with("expected a variance of 0 or more"));
    assert!(with(|m| m.measurement_noise = f32::INFINITY).starts_with("measurement_noise "));
}

/// The scalar model in the form in which `adskalman` takes it.
struct Oracle {
    a: Matrix1<f64>,
    q: Matrix1<f64>,
    h: Matrix1<f64>,
    r: Matrix1<f64>,
}

impl Oracle {
    fn new(model: &KalmanModel) -> Self {
        let matrix = |value: f32| Matrix1::new(f64::from(value));
        Self {
            a: matrix(model.transition),
            q: matrix(model.process_noise),
            h: matrix(model.observation),
            r: matrix(model.measurement_noise),
        }
    }
}

#[allow(non_snake_case)]
impl TransitionModelLinearNoControl<f64, nalgebra::U1> for Oracle {
    fn F(&self) -> &Matrix1<f64> {
        &self.a
    }
    fn FT(&self) -> &Matrix1<f64> {
        &self.a
    }
    fn Q(&self) -> &Matrix1<f64> {
        &self.q
    }
}

#[allow(non_snake_case)]
impl ObservationModel<f64, nalgebra::U1, nalgebra::U1> for Oracle {
    fn H(&self) -> &Matrix1<f64> {
        &self.h
    }
    fn HT(&self) -> &Matrix1<f64> {
        &self.h
    }
    fn R(&self) -> &Matrix1<f64> {
        &self.r
    }
}

/// Models of sizes that occur: `adskalman` wants measurement noise above 0.
fn models() -> impl Strategy<Value = KalmanModel> {
    (
        -1.5f32..1.5,
        -2.0f32..2.0,
        prop_oneof![-4.0f32..-0.25, 0.25f32..4.0],
        prop_oneof![1 => Just(0.0f32), 4 => 1e-6f32..10.0],
        1e-6f32..10.0,
    )
        .prop_map(|(transition, control, observation, q, r)| KalmanModel {
            transition,
            control,
            observation,
            process_noise: q,
            measurement_noise: r,
        })
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(500))]

    #[test]
    fn agrees_with_adskalman(
        model in models(),
        initial in -10.0f32..10.0,
        frames in prop::collection::vec((-10.0f32..10.0, -1.0f32..1.0, any::<bool>()), 1..30),
    ) {
        let oracle = Oracle::new(&model);
        let other = KalmanFilterNoControl::new(&oracle, &oracle);
        let mut estimate = StateAndCovariance::new(
            Vector1::new(f64::from(initial)),
            Matrix1::new(0.0),
        );
        let mut filter = filter(model, &[initial]);
        // Rounding is relative to the largest number that went into the state.
        let mut scale = f64::from(initial).abs();
        for (z, u, controlled) in frames {
            if controlled {
                // Control only shifts the predicted mean, which `adskalman` lets us do.
                filter.predict_with_control(&[u]);
                let prior = oracle.predict(&estimate);
                let shift = f64::from(model.control) * f64::from(u);
                let prior = StateAndCovariance::new(
                    prior.state() + Vector1::new(shift),
                    *prior.covariance(),
                );
                let z = Vector1::new(f64::from(z));
                estimate = oracle
                    .update(&prior, &z, CovarianceUpdateMethod::JosephForm)
                    .expect("R is positive");
                scale = scale.max(shift.abs());
            } else {
                filter.predict();
                estimate = other
                    .step(&estimate, &Vector1::new(f64::from(z)))
                    .expect("R is positive");
            }
            filter.correct(&[z]);
            let (x, p) = (estimate.state()[0], estimate.covariance()[0]);
            scale = scale
                .max(x.abs())
                .max(f64::from(filter.predictions()[0]).abs())
                .max((f64::from(z) / f64::from(model.observation)).abs());
            assert_near(filter.state()[0], x, 1e-4 * scale, "state");
            assert_near(filter.covariance()[0], p, 1e-4 * p, "covariance");
        }
    }

    /// Over models of any size, the absurd included.
    #[test]
    fn covariance_and_gain_stay_in_their_bounds(
        exponents in prop::array::uniform4(-30.0f32..30.0),
        zeros in prop::array::uniform2(any::<bool>()),
        negative in any::<bool>(),
        observations in prop::collection::vec(-1e30f32..1e30, 20),
    ) {
        let [a, h, q, r] = exponents.map(|e| 10f32.powf(e));
        let model = KalmanModel {
            transition: if negative { -a } else { a },
            control: 0.0,
            observation: h,
            process_noise: if zeros[0] { 0.0 } else { q },
            measurement_noise: if zeros[1] { 0.0 } else { r },
        };
        let mut filter = filter(model, &[0.0]);
        for z in observations {
            filter.predict();
            prop_assert!(filter.covariance()[0] >= 0.0);
            let prior = filter.covariance()[0];
            filter.correct(&[z]);
            prop_assert!(filter.covariance()[0] >= 0.0 && filter.covariance()[0] <= prior);
            // Where H P H is a normal number the gain is as exact as single precision is.
            let hph = f64::from(h) * f64::from(h) * f64::from(prior);
            if hph > f64::from(f32::MIN_POSITIVE) && prior * h > f32::MIN_POSITIVE {
                let gain = f64::from(filter.gain()[0]) * f64::from(h);
                prop_assert!((0.0..1.000001).contains(&gain), "K H is {gain}");
            }
        }
    }

    /// With A and H any, the variance before a correction satisfies the Riccati equation
    /// `H² P⁻² + (R − A² R − H² Q) P⁻ − Q R = 0`, of which one root is positive.
    #[test]
    fn constant_signals_reach_the_riccati_fixed_point(
        transition in -1.2f32..1.2,
        observation in 0.25f32..4.0,
        process_noise in 0.01f32..10.0,
        measurement_noise in 0.01f32..10.0,
    ) {
        let model = KalmanModel {
            transition,
            control: 0.0,
            observation,
            process_noise,
            measurement_noise,
        };
        let mut filter = filter(model, &[0.0]);
        for _ in 0..2000 {
            filter.correct(&[5.0]);
            filter.predict();
        }
        let [a, h, q, r] = [transition, observation, process_noise, measurement_noise]
            .map(f64::from);
        let linear = r - a * a * r - h * h * q;
        let fixed = ((linear * linear + 4.0 * h * h * q * r).sqrt() - linear) / (2.0 * h * h);
        assert_near(filter.covariance()[0], fixed, 1e-4 * fixed, "P⁻");
        filter.correct(&[5.0]);
        let gain = fixed * h / (h * h * fixed + r);
        assert_near(filter.gain()[0], gain, 1e-4 * gain, "K");
        if transition == 1.0 {
            assert_near(filter.state()[0], 5.0 / h, 1e-4 * 5.0 / h, "x");
        }
    }

    /// A random walk that follows `z_k = v k` without noise lags behind. Let
    /// `e_k = z_k − x_k` be the error after correction. The error before it is
    /// `e_(k−1) + v`, and the correction leaves `1 − K` of that, so in the steady state
    /// `e = (1 − K)(e + v)`: `e = v (1 − K) / K`, and the innovation is `e + v = v / K`.
    #[test]
    fn linear_motion_is_followed_with_the_theoretical_lag(
        velocity in prop_oneof![-1.0f32..-0.01, 0.01f32..1.0],
        process_noise in 0.05f32..10.0,
        measurement_noise in 0.05f32..10.0,
    ) {
        let model = KalmanModel::random_walk(process_noise, measurement_noise);
        let mut filter = filter(model, &[0.0]);
        let mut position = 0.0;
        for frame in 1..=1000 {
            position = velocity * frame as f32;
            filter.predict();
            filter.correct(&[position]);
        }
        let gain = f64::from(filter.gain()[0]);
        let v = f64::from(velocity);
        // Positions reach 1000, where single precision is good to 6e-5.
        let tolerance = 1e-3 * (v / gain).abs() + 2e-3;
        assert_near(filter.innovations()[0], v / gain, tolerance, "innovation");
        let lag = v * (1.0 - gain) / gain;
        assert_near(position - filter.state()[0], lag, tolerance, "lag");
    }

    /// Any component gives the same bits alone, in company, and after the set was re-ordered.
    #[test]
    fn components_are_independent(
        model in models(),
        initial in prop::collection::vec(-10.0f32..10.0, 1..40),
        seeds in prop::collection::vec(-10.0f32..10.0, 40),
        swap in any::<prop::sample::Index>(),
    ) {
        let n = initial.len();
        let mut together = filter(model, &initial);
        let mut alone: Vec<_> = initial.iter().map(|&x| filter(model, &[x])).collect();
        // A rotation: component i of the new set is component order[i] of the old.
        let rotation: Vec<u32> = (0..n).map(|i| ((i + swap.index(n)) % n) as u32).collect();
        let mut order: Vec<usize> = (0..n).collect();
        for frame in 0..6 {
            together.predict();
            together.carry_over(&rotation, &vec![f32::NAN; n]);
            order = rotation.iter().map(|&i| order[i as usize]).collect();
            let seen: Vec<f32> = order.iter().map(|&i| seeds[(i + frame) % 40]).collect();
            together.correct(&seen);
            for (i, &original) in order.iter().enumerate() {
                alone[original].predict();
                alone[original].correct(&seen[i..=i]);
                prop_assert_eq!(alone[original].state(), &together.state()[i..=i]);
                prop_assert_eq!(alone[original].covariance(), &together.covariance()[i..=i]);
                prop_assert_eq!(alone[original].gain(), &together.gain()[i..=i]);
                prop_assert_eq!(alone[original].innovations(), &together.innovations()[i..=i]);
                prop_assert_eq!(alone[original].predictions(), &together.predictions()[i..=i]);
            }
        }
    }
}
