//! Trees that follow a mesh through changes of every kind: right, no worse than new ones, and
//! kept where nothing has changed.

mod suite;

use std::sync::mpsc;
use std::time::Duration;

use proptest::prelude::*;
use splitcast::{
    BuildError, BuildOptions, Builder, KdTree, Mesh, NonFinite, Tracker, Update, UpdateReport,
};
use suite::edits::{Edit, Part, moved_ranges, muddled};
use suite::meshes::{Rng, Soup, bumpy_sphere, sheet};
use suite::{Expectations, cases, check_whole, option_sets};

/// More than any update here takes.
const AMPLE: Duration = Duration::from_secs(1000);

fn mesh(soup: &Soup) -> Mesh<'_> {
    Mesh::new(&soup.positions, &soup.triangles).expect("generated meshes are sound")
}

fn tracker() -> Tracker {
    Tracker::new(&BuildOptions::default()).expect("the defaults are within bounds")
}

/// A new tree of the kind that trackers make.
fn fresh(soup: &Soup) -> KdTree<'_> {
    let options = BuildOptions {
        builder: Builder::Tracked,
        ..BuildOptions::default()
    };
    KdTree::build(mesh(soup), &options).expect("finite vertices")
}

/// Expected cost of a ray through all of space: to compare trees whose boxes differ.
fn unscaled_cost(tree: &KdTree<'_>) -> f64 {
    tree.stats().traced_cost * f64::from(tree.bounds().half_area())
}

/// A run of triangles somewhere in the mesh.
fn part(start: f32, share: f32) -> Part {
    Part { start, share }
}

/// Panics if the tree is not whole, or its report does not describe it.
fn check(what: &str, update: &Update<'_>, options: &BuildOptions) {
    let Update { tree, report } = update;
    check_whole(what, tree, options);
    let parts = [report.kept, report.moved, report.searched, report.rebuilt];
    let nodes: usize = parts.iter().map(|part| part.nodes).sum();
    assert_eq!(nodes, tree.nodes().len(), "{what}: {report:?}");
    let references: usize = parts.iter().map(|part| part.references).sum();
    assert_eq!(references, tree.references().len(), "{what}: {report:?}");
    let cost = tree.stats().traced_cost;
    assert!(
        (report.sah_cost - cost).abs() <= 1e-4 * cost,
        "{what}: {} reported, {cost} found",
        report.sah_cost
    );
    assert!(report.sah_ratio.is_finite(), "{what}: {report:?}");
    assert!(report.late <= references, "{what}: {report:?}");
}

/// [`check`], and that queries give what brute force gives.
fn check_hits(what: &str, update: &Update<'_>, options: &BuildOptions, rays: usize) {
    check(what, update, options);
    Expectations::of_rays(update.tree.mesh(), rays).check(&update.tree, what);
}

/// A report without what depends on the clock.
fn timeless(report: &UpdateReport) -> UpdateReport {
    UpdateReport {
        time: Duration::ZERO,
        ..report.clone()
    }
}

fn assert_same(what: &str, a: &Update<'_>, b: &Update<'_>) {
    assert_eq!(a.tree.bounds(), b.tree.bounds(), "{what}");
    assert!(a.tree.nodes() == b.tree.nodes(), "{what}");
    assert!(a.tree.references() == b.tree.references(), "{what}");
    assert_eq!(timeless(&a.report), timeless(&b.report), "{what}");
}

/// One way to ask for the next tree.
#[derive(Clone, Copy, Debug)]
enum Call {
    Update,
    Dirty,
    /// With ranges that say the same in a muddle.
    Muddled,
    Within(Duration),
}

