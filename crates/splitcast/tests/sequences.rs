//! What is carried from frame to frame by builders that track.

mod suite;

use splitcast::filter::NoiseParameters;
use splitcast::{
    BuildError, BuildOptions, BuildStage, Builder, InitialState, KdTree, Mesh, Outcome,
    SequenceBuilder,
};
use suite::meshes;

/// A sheet away from the origin, in motion with `phase`.
fn sheet(n: u32, phase: f32) -> (Vec<[f32; 3]>, Vec<[u32; 3]>) {
    let sheet = meshes::sheet(n, phase).moved([0.0, 0.0, 2.0]);
    (sheet.positions, sheet.triangles)
}

fn options(builder: Builder) -> BuildOptions {
    BuildOptions {
        builder,
        ..BuildOptions::default()
    }
}

#[test]
fn stages_follow_each_other() {
    let (positions, triangles) = sheet(40, 0.0);
    let mesh = Mesh::new(&positions, &triangles).unwrap();
    let mut sequence = SequenceBuilder::new(&options(Builder::Kalman)).unwrap();
    sequence.build(mesh).unwrap();
    let initial = sequence.report();
    assert_eq!(initial.stage, BuildStage::Initial);
    assert!(initial.splits.iter().all(|split| split.predicted.is_none()));
    sequence.build(mesh).unwrap();
    let running = sequence.report();
    assert_eq!(running.stage, BuildStage::Running);
    assert!(running.splits[0].predicted.is_some());
    sequence.reset();
    sequence.build(mesh).unwrap();
    assert_eq!(sequence.report().splits, initial.splits);
}

#[test]
fn an_initial_build_is_a_normal_one() {
    let (positions, triangles) = sheet(50, 0.0);
    let mesh = Mesh::new(&positions, &triangles).unwrap();
    let search = KdTree::build(mesh, &options(Builder::Search)).unwrap();
    for builder in [Builder::Kalman, Builder::Wiener] {
        let tree = SequenceBuilder::new(&options(builder))
            .unwrap()
            .build(mesh)
            .unwrap();
        assert_eq!(tree.nodes(), search.nodes());
    }
}

#[test]
fn a_still_scene_is_hardly_searched() {
    let (positions, triangles) = sheet(60, 0.0);
    let mesh = Mesh::new(&positions, &triangles).unwrap();
    for builder in [Builder::Kalman, Builder::Wiener] {
        let mut options = options(builder);
        options.tracking.noise.measurement = 0.0;
        let mut sequence = SequenceBuilder::new(&options).unwrap();
        let first = sequence.build(mesh).unwrap();
        let initial = sequence.report();
        for _ in 0..5 {
            let tree = sequence.build(mesh).unwrap();
            let running = sequence.report();
            let kept = [Outcome::Matched, Outcome::EmptySpace];
            let splits = running.splits.iter();
            let lost = splits
                .filter(|split| !kept.contains(&split.outcome))
                .count();
            // A plane may still be improved, which changes what its children hold.
            assert!(20 * lost < running.splits.len(), "{builder}: {lost} lost");
            let (now, before) = (running.evaluations, initial.evaluations);
            assert!(5 * now < before, "{builder}: {now} of {before}");
            let ratio = tree.stats().sah_cost / first.stats().sah_cost;
            assert!(ratio < 1.01, "{builder}: {ratio}");
        }
    }
}

#[test]
fn predictions_lie_near_a_slow_motion() {
    let mut sequence = SequenceBuilder::new(&options(Builder::Kalman)).unwrap();
    for frame in 0..6 {
        let (positions, triangles) = sheet(40, 0.002 * frame as f32);
        sequence
            .build(Mesh::new(&positions, &triangles).unwrap())
            .unwrap();
    }
    let report = sequence.report();
    let tracked: Vec<_> = (report.splits.iter())
        .filter(|split| split.outcome == Outcome::Matched)
        .collect();
    assert!(2 * tracked.len() > report.splits.len());
    for split in tracked.iter().filter(|split| split.depth < 4) {
        let error = (split.predicted.unwrap() - split.position).abs();
        assert!(error < 0.2 * split.extent, "{split:?}");
    }
}

