//! The Wiener predictor on motions of which the best weights are known.

use proptest::prelude::*;
use rand::SeedableRng;
use rand::rngs::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

use super::*;
use crate::filter::NEW_COMPONENT;

fn predictor(order: usize, forgetting: f32, noise: f32, initial: &[f32]) -> WienerPredictor {
    let parameters = WienerParameters {
        order,
        forgetting,
        noise,
    };
    let mut predictor = WienerPredictor::new(parameters, 0).expect("the parameters are valid");
    predictor.load(initial);
    predictor
}

/// Weights learned from displacements `d_k = Σ a_j d_(k−j) + e_k` with e from N(0, 1), seen by
/// 200 components over 200 frames.
fn learned(process: &[f32], noise: f32) -> Vec<f32> {
    let components = 200;
    let mut draws = StandardNormal.sample_iter(ChaCha8Rng::seed_from_u64(1));
    let mut positions = vec![0.0f32; components];
    let mut displacements = vec![vec![0.0f32; components]; process.len()];
    let mut predictor = predictor(process.len(), 1.0, noise, &positions);
    for _ in 0..200 {
        for i in 0..components {
            let draw: f32 = draws.next().expect("draws do not end");
            let lags = displacements.iter().map(|row| row[i]);
            let expected: f32 = lags.zip(process).map(|(d, a)| d * a).sum();
            let step = expected + draw;
            displacements
                .iter_mut()
                .fold(step, |newer, row| std::mem::replace(&mut row[i], newer));
            positions[i] += step;
        }
        predictor.predict();
        predictor.correct(&positions);
    }
    predictor.weights().to_vec()
}

#[test]
fn constant_velocity_is_learned_exactly() {
    for order in 1..=MAX_ORDER {
        let mut predictor = predictor(order, 0.9, 0.0, &[0.0, 8.0]);
        for frame in 1..20 {
            let positions = [0.5 * frame as f32, 8.0 - 0.25 * frame as f32];
            let predicted = predictor.predict().to_vec();
            if frame > order + 2 {
                // Equal lags determine each other: the newest one gets all the weight.
                let mut weights = vec![0.0; order];
                weights[0] = 1.0;
                assert_eq!(predictor.weights(), weights);
                assert_eq!(predicted, positions);
            }
            predictor.correct(&positions);
        }
    }
}

#[test]
fn constant_velocity_is_shared_out_between_lags_under_noise() {
    let mut predictor = WienerPredictor::new(WienerParameters::default(), 1).unwrap();
    for frame in 1..20 {
        predictor.predict();
        predictor.correct(&[0.5 * frame as f32]);
    }
    for &weight in predictor.weights() {
        assert!((weight - 1.0 / 3.0).abs() < 1e-5, "weight {weight}");
    }
    assert!((predictor.predict()[0] - 10.0).abs() < 1e-5);
}

/// With one lag and constant velocity, `(R + noise R) w = R`.
#[test]
fn noise_pulls_the_weight_toward_zero() {
    for noise in [0.0, 0.25, 1.0] {
        let mut predictor = predictor(1, 0.9, noise, &[0.0]);
        for frame in 1..10 {
            predictor.correct(&[frame as f32]);
        }
        let expected = 1.0 / (1.0 + noise);
        assert!((predictor.weights()[0] - expected).abs() < 1e-6);
    }
}

/// `sin(ω k)` has displacements with `d_k = 2 cos(ω) d_(k−1) − d_(k−2)`, whatever the phase.
#[test]
fn an_oscillation_is_followed_with_two_lags() {
    let omega = 0.4f64;
    let at = |frame: usize, phase: f64| (omega * frame as f64 + phase).sin() as f32;
    let positions = |frame| [at(frame, 0.0), at(frame, 1.0), at(frame, 2.5)];
    let mut predictor = predictor(2, 0.9, 0.0, &positions(0));
    for frame in 1..40 {
        let (predicted, seen) = (predictor.predict().to_vec(), positions(frame));
        if frame > 10 {
            for (p, z) in predicted.iter().zip(seen) {
                assert!((p - z).abs() < 1e-5, "predicted {p}, seen {z}");
            }
        }
        predictor.correct(&seen);
    }
    let weights = predictor.weights();
    assert!((f64::from(weights[0]) - 2.0 * omega.cos()).abs() < 1e-4);
    assert!((weights[1] + 1.0).abs() < 1e-4);
}