impl Call {
    fn make<'m>(
        self,
        tracker: &mut Tracker,
        before: &Soup,
        after: &'m Soup,
        rng: &mut Rng,
    ) -> Update<'m> {
        let count = after.triangles.len();
        // With another number of triangles, all count as moved whatever the ranges.
        let moved = if before.triangles.len() == count {
            moved_ranges(before, after)
        } else {
            Vec::new()
        };
        let update = match self {
            Self::Update => tracker.update(mesh(after)),
            Self::Dirty => tracker.update_dirty(mesh(after), &moved),
            Self::Muddled => tracker.update_dirty(mesh(after), &muddled(&moved, count, rng)),
            Self::Within(budget) => tracker.update_within(mesh(after), budget),
        };
        update.expect("finite vertices")
    }
}

fn call() -> impl Strategy<Value = Call> {
    prop_oneof![
        4 => Just(Call::Update),
        2 => Just(Call::Dirty),
        2 => Just(Call::Muddled),
        3 => prop::sample::select(vec![
            Call::Within(Duration::ZERO),
            Call::Within(Duration::from_micros(300)),
            Call::Within(AMPLE),
        ]),
    ]
}

/// Mostly a small part of the mesh.
fn any_part() -> impl Strategy<Value = Part> {
    let share = prop_oneof![
        3 => Just(0.0_f32),
        4 => 0.0_f32..0.03,
        3 => 0.0_f32..0.3,
        1 => 0.0_f32..1.0,
    ];
    (0.0_f32..1.0, share).prop_map(|(start, share)| Part { start, share })
}

/// Places in and about the meshes, some of them far off.
fn place() -> impl Strategy<Value = [f32; 3]> {
    let near = prop::array::uniform3(-1.2_f32..1.2);
    prop_oneof![
        4 => near.clone(),
        1 => Just([0.0; 3]),
        1 => near.prop_map(|p| p.map(|x| 50.0 * x)),
    ]
}

fn edit() -> impl Strategy<Value = Edit> {
    let size = || (-7.0_f32..1.0).prop_map(|exponent| 10.0_f32.powf(exponent));
    prop_oneof![
        2 => Just(Edit::Nothing),
        5 => (any_part(), size()).prop_map(|(part, size)| Edit::Shake(part, size)),
        3 => (any_part(), place()).prop_map(|(part, by)| Edit::Shift(part, by)),
        3 => (any_part(), 0.0_f32..0.3, place())
            .prop_map(|(part, scale, at)| Edit::Gather(part, scale, at)),
        2 => (any_part(), 0_usize..4).prop_map(|(part, axes)| Edit::Collapse(part, axes)),
        1 => (size(), place())
            .prop_map(|(scale, at)| Edit::Gather(Part::ALL, scale.max(0.01), at)),
        2 => (1_usize..600, size()).prop_map(|(count, size)| Edit::Append(count, size.min(1.0))),
        2 => (0.0_f32..0.4).prop_map(Edit::Truncate),
        1 => Just(Edit::Truncate(1.0)),
        2 => any_part().prop_map(Edit::Remove),
        2 => any_part().prop_map(Edit::Reorder),
        1 => prop::sample::select(vec![0, 3, 500, 5000]).prop_map(Edit::Replace),
    ]
}

fn check_sequence(mut soup: Soup, steps: &[(Edit, Call)], seed: u64, rays: usize) {
    let options = BuildOptions::default();
    let mut tracker = tracker();
    let mut rng = Rng(seed);
    for (frame, (edit, call)) in steps.iter().enumerate() {
        let before = soup.clone();
        edit.apply(&mut soup, &mut rng);
        let update = call.make(&mut tracker, &before, &soup, &mut rng);
        assert_eq!(update.report.frame, frame as u64);
        let what = format!("frame {frame}, {call:?} after {edit:?}");
        check_hits(&what, &update, &options, rays);
        let again = call.make(&mut tracker.clone(), &soup, &soup, &mut rng);
        check(&format!("{what}, once more"), &again, &options);
    }
}

fn config(cases: u32) -> ProptestConfig {
    ProptestConfig {
        cases,
        failure_persistence: None,
        max_shrink_iters: 100,
        ..ProptestConfig::default()
    }
}