/// What was one leaf, since no plane divided it, has to be split when it comes apart.
#[test]
fn a_heap_that_comes_apart_is_split_again() {
    let (positions, triangles) = sheet(40, 0.0);
    let scaled = |scale: f32| -> Vec<[f32; 3]> {
        let toward = |p: &[f32; 3]| p.map(|x| 0.5 + scale * (x - 0.5));
        positions.iter().map(toward).collect()
    };
    for builder in [Builder::Kalman, Builder::Wiener] {
        let mut sequence = SequenceBuilder::new(&options(builder)).unwrap();
        for scale in [1.0, 1.0, 0.0, 0.0, 1.0, 1.0, 1e-6, 0.01, 0.1, 0.5, 1.0] {
            let positions = scaled(scale);
            let mesh = Mesh::new(&positions, &triangles).unwrap();
            let tree = sequence.build(mesh).unwrap();
            let normal = KdTree::build(mesh, &options(Builder::Search)).unwrap();
            let (cost, normal) = (tree.stats().sah_cost, normal.stats().sah_cost);
            assert!(
                cost <= 1.15 * normal,
                "{builder}, {scale}: {cost}, {normal}"
            );
        }
    }
}

/// A cluster that grows from a point beside a sheet at rest.
#[test]
fn what_grows_is_split_as_it_grows() {
    let (mut positions, mut triangles) = sheet(30, 0.0);
    let (cluster, more) = sheet(30, 0.3);
    let first = positions.len() as u32;
    triangles.extend(
        more.iter()
            .map(|corners| corners.map(|corner| corner + first)),
    );
    let mut sequence = SequenceBuilder::new(&options(Builder::Kalman)).unwrap();
    for frame in 0..12 {
        positions.truncate(first as usize);
        let scale = 0.1 * frame as f32;
        positions.extend(cluster.iter().map(|p| p.map(|x| 1.5 + scale * (x - 0.5))));
        let mesh = Mesh::new(&positions, &triangles).unwrap();
        let tree = sequence.build(mesh).unwrap();
        let normal = KdTree::build(mesh, &options(Builder::Search)).unwrap();
        let (cost, normal) = (tree.stats().sah_cost, normal.stats().sah_cost);
        assert!(cost <= 1.15 * normal, "frame {frame}: {cost}, {normal}");
    }
}

/// Algorithm 1 by hand, for the root's split, beside what the builder does.
#[test]
fn predictions_follow_the_filters_equations() {
    let mut options = options(Builder::Kalman);
    options.tracking.noise.process = 0.5;
    options.tracking.noise.measurement = 0.01;
    let mut sequence = SequenceBuilder::new(&options).unwrap();
    let (mut x, mut p, mut model) = (0.0, 0.0, None);
    let mut followed = 0;
    for frame in 0..8 {
        let (mut positions, triangles) = sheet(40, 0.0);
        for position in &mut positions {
            position[0] += 0.01 * frame as f32;
        }
        let mesh = Mesh::new(&positions, &triangles).unwrap();
        sequence.build(mesh).unwrap();
        let report = sequence.report();
        let root = report.splits[0];
        let model = *model.get_or_insert_with(|| {
            let initial: Vec<f32> = report.splits.iter().map(|split| split.position).collect();
            options.tracking.noise.kalman_model(&initial).unwrap()
        });
        if frame == 0 || !matches!(root.outcome, Outcome::Matched | Outcome::Drifted) {
            (x, p) = (f64::from(root.position), 0.0);
        } else {
            let predicted = f64::from(root.predicted.unwrap());
            assert!(
                (predicted - x).abs() < 1e-5,
                "frame {frame}: {predicted}, not {x}"
            );
            followed += 1;
        }
        let z = f64::from(root.observed.unwrap());
        assert!((z / f64::from(root.position) - 1.0).abs() < 0.06);
        let prior = p + f64::from(model.process_noise);
        let gain = prior / (prior + f64::from(model.measurement_noise));
        x += gain * (z - x);
        p = (1.0 - gain) * prior;
    }
    assert!(followed > 4, "{followed}");
}