/// 40,000 samples: a standard error of about 0.005 and less a weight.
#[test]
fn weights_of_autoregressive_motion_are_found() {
    for process in [
        &[0.7][..],
        &[-0.5],
        &[0.5, 0.3],
        &[1.2, -0.5],
        &[0.4, 0.0, 0.3],
    ] {
        let weights = learned(process, 0.0);
        for (weight, expected) in weights.iter().zip(process) {
            assert!(
                (weight - expected).abs() < 0.025,
                "learned {weights:?} from {process:?}"
            );
        }
    }
}

#[test]
fn old_motion_is_forgotten() {
    let mut predictor = predictor(1, 0.5, 0.0, &[0.0]);
    let mut position = 0.0;
    let mut turn = |factor: f32, frames: usize, predictor: &mut WienerPredictor| {
        let mut step = 1.0;
        for _ in 0..frames {
            step *= factor;
            position += step;
            predictor.correct(&[position]);
        }
        predictor.weights()[0]
    };
    assert!((turn(1.0, 20, &mut predictor) - 1.0).abs() < 1e-6);
    assert!((turn(-1.0, 30, &mut predictor) + 1.0).abs() < 1e-3);
}

#[test]
fn the_last_position_is_predicted_until_something_is_learned() {
    let mut predictor = predictor(3, 0.9, 1e-6, &[1.0, 2.0]);
    assert_eq!(predictor.predict(), [1.0, 2.0]);
    // Three displacements are known after the third correction, four after the fourth.
    for frame in 1..=3 {
        let positions = [1.0 + frame as f32, 2.0];
        predictor.correct(&positions);
        assert_eq!(predictor.weights(), [0.0; 3]);
        assert_eq!(predictor.predict(), positions);
    }
    predictor.correct(&[5.0, 2.0]);
    assert!((predictor.predict()[0] - 6.0).abs() < 1e-4);
    assert_eq!(predictor.predict()[1], 2.0);
}

#[test]
fn nothing_is_learned_from_rest_or_from_no_components() {
    for initial in [&[][..], &[3.0, 4.0]] {
        let mut predictor = predictor(3, 0.9, 0.0, initial);
        for _ in 0..10 {
            assert_eq!(predictor.predict(), initial);
            predictor.correct(initial);
        }
        assert_eq!(predictor.weights(), [0.0; 3]);
    }
}

#[test]
fn the_prediction_stands_for_a_missing_observation() {
    let seen = |frame: usize| [0.5 * frame as f32, 8.0 - 0.25 * frame as f32];
    let mut predictor = predictor(2, 0.9, 0.0, &seen(0));
    for frame in 1..10 {
        predictor.predict();
        predictor.correct(&seen(frame));
    }
    predictor.predict();
    predictor.correct(&[f32::NAN, seen(10)[1]]);
    assert_eq!(predictor.predict(), seen(11));
    predictor.correct(&[seen(11)[0], f32::INFINITY]);
    assert_eq!(predictor.predict(), seen(12));
    assert_eq!(predictor.weights(), [1.0, 0.0]);
}

#[test]
fn a_step_that_overflows_starts_its_component_anew() {
    let mut predictor = predictor(1, 0.9, 0.0, &[0.0, -3e38]);
    for frame in 1..5 {
        predictor.correct(&[frame as f32, -3e38]);
    }
    predictor.correct(&[5.0, 3e38]);
    assert_eq!(predictor.known, [2, 0]);
    assert_eq!(predictor.predict(), [6.0, 3e38]);
}

#[test]
fn carried_over_components_keep_their_history() {
    let initial: Vec<f32> = (0..7).map(|i| i as f32).collect();
    let at = |i: usize, frame: usize| i as f32 + ((i + 1) * frame) as f32 * 0.125;
    let mut kept = predictor(3, 0.9, 0.0, &initial);
    for frame in 1..8 {
        let seen: Vec<f32> = (0..7).map(|i| at(i, frame)).collect();
        kept.predict();
        kept.correct(&seen);
    }
    let mut moved = kept.clone();
    let before = kept.predict().to_vec();
    moved.predict();
    let sources = [6, NEW_COMPONENT, 2, 0, 6];
    moved.carry_over(&sources, &[70.0; 5]);
    assert_eq!(moved.len(), 5);
    assert_eq!(
        moved.predictions(),
        [before[6], 70.0, before[2], before[0], before[6]]
    );
    moved.correct(&[at(6, 8), 70.5, at(2, 8), at(0, 8), at(6, 8)]);
    // All weight is on the newest lag, and a new component has one displacement by now.
    let expected = [at(6, 9), 71.0, at(2, 9), at(0, 9), at(6, 9)];
    assert_eq!(moved.predict(), expected);
    assert_eq!(moved.known, [4, 1, 4, 4, 4]);
}