proptest! {
    #![proptest_config(config(40))]

    /// Meshes whose upper levels are built over a sample.
    #[test]
    fn large_meshes_stay_right_whatever_happens(
        body in any::<bool>(),
        steps in prop::collection::vec((edit(), call()), 1..9),
        seed in any::<u64>(),
    ) {
        let soup = if body { bumpy_sphere(5, 0.0) } else { cases::soup(5000, 0.05, seed) };
        check_sequence(soup, &steps, seed, 30);
    }
}

proptest! {
    #![proptest_config(config(120))]

    #[test]
    fn small_meshes_stay_right_whatever_happens(
        count in prop_oneof![1 => 0_usize..10, 2 => 10_usize..1200],
        size in prop::sample::select(vec![0.02_f32, 0.1, 0.7]),
        steps in prop::collection::vec((edit(), call()), 1..12),
        seed in any::<u64>(),
    ) {
        check_sequence(cases::soup(count, size, seed), &steps, seed, 40);
    }
}

/// A sheet of 16,200 triangles, of which a small part moves with `phase`.
fn with_a_moving_part(phase: f32) -> Soup {
    let mut soup = sheet(90, 0.0);
    Edit::Shift(part(0.4, 0.01), [0.0, 0.02 * phase, 0.03 * phase]).apply(&mut soup, &mut Rng(1));
    soup
}

#[test]
fn a_still_scene_is_kept_whole() {
    let soup = bumpy_sphere(5, 0.0);
    let mut tracker = tracker();
    let first = tracker.update(mesh(&soup)).unwrap();
    for budget in [None, Some(Duration::ZERO), Some(AMPLE)] {
        let again = match budget {
            None => tracker.update(mesh(&soup)),
            Some(budget) => tracker.update_within(mesh(&soup), budget),
        };
        let again = again.unwrap();
        assert!(again.tree.nodes() == first.tree.nodes());
        assert_eq!(again.report.kept.references, first.tree.references().len());
    }
    let untouched = tracker.update_dirty(mesh(&soup), &[]).unwrap();
    assert_eq!(untouched.report.kept.nodes, first.tree.nodes().len());
}

#[test]
fn a_small_moving_part_leaves_most_of_the_tree() {
    let still = with_a_moving_part(0.0);
    let mut found = tracker();
    let mut told = tracker();
    found.update(mesh(&still)).unwrap();
    told.update(mesh(&still)).unwrap();
    let mut before = still;
    for frame in 1..12 {
        let soup = with_a_moving_part(frame as f32);
        let what = format!("frame {frame}");
        let update = found.update(mesh(&soup)).unwrap();
        check_hits(&what, &update, found.options(), 60);
        let all = update.tree.references().len();
        assert!(
            update.report.kept.references > all * 3 / 4,
            "{what}: {:?}",
            update.report
        );
        let dirty = moved_ranges(&before, &soup);
        let update = told.update_dirty(mesh(&soup), &dirty).unwrap();
        check_hits(&what, &update, told.options(), 60);
        assert!(
            update.report.kept.references > all * 4 / 5,
            "{what}: {:?}",
            update.report
        );
        let ratio = unscaled_cost(&update.tree) / unscaled_cost(&fresh(&soup));
        assert!(ratio < 1.3, "{what}: {ratio}");
        before = soup;
    }
}

#[test]
fn a_scene_in_full_motion_is_as_good_as_new() {
    let mut tracker = tracker();
    let (mut moved, mut redone) = (0, 0);
    for frame in 0..40 {
        let soup = bumpy_sphere(5, 0.02 * frame as f32);
        let update = tracker.update(mesh(&soup)).unwrap();
        check("full motion", &update, tracker.options());
        let report = &update.report;
        if frame > 0 {
            assert_eq!(report.kept.references, 0, "frame {frame}: {report:?}");
            moved += usize::from(report.moved.references > 0);
            redone += usize::from(report.searched.nodes + report.rebuilt.references > 0);
        }
        let ratio = unscaled_cost(&update.tree) / unscaled_cost(&fresh(&soup));
        assert!(ratio < 1.15, "frame {frame}: {ratio}");
    }
    assert!(moved > redone && redone > 0, "{moved} {redone}");
}

