//! How the elephant moves: the walk, leg by leg, and what the rest of the body
//! makes of it.

use glam::DVec3;

use crate::builtin::curve::{cos, cycle};
use crate::builtin::foot_path::FootPath;
use crate::builtin::limb::{Limb, LimbGoal, LimbKind};
use crate::builtin::skeleton::{Pose, pitch, roll, yaw};

/// Bones of the trunk.
const TRUNK_BONES: u32 = 9;

/// The walk. All phases are in strides after the left hind touches down.
pub(super) fn pose(pose: &mut Pose<'_>, stride: f64) {
    move_body(pose, stride);
    move_head(pose, stride);
    for (side, sign, touchdown) in [("l", -1.0, 0.0), ("r", 1.0, 0.5)] {
        move_hind_leg(pose, side, sign, stride - touchdown);
    }
    for (side, sign, touchdown) in [("l", -1.0, 0.22), ("r", 1.0, 0.72)] {
        move_foreleg(pose, side, sign, stride - touchdown);
    }
}

/// The body bobs twice a stride. Once a stride it leans over the legs that
/// stand (the right feet swing about 0.35 behind and 0.57 in front), drops the
/// side that swings, and turns with the foot that reaches forward.
fn move_body(pose: &mut Pose<'_>, stride: f64) {
    let bob = 0.022 * cos(2.0 * stride - 0.7);
    let sway = -0.045 * cos(stride - 0.46);
    pose.turn(
        "chest",
        roll(1.6 * cos(stride - 0.52))
            * yaw(1.5 * cos(stride - 0.72))
            * pitch(0.8 * cos(2.0 * stride)),
        DVec3::new(0.0, bob - 0.03, sway),
    );
    pose.turn(
        "pelvis",
        roll(1.8 * cos(stride - 0.25)) * yaw(2.5 * cos(stride - 0.42)),
        DVec3::ZERO,
    );
    for bone in 0..4 {
        let late = 0.1 * f64::from(bone);
        let swing = cos(stride - 0.2 - late);
        pose.turn(
            &format!("tail{bone}"),
            roll(9.0 * swing) * pitch(-4.0),
            DVec3::ZERO,
        );
    }
}

/// The head nods twice a stride; the trunk swings like a rope, and the ears
/// fan once a stride, rippling towards their edges.
fn move_head(pose: &mut Pose<'_>, stride: f64) {
    let nod = cos(2.0 * stride - 0.35);
    pose.turn(
        "neck",
        pitch(2.0 * nod) * yaw(2.0 * cos(stride - 0.4)),
        DVec3::ZERO,
    );
    pose.turn(
        "head",
        pitch(2.5 * nod - 1.0) * yaw(2.0 * cos(stride - 0.45)),
        DVec3::ZERO,
    );
    for bone in 0..TRUNK_BONES {
        let late = 0.045 * f64::from(bone);
        let sway = 4.5 * cos(stride - 0.5 - late);
        let swing = 3.2 * cos(2.0 * stride - 0.2 - 1.4 * late);
        let curl = 4.0 * cos(stride - 0.1) * (f64::from(bone) / 8.0);
        pose.turn(
            &format!("trunk{bone}"),
            roll(sway) * pitch(swing + curl),
            DVec3::ZERO,
        );
    }
    for (side, sign) in [("r", 1.0), ("l", -1.0)] {
        for (bone, amplitude, late) in [
            ("ear", 17.0, 0.0),
            ("ear_middle", 9.0, 0.10),
            ("ear_edge", 9.0, 0.18),
        ] {
            let flap = amplitude * cos(2.0 * stride - late) - 2.0;
            pose.turn(&format!("{bone}.{side}"), yaw(sign * flap), DVec3::ZERO);
        }
    }
}

fn move_hind_leg(pose: &mut Pose<'_>, side: &str, sign: f64, phase: f64) {
    const PATH: FootPath = FootPath {
        duty: 0.70,
        touchdown: 0.55,
        liftoff: -0.55,
        lift: 0.10,
    };
    const HEEL_LIFT: [(f64, f64); 6] = [
        (0.0, 0.0),
        (0.50, 0.0),
        (0.70, 24.0),
        (0.81, 46.0),
        (0.92, 8.0),
        (0.97, 0.0),
    ];
    const FOLD: [(f64, f64); 5] = [
        (0.0, 0.0),
        (0.5, 0.0),
        (0.70, 6.0),
        (0.82, 14.0),
        (0.95, 0.0),
    ];
    let limb = Limb::new(
        pose.skeleton(),
        LimbKind::Strut,
        ["femur.", "tibia.", "metatarsus.", "hind_foot."],
        side,
    );
    let goal = LimbGoal {
        toe: DVec3::new(-0.66, 0.0, 0.36 * sign) + PATH.at(phase),
        heel_lift: cycle(&HEEL_LIFT, phase),
        fold: cycle(&FOLD, phase),
    };
    limb.reach(pose, goal);
}

fn move_foreleg(pose: &mut Pose<'_>, side: &str, sign: f64, phase: f64) {
    const PATH: FootPath = FootPath {
        duty: 0.70,
        touchdown: 0.52,
        liftoff: -0.58,
        lift: 0.17,
    };
    const HEEL_LIFT: [(f64, f64); 6] = [
        (0.0, 0.0),
        (0.50, 0.0),
        (0.70, 26.0),
        (0.79, 66.0),
        (0.92, 8.0),
        (0.97, 0.0),
    ];
    const FOLD: [(f64, f64); 6] = [
        (0.0, 0.0),
        (0.5, 0.0),
        (0.68, 6.0),
        (0.80, 40.0),
        (0.90, 12.0),
        (0.96, 0.0),
    ];
    let path = PATH.at(phase);
    pose.turn(
        &format!("scapula.{side}"),
        pitch(10.0 * path.x),
        DVec3::ZERO,
    );
    let limb = Limb::new(
        pose.skeleton(),
        LimbKind::Strut,
        ["humerus.", "radius.", "metacarpus.", "fore_foot."],
        side,
    );
    let goal = LimbGoal {
        toe: DVec3::new(1.165, 0.0, 0.39 * sign) + path,
        heel_lift: cycle(&HEEL_LIFT, phase),
        fold: cycle(&FOLD, phase),
    };
    limb.reach(pose, goal);
}