#[test]
#[should_panic(expected = "source 2 of component 0 is not below 2")]
fn a_source_out_of_range_panics() {
    predictor(3, 0.9, 0.0, &[0.0; 2]).carry_over(&[2], &[0.0]);
}

#[test]
#[should_panic(expected = "number of observations (left) and of components (right) differ")]
fn a_wrong_number_of_observations_panics() {
    predictor(3, 0.9, 0.0, &[0.0; 2]).correct(&[0.0; 3]);
}

#[test]
fn parameters_out_of_bounds_are_refused_by_name() {
    let with = |change: fn(&mut WienerParameters)| {
        let mut parameters = WienerParameters::default();
        change(&mut parameters);
        WienerPredictor::new(parameters, 1).unwrap_err().to_string()
    };
    assert!(with(|p| p.order = 0).ends_with("expected 1 to 8"));
    assert!(with(|p| p.order = 9).starts_with("order of the Wiener predictor is 9"));
    assert!(with(|p| p.forgetting = f32::NAN).starts_with("forgetting "));
    assert!(with(|p| p.forgetting = 1.5).ends_with("expected 0 to 1"));
    assert!(with(|p| p.noise = -0.5).starts_with("noise "));
}

proptest! {
    /// Motions from the tiny to the overflowing, with gaps, from any parameters.
    #[test]
    fn predictions_are_finite(
        order in 1..=MAX_ORDER,
        forgetting in 0.0f32..=1.0,
        noise in prop_oneof![Just(0.0f32), 0.0f32..=1.0],
        frames in prop::collection::vec(
            prop::array::uniform5(prop_oneof![
                4 => -10.0f32..10.0,
                2 => -3.4e38f32..3.4e38,
                2 => -1e-38f32..1e-38,
                1 => Just(0.0f32),
                1 => prop_oneof![Just(f32::NAN), Just(f32::INFINITY)],
            ]),
            1..40,
        ),
    ) {
        let mut predictor = predictor(order, forgetting, noise, &[0.0; 5]);
        for seen in frames {
            prop_assert!(predictor.predict().iter().all(|p| p.is_finite()));
            predictor.carry_over(&[1, 2, 3, NEW_COMPONENT, 0], &[0.5; 5]);
            predictor.correct(&seen);
            prop_assert!(predictor.weights().iter().all(|w| w.is_finite()));
        }
    }

    /// A = G Gᵀ, of full rank or less: what is solved for satisfies the equations whenever
    /// the right side lies in the range of A.
    #[test]
    fn semidefinite_systems_are_solved(
        n in 1..=MAX_ORDER,
        rank in 1..=MAX_ORDER,
        entries in prop::array::uniform8(prop::array::uniform8(-8i32..=8)),
        x in prop::array::uniform8(-4i32..=4),
    ) {
        let mut a = [[0.0; MAX_ORDER]; MAX_ORDER];
        for i in 0..n {
            for j in 0..n {
                let terms = (0..rank).map(|k| entries[i][k] * entries[j][k]);
                a[i][j] = f64::from(terms.sum::<i32>());
            }
        }
        let times = |x: &[f64; MAX_ORDER]| -> [f64; MAX_ORDER] {
            std::array::from_fn(|i| (0..n).map(|j| a[i][j] * x[j]).sum())
        };
        let b = times(&x.map(f64::from));
        let solved = times(&solve_semidefinite(&a, &b, n));
        let scale = b.iter().fold(1.0f64, |scale, v| scale.max(v.abs()));
        for i in 0..n {
            prop_assert!((solved[i] - b[i]).abs() <= 1e-4 * scale, "{solved:?} {b:?}");
        }
    }

    /// Whole numbers, of which every sum is exact: the same in any order.
    #[test]
    fn dot_products_take_every_element_once(
        pairs in prop::collection::vec((-1000i16..1000, -1000i16..1000), 0..40),
    ) {
        let (a, b): (Vec<f32>, Vec<f32>) =
            pairs.iter().map(|&(a, b)| (f32::from(a), f32::from(b))).unzip();
        let expected: i64 = pairs.iter().map(|&(a, b)| i64::from(a) * i64::from(b)).sum();
        prop_assert_eq!(dot(&a, &b), expected as f64);
    }
}
