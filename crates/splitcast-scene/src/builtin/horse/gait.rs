//! How the horse moves: the gallop, leg by leg, and what the rest of the body
//! makes of it.

use glam::DVec3;

use crate::builtin::curve::{cos, cycle};
use crate::builtin::foot_path::FootPath;
use crate::builtin::limb::{Limb, LimbGoal, LimbKind};
use crate::builtin::skeleton::{Pose, pitch, yaw};

/// Strides in the whole cycle; tail and head need both to come round.
const STRIDES: f64 = 2.0;

/// The gallop. All phases are in strides after the trailing hind touches down.
pub(super) fn pose(pose: &mut Pose<'_>, cycle_phase: f64) {
    let stride = cycle_phase * STRIDES;
    move_trunk(pose, stride);
    move_neck_and_head(pose, stride, cycle_phase);
    move_tail(pose, stride, cycle_phase);
    for (side, sign, touchdown) in [("l", -1.0, 0.0), ("r", 1.0, 0.13)] {
        move_hind_leg(pose, side, sign, stride - touchdown);
    }
    for (side, sign, touchdown) in [("l", -1.0, 0.33), ("r", 1.0, 0.49)] {
        move_foreleg(pose, side, sign, stride - touchdown);
    }
}

/// Up and down, pitch, and the back that rounds as the hind legs come
/// forward and stretches as they push.
fn move_trunk(pose: &mut Pose<'_>, stride: f64) {
    let bob = 0.035 * cos(stride - 0.90);
    let nose_up = 4.5 * cos(stride - 0.10);
    let rounding = 2.5 + 8.0 * cos(stride - 0.93);
    pose.turn("chest", pitch(nose_up), DVec3::new(0.0, bob - 0.01, 0.0));
    // Behind the joint, a positive pitch lowers.
    pose.turn("loin", pitch(0.45 * rounding), DVec3::ZERO);
    pose.turn("pelvis", pitch(0.75 * rounding), DVec3::ZERO);
}

fn move_neck_and_head(pose: &mut Pose<'_>, stride: f64, cycle_phase: f64) {
    let nod = 5.0 * cos(stride - 0.15);
    let look = 1.5 * cos(cycle_phase - 0.2);
    pose.turn("neck0", pitch(nod - 4.0) * yaw(look), DVec3::ZERO);
    pose.turn("neck1", pitch(0.6 * nod - 2.0) * yaw(look), DVec3::ZERO);
    pose.turn("neck2", pitch(0.4 * nod) * yaw(look), DVec3::ZERO);
    pose.turn("head", pitch(10.0 - 1.2 * nod), DVec3::ZERO);
}

/// A wave that runs down the tail once a stride, and a slow sway.
fn move_tail(pose: &mut Pose<'_>, stride: f64, cycle_phase: f64) {
    for bone in 0..5 {
        let late = 0.11 * f64::from(bone);
        let wave = -3.0 + 9.0 * cos(stride - 0.05 - late);
        let sway = 7.0 * cos(cycle_phase - 0.5 * late);
        pose.turn(&format!("tail{bone}"), pitch(wave) * yaw(sway), DVec3::ZERO);
    }
}

fn move_hind_leg(pose: &mut Pose<'_>, side: &str, sign: f64, phase: f64) {
    const PATH: FootPath = FootPath {
        duty: 0.245,
        touchdown: 0.52,
        liftoff: -0.53,
        lift: 0.36,
    };
    const HEEL_LIFT: [(f64, f64); 7] = [
        (0.0, 0.0),
        (0.12, 0.0),
        (0.245, 38.0),
        (0.38, 85.0),
        (0.58, 60.0),
        (0.80, 12.0),
        (0.93, -4.0),
    ];
    const FOLD: [(f64, f64); 6] = [
        (0.0, 0.0),
        (0.12, 6.0),
        (0.25, -8.0),
        (0.45, 18.0),
        (0.65, 22.0),
        (0.88, 0.0),
    ];
    let limb = Limb::new(
        pose.skeleton(),
        LimbKind::Pantograph,
        ["femur.", "tibia.", "metatarsus.", "hind_hoof."],
        side,
    );
    let toe = DVec3::new(-0.51, 0.0, 0.12 * sign) + PATH.at(phase);
    let goal = LimbGoal {
        toe,
        heel_lift: cycle(&HEEL_LIFT, phase),
        fold: cycle(&FOLD, phase),
    };
    limb.reach(pose, goal);
}

fn move_foreleg(pose: &mut Pose<'_>, side: &str, sign: f64, phase: f64) {
    const PATH: FootPath = FootPath {
        duty: 0.215,
        touchdown: 0.50,
        liftoff: -0.42,
        lift: 0.42,
    };
    const HEEL_LIFT: [(f64, f64); 7] = [
        (0.0, 0.0),
        (0.11, 0.0),
        (0.215, 40.0),
        (0.35, 105.0),
        (0.55, 100.0),
        (0.78, 18.0),
        (0.93, -4.0),
    ];
    const FOLD: [(f64, f64); 7] = [
        (0.0, 0.0),
        (0.10, -2.0),
        (0.215, 6.0),
        (0.38, 75.0),
        (0.55, 90.0),
        (0.74, 30.0),
        (0.90, 2.0),
    ];
    let path = PATH.at(phase);
    // The shoulder blade glides along the ribs with the leg.
    let swing = path.x.clamp(-0.5, 0.6);
    pose.turn(&format!("scapula.{side}"), pitch(18.0 * swing), DVec3::ZERO);
    let limb = Limb::new(
        pose.skeleton(),
        LimbKind::Strut,
        ["humerus.", "radius.", "metacarpus.", "fore_hoof."],
        side,
    );
    let goal = LimbGoal {
        toe: DVec3::new(0.62, 0.0, 0.11 * sign) + path,
        heel_lift: cycle(&HEEL_LIFT, phase),
        fold: cycle(&FOLD, phase),
    };
    limb.reach(pose, goal);
}