#[test]
fn cuts_and_explosions_are_followed() {
    let mut tracker = tracker();
    let mut rng = Rng(9);
    for frame in 0..6 {
        let soup = match frame {
            0 | 3 => bumpy_sphere(5, 0.0),
            1 => cases::soup(20_480, 0.05, 3),
            2 => cases::soup(20_480, 0.01, 4),
            4 => sheet(90, 0.0),
            _ => {
                let mut soup = sheet(90, 0.0);
                Edit::Shake(Part::ALL, 2.0).apply(&mut soup, &mut rng);
                soup
            }
        };
        let update = tracker.update(mesh(&soup)).unwrap();
        check_hits(&format!("frame {frame}"), &update, tracker.options(), 60);
        let ratio = unscaled_cost(&update.tree) / unscaled_cost(&fresh(&soup));
        assert!(ratio < 1.3, "frame {frame}: {ratio}");
    }
}

#[test]
fn updates_do_not_depend_on_the_number_of_threads() {
    let frames: Vec<Soup> = (0..6)
        .map(|frame| with_a_moving_part(frame as f32))
        .collect();
    let run = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
        pool.expect("a pool of a few threads").install(|| {
            let mut tracker = tracker();
            let updates = frames
                .iter()
                .map(|soup| tracker.update(mesh(soup)).unwrap());
            updates.collect::<Vec<_>>()
        })
    };
    let one = run(1);
    assert!(one[3].report.kept.references > 0 && one[3].report.moved.references > 0);
    for threads in [2, 3, 7] {
        for (a, b) in one.iter().zip(&run(threads)) {
            assert_same(&format!("{threads} threads"), a, b);
        }
    }
}

#[test]
fn a_refused_mesh_changes_nothing() {
    let frames: Vec<Soup> = (0..3)
        .map(|frame| with_a_moving_part(frame as f32))
        .collect();
    let mut bad = frames[1].clone();
    bad.positions[100][1] = f32::NAN;
    let mut disturbed = tracker();
    let mut calm = tracker();
    let kept = disturbed.update(mesh(&frames[0])).unwrap();
    calm.update(mesh(&frames[0])).unwrap();
    let error = disturbed.update(mesh(&bad)).unwrap_err();
    assert!(
        matches!(error, BuildError::NonFinite { vertex: 100, .. }),
        "{error}"
    );
    Expectations::of_rays(kept.tree.mesh(), 60).check(&kept.tree, "the last tree");
    for soup in &frames[1..] {
        let (a, b) = (
            disturbed.update(mesh(soup)).unwrap(),
            calm.update(mesh(soup)).unwrap(),
        );
        assert_same("after a refusal", &a, &b);
    }
    let options = BuildOptions {
        non_finite: NonFinite::Skip,
        ..BuildOptions::default()
    };
    let mut skipping = Tracker::new(&options).unwrap();
    for soup in [&frames[0], &bad, &bad, &frames[2], &frames[2]] {
        let update = skipping.update(mesh(soup)).unwrap();
        check_hits("skipping", &update, &options, 60);
        let unusable = soup.positions.iter().flatten().any(|x| x.is_nan());
        assert_eq!(update.tree.skipped_triangles() > 0, unusable);
    }
}