#[test]
fn any_number_of_threads_gives_the_same_trees() {
    for builder in [Builder::Search, Builder::Kalman, Builder::Wiener] {
        let run = |threads| {
            let pool = rayon::ThreadPoolBuilder::new()
                .num_threads(threads)
                .build()
                .unwrap();
            let mut sequence = SequenceBuilder::new(&options(builder)).unwrap();
            let mut trees = Vec::new();
            for frame in 0..4 {
                let (positions, triangles) = sheet(80, 0.01 * frame as f32);
                let mesh = Mesh::new(&positions, &triangles).unwrap();
                let tree = pool.install(|| sequence.build(mesh).unwrap());
                trees.push((tree.nodes().to_vec(), tree.references().to_vec()));
            }
            (trees, sequence.report().splits)
        };
        assert_eq!(run(1), run(3), "{builder}");
    }
}

#[test]
fn an_error_leaves_the_sequence_as_it_was() {
    let (mut positions, triangles) = sheet(20, 0.0);
    let mut sequence = SequenceBuilder::new(&options(Builder::Kalman)).unwrap();
    sequence
        .build(Mesh::new(&positions, &triangles).unwrap())
        .unwrap();
    let mut other = sequence.clone();
    let good = positions[5];
    positions[5][1] = f32::NAN;
    let failed = sequence.build(Mesh::new(&positions, &triangles).unwrap());
    assert!(matches!(failed, Err(BuildError::NonFinite { .. })));
    positions[5] = good;
    let mesh = Mesh::new(&positions, &triangles).unwrap();
    let (tree, expected) = (sequence.build(mesh).unwrap(), other.build(mesh).unwrap());
    assert_eq!(tree.nodes(), expected.nodes());
    assert_eq!(sequence.report().splits, other.report().splits);
}

#[test]
fn frames_may_be_empty_and_change_in_size() {
    for builder in Builder::ALL {
        let mut sequence = SequenceBuilder::new(&options(*builder)).unwrap();
        for n in [0, 30, 1, 12, 0, 40, 3] {
            let (positions, triangles) = sheet(n, 0.1);
            let tree = sequence
                .build(Mesh::new(&positions, &triangles).unwrap())
                .unwrap();
            assert!(tree.validate().is_ok(), "{builder} with {n}");
        }
    }
}

#[test]
fn noise_out_of_bounds_is_refused() {
    let mut options = options(Builder::Kalman);
    options.tracking.noise = NoiseParameters {
        measurement: f32::NAN,
        ..NoiseParameters::default()
    };
    let error = SequenceBuilder::new(&options).unwrap_err();
    assert!(
        error
            .to_string()
            .contains("tracking.noise.measurement is NaN"),
        "{error}"
    );
}

#[test]
fn a_state_from_zero_moves_toward_the_planes() {
    let (positions, triangles) = sheet(40, 0.0);
    let mesh = Mesh::new(&positions, &triangles).unwrap();
    let mut options = options(Builder::Kalman);
    options.tracking.initial_state = InitialState::Zero;
    options.tracking.noise.process = 0.0;
    options.tracking.noise.measurement = 0.0;
    let mut sequence = SequenceBuilder::new(&options).unwrap();
    sequence.build(mesh).unwrap();
    let first = sequence.report().splits[0];
    sequence.build(mesh).unwrap();
    let split = sequence.report().splits[0];
    let share = split.predicted.unwrap() / first.position;
    // P⁻ = Q, so K = Q / (Q + R), and without noise Q = R.
    assert!((share - 0.5).abs() < 0.05, "{split:?}");
}