#[test]
fn what_there_is_no_time_for_is_made_up_for() {
    let still = with_a_moving_part(0.0);
    let count = still.triangles.len();
    let mut tracker = tracker();
    let hurried = tracker.update_within(mesh(&still), Duration::ZERO).unwrap();
    check_hits("no time", &hurried, tracker.options(), 100);
    assert_eq!(hurried.report.late, count);
    let soup = with_a_moving_part(1.0);
    let moved = tracker.update_within(mesh(&soup), Duration::ZERO).unwrap();
    check_hits("no time again", &moved, tracker.options(), 100);
    assert!(moved.report.late > count / 2, "{:?}", moved.report);
    let caught_up = tracker.update_within(mesh(&soup), AMPLE).unwrap();
    check_hits("time enough", &caught_up, tracker.options(), 100);
    assert_eq!(caught_up.report.late, 0);
    let ratio = unscaled_cost(&caught_up.tree) / unscaled_cost(&fresh(&soup));
    assert!(ratio < 1.1, "{ratio}");
    assert!(unscaled_cost(&hurried.tree) > unscaled_cost(&caught_up.tree));
}

#[test]
fn a_little_time_in_every_frame_is_enough() {
    let soup = with_a_moving_part(0.0);
    let mut tracker = tracker();
    tracker.update_within(mesh(&soup), Duration::ZERO).unwrap();
    let mut frames = 0;
    let tree = loop {
        let update = tracker
            .update_within(mesh(&soup), Duration::from_millis(3))
            .unwrap();
        frames += 1;
        if update.report.late == 0 {
            break update.tree;
        }
        assert!(frames < 2000, "{:?}", update.report);
    };
    check_whole("in the end", &tree, tracker.options());
    let ratio = unscaled_cost(&tree) / unscaled_cost(&fresh(&soup));
    assert!(ratio < 1.2, "{ratio}");
}

#[test]
fn the_last_tree_is_traced_while_the_next_is_made() {
    let frames: Vec<Soup> = (0..4)
        .map(|frame| with_a_moving_part(frame as f32))
        .collect();
    let mut tracker = tracker();
    std::thread::scope(|scope| {
        let (trees, received) = mpsc::channel::<KdTree<'_>>();
        scope.spawn(move || {
            for tree in received {
                Expectations::of_rays(tree.mesh(), 60).check(&tree, "on another thread");
            }
        });
        for soup in &frames {
            trees
                .send(tracker.update(mesh(soup)).unwrap().tree)
                .unwrap();
        }
    });
}

#[test]
fn long_runs_neither_rot_nor_grow() {
    let mut soup = sheet(70, 0.0);
    let mut tracker = tracker();
    let mut rng = Rng(5);
    let mut most = 0;
    for frame in 0..400 {
        let place = part(0.5 + 0.5 * rng.signed(), 0.02);
        Edit::Shake(place, 0.003).apply(&mut soup, &mut rng);
        let update = tracker.update(mesh(&soup)).unwrap();
        if frame == 0 {
            most = update.report.tracker_bytes;
        }
        if frame % 40 == 39 {
            check("a long run", &update, tracker.options());
            let ratio = unscaled_cost(&update.tree) / unscaled_cost(&fresh(&soup));
            assert!(ratio < 1.15, "frame {frame}: {ratio}");
            let bytes = update.report.tracker_bytes;
            assert!(bytes < 2 * most, "frame {frame}: {bytes}");
            assert!(
                bytes < update.tree.stats().bytes / 2,
                "frame {frame}: {bytes}"
            );
        }
    }
}

#[test]
fn every_option_holds_for_what_is_built_anew() {
    let frames: Vec<Soup> = (0..3)
        .map(|frame| {
            let mut soup = bumpy_sphere(4, 0.0);
            let by = [0.0, 0.0, 0.05 * frame as f32];
            Edit::Shift(part(0.2, 0.02), by).apply(&mut soup, &mut Rng(3));
            soup
        })
        .collect();
    let tracked = |options: &BuildOptions| options.builder == Builder::Tracked;
    for options in option_sets().into_iter().filter(tracked) {
        let mut tracker = Tracker::new(&options).unwrap();
        for soup in &frames {
            let update = tracker.update(mesh(soup)).unwrap();
            check_hits(&format!("{options:?}"), &update, &options, 40);
        }
    }
}
